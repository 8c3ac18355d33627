// One emulated drive: start, reset, frames, time and errors; its motor is in drive_motor.cpp, what its
// objects do in drive_objects.cpp. Choices left open by CiA 301, CiA 402 and the makers are noted beside the
// code. Knows its own frames and sensors only; nothing of the rack, the robot or a wall clock.
#include "drive.h"

#include <algorithm>

#include "tendril/canopen/epos4.h"

namespace tendril::emulator {
namespace {

using canopen::NmtCommand;
using canopen::NmtState;

constexpr std::uint16_t kHeartbeatLost = 0x8130, kPdoTooShort = 0x8210;

std::array<Pdo, 4> MakePdos(ObjectDictionary& objects, bool transmit) {
  return {Pdo(objects, transmit, 1), Pdo(objects, transmit, 2), Pdo(objects, transmit, 3),
          Pdo(objects, transmit, 4)};
}

/// The load cell's input; where no object shows it, one that only the drive itself sees.
Object& AnalogInput(const canopen::DriveProfile& profile, ObjectDictionary& objects) {
  Object* shown = profile.analog_input ? objects.Find(*profile.analog_input) : nullptr;
  return shown == nullptr ? objects.At(0x3160, 1) : *shown;
}

}  // namespace

Drive::Drive(const EmulatedDriveParameters& parameters, can::CanPort& port)
    : node_id_(parameters.node_id),
      port_(port),
      profile_(parameters.profile),
      objects_(*profile_, parameters.node_id),
      rpdos_(MakePdos(objects_, false)),
      tpdos_(MakePdos(objects_, true)),
      sdo_(parameters.node_id, *this),
      error_register_(objects_.At(0x1001, 0)),
      heartbeat_time_(objects_.At(0x1017, 0)),
      nominal_current_(objects_.At(0x3001, 1)),
      current_limit_(objects_.At(0x3001, 2)),
      pole_pairs_(objects_.At(0x3001, 3)),
      thermal_time_(objects_.At(0x3001, 4)),
      torque_constant_(objects_.At(0x3001, 5)),
      sto_inputs_(objects_.At(0x3202, 1)),
      current_average_(objects_.At(0x30D1, 1)),
      current_(objects_.At(0x30D1, 2)),
      torque_average_(objects_.At(0x30D2, 1)),
      analog1_(AnalogInput(*profile_, objects_)),
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
      deceleration_(objects_.At(0x6085, 0)),
      max_torque_(objects_.Find({0x6072, 0})) {
  const auto make = [this](std::uint16_t index, std::uint8_t sub, std::int64_t value) {
    Object& object = objects_.At(index, sub);
    object.value = object.factory = object.power_on = value;
  };
  if (parameters.product_code) make(0x1018, 2, *parameters.product_code);
  if (parameters.revision) make(0x1018, 3, *parameters.revision);
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

// ---- start and reset ---------------------------------------------------------------------------

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
  if (!in_fault &&
      canopen::FindEmcy(profile_->emcy, static_cast<std::uint16_t>(error_code_.value)).register_bit ==
          canopen::error_register::kCommunication) {
    error_register_.value &= ~std::int64_t{canopen::error_register::kCommunication};
    error_code_.value = 0;
  }
  const std::int64_t active_errors = error_register_.value;  // shown in 0x1001, but a device state
  std::array<std::int64_t, kHistory + 1> history{};
  for (std::uint8_t i = 0; i <= kHistory; ++i) history[i] = objects_.At(0x1003, i).value;
  objects_.Restore(0x1000, 0x1FFF);
  error_register_.value = active_errors;
  for (std::uint8_t i = 0; i <= kHistory; ++i) objects_.At(0x1003, i).value = history[i];
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
  const std::uint32_t rated_uNm = canopen::RatedTorque_uNm(
      static_cast<std::uint32_t>(nominal_current_.value), static_cast<std::uint32_t>(torque_constant_.value));
  const std::uint32_t unit_uNm = profile_->rated_torque_unit_uNm;
  rated_torque_.value = (rated_uNm + unit_uNm / 2) / unit_uNm;
}

// ---- sensors -----------------------------------------------------------------------------------

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

// ---- frames ------------------------------------------------------------------------------------

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
  const std::int64_t option = objects_.At(0x6007, 0).value;
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

// ---- time --------------------------------------------------------------------------------------

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
    const std::int64_t behaviour = objects_.At(0x1029, 1).value;
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

// ---- errors ------------------------------------------------------------------------------------

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
  const canopen::EmcyInfo& info = canopen::FindEmcy(profile_->emcy, code);
  error_register_.value |= info.register_bit;
  error_code_.value = code;
  if (code == kSafeTorqueOff && sto_) sto_error_ = true;
  Object& count = objects_.At(0x1003, 0);
  for (std::uint8_t sub = kHistory; sub > 1; --sub) {
    objects_.At(0x1003, sub).value = objects_.At(0x1003, static_cast<std::uint8_t>(sub - 1)).value;
  }
  objects_.At(0x1003, 1).value = code;
  count.value = std::min<std::int64_t>(count.value + 1, kHistory);

  const auto option = [this](std::uint16_t index) { return objects_.At(index, 0).value; };
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

}  // namespace tendril::emulator
