// What `tendril follow` is asked to follow, made into a motion for a robot and the limits of its daemon.
// Knows files and the command line's words, nothing of a running daemon.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"
#include "tendril/motion/motion.h"

namespace tendril::motion {

struct MotionRequest {
  std::string kind;                      // a motion of MakeMotion, or via, line, arc, csv
  std::vector<std::string> tips;         // via, line, arc: "X,Y,Z" [m]
  std::vector<std::string> bends;        // via: "U,V,..." [rad], two a section
  std::string points;                    // via: a CSV of points; csv: one with times
  std::string centre, normal = "0,0,1";  // arc around a centre
  std::optional<double> angle_deg;       // the same; none: the arc goes through three points
  bool nearest = false;                  // out of reach: the nearest point that the robot reaches
  double stretch = 1;                    // csv: of its times
  // Along paths; 0: what follows from the daemon's file.
  double speed_radps = 0, acceleration_radps2 = 0, jerk_radps3 = 0;
};

/// Checked against what the tendons and drives can do. Points out of reach, where the nearest ones are taken,
/// are one line to `remark`. Throws UsageError for a request that makes no sense, std::runtime_error with
/// file, line or point for what this robot and these limits cannot do.
std::unique_ptr<Motion> MakeRequestedMotion(const MotionRequest& request, const RobotParameters& robot,
                                            const TrajectoryParameters& limits,
                                            const std::function<void(const std::string&)>& remark);

}  // namespace tendril::motion
