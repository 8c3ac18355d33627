// Planned motions as streams of moving targets: the paper's circle and planar bend, for any robot. Pure
// functions of time, used by the demo in simulated time and by `tendril follow` against a live daemon.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>

#include "tendril/core/cycle.h"
#include "tendril/core/robot.h"
#include "tendril/model/body.h"

namespace tendril::motion {

class Motion {
 public:
  virtual ~Motion() = default;
  const std::string& name() const { return name_; }
  /// Description in one line.
  const std::string& description() const { return description_; }
  double duration_s() const { return duration_s_; }
  /// Errors are evaluated from here to judged_until_s: the motion without its lead-in and lead-out.
  double judged_from_s() const { return judged_from_s_; }
  double judged_until_s() const { return judged_until_s_; }
  /// Target at time t of the motion, 0 <= t <= duration, as a command without its sequence and validity.
  virtual Command At(double t_s) const = 0;
  /// The motion's first target, at rest.
  Command Start() const;
  /// The target to send at time t (which may be negative) to a controller whose reference lags its goal by
  /// `ahead_s`. A controller with look-ahead extrapolates targets by `extrapolates_s`; its target is moved
  /// back by that much of its velocity, so that its goal is the motion's and not a tangent's. At rest before
  /// and after.
  Command SentAhead(double t_s, double ahead_s, double extrapolates_s) const;
  /// Constant-curvature tip of the target at time t [m, F_0].
  virtual Eigen::Vector3d TipAt(double t_s) const = 0;

 protected:
  std::string name_, description_;
  double duration_s_ = 0, judged_from_s_ = 0, judged_until_s_ = 0;
};

/// The circle of the paper's section 5.2: the tip turns about z at pi/6 rad/s, the whole robot bent by pi/3
/// (for a 60 mm robot eq. 31: radius 28.6479 mm at z = 49.6196 mm), one revolution after a second of
/// acceleration.
std::unique_ptr<Motion> MakeCircle(const BodyParameters& body);

/// The planar bend of section 5.1: from straight to 1.6 rad in the xz plane at 0.26 rad/s, and a second's
/// rest. Sections whose tendons do not pull in every direction bend towards their first holdable direction,
/// from their rest shape under the minimum tension.
std::unique_ptr<Motion> MakePlanarBend(const RobotParameters& robot);

/// "circle", "planar", "fast_circle" (the same circle, five turns of a second), "square" (the circle's
/// inscribed one, at rest in its corners) or "spiral" (turning, outwards and back, z with it); throws
/// std::invalid_argument naming the choices, or why a robot whose tendons do not pull in every direction
/// bends planar only.
std::unique_ptr<Motion> MakeMotion(const std::string& name, const RobotParameters& robot);

}  // namespace tendril::motion
