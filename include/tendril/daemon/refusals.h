// Refused commands as lines for people: each cause at once, then at most once a second with how many there
// were. Knows nothing of LCM or the log.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>

#include "tendril/core/cycle.h"
#include "tendril/core/robot.h"

namespace tendril::daemon {

/// What a command asked for, in a few words: "bend 0.3 0 rad".
std::string CommandText(const Command& command);

/// Why a tip was refused as out of reach, with the nearest point that a robot of that length can be led to.
std::string OutOfReachText(const Command& command, const Eigen::Vector3d& nearest_W_m, double length_m);

/// Which value of a target is out of range, and what is accepted; empty where the status tells it.
std::string OutOfRangeText(const Command& command, const RobotParameters& robot);

/// What `mode` accepts, for a command that it refuses.
std::string WrongModeText(Mode mode);

/// How many values there are, and how many the robot takes; empty for a tip.
std::string WrongSizeText(const Command& command, const RobotParameters& robot);

/// Why a target was refused whose sender is not the one that leads.
std::string AnotherSenderText(std::uint32_t leader, Mode mode);

class Refusals {
 public:
  using Tell = std::function<void(Status cause, const std::string& text)>;

  /// A command that came in a cycle and was refused for `cause`. `why`, where it is not empty, stands for
  /// what the cause's number means.
  void Add(Status cause, const Command& command, Mode mode, const std::string& why);
  /// Hands out what is due.
  void TellDue(TimeNs now_ns, const Tell& tell);

 private:
  struct Cause {
    std::uint64_t count = 0, told = 0;
    TimeNs next_ns = 0;
    Command command;  // the last one
    Mode mode = Mode::kDisconnected;
    std::string why;
  };
  std::map<Status, Cause> causes_;
};

}  // namespace tendril::daemon
