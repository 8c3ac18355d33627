// One emulated EPOS4. Choices left open by CiA 301, CiA 402 and maxon are noted beside the code. Knows its
// own frames and sensors only; nothing of the rack, the robot or a wall clock.
#include "drive.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "tendril/canopen/emcy.h"

namespace tendril::emulator {
namespace {

using canopen::NmtCommand;
using canopen::NmtState;
namespace sdo_abort = canopen::sdo_abort;

constexpr int kHistory = 5;  // entries of 0x1003
constexpr std::uint16_t kParameterError = 0x6320, kHeartbeatLost = 0x8130, kPdoTooShort = 0x8210,
                        kSafeTorqueOff = 0x8A88;
constexpr std::int64_t kStoInputsPowered = 0x03;  // 0x3202:01, one bit per input

std::array<Pdo, 4> MakePdos(ObjectDictionary& objects, bool transmit) {
  return {Pdo(objects, transmit, 1), Pdo(objects, transmit, 2), Pdo(objects, transmit, 3),
          Pdo(objects, transmit, 4)};
}

/// The modes listed in 0x6502, and none.
bool SupportedMode(std::int64_t mode) { return mode == 0 || mode == canopen::kModeCyclicSynchronousTorque; }

std::int64_t Saturate16(double value) { return std::clamp<std::int64_t>(std::llround(value), -32768, 32767); }

}  // namespace

Drive::Drive(const EmulatedDriveParameters& parameters, can::CanPort& port)
    : node_id_(parameters.node_id),
      port_(port),
      objects_(parameters.node_id),
      rpdos_(MakePdos(objects_, false)),
      tpdos_(MakePdos(objects_, true)),
      sdo_(parameters.node_id, *this),
      error_register_(objects_.At(0x1001, 0)),
      heartbeat_time_(objects_.At(0x1017, 0)),
      nominal_current_(objects_.At(0x3001, 1)),
      current_limit_(objects_.At(0x3001, 2)),
      thermal_time_(objects_.At(0x3001, 4)),
      torque_constant_(objects_.At(0x3001, 5)),
      sto_inputs_(objects_.At(0x3202, 1)),
      current_average_(objects_.At(0x30D1, 1)),
      current_(objects_.At(0x30D1, 2)),
      torque_average_(objects_.At(0x30D2, 1)),
      analog1_(objects_.At(0x3160, 1)),
      analog2_(objects_.At(0x3160, 2)),
      error_code_(objects_.At(0x603F, 0)),
      controlword_(objects_.At(0x6040, 0)),
      statusword_(objects_.At(0x6041, 0)),
      mode_(objects_.At(0x6060, 0)),
      mode_shown_(objects_.At(0x6061, 0)),
      position_(objects_.At(0x6064, 0)),
      velocity_(objects_.At(0x606C, 0)),
      target_torque_(objects_.At(0x6071, 0)),
      torque_offset_(objects_.At(0x60B2, 0)),
      rated_torque_(objects_.At(0x6076, 0)),
      torque_(objects_.At(0x6077, 0)),
      deceleration_(objects_.At(0x6085, 0)) {
  const auto make = [this](std::uint16_t index, std::uint8_t sub, std::int64_t value) {
    Object& object = objects_.At(index, sub);
    object.value = object.factory = object.power_on = value;
  };
  make(0x1018, 2, parameters.product_code);
  make(0x1018, 3, parameters.revision);
  make(0x1018, 4, parameters.serial);
  // The motor's data of a commissioned drive; "load" restores the table's defaults.
  if (parameters.nominal_current_mA != 0) {
    nominal_current_.power_on = parameters.nominal_current_mA;
    current_limit_.power_on = 2 * static_cast<std::int64_t>(parameters.nominal_current_mA);
  }
  if (parameters.torque_constant_uNmpA != 0) torque_constant_.power_on = parameters.torque_constant_uNmpA;
  for (std::size_t i = 0; i < consumers_.size(); ++i) {
    consumers_[i].setting = &objects_.At(0x1016, static_cast<std::uint8_t>(i + 1));
  }
  PowerCycle();
}

// ---- start and reset
// -------------------------------------------------------------------------------------------

/// The same for NMT reset node: the device restarts from its stored values and boots at the next OnTime.
void Drive::PowerCycle() noexcept {
  objects_.Restore(0x0000, 0xFFFF);
  TakeNodeId();
  stage_.Reset();
  supplied_ = true;
  frozen_ = heartbeat_stopped_ = false;
  connection_lost_ = i2t_limits_ = sto_error_ = false;
  i2t_ = 0;
  nmt_ = NmtState::kBootUp;
  ResetCommunication();
  RefreshRatedTorque();
}

/// The stage is reset when the supply goes off, so that no torque is left, and everything again when it
/// returns.
void Drive::SetSupply(bool on) noexcept {
  if (on == supplied_) return;
  PowerCycle();
  supplied_ = on;
}

/// A stored node id takes effect at the next reset of the device, together with the COB-IDs that depend on
/// it.
void Drive::TakeNodeId() noexcept {
  const auto id = static_cast<int>(objects_.At(0x2000, 0).value);
  if (id == node_id_) return;
  objects_.MoveNodeId(node_id_, id);
  node_id_ = id;
  sdo_.SetNodeId(id);
}

void Drive::ResetCommunication() noexcept {
  // Communication errors without a fault reaction end here; a fault keeps its cause.
  const bool in_fault = stage_.state() == canopen::DriveMachine::kFault ||
                        stage_.state() == canopen::DriveMachine::kFaultReactionActive;
  if (!in_fault && canopen::FindEmcy(static_cast<std::uint16_t>(error_code_.value)).register_bit ==
                       canopen::error_register::kCommunication) {
    error_register_.value &= ~std::int64_t{canopen::error_register::kCommunication};
    error_code_.value = 0;
  }
  const std::int64_t active_errors = error_register_.value;  // shown in 0x1001, but a device state
  std::array<std::int64_t, kHistory + 1> history{};
  for (std::uint8_t i = 0; i <= kHistory; ++i) history[i] = objects_.Find({0x1003, i})->value;
  objects_.Restore(0x1000, 0x1FFF);
  error_register_.value = active_errors;
  for (std::uint8_t i = 0; i <= kHistory; ++i) objects_.Find({0x1003, i})->value = history[i];
  sdo_.Reset();
  connection_lost_ = false;
  nmt_ = NmtState::kBootUp;
  RefreshAll();
}

void Drive::Boot(TimeNs now_ns) {
  port_.Send(canopen::HeartbeatFrame(node_id_, NmtState::kBootUp));
  nmt_ = NmtState::kPreOperational;
  next_heartbeat_ns_ = now_ns + heartbeat_time_.value * kNsPerMs;
}

void Drive::RefreshAll() noexcept {
  for (Pdo& pdo : rpdos_) pdo.Refresh();
  for (Pdo& pdo : tpdos_) pdo.Refresh();
  received_ = {};
  events_ = {};
  for (Consumer& consumer : consumers_) consumer.heard = false;
}

/// Written values of 0x6076 stay until the motor's data change (undocumented).
void Drive::RefreshRatedTorque() noexcept {
  rated_at_mA_ = nominal_current_.value;
  rated_torque_.value = canopen::RatedTorque_uNm(static_cast<std::uint32_t>(nominal_current_.value),
                                                 static_cast<std::uint32_t>(torque_constant_.value));
}

// ---- sensors
// ---------------------------------------------------------------------------------------------------

/// A stuck encoder shows standstill, because the drive derives the velocity from it.
void Drive::SetSensors(const DriveSensors& sensors) noexcept {
  const auto stuck = [this](DriveSensor sensor) { return stuck_[static_cast<std::size_t>(sensor)]; };
  DriveSensors shown = sensors;
  if (stuck(DriveSensor::kEncoder)) {
    shown.position_counts = sensors_.position_counts;
    shown.velocity_rpm = 0;
  }
  if (stuck(DriveSensor::kLoadCell)) shown.analog_mV = sensors_.analog_mV;
  if (stuck(DriveSensor::kTorque)) shown.actual_torque_Nm = sensors_.actual_torque_Nm;
  sensors_ = shown;
}

// ---- frames
// ----------------------------------------------------------------------------------------------------

void Drive::OnFrame(const can::CanFrame& frame, TimeNs now_ns) {
  if (!alive() || frame.error) return;
  now_ns_ = now_ns;
  const std::uint32_t function = canopen::CobFunction(frame.id);
  if (frame.id == canopen::kNmtCobId) {
    const auto message = canopen::ParseNmt(frame);
    if (message && (message->node_id == 0 || message->node_id == node_id_)) OnNmt(message->command);
    return;
  }
  if (nmt_ == NmtState::kBootUp) return;  // not listening yet
  if (function == canopen::kHeartbeatBase) {
    if (!frame.remote) OnHeartbeat(canopen::CobNode(frame.id), now_ns);
    return;
  }
  if (nmt_ != NmtState::kStopped &&
      frame.id == canopen::kSdoRequestBase + static_cast<std::uint32_t>(node_id_)) {
    can::CanFrame response;
    if (!frame.remote && sdo_.Answer(frame, &response)) port_.Send(response);
    return;
  }
  if (nmt_ != NmtState::kOperational) return;
  if (frame.remote) {
    for (const Pdo& pdo : tpdos_) {
      if (pdo.valid() && pdo.remote_allowed() && pdo.cob_id() == frame.id) SendPdo(pdo);
    }
    return;
  }
  for (std::size_t i = 0; i < rpdos_.size(); ++i) {
    if (rpdos_[i].valid() && rpdos_[i].cob_id() == frame.id) OnReceivePdo(rpdos_[i], i, frame);
  }
}

void Drive::OnNmt(NmtCommand command) {
  switch (command) {
    case NmtCommand::kStart:
      if (nmt_ == NmtState::kBootUp || nmt_ == NmtState::kOperational) return;
      nmt_ = NmtState::kOperational;
      received_ = {};
      events_ = {};  // a TPDO sent on change is sent once at the start
      return;
    case NmtCommand::kStop:
      if (nmt_ == NmtState::kBootUp || nmt_ == NmtState::kStopped) return;
      nmt_ = NmtState::kStopped;
      sdo_.Reset();
      ConnectionEvent();
      return;
    case NmtCommand::kEnterPreOperational:
      if (nmt_ != NmtState::kBootUp) nmt_ = NmtState::kPreOperational;
      return;
    case NmtCommand::kResetNode:
      PowerCycle();
      return;
    case NmtCommand::kResetCommunication:
      ConnectionEvent();
      ResetCommunication();
      return;
  }
}

/// CiA 402 counts NMT stop and the resets among the losses of connection of 0x6007: they disable, but are no
/// fault.
void Drive::ConnectionEvent() noexcept {
  const std::int64_t option = objects_.Find({0x6007, 0})->value;
  if (option != 0) stage_.Disconnect(option == 3 ? Stop::kRamp : Stop::kAtOnce);
}

void Drive::OnHeartbeat(int node_id, TimeNs now_ns) noexcept {
  for (Consumer& consumer : consumers_) {
    const auto setting = static_cast<std::uint32_t>(consumer.setting->value);
    if (static_cast<int>((setting >> 16) & 0x7Fu) != node_id || (setting & 0xFFFFu) == 0) continue;
    consumer.heard = true;  // monitoring begins with the first heartbeat
    consumer.deadline_ns = now_ns + static_cast<TimeNs>(setting & 0xFFFFu) * kNsPerMs;
  }
}

void Drive::OnReceivePdo(Pdo& pdo, std::size_t which, const can::CanFrame& frame) {
  if (frame.size < pdo.bytes()) {
    if (error_code_.value != kPdoTooShort) InjectEmcy(kPdoTooShort);  // once, not at every cycle
    return;
  }
  if (pdo.synchronous()) {
    received_[which] = {.fresh = true, .data = frame.data};
    return;
  }
  pdo.Unpack(frame.data);
  ActOnControlword();
  RunStage(now_ns_);
}

void Drive::OnSync(TimeNs now_ns) {
  if (!alive() || nmt_ != NmtState::kOperational) return;
  now_ns_ = now_ns;
  bool fresh = false;
  for (std::size_t i = 0; i < received_.size(); ++i) {
    if (!received_[i].fresh) continue;
    received_[i].fresh = false;
    fresh = true;
    rpdos_[i].Unpack(received_[i].data);
  }
  if (fresh) ActOnControlword();
  RunStage(now_ns);
  ShowProcessValues();
  for (const Pdo& pdo : tpdos_) {
    if (pdo.valid() && pdo.synchronous()) SendPdo(pdo);
  }
}

void Drive::SendPdo(const Pdo& pdo) {
  can::CanFrame frame;
  frame.id = pdo.cob_id();
  frame.size = static_cast<std::uint8_t>(pdo.Pack(frame.data));
  if (frame.size != 0) port_.Send(frame);
}

// ---- time
// ------------------------------------------------------------------------------------------------------

void Drive::OnTime(TimeNs now_ns) {
  if (!alive()) return;
  now_ns_ = now_ns;
  if (nmt_ == NmtState::kBootUp) Boot(now_ns);
  RunHeartbeats(now_ns);
  RunStage(now_ns);
  ShowProcessValues();
  if (nmt_ == NmtState::kOperational) SendEvents(now_ns);
}

void Drive::RunHeartbeats(TimeNs now_ns) {
  const TimeNs period_ns = heartbeat_time_.value * kNsPerMs;
  if (period_ns > 0 && now_ns >= next_heartbeat_ns_) {
    if (!heartbeat_stopped_) port_.Send(canopen::HeartbeatFrame(node_id_, nmt_));
    next_heartbeat_ns_ += period_ns * (1 + (now_ns - next_heartbeat_ns_) / period_ns);
  }
  for (Consumer& consumer : consumers_) {
    if (!consumer.heard || now_ns < consumer.deadline_ns) continue;
    consumer.heard = false;
    connection_lost_ = true;
    InjectEmcy(kHeartbeatLost);
    const std::int64_t behaviour = objects_.Find({0x1029, 1})->value;
    if (behaviour == 0 && nmt_ == NmtState::kOperational) nmt_ = NmtState::kPreOperational;
    if (behaviour == 2) nmt_ = NmtState::kStopped;
  }
}

void Drive::SendEvents(TimeNs now_ns) {
  for (std::size_t i = 0; i < tpdos_.size(); ++i) {
    if (!tpdos_[i].valid() || !tpdos_[i].on_event() || now_ns < events_[i].next_ns) continue;
    Event now{.sent = true, .size = 0, .data = {}, .next_ns = now_ns + tpdos_[i].inhibit_ns()};
    now.size = tpdos_[i].Pack(now.data);
    if (events_[i].sent && now.size == events_[i].size && now.data == events_[i].data) continue;
    events_[i] = now;
    SendPdo(tpdos_[i]);
  }
}

// ---- errors
// ----------------------------------------------------------------------------------------------------

void Drive::SendEmcy(std::uint16_t code) {
  if (nmt_ != NmtState::kPreOperational && nmt_ != NmtState::kOperational) return;
  port_.Send(canopen::EmcyFrame({.node_id = node_id_,
                                 .code = code,
                                 .error_register = static_cast<std::uint8_t>(error_register_.value),
                                 .vendor = {}}));
}

/// Safe torque off removes the power in every state. The drive reports it only while powered or enabling, and
/// refuses a fault reset while it lasts (maxon's support notes on error 0x8A88). Showing no voltage meanwhile
/// is our choice.
void Drive::SetSto(bool active) {
  sto_ = active;
  if (active && stage_.powered()) InjectEmcy(kSafeTorqueOff);
}

void Drive::InjectEmcy(std::uint16_t code) {
  if (!alive()) return;
  if (code == 0) {
    SendEmcy(code);
    return;
  }
  const canopen::EmcyInfo& info = canopen::FindEmcy(code);
  error_register_.value |= info.register_bit;
  error_code_.value = code;
  if (code == kSafeTorqueOff && sto_) sto_error_ = true;
  Object* count = objects_.Find({0x1003, 0});
  for (std::uint8_t sub = kHistory; sub > 1; --sub) {
    objects_.Find({0x1003, sub})->value = objects_.Find({0x1003, static_cast<std::uint8_t>(sub - 1)})->value;
  }
  objects_.Find({0x1003, 1})->value = code;
  count->value = std::min<std::int64_t>(count->value + 1, kHistory);

  const auto option = [this](std::uint16_t index) { return objects_.Find({index, 0})->value; };
  switch (info.reaction) {
    case canopen::EmcyReaction::kNone:
      break;
    case canopen::EmcyReaction::kDisable:
      stage_.RaiseFault(Stop::kAtOnce);
      break;
    case canopen::EmcyReaction::kFaultOption:  // 0x605E: 0 at once, 1 slow-down ramp, 2 quick-stop ramp
      stage_.RaiseFault(option(0x605E) == 0 ? Stop::kAtOnce : Stop::kRamp);
      break;
    case canopen::EmcyReaction::kAbortConnection:  // 0x6007: 0 nothing, 1 fault, 2 disable voltage, 3 quick
                                                   // stop
      if (option(0x6007) != 0) stage_.RaiseFault(option(0x6007) == 3 ? Stop::kRamp : Stop::kAtOnce);
      break;
  }
  SendEmcy(code);
}

// ---- the motor
// -------------------------------------------------------------------------------------------------

void Drive::ActOnControlword() {
  if (nominal_current_.value != rated_at_mA_) RefreshRatedTorque();  // 0x3001:01 can be mapped
  if (!SupportedMode(mode_.value)) mode_.value = mode_shown_.value;  // a PDO may carry anything
  mode_shown_.value = mode_.value;
  const PowerStage::Options options{
      .shutdown = objects_.Find({0x605B, 0})->value == 0 ? Stop::kAtOnce : Stop::kRamp,
      .disable_operation = objects_.Find({0x605C, 0})->value == 0 ? Stop::kAtOnce : Stop::kRamp,
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
  const double rated_Nm = static_cast<double>(rated_torque_.value) * 1e-6;
  const std::int64_t limit_mA =
      i2t_limits_ ? std::min(current_limit_.value, nominal_current_.value) : current_limit_.value;
  const StageDemand demand{
      .torque_mode = mode_.value == canopen::kModeCyclicSynchronousTorque,
      .target_Nm = static_cast<double>(target_torque_.value + torque_offset_.value) * 1e-3 * rated_Nm,
      .limit_Nm = static_cast<double>(limit_mA) * static_cast<double>(torque_constant_.value) * 1e-9,
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
  analog1_.value = sensors_.analog_mV[0];
  analog2_.value = sensors_.analog_mV[1];
  const double torque_uNm = sensors_.actual_torque_Nm * 1e6;
  torque_.value =
      rated_torque_.value > 0 ? Saturate16(torque_uNm * 1e3 / static_cast<double>(rated_torque_.value)) : 0;
  torque_average_.value = torque_.value;
  current_.value = torque_constant_.value > 0
                       ? std::llround(torque_uNm * 1e3 / static_cast<double>(torque_constant_.value))
                       : 0;
  current_average_.value = current_.value;
  statusword_.value = Statusword();
  sto_inputs_.value = sto_ ? 0 : kStoInputsPowered;
}

// ---- objects
// ---------------------------------------------------------------------------------------------------

std::uint32_t Drive::Read(canopen::ObjectAddress address, std::span<std::uint8_t> to, std::size_t* size) {
  ShowProcessValues();
  const Object* object = objects_.Find(address);
  if (object == nullptr)
    return canopen::HasIndex(address.index) ? sdo_abort::kNoSubIndex : sdo_abort::kNoObject;
  if (object->entry->type == canopen::DataType::kString) {
    *size = std::min(to.size(), std::strlen(object->entry->text));
    std::copy_n(object->entry->text, *size, to.begin());
    return 0;
  }
  *size = static_cast<std::size_t>(object->bytes());
  canopen::PutLe(to, static_cast<std::uint64_t>(object->value), object->bytes());
  return 0;
}

std::uint32_t Drive::Write(canopen::ObjectAddress address, std::span<const std::uint8_t> from, bool exact) {
  Object* object = objects_.Find(address);
  if (object == nullptr)
    return canopen::HasIndex(address.index) ? sdo_abort::kNoSubIndex : sdo_abort::kNoObject;
  if (object->entry->access != canopen::Access::kReadWrite) return sdo_abort::kReadOnly;
  const auto width = static_cast<std::size_t>(object->bytes());
  if (exact && from.size() > width) return sdo_abort::kLengthHigh;
  if (from.size() < width) return sdo_abort::kLengthLow;
  const std::uint64_t raw = canopen::GetLe(from, object->bytes());
  const std::int64_t value = canopen::TypeSigned(object->entry->type)
                                 ? canopen::SignExtend(raw, 8 * object->bytes())
                                 : static_cast<std::int64_t>(raw);
  if (value > object->entry->max) return sdo_abort::kValueHigh;
  if (value < object->entry->min) return sdo_abort::kValueLow;
  if (const std::uint32_t error = CheckWrite(*object, value); error != 0) return error;
  object->value = value;
  AfterWrite(*object);
  return 0;
}

std::uint32_t Drive::CheckWrite(const Object& object, std::int64_t value) {
  const canopen::ObjectAddress address = object.address();
  for (auto* pdos : {&rpdos_, &tpdos_}) {
    for (Pdo& pdo : *pdos) {
      if (!pdo.Owns(address)) continue;
      const std::uint32_t error = pdo.CheckWrite(address, value, nmt_ == NmtState::kPreOperational);
      return error != 0 ? error : CheckCollision(pdo, object, static_cast<std::uint32_t>(value));
    }
  }
  switch (address.index) {
    case 0x1010:
    case 0x1011:
      if (value != (address.index == 0x1010 ? canopen::kSignatureSave : canopen::kSignatureLoad)) {
        return sdo_abort::kTransfer;
      }
      return stage_.powered() ? sdo_abort::kDeviceState : 0;
    case 0x1016:
      return CheckConsumer(object, static_cast<std::uint32_t>(value));
    case 0x3001:  // currents and heat may change in operation, pole pairs and torque constant may not
      return (address.sub == 3 || address.sub == 5) && stage_.powered() ? sdo_abort::kDeviceState : 0;
    case 0x6076:
    case 0x6402:
      return stage_.powered() ? sdo_abort::kDeviceState : 0;
    case 0x6060:
      return SupportedMode(value) ? 0 : sdo_abort::kValueRange;
    default:
      return 0;
  }
}

/// An identifier used by two PDOs, or by a PDO and SYNC or our own EMCY, is ambiguous. A real drive reports
/// error 8150; refusing the write is our choice.
std::uint32_t Drive::CheckCollision(const Pdo& pdo, const Object& object, std::uint32_t value) const {
  if (!pdo.IsCobId(object) || (value & canopen::kPdoInvalid) != 0) return 0;
  const std::uint32_t id = value & 0x7FFu;
  bool taken = id == canopen::kSyncCobId || id == canopen::kEmcyBase + static_cast<std::uint32_t>(node_id_);
  for (const auto* pdos : {&rpdos_, &tpdos_}) {
    for (const Pdo& other : *pdos) taken = taken || (&other != &pdo && other.valid() && other.cob_id() == id);
  }
  return taken ? sdo_abort::kIncompatible : 0;
}

/// Two consumers of one node would contradict each other (CiA 301).
std::uint32_t Drive::CheckConsumer(const Object& object, std::uint32_t value) const {
  const std::uint32_t node = value >> 16, time_ms = value & 0xFFFFu;
  if (node > static_cast<std::uint32_t>(canopen::kMaxNodeId)) return sdo_abort::kValueRange;
  for (const Consumer& consumer : consumers_) {
    const auto other = static_cast<std::uint32_t>(consumer.setting->value);
    if (consumer.setting != &object && node != 0 && time_ms != 0 && (other & 0xFFFFu) != 0 &&
        (other >> 16) == node) {
      return sdo_abort::kIncompatible;
    }
  }
  return 0;
}

void Drive::AfterWrite(const Object& object) {
  const std::uint16_t index = object.entry->index;
  const std::uint8_t sub = object.entry->sub;
  if (index >= 0x1400 && index <= 0x1BFF) {
    for (auto* pdos : {&rpdos_, &tpdos_}) {
      for (Pdo& pdo : *pdos) {
        if (pdo.Owns(object.address())) pdo.Refresh();
      }
    }
    return;
  }
  switch (index) {
    case 0x1003:
      for (std::uint8_t i = 1; i <= kHistory; ++i) objects_.Find({0x1003, i})->value = 0;
      break;
    case 0x1010:  // reading returns the capability: save, restore on command
    case 0x1011:
      objects_.At(index, sub).value = object.entry->default_value;
      if (index == 0x1010) {
        objects_.Store();
      } else {
        objects_.Load();
      }
      break;
    case 0x1016:
      for (Consumer& consumer : consumers_) {
        if (consumer.setting == &object) consumer.heard = false;
      }
      break;
    case 0x1017:
      next_heartbeat_ns_ = now_ns_ + heartbeat_time_.value * kNsPerMs;
      break;
    case 0x3001:
      if (sub == 1 || sub == 5) RefreshRatedTorque();
      break;
    case 0x6040:
    case 0x6060:
      if (index == 0x6060) {
        mode_shown_.value = mode_.value;
      } else {
        ActOnControlword();
      }
      RunStage(now_ns_);
      break;
    default:
      break;
  }
}

}  // namespace tendril::emulator
