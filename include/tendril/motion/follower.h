// Streams a motion to a running daemon in real time, each target as far ahead as the daemon's smoothing
// delays, and says how well it was followed. Knows robot and controller only as the daemon describes them.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"
#include "tendril/io/signature.h"
#include "tendril/motion/motion.h"

namespace tendril::motion {

/// What a motion is planned for and with.
struct Subject {
  RobotParameters robot;
  DaemonParameters daemon;

  /// How far the reference comes after its goal.
  double LeadS() const;
};

struct FollowSetup {
  std::string lcm_url, channel_prefix;
  std::string robot_file;                                 // in place of the daemon's robot; empty: that one
  std::function<std::string()> stopped_by;                // not empty: what ends it
  std::function<void(const std::string& line)> tell;      // what is done, and how well it went
  std::function<void(const std::string& line)> progress;  // once a second
  std::string key = io::KeyOfEnvironment();               // that signs targets; empty: they are not signed
};

/// A running daemon and its robot. Everything that goes wrong is a std::runtime_error; the robot then holds
/// the last target.
class Follower {
 public:
  /// Waits for the daemon to describe itself.
  explicit Follower(const FollowSetup& setup);
  ~Follower();
  Follower(const Follower&) = delete;
  Follower& operator=(const Follower&) = delete;

  const Subject& subject() const;

  /// From the motion's first target to its end, of an armed daemon.
  void Follow(const Motion& motion);
  /// Commands that another program sends on channels with the prefix `from`, as one even motion `delay_s`
  /// behind them, until the last one expires. `nearest`: for tips out of reach, the nearest point.
  void FollowSamples(const std::string& from, double delay_s, bool nearest);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tendril::motion
