// What the drive's objects make of the motor, and what of it they show. Knows the power stage and the
// sensors, no bus.
#include <algorithm>
#include <cmath>

#include "drive.h"

namespace tendril::emulator {
namespace {

using canopen::NmtState;

constexpr std::uint16_t kParameterError = 0x6320;
constexpr std::int64_t kStoInputsPowered = 0x03;  // 0x3202:01 of an EPOS4, one bit per input

std::int64_t Saturate16(double value) { return std::clamp<std::int64_t>(std::llround(value), -32768, 32767); }

}  // namespace

/// The one that is offered, and none.
bool Drive::SupportedMode(std::int64_t mode) {
  return mode == 0 || mode == canopen::kModeCyclicSynchronousTorque;
}

void Drive::ActOnControlword() {
  if (nominal_current_.value != rated_at_mA_) RefreshRatedTorque();  // 0x3001:01 can be mapped
  if (!SupportedMode(mode_.value)) mode_.value = mode_shown_.value;  // a PDO may carry anything
  mode_shown_.value = mode_.value;
  const PowerStage::Options options{
      .shutdown = objects_.At(0x605B, 0).value == 0 ? Stop::kAtOnce : Stop::kRamp,
      .disable_operation = objects_.At(0x605C, 0).value == 0 ? Stop::kAtOnce : Stop::kRamp,
      .fault_reset_allowed = !connection_lost_ && !(sto_ && sto_error_),
      .enabling_allowed = !sto_ && rated_torque_.value != 0};
  switch (stage_.Command(static_cast<std::uint16_t>(controlword_.value), options)) {
    case PowerStage::Outcome::kNothingSpecial:
      return;
    case PowerStage::Outcome::kEnablingRefused:
      // Without a rated torque set values are undefined. Which error a real drive then reports is unknown.
      InjectEmcy(sto_ ? kSafeTorqueOff : kParameterError);
      return;
    case PowerStage::Outcome::kFaultReset:
      if (error_register_.value == 0 && error_code_.value == 0) return;
      error_register_.value = 0;
      error_code_.value = 0;
      sto_error_ = false;
      SendEmcy(0);
      return;
  }
}

void Drive::RunStage(TimeNs now_ns) noexcept {
  RunThermalModel(ToSeconds(now_ns - stage_ns_));
  stage_ns_ = now_ns;
  const double rated_Nm = static_cast<double>(rated_torque_.value) * profile_->rated_torque_unit_uNm * 1e-6;
  const std::int64_t limit_mA =
      i2t_limits_ ? std::min(current_limit_.value, nominal_current_.value) : current_limit_.value;
  double limit_Nm = static_cast<double>(limit_mA) * static_cast<double>(torque_constant_.value) * 1e-9;
  if (max_torque_ != nullptr)
    limit_Nm = std::min(limit_Nm, static_cast<double>(max_torque_->value) * 1e-3 * rated_Nm);
  const StageDemand demand{
      .torque_mode = mode_.value == canopen::kModeCyclicSynchronousTorque,
      .target_Nm = static_cast<double>(target_torque_.value + torque_offset_.value) * 1e-3 * rated_Nm,
      .limit_Nm = limit_Nm,
      .rated_Nm = rated_Nm,
      .deceleration_rpmps = static_cast<double>(deceleration_.value)};
  stage_.Update(now_ns, demand, sensors_.velocity_rpm);
}

/// I2t: heat follows the square of current over nominal current with the winding's time constant; at 1 the
/// current is held to nominal until the heat has fallen below 0.95.
void Drive::RunThermalModel(double dt_s) noexcept {
  const double nominal_A = static_cast<double>(nominal_current_.value) * 1e-3;
  const double constant_NmpA = static_cast<double>(torque_constant_.value) * 1e-6;
  const double time_constant_s = 0.1 * static_cast<double>(thermal_time_.value);
  if (nominal_A <= 0 || constant_NmpA <= 0 || time_constant_s <= 0 || dt_s <= 0) return;
  const double load = sensors_.actual_torque_Nm / (constant_NmpA * nominal_A);
  i2t_ += std::min(dt_s / time_constant_s, 1.0) * (load * load - i2t_);
  if (i2t_ > 1.0) i2t_limits_ = true;
  if (i2t_ < 0.95) i2t_limits_ = false;
}

std::uint16_t Drive::Statusword() const noexcept {
  namespace bits = canopen::statusword;
  using canopen::DriveMachine;
  const DriveMachine state = stage_.state();
  std::uint16_t word = canopen::EncodeState(state);
  const bool voltage =
      state == DriveMachine::kReadyToSwitchOn || state == DriveMachine::kSwitchedOn || stage_.powered();
  if (voltage && !sto_) word |= bits::kVoltageEnabled;
  if (nmt_ == NmtState::kOperational) word |= bits::kRemote;
  if (stage_.limited()) word |= bits::kInternalLimit;
  if (i2t_limits_) word |= bits::kWarning;
  if (stage_.follows_command()) word |= bits::kFollowsCommand;
  return word;
}

void Drive::ShowProcessValues() noexcept {
  position_.value = sensors_.position_counts;
  velocity_.value = sensors_.velocity_rpm;
  analog1_.value = std::clamp<std::int64_t>(
      std::llround(sensors_.analog_mV[0] / profile_->analog_mV_per_count),
      canopen::TypeMin(analog1_.entry->type), canopen::TypeMax(analog1_.entry->type));
  analog2_.value = sensors_.analog_mV[1];
  const double torque_uNm = sensors_.actual_torque_Nm * 1e6;
  torque_.value =
      rated_torque_.value > 0
          ? Saturate16(torque_uNm * 1e3 /
                       (static_cast<double>(rated_torque_.value) * profile_->rated_torque_unit_uNm))
          : 0;
  torque_average_.value = torque_.value;
  current_.value = torque_constant_.value > 0
                       ? std::llround(torque_uNm * 1e3 / static_cast<double>(torque_constant_.value))
                       : 0;
  current_average_.value = current_.value;
  statusword_.value = Statusword();
  sto_inputs_.value = sto_ ? 0 : kStoInputsPowered;
}

}  // namespace tendril::emulator
