// Modes as a table: which event leads from which mode to which, and nothing else. Faults latch with their
// cause until the operator clears them; nothing resumes by itself.
#pragma once

#include <span>
#include <string_view>

#include "tendril/core/cycle.h"

namespace tendril::control {

class StateArchive;

enum class Event : std::uint8_t {
  kDrivesReady,
  kDrivesEnabled,
  kPretensioned,
  kReleased,
  kHomed,
  kArm,
  kHome,
  kCommission,
  kDisarm,
  kHold,
  kClear,
  kFault,
};

/// "every drive is enabled": what happened, as a clause.
std::string_view EventText(Event event) noexcept;

struct Transition {
  Mode from;
  Event event;
  Mode to;
};

class Supervisor {
 public:
  /// All legal transitions; an event without a row in the current mode changes nothing.
  static std::span<const Transition> Table() noexcept;

  Mode mode() const noexcept { return mode_; }
  /// Cause of the fault; kOk outside kFault.
  Status cause() const noexcept { return cause_; }
  /// True when the event changed the mode.
  bool Handle(Event event, Status cause = Status::kOk) noexcept;

  void Archive(StateArchive& archive) noexcept;

 private:
  Mode mode_ = Mode::kDisconnected;
  Status cause_ = Status::kOk;
};

}  // namespace tendril::control
