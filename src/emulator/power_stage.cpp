// The power stage of one drive. Transitions come from the shared CiA 402 table; their effects on the torque
// are here. Knows no bus and no object dictionary.
#include "power_stage.h"

#include <algorithm>
#include <cmath>

namespace tendril::emulator {

using canopen::DriveCommand;
using canopen::DriveMachine;

namespace {
// Speed loop of the ramps: rated torque at this much speed error, integrated over this time. Stiff enough to
// hold a loaded motor at rest, slow enough to be stable at one update a millisecond with a small rotor.
constexpr double kFullTorqueError_rpm = 1000;
constexpr double kIntegralTime_s = 0.02;
constexpr double kAtRest_rpm = 20;
constexpr TimeNs kBrakeGrace_ns = kNsPerS / 2;  // after the ramp should have ended
}  // namespace

void PowerStage::Reset() noexcept { *this = PowerStage{}; }

bool PowerStage::powered() const noexcept {
  return state_ == DriveMachine::kOperationEnabled || state_ == DriveMachine::kQuickStopActive ||
         state_ == DriveMachine::kFaultReactionActive;
}

void PowerStage::Enter(DriveMachine state) noexcept {
  state_ = state;
  braking_ = false;
  if (!powered()) {
    torque_Nm_ = 0;
    limited_ = false;
  }
  follows_command_ = false;
}

void PowerStage::Brake(std::optional<DriveMachine> then) noexcept {
  if (braking_ && after_brake_ == then) return;
  brake_begins_ = !braking_;
  braking_ = true;
  after_brake_ = then;
}

PowerStage::Outcome PowerStage::Command(std::uint16_t controlword, const Options& options) noexcept {
  const DriveCommand command = canopen::DecodeControlword(controlword, previous_controlword_);
  previous_controlword_ = controlword;
  if (command == DriveCommand::kFaultReset) {
    if (!options.fault_reset_allowed || state_ == DriveMachine::kFaultReactionActive) {
      return Outcome::kNothingSpecial;
    }
    if (state_ == DriveMachine::kFault) Enter(canopen::Apply(state_, command));
    return Outcome::kFaultReset;
  }
  const DriveMachine next = canopen::Apply(state_, command);
  if (state_ == DriveMachine::kOperationEnabled) {
    if (command == DriveCommand::kEnableOperation) {
      braking_ = false;  // enabled again before the ramp of a disable had ended
      return Outcome::kNothingSpecial;
    }
    const bool ramp = (next == DriveMachine::kSwitchedOn && options.disable_operation == Stop::kRamp) ||
                      (next == DriveMachine::kReadyToSwitchOn && options.shutdown == Stop::kRamp);
    if (ramp) {
      Brake(next);
      return Outcome::kNothingSpecial;
    }
    if (next == DriveMachine::kQuickStopActive) {
      state_ = next;
      Brake(std::nullopt);
      return Outcome::kNothingSpecial;
    }
  }
  if (next == state_) return Outcome::kNothingSpecial;
  if (command == DriveCommand::kEnableOperation && !options.enabling_allowed)
    return Outcome::kEnablingRefused;
  Enter(next);
  // Enable operation sent in ready to switch on goes through switched on by itself.
  if (command == DriveCommand::kEnableOperation) Enter(canopen::Apply(state_, command));
  return Outcome::kNothingSpecial;
}

void PowerStage::RaiseFault(Stop stop) noexcept {
  if (state_ == DriveMachine::kFault) return;
  if (stop == Stop::kRamp && powered()) {
    state_ = DriveMachine::kFaultReactionActive;
    Brake(DriveMachine::kFault);
  } else {
    Enter(DriveMachine::kFault);
  }
}

void PowerStage::Disconnect(Stop stop) noexcept {
  if (state_ != DriveMachine::kOperationEnabled && state_ != DriveMachine::kQuickStopActive) return;
  if (stop == Stop::kRamp) {
    state_ = DriveMachine::kQuickStopActive;
    Brake(DriveMachine::kSwitchOnDisabled);
  } else {
    Enter(DriveMachine::kSwitchOnDisabled);
  }
}

double PowerStage::Limit(double torque_Nm, double limit_Nm) noexcept {
  limited_ = std::abs(torque_Nm) > limit_Nm;
  return std::clamp(torque_Nm, -limit_Nm, limit_Nm);
}

void PowerStage::Update(TimeNs now_ns, const StageDemand& demand, double velocity_rpm) noexcept {
  const double dt_s = std::max(0.0, ToSeconds(now_ns - updated_ns_));
  updated_ns_ = now_ns;
  follows_command_ = false;
  if (!powered()) return;
  if (braking_) {
    StepBrake(dt_s, now_ns, demand, velocity_rpm);
  } else {
    follows_command_ = demand.torque_mode;
    torque_Nm_ = Limit(demand.torque_mode ? demand.target_Nm : 0.0, demand.limit_Nm);
  }
}

void PowerStage::StepBrake(double dt_s, TimeNs now_ns, const StageDemand& demand,
                           double velocity_rpm) noexcept {
  if (brake_begins_) {
    brake_begins_ = false;
    brake_reference_rpm_ = velocity_rpm;
    brake_integral_Nm_ = torque_Nm_;
    const double ramp_s = std::abs(velocity_rpm) / std::max(demand.deceleration_rpmps, 1.0);
    brake_gives_up_ns_ = now_ns + static_cast<TimeNs>(ramp_s * 1e9) + kBrakeGrace_ns;
  } else {
    const double step_rpm = demand.deceleration_rpmps * dt_s;
    brake_reference_rpm_ -= std::clamp(brake_reference_rpm_, -step_rpm, step_rpm);
    const double gain_Nmprpm = demand.rated_Nm / kFullTorqueError_rpm;
    const double error_rpm = brake_reference_rpm_ - velocity_rpm;
    brake_integral_Nm_ = std::clamp(brake_integral_Nm_ + gain_Nmprpm * error_rpm * dt_s / kIntegralTime_s,
                                    -demand.limit_Nm, demand.limit_Nm);
    torque_Nm_ = Limit(gain_Nmprpm * error_rpm + brake_integral_Nm_, demand.limit_Nm);
  }
  const bool at_rest = std::abs(brake_reference_rpm_) < kAtRest_rpm && std::abs(velocity_rpm) < kAtRest_rpm;
  if (after_brake_ && (at_rest || now_ns >= brake_gives_up_ns_)) Enter(*after_brake_);
}

}  // namespace tendril::emulator
