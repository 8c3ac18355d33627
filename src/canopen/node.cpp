// One drive's boot, state machine and faults.
// Knows no other node and no port.
#include "node.h"

#include <algorithm>
#include <cstdarg>
#include <cstdio>
#include <limits>

#include "tendril/canopen/epos4.h"

namespace tendril::canopen {
namespace {

constexpr int kTries = 3;                           // of each SDO transfer during boot
constexpr TimeNs kBootUpWait_ns = 1000 * kNsPerMs;  // then the node is polled
constexpr TimeNs kNmtGrace_ns = 50 * kNsPerMs;      // heartbeats sent before NMT start may still arrive
constexpr TimeNs kWalk_ns = 2000 * kNsPerMs;        // from a request to operation enabled
constexpr TimeNs kDisable_ns = 500 * kNsPerMs;  // from a request to disabled; then NMT takes the power away
constexpr TimeNs kFaultReset_ns = 1000 * kNsPerMs;
constexpr TimeNs kStopAgain_ns = 200 * kNsPerMs;  // NMT stop is unacknowledged, and may get lost
// A lost statusword TPDO is replaced by a read after this.
constexpr TimeNs kStatusRefresh_ns = 200 * kNsPerMs;
// A restarted drive answers no SYNC. Three answers, because the fault injector may delay one or two.
constexpr int kAnswersAfterBootUp = 3, kSyncsAfterBootUp = 5;
// Consecutive requests answered twice alike: duplication of a single frame is rare, of eight in a row it is
// not chance.
constexpr int kAnsweredTwice = 8;
constexpr std::uint16_t kNeverHeard = std::numeric_limits<std::uint16_t>::max();

using ValueText = std::array<char, 24>;

/// Communication objects and identities are printed in hexadecimal, others in decimal.
ValueText TextOf(ObjectAddress address, std::int64_t value) noexcept {
  ValueText text{};
  const bool hexadecimal = address.index < 0x2000 || address.index == 0x6502;
  std::snprintf(text.data(), text.size(), hexadecimal ? "0x%llX" : "%lld", static_cast<long long>(value));
  return text;
}

int WidthOf(ObjectAddress address) noexcept {
  const ObjectEntry* entry = FindObject(address);
  return entry == nullptr ? 4 : TypeBytes(entry->type);
}

/// Objects that identify a device, rather than configure it.
bool IsIdentity(ObjectAddress address) noexcept {
  return address.index == 0x1000 || address.index == 0x1018 || address.index == 0x6502;
}

DriveState MismatchOf(ObjectAddress address) noexcept {
  return IsIdentity(address) ? DriveState::kOtherDevice : DriveState::kMisconfigured;
}

bool IsCobId(ObjectAddress address) noexcept {
  return address.sub == 1 && ((address.index >= 0x1400 && address.index < 0x1600) ||
                              (address.index >= 0x1800 && address.index < 0x1A00));
}

bool Decode(const PdoLayout& pdo, const can::CanFrame& frame, PdoValues& values) noexcept {
  return frame.size == pdo.bytes() && DecodePdo({pdo.entries.data(), static_cast<std::size_t>(pdo.count)},
                                                {frame.data.data(), frame.size}, values);
}

}  // namespace

Node::Node(const BusParameters& bus, const DriveSetup& drive, EventRing& events)
    : id_(drive.node_id),
      script_(MakeBootScript(bus, drive)),
      product_codes_(bus.identity.product_codes),
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
  FindObject({0x1000, 0});  // builds the table here, not in a cycle
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

// ---- boot ---------------------------------------------------------------------------------------

void Node::Boot(TimeNs now_ns, bool reset_fault) noexcept {
  sdo_.Reset();
  transfer_ = Transfer::kNone;
  phase_ = Phase::kWaitBootUp;
  ever_ready_ = false;
  reset_after_boot_ = reset_fault;
  rebooted_for_reset_ = reset_fault;
  boot_deadline_ns_ = now_ns + boot_timeout_ns_;
  probe_ns_ = now_ns + std::min(kBootUpWait_ns, boot_timeout_ns_ / 2);
  started_ = heartbeat_watched_ = latched_ = may_enable_ = holds_ = walking_ = released_ = false;
  after_boot_up_ = 0;
  reset_ = Reset::kNone;
  feedback_.age_cycles = kNeverHeard;
  feedback_.statusword = 0;
  QueueNmt(NmtCommand::kResetCommunication);
  UpdateState();
}

void Node::BeginScript(TimeNs now_ns) noexcept {
  phase_ = Phase::kScript;
  at_ = 0;
  started_ = heartbeat_watched_ = false;
  after_boot_up_ = 0;
  answers_.Restart();
  sdo_.Reset();
  UpdateState();
  BeginAction(now_ns);
}

void Node::BeginAction(TimeNs now_ns) noexcept {
  tries_ = 1;
  switch (action().kind) {
    case BootAction::Kind::kWrite:
      WriteObject(action().address, action().value);
      return;
    case BootAction::Kind::kStart:
      started_ns_ = now_ns;
      QueueNmt(NmtCommand::kStart);
      return;
    default:
      Read(action().address, Transfer::kRead);
      return;
  }
}

void Node::NextAction(TimeNs now_ns) noexcept {
  // The node has a heartbeat producer time from here on.
  if (action().address == ObjectAddress{0x1017, 0} && heartbeat_timeout_ns_ > 0) {
    heartbeat_watched_ = true;
    heartbeat_deadline_ns_ = now_ns + heartbeat_timeout_ns_;
  }
  ++at_;
  if (at_ < script_.size()) {
    BeginAction(now_ns);
  } else {
    FinishBoot(now_ns);
  }
}

void Node::FinishBoot(TimeNs now_ns) noexcept {
  phase_ = Phase::kReady;
  ever_ready_ = true;
  const DriveMachine state = machine();
  Report(now_ns, Status::kOk, "configured: product 0x%08X, serial %u, state %s", product_code_, serial_,
         DriveMachineText(state));
  const bool in_fault = state == DriveMachine::kFault || state == DriveMachine::kFaultReactionActive;
  if (in_fault) {
    Latch(now_ns);
    if (reset_after_boot_) {
      reset_ = Reset::kLow;
      reset_deadline_ns_ = now_ns + kFaultReset_ns;
      refresh_ns_ = now_ns + kStatusRefresh_ns;
    } else {
      Report(now_ns, Status::kDriveFault, "was in fault before it was configured, error 0x%04X %s: clear",
             feedback_.error_code, FindEmcy(feedback_.error_code).text);
    }
  } else {
    feedback_.error_code = 0;
  }
  reset_after_boot_ = false;
  UpdateState();
}

void Node::Read(ObjectAddress address, Transfer transfer) noexcept {
  transfer_ = transfer;
  sdo_.Upload(address, sdo_timeout_ns_);
}

void Node::WriteObject(ObjectAddress address, std::int64_t value) noexcept {
  written_ = value;
  transfer_ = Transfer::kWrite;
  std::array<std::uint8_t, 8> data{};
  const int width = WidthOf(address);
  PutLe(data, static_cast<std::uint64_t>(value), width);
  sdo_.Download(address, {data.data(), static_cast<std::size_t>(width)}, sdo_timeout_ns_);
}

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

void Node::OnTransferEnd(TimeNs now_ns) noexcept {
  if (sdo_.state() != SdoClient::State::kDone) {
    OnTransferFailed(now_ns);
    return;
  }
  const Transfer ended = transfer_;
  transfer_ = Transfer::kNone;
  switch (ended) {
    case Transfer::kNone:
      return;
    case Transfer::kProbe:
      if (phase_ == Phase::kWaitBootUp) BeginScript(now_ns);
      return;
    case Transfer::kWrite:
      tries_ = 1;
      Read(sdo_.address(), Transfer::kReadBack);
      return;
    case Transfer::kRelease:
      released_ = true;
      return;
    case Transfer::kRead:
    case Transfer::kReadBack:
    case Transfer::kStatusword:
      break;
  }
  const ObjectEntry* entry = FindObject(sdo_.address());
  const int width = TypeBytes(entry->type);
  if (static_cast<int>(sdo_.data().size()) < width) {
    if (ended == Transfer::kStatusword) return;
    Report(now_ns, Status::kConfigurationMismatch, "%s: %04X:%02X has %d bytes, expected %d", action().step,
           entry->index, entry->sub, static_cast<int>(sdo_.data().size()), width);
    Fail(MismatchOf(sdo_.address()));
    return;
  }
  // Servers that announce no size send four bytes; the object's width applies.
  const std::uint64_t raw = GetLe(sdo_.data(), width);
  const std::int64_t value =
      TypeSigned(entry->type) ? SignExtend(raw, 8 * width) : static_cast<std::int64_t>(raw);
  if (ended == Transfer::kStatusword) {
    OnStatusword(static_cast<std::uint16_t>(value), now_ns);
  } else if (ended == Transfer::kReadBack) {
    OnReadBack(value, now_ns);
  } else {
    OnRead(value, now_ns);
  }
}

void Node::OnTransferFailed(TimeNs now_ns) noexcept {
  const bool timed_out = sdo_.state() == SdoClient::State::kTimedOut;
  const Transfer failed = transfer_;
  const ObjectAddress address = sdo_.address();
  switch (failed) {
    case Transfer::kNone:
    case Transfer::kStatusword:
      transfer_ = Transfer::kNone;
      return;
    case Transfer::kRelease:
      transfer_ = Transfer::kNone;
      released_ = true;  // it will detect our silence; nothing more can be done
      return;
    case Transfer::kProbe:
      // An abort is an answer too: the node is present.
      transfer_ = Transfer::kNone;
      if (!timed_out && phase_ == Phase::kWaitBootUp) BeginScript(now_ns);
      return;
    case Transfer::kRead:
    case Transfer::kReadBack:
    case Transfer::kWrite:
      break;
  }
  if (timed_out && tries_ < kTries) {
    ++tries_;
    if (failed == Transfer::kWrite) {
      WriteObject(address, written_);
    } else {
      Read(address, failed);
    }
    return;
  }
  std::array<char, 40> what{};
  if (failed == Transfer::kWrite) {
    std::snprintf(what.data(), what.size(), "write %04X:%02X = %s", address.index, address.sub,
                  TextOf(address, written_).data());
  } else {
    std::snprintf(what.data(), what.size(), "read %04X:%02X", address.index, address.sub);
  }
  if (timed_out) {
    Report(now_ns, Status::kBootFailed, "%s: %s: no answer (%d tries of %d ms)", action().step, what.data(),
           tries_, static_cast<int>(sdo_timeout_ns_ / kNsPerMs));
  } else {
    Report(now_ns, Status::kBootFailed, "%s: %s: abort %08X %s", action().step, what.data(),
           sdo_.abort_code(), AbortText(sdo_.abort_code()));
  }
  // A node that refuses is present.
  Fail(timed_out ? DriveState::kOffline : MismatchOf(address));
}

void Node::OnRead(std::int64_t value, TimeNs now_ns) noexcept {
  const BootAction& a = action();
  const ValueText text = TextOf(a.address, value);
  bool matches = true;
  switch (a.kind) {
    case BootAction::Kind::kDisablePdo:
      WriteObject(a.address, value | kPdoInvalid);
      return;
    case BootAction::Kind::kConfirm:
      if (value == a.value) {
        NextAction(now_ns);
      } else {
        Read(a.address, Transfer::kRead);  // until the boot's deadline
      }
      return;
    case BootAction::Kind::kNote:
      if (a.address.index == 0x1018) serial_ = static_cast<std::uint32_t>(value);
      if (a.address.index == 0x603F) feedback_.error_code = static_cast<std::uint16_t>(value);
      if (a.address.index == 0x6041) feedback_.statusword = static_cast<std::uint16_t>(value);
      NextAction(now_ns);
      return;
    case BootAction::Kind::kExpectProduct:
      product_code_ = static_cast<std::uint32_t>(value);
      matches =
          std::find(product_codes_.begin(), product_codes_.end(), product_code_) != product_codes_.end();
      if (!matches) {
        Report(now_ns, Status::kConfigurationMismatch,
               "%s: product code %04X:%02X is %s, not one of bus.identity.product_codes", a.step,
               a.address.index, a.address.sub, text.data());
      }
      break;
    case BootAction::Kind::kExpectBits:
      matches = (value & a.max) == a.value;
      if (!matches) {
        Report(now_ns, Status::kConfigurationMismatch, "%s: %04X:%02X is %s, %s", a.step, a.address.index,
               a.address.sub, text.data(),
               a.address.index == 0x1000 ? "no CiA 402 drive" : "no cyclic synchronous torque mode");
      }
      break;
    case BootAction::Kind::kExpect:
      matches = value >= a.value && value <= a.max;
      if (!matches && a.address.index == 0x6076) {
        Report(now_ns, Status::kConfigurationMismatch,
               "%s: 6076:00 is %lld uNm, expected %lld: rated_torque_Nm must be torque constant x nominal "
               "current",
               a.step, static_cast<long long>(value), static_cast<long long>((a.value + a.max) / 2));
      } else if (!matches) {
        Report(now_ns, Status::kConfigurationMismatch, "%s: %04X:%02X is %s, expected %s..%s (bus.identity)",
               a.step, a.address.index, a.address.sub, text.data(), TextOf(a.address, a.value).data(),
               TextOf(a.address, a.max).data());
      }
      break;
    case BootAction::Kind::kWrite:
    case BootAction::Kind::kStart:
      break;
  }
  if (matches) {
    NextAction(now_ns);
  } else {
    Fail(MismatchOf(a.address));
  }
}

void Node::OnReadBack(std::int64_t value, TimeNs now_ns) noexcept {
  const ObjectAddress address = action().address;
  // Bit 30 of a COB-ID states whether a remote request is allowed; drives differ in how they report it.
  const std::int64_t mask = IsCobId(address) ? ~static_cast<std::int64_t>(kPdoNoRtr) : -1;
  if ((value & mask) == (written_ & mask)) {
    NextAction(now_ns);
    return;
  }
  Report(now_ns, Status::kConfigurationMismatch, "%s: %04X:%02X reads %s after %s was written", action().step,
         address.index, address.sub, TextOf(address, value).data(), TextOf(address, written_).data());
  Fail(DriveState::kMisconfigured);
}

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
             TpdoCobId(kTpdoFeedback.number, id_), limit_ms);
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
           FindEmcy(feedback_.error_code).text, rebooted_for_reset_ ? "" : ": booting it again");
    // A drive that lost our heartbeat accepts a fault reset only after NMT reset communication.
    if (!rebooted_for_reset_) Boot(now_ns, true);
  }
}

