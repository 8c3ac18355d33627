// A drive's torque loop: delay, bound and first-order lag between the torque sent and the torque that the
// drive reports, solved exactly, so that it adds no states to a solver. Knows nothing of the motor.
#pragma once

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>

namespace tendril::sim {

class TorqueLoop {
 public:
  /// T' = (commanded - T) / lag; `commanded` is the torque sent `delay` earlier, within +-limit.
  TorqueLoop(double start_Nm, double lag_s, double delay_s, double limit_Nm)
      : lag_s_(lag_s), delay_s_(delay_s), limit_Nm_(limit_Nm), now_{0, start_Nm, start_Nm} {}

  /// The same drive after it has held this torque for long.
  TorqueLoop Holding(double torque_Nm) const { return {torque_Nm, lag_s_, delay_s_, limit_Nm_}; }

  /// Sets the torque from time_s on, not before the last call's.
  void Set(double time_s, double sent_Nm) {
    const double commanded = std::clamp(sent_Nm, -limit_Nm_, limit_Nm_);
    if (delay_s_ > 0) {
      for (; !pending_.empty() && pending_.front().time_s <= time_s; pending_.pop_front()) {
        now_ = Next(now_, pending_.front());
      }
      pending_.push_back({time_s + delay_s_, commanded});
    } else {
      now_ = Next(now_, {time_s, commanded});
    }
  }

  /// The torque at a time at or after the last Set.
  double At(double time_s) const noexcept {
    if (pending_.empty()) return Value(now_, time_s);
    Segment segment = now_;
    for (const Command& command : pending_) {
      if (command.time_s > time_s) break;
      segment = Next(segment, command);
    }
    return Value(segment, time_s);
  }

  /// Time after time_s at which the next command sent takes effect, where a solver must stop. Infinity when
  /// there is none.
  double NextCorner(double time_s) const noexcept {
    for (const Command& command : pending_) {
      if (command.time_s > time_s) return command.time_s;
    }
    return std::numeric_limits<double>::infinity();
  }

 private:
  struct Segment {
    double time_s, from_Nm, commanded_Nm;
  };
  struct Command {
    double time_s, commanded_Nm;
  };

  double Value(const Segment& s, double time_s) const noexcept {
    if (s.from_Nm == s.commanded_Nm || lag_s_ <= 0) return s.commanded_Nm;
    return s.commanded_Nm + (s.from_Nm - s.commanded_Nm) * std::exp(-(time_s - s.time_s) / lag_s_);
  }
  Segment Next(const Segment& s, const Command& command) const noexcept {
    return {command.time_s, Value(s, command.time_s), command.commanded_Nm};
  }

  double lag_s_, delay_s_, limit_Nm_;
  Segment now_;
  std::deque<Command> pending_;
};

}  // namespace tendril::sim
