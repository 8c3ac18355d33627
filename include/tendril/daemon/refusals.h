// Refused commands as log lines: each cause at once, then at most once per second with the count. Knows
// nothing of LCM or the log.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>

#include "tendril/core/cycle.h"
#include "tendril/core/robot.h"

namespace tendril::daemon {

/// A command in a few words: "bend 0.3 0 rad".
std::string CommandText(const Command& command);

/// Why a tip was refused as out of reach, with the nearest reachable point and the robot's length.
std::string OutOfReachText(const Command& command, const Eigen::Vector3d& nearest_W_m, double length_m);

/// Which value of a target is out of range, and the accepted range; empty where the status says it all.
std::string OutOfRangeText(const Command& command, const RobotParameters& robot);

/// The commands that `mode` accepts, for one that it refuses.
std::string WrongModeText(Mode mode);

/// The number of values given and required; empty for a tip.
std::string WrongSizeText(const Command& command, const RobotParameters& robot);

/// Why a target was refused whose sender is not in control.
std::string AnotherSenderText(std::uint32_t sender_in_control, Mode mode);

class Refusals {
 public:
  using Sink = std::function<void(Status cause, const std::string& text)>;

  /// Adds a command that was refused for `cause`. `why`, unless empty, replaces the text of the cause.
  void Add(Status cause, const Command& command, Mode mode, const std::string& why);
  /// Passes on the lines that are due.
  void ReportDue(TimeNs now_ns, const Sink& sink);

 private:
  struct Cause {
    std::uint64_t count = 0, reported = 0;
    TimeNs next_ns = 0;
    Command command;  // the last one
    Mode mode = Mode::kDisconnected;
    std::string why;
  };
  std::map<Status, Cause> causes_;
};

}  // namespace tendril::daemon
