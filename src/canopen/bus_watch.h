// Decides when to restart a bus after bus-off, and when to leave it off. Knows neither frames nor drives:
// port states are passed in, orders come out.
#pragma once

#include <cstdint>

#include "tendril/core/clock.h"

namespace tendril::canopen {

class BusWatch {
 public:
  enum class Order : std::uint8_t { kNone, kTellDown, kAskRestart, kTellBack, kTellGivenUp };
  static constexpr int kRestarts = 5;  // unsuccessful restarts before the operator decides
  /// The kernel's own restart follows within its restart-ms, usually 100; the interface's flags show a
  /// controller that is off within a second.
  static constexpr TimeNs kPatience_ns = 1500 * kNsPerMs;
  static constexpr TimeNs kSteady_ns = 2 * kNsPerS;  // with frames: the restart succeeded

  /// Once per cycle. `off`: bus-off, as opposed to an interface that is down, which the master cannot bring
  /// up.
  Order Update(TimeNs now_ns, bool up, bool off, std::uint64_t frames_received) noexcept {
    if (!down_) {
      if (up) {
        if (now_ns >= back_ns_ + kSteady_ns && frames_received != frames_when_back_) restarts_ = 0;
        return Order::kNone;
      }
      down_ = true;
      asked_ = false;
      next_ask_ns_ = now_ns + kPatience_ns;
      return Order::kTellDown;
    }
    if (given_up_) return Order::kNone;
    const bool ask = !up && off && now_ns >= next_ask_ns_;
    if (restarts_ >= kRestarts && (ask || (up && !asked_))) {
      given_up_ = true;
      return Order::kTellGivenUp;
    }
    if (up) {
      if (!asked_) ++restarts_;
      down_ = false;
      back_ns_ = now_ns;
      frames_when_back_ = frames_received;
      return Order::kTellBack;
    }
    if (!ask) return Order::kNone;
    ++restarts_;
    asked_ = true;
    next_ask_ns_ = now_ns + kPatience_ns;
    return Order::kAskRestart;
  }
  /// The operator has removed the cause.
  void TryAgain(TimeNs now_ns) noexcept {
    restarts_ = 0;
    given_up_ = false;
    next_ask_ns_ = now_ns;
  }
  bool down() const noexcept { return down_; }
  int restarts() const noexcept { return restarts_; }

 private:
  bool down_ = false, given_up_ = false;
  bool asked_ = false;  // since it went down
  int restarts_ = 0;    // by any process, since the bus was last steady
  TimeNs next_ask_ns_ = 0, back_ns_ = 0;
  std::uint64_t frames_when_back_ = 0;
};

}  // namespace tendril::canopen
