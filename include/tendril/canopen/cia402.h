// The CiA 402 drive state machine as tables: statusword to state, controlword to command, and the
// transitions. Shared by master and emulator; knows no bus.
#pragma once

#include <cstdint>
#include <span>

namespace tendril::canopen {

enum class DriveMachine : std::uint8_t {
  kNotReady,
  kSwitchOnDisabled,
  kReadyToSwitchOn,
  kSwitchedOn,
  kOperationEnabled,
  kQuickStopActive,
  kFaultReactionActive,
  kFault,
};
inline constexpr int kDriveMachineStates = 8;

const char* DriveMachineText(DriveMachine state) noexcept;

/// Bits of 0x6041 beyond those of the state.
namespace statusword {
inline constexpr std::uint16_t kVoltageEnabled = 1u << 4, kWarning = 1u << 7, kRemote = 1u << 9,
                               kInternalLimit = 1u << 11, kFollowsCommand = 1u << 12, kHomingValid = 1u << 15;
}

/// State of a statusword. The quick-stop bit (5) is ignored in the four states that do not define it, where
/// drives differ. Bit patterns of no state give kNotReady, the state without power.
DriveMachine DecodeStatusword(std::uint16_t statusword) noexcept;
/// The six state bits (mask 0x6F) that an EPOS4 shows in a state.
std::uint16_t EncodeState(DriveMachine state) noexcept;

enum class DriveCommand : std::uint8_t {
  kNone,
  kShutdown,
  kSwitchOn,
  kEnableOperation,
  kDisableOperation,
  kDisableVoltage,
  kQuickStop,
  kFaultReset,  // rising edge of bit 7, regardless of the other bits
};

/// Controlword values to send.
namespace controlword {
inline constexpr std::uint16_t kShutdown = 0x0006, kSwitchOn = 0x0007, kEnableOperation = 0x000F,
                               kDisableOperation = 0x0007, kDisableVoltage = 0x0000, kQuickStop = 0x0002,
                               kFaultReset = 0x0080;
}

/// Command of a controlword that follows `previous`. Switch on and disable operation are the same bits:
/// kSwitchOn is returned, and acts as disable operation in operation enabled.
DriveCommand DecodeControlword(std::uint16_t controlword, std::uint16_t previous) noexcept;

struct DriveTransition {
  DriveMachine from;
  DriveCommand command;
  DriveMachine to;
  std::int8_t number;  // CiA 402's transition number
};

/// All transitions caused by commands. Enable operation in ready to switch on goes to switched on; the same
/// controlword then continues from there.
std::span<const DriveTransition> DriveTransitions() noexcept;
/// State after `command` in `from`; `from` itself when the command has no effect there.
DriveMachine Apply(DriveMachine from, DriveCommand command) noexcept;

/// Controlword that brings a drive one transition nearer to operation enabled; kDisableVoltage where no
/// command helps (not ready, faults: these need ClearFaults).
std::uint16_t ControlwordTowardsEnabled(DriveMachine state) noexcept;

}  // namespace tendril::canopen
