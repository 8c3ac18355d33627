// What a node makes of the frames of its drive: feedback, statusword, emergencies, heartbeats, SDO responses.
// Knows no other node and no port.
#include <cmath>

#include "node.h"

namespace tendril::canopen {
namespace {

constexpr TimeNs kNmtGrace_ns = 50 * kNsPerMs;  // heartbeats sent before NMT start may still arrive
// A restarted drive answers no SYNC. Three answers, because the fault injector may delay one or two.
constexpr int kAnswersAfterBootUp = 3, kSyncsAfterBootUp = 5;
// Consecutive requests answered twice alike: duplication of a single frame is rare, of eight in a row it is
// not chance.
constexpr int kAnsweredTwice = 8;

bool Decode(const PdoLayout& pdo, const can::CanFrame& frame, PdoValues& values) noexcept {
  return frame.size == pdo.bytes() && DecodePdo({pdo.entries.data(), static_cast<std::size_t>(pdo.count)},
                                                {frame.data.data(), frame.size}, values);
}

}  // namespace

bool Node::OnFeedback(const can::CanFrame& frame, TimeNs now_ns) noexcept {
  if (!started()) return true;  // not mapped yet
  PdoValues values{};
  if (!Decode(pdos().feedback, frame, values)) return false;
  if (after_boot_up_ > 0) {
    OnAnswerAfterBootUp(now_ns);
    return true;
  }
  if (answers_.OnAnswer(frame.data)) {
    Report(now_ns, Status::kNodeIdShared,
           "two drives have this node id: each SYNC is answered by two TPDO 0x%03X",
           TpdoCobId(pdos().feedback.number, id_));
    FailTwice(now_ns);
    return true;
  }
  feedback_.position_counts = static_cast<std::int32_t>(values[slots_.position]);
  feedback_.torque_permille = FromDrive(static_cast<std::int16_t>(values[slots_.torque]));
  if (profile_->analog_input)
    feedback_.analog_mV =
        Saturate16(profile_->analog_mV_per_count * static_cast<double>(values[slots_.analog]));
  feedback_.age_cycles = 0;
  if (phase_ == Phase::kScript && action().kind == BootAction::Kind::kStart) NextAction(now_ns);
  return true;
}

/// A drive that has just restarted is not operational; an answer comes from another one with its node id.
void Node::OnAnswerAfterBootUp(TimeNs now_ns) noexcept {
  if (after_boot_up_ > 1) {
    --after_boot_up_;
    return;
  }
  Report(now_ns, Status::kNodeIdShared,
         "two drives have this node id: one still answers SYNC after the other's boot-up message");
  FailTwice(now_ns);
}

bool Node::OnStatus(const can::CanFrame& frame, TimeNs now_ns) noexcept {
  if (!started() || phase_ == Phase::kLost) return true;
  PdoValues values{};
  if (!Decode(pdos().status, frame, values)) return false;
  OnStatusword(static_cast<std::uint16_t>(values[slots_.statusword]), now_ns);
  return true;
}

void Node::OnStatusword(std::uint16_t statusword, TimeNs now_ns) noexcept {
  const std::uint16_t before = feedback_.statusword;
  const DriveMachine was = machine();
  feedback_.statusword = statusword;
  if (phase_ != Phase::kReady) return;
  const DriveMachine is = machine();
  const std::uint16_t rising = static_cast<std::uint16_t>(statusword & ~before);
  if (rising & statusword::kInternalLimit) {
    Report(now_ns, Status::kLimitedByDrive, "internal limit active (statusword 0x%04X)", statusword);
  }
  if (rising & statusword::kWarning) {
    Report(now_ns, Status::kDriveWarning, "warning bit set (statusword 0x%04X)", statusword);
  }
  const bool in_fault = is == DriveMachine::kFault || is == DriveMachine::kFaultReactionActive;
  if (reset_ == Reset::kHigh && !in_fault) {
    reset_ = Reset::kNone;
    latched_ = false;
    feedback_.error_code = 0;
    Report(now_ns, Status::kOk, "fault reset: now %s", DriveMachineText(is));
  } else if (in_fault && !latched_) {
    Report(
        now_ns, Status::kDriveFault, "%s (statusword 0x%04X, error 0x%04X %s)", DriveMachineText(is),
        statusword, feedback_.error_code,
        feedback_.error_code == 0 ? "not reported yet" : FindEmcy(profile_->emcy, feedback_.error_code).text);
    Latch(now_ns);
  } else if (holds_ && is != DriveMachine::kOperationEnabled && !latched_) {
    Report(now_ns, Status::kDriveFault, "left operation enabled by itself: %s (statusword 0x%04X)",
           DriveMachineText(is), statusword);
    Latch(now_ns);
  }
  if (walking_ && is == DriveMachine::kOperationEnabled) {
    walking_ = false;
    holds_ = true;
  } else if (walking_ && is != was) {
    refresh_ns_ = now_ns + kStatusRefresh_ns;
  }
  UpdateState();
}

void Node::OnEmcy(const EmcyMessage& emcy, TimeNs now_ns) noexcept {
  if (phase_ == Phase::kIdle) return;
  const EmcyInfo& info = FindEmcy(profile_->emcy, emcy.code);
  if (emcy.code == 0) {
    if (!latched_) feedback_.error_code = 0;
    Report(now_ns, Status::kOk, "EMCY 0x0000: errors cleared");
    return;
  }
  feedback_.error_code = emcy.code;
  // A drive that is being booted may still send old status; its state is read when the boot ends.
  if (phase_ == Phase::kReady) Latch(now_ns);
  Report(now_ns, Status::kDriveFault, "EMCY 0x%04X (register 0x%02X) %s: %s; %s", emcy.code,
         emcy.error_register, info.text, info.cause, info.remedy);
  UpdateState();
}

void Node::OnHeartbeat(NmtState state, TimeNs now_ns) noexcept {
  if (heartbeat_watched_) heartbeat_deadline_ns_ = now_ns + heartbeat_timeout_ns_;
  if (state == NmtState::kBootUp) {
    switch (phase_) {
      case Phase::kIdle:
        return;
      case Phase::kWaitBootUp:
        // A boot-up message from before our reset was sent does not count: the reset would interrupt the
        // boot.
        if (!nmt_waits_) BeginScript(now_ns);
        return;
      case Phase::kScript:
        // Before the first request: the same restart again, or that of a second drive, which its answers will
        // show.
        if (at_ == 0 && sdo_.pending() != nullptr) return;
        Report(now_ns, Status::kDriveLost, "%s: restarted during its boot: beginning again", action().step);
        BeginScript(now_ns);
        return;
      case Phase::kFailed:
      case Phase::kLost:
        if (ever_ready_) return;
        boot_deadline_ns_ = now_ns + boot_timeout_ns_;
        BeginScript(now_ns);
        return;
      case Phase::kReady:
        Report(now_ns, Status::kDriveLost,
               "unexpected boot-up: the drive restarted (power, watchdog or NMT reset)");
        Lose(now_ns);
        // If a second drive with this id restarted, the first one still applies its last torque.
        stops_ = true;
        stop_again_ns_ = now_ns + kSyncsAfterBootUp * cycle_ns_;
        after_boot_up_ = kAnswersAfterBootUp;
        return;
    }
  }
  if (started() && phase_ != Phase::kLost && state != NmtState::kOperational &&
      now_ns >= started_ns_ + kNmtGrace_ns) {
    // NMT commands are unacknowledged: resend until the boot's deadline, in case one was lost.
    if (phase_ == Phase::kScript && action().kind == BootAction::Kind::kStart) {
      QueueNmt(NmtCommand::kStart);
      return;
    }
    Report(now_ns, Status::kDriveLost, "NMT state changed to %s without a request", NmtStateText(state));
    Lose(now_ns);
  }
}

// ---- SDO responses ------------------------------------------------------------------------------

void Node::OnSdo(const can::CanFrame& frame, TimeNs now_ns) noexcept {
  const bool was_busy = sdo_.busy();
  sdo_.OnFrame(frame);
  if (was_busy && !sdo_.busy()) OnTransferEnd(now_ns);
  CheckReplies(frame, now_ns);
}

/// Two servers on one node id: a second reply to one request.
void Node::CheckReplies(const can::CanFrame& frame, TimeNs now_ns) noexcept {
  using Surplus = ReplyWatch::Surplus;
  const Surplus surplus = replies_.OnReply(frame);
  const bool in_use = phase_ == Phase::kScript || phase_ == Phase::kReady;
  if (!in_use || surplus == Surplus::kNone) return;
  const ObjectAddress address = DecodeSdoResponse(frame).address;
  const auto [first, second] = replies_.values();
  if (surplus == Surplus::kDifferent && address == ObjectAddress{0x1018, 4}) {
    Report(now_ns, Status::kNodeIdShared, "two drives have this node id: serial numbers %u and %u", first,
           second);
  } else if (surplus == Surplus::kDifferent) {
    Report(now_ns, Status::kNodeIdShared,
           "two drives have this node id: %04X:%02X was answered 0x%X and 0x%X", address.index, address.sub,
           first, second);
  } else if (replies_.in_a_row() >= kAnsweredTwice) {
    Report(now_ns, Status::kNodeIdShared,
           "two drives have this node id (or the bus repeats its frames): %d SDO requests in a row were "
           "answered twice alike",
           replies_.in_a_row());
  } else {
    return;
  }
  FailTwice(now_ns);
}

/// The event was reported already. Both drives follow the same torque: if started, both are disabled.
void Node::FailTwice(TimeNs now_ns) noexcept {
  const bool was_started = started();
  Fail(DriveState::kIdTwice);
  stops_ = was_started;
  stop_again_ns_ = now_ns;
}

}  // namespace tendril::canopen
