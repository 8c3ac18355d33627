// The CiA 402 machine's tables.
// Knows no bus.
#include "tendril/canopen/cia402.h"

#include <array>

namespace tendril::canopen {
namespace {

using S = DriveMachine;
using C = DriveCommand;

constexpr std::uint16_t kStateMask = 0x6F, kStateMaskWithoutQuickStop = 0x4F;

struct StateBits {
  S state;
  std::uint16_t mask, value, shown;
};

constexpr std::array<StateBits, kDriveMachineStates> kStateBits = {{
    {S::kNotReady, kStateMaskWithoutQuickStop, 0x00, 0x00},
    {S::kSwitchOnDisabled, kStateMaskWithoutQuickStop, 0x40, 0x40},
    {S::kReadyToSwitchOn, kStateMask, 0x21, 0x21},
    {S::kSwitchedOn, kStateMask, 0x23, 0x23},
    {S::kOperationEnabled, kStateMask, 0x27, 0x27},
    {S::kQuickStopActive, kStateMask, 0x07, 0x07},
    {S::kFaultReactionActive, kStateMaskWithoutQuickStop, 0x0F, 0x0F},
    {S::kFault, kStateMaskWithoutQuickStop, 0x08, 0x08},
}};

constexpr std::array<DriveTransition, 16> kTransitions = {{
    {S::kSwitchOnDisabled, C::kShutdown, S::kReadyToSwitchOn, 2},
    {S::kReadyToSwitchOn, C::kSwitchOn, S::kSwitchedOn, 3},
    {S::kReadyToSwitchOn, C::kEnableOperation, S::kSwitchedOn, 3},
    {S::kSwitchedOn, C::kEnableOperation, S::kOperationEnabled, 4},
    {S::kOperationEnabled, C::kSwitchOn, S::kSwitchedOn, 5},
    {S::kSwitchedOn, C::kShutdown, S::kReadyToSwitchOn, 6},
    {S::kReadyToSwitchOn, C::kDisableVoltage, S::kSwitchOnDisabled, 7},
    {S::kReadyToSwitchOn, C::kQuickStop, S::kSwitchOnDisabled, 7},
    {S::kOperationEnabled, C::kShutdown, S::kReadyToSwitchOn, 8},
    {S::kOperationEnabled, C::kDisableVoltage, S::kSwitchOnDisabled, 9},
    {S::kSwitchedOn, C::kDisableVoltage, S::kSwitchOnDisabled, 10},
    {S::kSwitchedOn, C::kQuickStop, S::kSwitchOnDisabled, 10},
    {S::kOperationEnabled, C::kQuickStop, S::kQuickStopActive, 11},
    {S::kQuickStopActive, C::kDisableVoltage, S::kSwitchOnDisabled, 12},
    {S::kFault, C::kFaultReset, S::kSwitchOnDisabled, 15},
    // Follows from the only quick-stop option of the drive (0x605A = 6: stay in quick stop active); the
    // master never uses it, it goes through switch on disabled.
    {S::kQuickStopActive, C::kEnableOperation, S::kOperationEnabled, 16},
}};

}  // namespace

const char* DriveMachineText(DriveMachine state) noexcept {
  switch (state) {
    case S::kNotReady:
      return "not ready to switch on";
    case S::kSwitchOnDisabled:
      return "switch on disabled";
    case S::kReadyToSwitchOn:
      return "ready to switch on";
    case S::kSwitchedOn:
      return "switched on";
    case S::kOperationEnabled:
      return "operation enabled";
    case S::kQuickStopActive:
      return "quick stop active";
    case S::kFaultReactionActive:
      return "fault reaction active";
    case S::kFault:
      return "fault";
  }
  return "unknown";
}

DriveMachine DecodeStatusword(std::uint16_t statusword) noexcept {
  for (const StateBits& bits : kStateBits) {
    if ((statusword & bits.mask) == bits.value) return bits.state;
  }
  return S::kNotReady;
}

std::uint16_t EncodeState(DriveMachine state) noexcept {
  return kStateBits[static_cast<std::size_t>(state)].shown;
}

DriveCommand DecodeControlword(std::uint16_t controlword, std::uint16_t previous) noexcept {
  constexpr std::uint16_t kReset = 0x80;
  if ((controlword & kReset) != 0) return (previous & kReset) == 0 ? C::kFaultReset : C::kNone;
  if ((controlword & 0x82) == 0x00) return C::kDisableVoltage;
  if ((controlword & 0x86) == 0x02) return C::kQuickStop;
  if ((controlword & 0x87) == 0x06) return C::kShutdown;
  return (controlword & 0x8F) == 0x0F ? C::kEnableOperation : C::kSwitchOn;
}

std::span<const DriveTransition> DriveTransitions() noexcept { return kTransitions; }

DriveMachine Apply(DriveMachine from, DriveCommand command) noexcept {
  for (const DriveTransition& transition : kTransitions) {
    if (transition.from == from && transition.command == command) return transition.to;
  }
  return from;
}

std::uint16_t ControlwordTowardsEnabled(DriveMachine state) noexcept {
  switch (state) {
    case S::kSwitchOnDisabled:
      return controlword::kShutdown;
    case S::kReadyToSwitchOn:
      return controlword::kSwitchOn;
    case S::kSwitchedOn:
    case S::kOperationEnabled:
      return controlword::kEnableOperation;
    default:
      return controlword::kDisableVoltage;
  }
}

}  // namespace tendril::canopen
