#include "tendril/core/cycle.h"

namespace tendril {

std::string_view ModeText(Mode mode) noexcept {
  switch (mode) {
    case Mode::kDisconnected: return "disconnected";
    case Mode::kConfigured: return "configured";
    case Mode::kArmed: return "armed";
    case Mode::kPretension: return "pretension";
    case Mode::kRunning: return "running";
    case Mode::kHold: return "hold";
    case Mode::kSafeStop: return "safe stop";
    case Mode::kFault: return "fault";
    case Mode::kHoming: return "homing";
    case Mode::kCommissioning: return "commissioning";
  }
  return "unknown";
}

}  // namespace tendril
