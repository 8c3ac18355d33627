// What is known of drives, tendons and zero in the present mode, beside the mode itself.
#pragma once

#include <array>

#include "tendril/control/supervisor.h"
#include "tendril/core/clock.h"
#include "tendril/core/limits.h"

namespace tendril::control {

class StateArchive;

struct ModeState {
  Supervisor supervisor;
  bool engaged = false;         // homing or commissioning with every drive enabled
  bool bare = false;            // commanded tensions are the pulls of bare motors
  bool zeroed = false;          // displacement counts from pretension
  bool zero_known = false;      // ... did before, and the encoders have counted on since then
  bool may_be_slack = false;    // a drive failed after that: its tendon may be slack
  TimeNs stop_by_ns = 0;        // when the daemon stops: time for zero tension; else 0
  TimeNs settled_since_ns = 0;  // or since when drives are requested to switch on
  // Seen without power after the mode was entered: a drive that is still enabled must switch off before it is
  // enabled again.
  std::array<bool, kMaxTendons> was_off{};

  Mode mode() const noexcept { return supervisor.mode(); }
  bool takes_up() const noexcept { return mode() == Mode::kHoming || mode() == Mode::kCommissioning; }
  bool controls_shape() const noexcept { return mode() == Mode::kRunning || mode() == Mode::kHold; }
  /// Drives are switching on.
  bool enabling() const noexcept { return mode() == Mode::kArmed || (takes_up() && !engaged); }

  void Archive(StateArchive& archive) noexcept;
};

}  // namespace tendril::control
