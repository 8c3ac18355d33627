// The power stage of one drive: CiA 402 state machine with its option codes, torque in cyclic synchronous
// torque mode, and the ramps that bring the motor to rest. Knows no bus and no object dictionary.
#pragma once

#include <cstdint>
#include <optional>

#include "tendril/canopen/cia402.h"
#include "tendril/core/clock.h"

namespace tendril::emulator {

enum class Stop : std::uint8_t { kAtOnce, kRamp };

/// Demand on the stage and its limits, from the objects.
struct StageDemand {
  bool torque_mode = false;  // 0x6060 is 10
  double target_Nm = 0;      // 0x6071 + 0x60B2
  double limit_Nm = 0;       // of the magnitude
  double rated_Nm = 0;
  double deceleration_rpmps = 0;  // 0x6085
};

class PowerStage {
 public:
  struct Options {
    Stop shutdown = Stop::kAtOnce;         // 0x605B
    Stop disable_operation = Stop::kRamp;  // 0x605C
    bool fault_reset_allowed = true;       // false while the cause of the fault lasts
    bool enabling_allowed = true;          // false: operation enabled is not entered
  };
  enum class Outcome : std::uint8_t {
    kNothingSpecial,
    kFaultReset,       // errors are acknowledged, with or without a fault
    kEnablingRefused,  // the state stayed as it was
  };

  /// As after power-on, from which the drive enters switch on disabled by itself.
  void Reset() noexcept;
  /// Acts on 0x6040.
  Outcome Command(std::uint16_t controlword, const Options& options) noexcept;
  /// To fault: at once, or by the quick-stop ramp when the motor is powered.
  void RaiseFault(Stop stop) noexcept;
  /// To switch on disabled without a fault, from the powered states only.
  void Disconnect(Stop stop) noexcept;
  /// Brings torque and ramps up to `now_ns`.
  void Update(TimeNs now_ns, const StageDemand& demand, double velocity_rpm) noexcept;

  canopen::DriveMachine state() const noexcept { return state_; }
  bool powered() const noexcept;
  double torque_Nm() const noexcept { return torque_Nm_; }
  bool limited() const noexcept { return limited_; }
  bool follows_command() const noexcept { return follows_command_; }

 private:
  void Enter(canopen::DriveMachine state) noexcept;
  void Brake(std::optional<canopen::DriveMachine> then) noexcept;
  void StepBrake(double dt_s, TimeNs now_ns, const StageDemand& demand, double velocity_rpm) noexcept;
  double Limit(double torque_Nm, double limit_Nm) noexcept;

  canopen::DriveMachine state_ = canopen::DriveMachine::kSwitchOnDisabled;
  std::uint16_t previous_controlword_ = 0;
  double torque_Nm_ = 0;
  bool limited_ = false, follows_command_ = false;
  TimeNs updated_ns_ = 0;

  bool braking_ = false, brake_begins_ = false;
  std::optional<canopen::DriveMachine> after_brake_;  // none: holds at rest
  double brake_reference_rpm_ = 0, brake_integral_Nm_ = 0;
  TimeNs brake_gives_up_ns_ = 0;
};

}  // namespace tendril::emulator