void Node::RefreshStatusword(TimeNs now_ns) noexcept {
  refresh_ns_ = now_ns + kStatusRefresh_ns;
  if (transfer_ == Transfer::kNone) Read({0x6041, 0}, Transfer::kStatusword);
}

// ---- frames in ----------------------------------------------------------------------------------

bool Node::OnFeedback(const can::CanFrame& frame, TimeNs now_ns) noexcept {
  if (!started()) return true;  // not mapped yet
  PdoValues values{};
  if (!Decode(kTpdoFeedback, frame, values)) return false;
  if (after_boot_up_ > 0) {
    OnAnswerAfterBootUp(now_ns);
    return true;
  }
  if (answers_.OnAnswer(frame.data)) {
    Report(now_ns, Status::kNodeIdShared,
           "two drives have this node id: each SYNC is answered by two TPDO 0x%03X",
           TpdoCobId(kTpdoFeedback.number, id_));
    FailTwice(now_ns);
    return true;
  }
  feedback_.position_counts = static_cast<std::int32_t>(values[Slot(kTpdoFeedback, 0x6064, 0)]);
  feedback_.torque_permille = static_cast<std::int16_t>(values[Slot(kTpdoFeedback, 0x6077, 0)]);
  feedback_.analog_mV = static_cast<std::int16_t>(values[Slot(kTpdoFeedback, 0x3160, 1)]);
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
  if (!Decode(kTpdoStatus, frame, values)) return false;
  OnStatusword(static_cast<std::uint16_t>(values[Slot(kTpdoStatus, 0x6041, 0)]), now_ns);
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
    Report(now_ns, Status::kDriveFault, "%s (statusword 0x%04X, error 0x%04X %s)", DriveMachineText(is),
           statusword, feedback_.error_code,
           feedback_.error_code == 0 ? "not reported yet" : FindEmcy(feedback_.error_code).text);
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
  const EmcyInfo& info = FindEmcy(emcy.code);
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

// ---- faults -------------------------------------------------------------------------------------

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
  PdoValues values{};
  values[Slot(kRpdoTorque, 0x6040, 0)] = command;
  values[Slot(kRpdoTorque, 0x6071, 0)] = torque;
  frame->id = RpdoCobId(kRpdoTorque.number, id_);
  frame->size = static_cast<std::uint8_t>(EncodePdo(
      {kRpdoTorque.entries.data(), static_cast<std::size_t>(kRpdoTorque.count)}, values, frame->data));
  return true;
}

}  // namespace tendril::canopen
