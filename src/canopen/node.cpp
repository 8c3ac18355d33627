// One drive's orders, time-outs, faults and what is sent to it; its boot is in node_boot.cpp, what it sends
// in node_frames.cpp. Knows no other node and no port.
#include "node.h"

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>

namespace tendril::canopen {
namespace {

constexpr TimeNs kWalk_ns = 2000 * kNsPerMs;      // from a request to operation enabled
constexpr TimeNs kDisable_ns = 500 * kNsPerMs;    // from a request to disabled; then NMT takes the power away
constexpr TimeNs kStopAgain_ns = 200 * kNsPerMs;  // NMT stop is unacknowledged, and may get lost

}  // namespace

Node::Slots::Slots(const DriveProfile& profile) {
  const auto place = [](const PdoLayout& pdo, ObjectAddress object) {
    return static_cast<std::size_t>(std::max(Slot(pdo, object.index, object.sub), 0));
  };
  controlword = place(profile.pdos.torque, {0x6040, 0});
  target_torque = place(profile.pdos.torque, {0x6071, 0});
  position = place(profile.pdos.feedback, {0x6064, 0});
  torque = place(profile.pdos.feedback, {0x6077, 0});
  analog = profile.analog_input ? place(profile.pdos.feedback, *profile.analog_input) : 0;
  statusword = place(profile.pdos.status, {0x6041, 0});
}

std::int16_t Node::Saturate16(double value) noexcept {
  constexpr double kMost = std::numeric_limits<std::int16_t>::max();
  return static_cast<std::int16_t>(std::lround(std::clamp(value, -kMost - 1, kMost)));
}

Node::Node(const BusParameters& bus, const DriveSetup& drive, EventRing& events)
    : id_(drive.node_id),
      profile_(drive.profile),
      slots_(*profile_),
      script_(profile_->boot_script(*profile_, bus, drive)),
      product_codes_(bus.identity.product_codes),
      rated_torque_uNm_(drive.rated_torque_uNm),
      cycle_ns_(bus.cycle_ns),
      sdo_timeout_ns_(bus.sdo_timeout_ms * kNsPerMs),
      boot_timeout_ns_(bus.boot_timeout_ms * kNsPerMs),
      heartbeat_timeout_ns_(bus.heartbeat_ms > 0 ? bus.heartbeat_timeout_ms * kNsPerMs : 0),
      events_(events),
      sdo_(drive.node_id),
      // An answer later than the heartbeat time-out is that of a lost drive; the last SYNC's may always be
      // outstanding.
      answers_(std::max(2, static_cast<int>(std::max(heartbeat_timeout_ns_, sdo_timeout_ns_) / cycle_ns_))) {
  feedback_.age_cycles = kNeverHeard;
}

void Node::Report(TimeNs now_ns, Status status, const char* format, ...) noexcept {
  BusEvent event;
  event.time_ns = now_ns;
  event.status = status;
  event.node_id = id_;
  const int lead = std::snprintf(event.text.data(), event.text.size(), "node %d: ", id_);
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(event.text.data() + lead, event.text.size() - static_cast<std::size_t>(lead), format,
                 arguments);
  va_end(arguments);
  events_.Push(event);
}

// ---- orders -------------------------------------------------------------------------------------

void Node::ClearFault(TimeNs now_ns) noexcept {
  switch (phase_) {
    case Phase::kIdle:
      return;
    case Phase::kWaitBootUp:
    case Phase::kScript:
      reset_after_boot_ = true;
      return;
    case Phase::kFailed:
    case Phase::kLost:
      Boot(now_ns, true);
      return;
    case Phase::kReady:
      break;
  }
  if (!latched_) return;
  rebooted_for_reset_ = false;
  reset_ = Reset::kLow;
  reset_deadline_ns_ = now_ns + kFaultReset_ns;
  refresh_ns_ = now_ns + kStatusRefresh_ns;
}

void Node::OnBusDown(TimeNs now_ns) noexcept {
  if (phase_ == Phase::kIdle || phase_ == Phase::kFailed) return;
  Lose(now_ns);
}

void Node::OnBusUp(TimeNs now_ns) noexcept {
  if (phase_ == Phase::kLost || phase_ == Phase::kFailed) Boot(now_ns, reset_after_boot_);
}

bool Node::Release() noexcept {
  if (phase_ != Phase::kReady || released_) return true;
  if (transfer_ == Transfer::kNone) {
    WriteObject({0x1016, 1}, 0);
    transfer_ = Transfer::kRelease;
  }
  return false;
}

// ---- time ---------------------------------------------------------------------------------------

void Node::BeginCycle(TimeNs now_ns) noexcept {
  if (feedback_.age_cycles < kNeverHeard) ++feedback_.age_cycles;
  const bool was_busy = sdo_.busy();
  sdo_.Poll(now_ns);
  if (was_busy && !sdo_.busy()) OnTransferEnd(now_ns);

  // A drive without a heartbeat gets no more torque frames; NMT stop disables it in case it still applies the
  // last one.
  const bool given_up = phase_ == Phase::kLost || phase_ == Phase::kFailed;
  if (given_up && stops_ && now_ns >= stop_again_ns_) {
    after_boot_up_ = 0;
    stop_again_ns_ = now_ns + kStopAgain_ns;
    QueueNmt(NmtCommand::kStop);
  }
  if (phase_ == Phase::kWaitBootUp && transfer_ == Transfer::kNone && now_ns >= probe_ns_) {
    Read({0x1000, 0}, Transfer::kProbe);
  }
  const bool booting = phase_ == Phase::kWaitBootUp || phase_ == Phase::kScript;
  if (booting && now_ns >= boot_deadline_ns_) {
    const int limit_ms = static_cast<int>(boot_timeout_ns_ / kNsPerMs);
    // A drive that answers but never reads back the written value refused it.
    const bool refuses =
        phase_ == Phase::kScript && action().kind == BootAction::Kind::kConfirm && tries_ == 1;
    if (phase_ == Phase::kWaitBootUp) {
      Report(now_ns, Status::kBootFailed,
             "boot-up: no message and no answer to read 1000:00 in %d ms: check power, wiring, node id, bit "
             "rate",
             limit_ms);
    } else if (action().kind == BootAction::Kind::kStart) {
      Report(now_ns, Status::kBootFailed, "%s: no TPDO 0x%03X after SYNC in %d ms", action().step,
             TpdoCobId(pdos().feedback.number, id_), limit_ms);
    } else {
      Report(now_ns, Status::kBootFailed, "%s: %04X:%02X not settled within bus.boot_timeout_ms = %d",
             action().step, action().address.index, action().address.sub, limit_ms);
    }
    Fail(refuses ? MismatchOf(action().address) : DriveState::kOffline);
    return;
  }
  if (heartbeat_watched_ && now_ns >= heartbeat_deadline_ns_) {
    Report(now_ns, Status::kDriveLost, "no heartbeat for %d ms",
           static_cast<int>(heartbeat_timeout_ns_ / kNsPerMs));
    Lose(now_ns);
    stops_ = true;
    stop_again_ns_ = now_ns;
    return;
  }
  if (phase_ == Phase::kReady) CheckProgress(now_ns);
}

/// Detects requests that the drive does not fulfil in time.
void Node::CheckProgress(TimeNs now_ns) noexcept {
  if ((walking_ || off_first_ || reset_ != Reset::kNone) && now_ns >= refresh_ns_) RefreshStatusword(now_ns);
  if (walking_ && now_ns >= walk_deadline_ns_) {
    Report(now_ns, Status::kDriveFault, "enabling: stuck in %s (statusword 0x%04X)",
           DriveMachineText(machine()), feedback_.statusword);
    Latch(now_ns);
    UpdateState();
  }
  if (reset_ != Reset::kNone && now_ns >= reset_deadline_ns_) {
    reset_ = Reset::kNone;
    Report(now_ns, Status::kDriveFault, "fault reset: still in %s (statusword 0x%04X, error 0x%04X %s)%s",
           DriveMachineText(machine()), feedback_.statusword, feedback_.error_code,
           FindEmcy(profile_->emcy, feedback_.error_code).text,
           rebooted_for_reset_ ? "" : ": booting it again");
    // A drive that lost our heartbeat accepts a fault reset only after NMT reset communication.
    if (!rebooted_for_reset_) Boot(now_ns, true);
  }
}

void Node::RefreshStatusword(TimeNs now_ns) noexcept {
  refresh_ns_ = now_ns + kStatusRefresh_ns;
  if (transfer_ == Transfer::kNone) Read({0x6041, 0}, Transfer::kStatusword);
}

// ---- faults -------------------------------------------------------------------------------------

/// The event was reported already. `state`: why the node cannot be used.
void Node::Fail(DriveState state) noexcept {
  sdo_.Reset();
  transfer_ = Transfer::kNone;
  nmt_waits_ = false;
  phase_ = Phase::kFailed;
  started_ = heartbeat_watched_ = stops_ = false;
  after_boot_up_ = 0;
  feedback_.state = state;
}

/// The event was reported already.
void Node::Lose(TimeNs) noexcept {
  sdo_.Reset();
  transfer_ = Transfer::kNone;
  nmt_waits_ = false;
  phase_ = Phase::kLost;
  started_ = heartbeat_watched_ = may_enable_ = holds_ = walking_ = stops_ = false;
  after_boot_up_ = 0;
  reset_ = Reset::kNone;
  UpdateState();
}

void Node::Latch(TimeNs) noexcept {
  latched_ = true;
  may_enable_ = holds_ = walking_ = false;
}

void Node::UpdateState() noexcept {
  switch (phase_) {
    case Phase::kIdle:
    case Phase::kLost:
      feedback_.state = DriveState::kOffline;
      return;
    case Phase::kWaitBootUp:
    case Phase::kScript:
      feedback_.state = DriveState::kBooting;
      return;
    case Phase::kFailed:
      return;
    case Phase::kReady:
      break;
  }
  if (machine() == DriveMachine::kQuickStopActive) {
    feedback_.state = DriveState::kQuickStop;
  } else if (latched_) {
    feedback_.state = DriveState::kFault;
  } else {
    feedback_.state = powered() ? DriveState::kEnabled : DriveState::kReady;
  }
}

// ---- frames out ---------------------------------------------------------------------------------

void Node::QueueNmt(NmtCommand command) noexcept {
  nmt_frame_ = NmtFrame(command, id_);
  nmt_waits_ = true;
}

const can::CanFrame* Node::pending() const noexcept { return nmt_waits_ ? &nmt_frame_ : sdo_.pending(); }

void Node::PendingSent(TimeNs now_ns) noexcept {
  if (!nmt_waits_) {
    replies_.OnRequest(*sdo_.pending());
    sdo_.FrameSent(now_ns);
    return;
  }
  nmt_waits_ = false;
  if (phase_ == Phase::kScript) {
    started_ = true;
    started_ns_ = now_ns;
  }
}

std::uint16_t Node::ControlwordOfReset(TimeNs now_ns) noexcept {
  if (reset_ == Reset::kLow) {
    // One cycle with the bit low gives a rising edge; then the drive must have ended its fault reaction.
    if (machine() != DriveMachine::kFaultReactionActive) reset_ = Reset::kHigh;
    return controlword::kDisableVoltage;
  }
  // Latched although the drive is not in fault: nothing to wait for.
  if (machine() != DriveMachine::kFault && machine() != DriveMachine::kFaultReactionActive) {
    OnStatusword(feedback_.statusword, now_ns);
    return controlword::kDisableVoltage;
  }
  return controlword::kFaultReset;
}

bool Node::MakeRpdo(TimeNs now_ns, DriveRequest request, std::int16_t torque_permille,
                    can::CanFrame* frame) noexcept {
  if (phase_ != Phase::kReady) return false;
  std::uint16_t command = controlword::kDisableVoltage;
  std::int16_t torque = 0;
  if (reset_ != Reset::kNone) {
    command = ControlwordOfReset(now_ns);
  } else if (request == DriveRequest::kDisable) {
    may_enable_ = !latched_;
    walking_ = holds_ = false;
    if (powered() && !off_first_) {
      refresh_ns_ = now_ns + kStatusRefresh_ns;
      disable_deadline_ns_ = now_ns + kDisable_ns;
    } else if (powered() && now_ns >= disable_deadline_ns_) {
      // Its torque frames may be lost while other frames arrive.
      disable_deadline_ns_ = now_ns + kDisable_ns;
      Report(now_ns, Status::kDriveFault, "still enabled %d ms after the disable request: stopped by NMT",
             static_cast<int>(kDisable_ns / kNsPerMs));
      QueueNmt(NmtCommand::kStop);
    }
    off_first_ = powered();
  } else if (may_enable_ && !(off_first_ && powered())) {
    off_first_ = false;
    command = ControlwordTowardsEnabled(machine());
    if (powered()) {
      holds_ = true;
      torque = torque_permille;
    } else if (!walking_) {
      walking_ = true;
      walk_deadline_ns_ = now_ns + kWalk_ns;
      refresh_ns_ = now_ns + kStatusRefresh_ns;
    }
  }
  const PdoLayout& pdo = pdos().torque;
  PdoValues values{};
  values[slots_.controlword] = command;
  values[slots_.target_torque] = ToDrive(torque);
  frame->id = RpdoCobId(pdo.number, id_);
  frame->size = static_cast<std::uint8_t>(
      EncodePdo({pdo.entries.data(), static_cast<std::size_t>(pdo.count)}, values, frame->data));
  return true;
}

}  // namespace tendril::canopen
