#include "tendril/control/supervisor.h"

#include "tendril/control/state_archive.h"

namespace tendril::control {
namespace {

using enum Mode;

constexpr Transition kTransitions[] = {
    {kDisconnected, Event::kDrivesReady, kConfigured},

    {kConfigured, Event::kArm, kArmed},
    {kConfigured, Event::kHome, kHoming},
    {kConfigured, Event::kCommission, kCommissioning},
    {kConfigured, Event::kFault, kFault},

    {kArmed, Event::kDrivesEnabled, kPretension},
    {kArmed, Event::kDisarm, kSafeStop},
    {kArmed, Event::kFault, kFault},

    {kPretension, Event::kPretensioned, kRunning},
    {kPretension, Event::kDisarm, kSafeStop},
    {kPretension, Event::kFault, kFault},

    {kRunning, Event::kHold, kHold},
    {kRunning, Event::kDisarm, kSafeStop},
    {kRunning, Event::kFault, kFault},

    {kHold, Event::kArm, kRunning},
    {kHold, Event::kDisarm, kSafeStop},
    {kHold, Event::kFault, kFault},

    {kHoming, Event::kHomed, kHold},
    {kHoming, Event::kDisarm, kSafeStop},
    {kHoming, Event::kFault, kFault},

    {kCommissioning, Event::kDisarm, kSafeStop},
    {kCommissioning, Event::kFault, kFault},

    {kSafeStop, Event::kReleased, kConfigured},
    {kSafeStop, Event::kFault, kFault},

    {kFault, Event::kClear, kDisconnected},
};

}  // namespace

std::string_view EventText(Event event) noexcept {
  switch (event) {
    case Event::kDrivesReady:
      return "every drive is configured and answers";
    case Event::kDrivesEnabled:
      return "every drive is enabled";
    case Event::kPretensioned:
      return "tensions are at the minimum and settled";
    case Event::kReleased:
      return "tensions are down to pretension";
    case Event::kHomed:
      return "every tendon is taut at pretension";
    case Event::kArm:
      return "command arm";
    case Event::kHome:
      return "command home";
    case Event::kCommission:
      return "command commission";
    case Event::kDisarm:
      return "command disarm, or the controller stops by itself";
    case Event::kHold:
      return "command hold, or a silent stream";
    case Event::kClear:
      return "command clear";
    case Event::kFault:
      return "a fault";
  }
  return "";
}

std::span<const Transition> Supervisor::Table() noexcept { return kTransitions; }

bool Supervisor::Handle(Event event, Status cause) noexcept {
  for (const Transition& t : kTransitions) {
    if (t.from != mode_ || t.event != event) continue;
    mode_ = t.to;
    cause_ = event == Event::kFault ? cause : Status::kOk;
    return true;
  }
  return false;
}

void Supervisor::Archive(StateArchive& a) noexcept {
  a.Choice(mode_, Mode::kCommissioning);
  a.Choice(cause_, static_cast<Status>(999));
}

}  // namespace tendril::control
