// A drive's boot: the script of its profile, run by SDO, each value read back. Knows no other node and no
// port.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "node.h"

namespace tendril::canopen {
namespace {

constexpr int kTries = 3;                           // of each SDO transfer during boot
constexpr TimeNs kBootUpWait_ns = 1000 * kNsPerMs;  // then the node is polled

using ValueText = std::array<char, 24>;

/// Communication objects and identities are printed in hexadecimal, others in decimal.
ValueText TextOf(ObjectAddress address, std::int64_t value) noexcept {
  ValueText text{};
  const bool hexadecimal = address.index < 0x2000 || address.index == 0x6502;
  std::snprintf(text.data(), text.size(), hexadecimal ? "0x%llX" : "%lld", static_cast<long long>(value));
  return text;
}

/// Objects that identify a device, rather than configure it.
bool IsIdentity(ObjectAddress address) noexcept {
  return address.index == 0x1000 || address.index == 0x1018 || address.index == 0x6502;
}

}  // namespace

DriveState Node::MismatchOf(ObjectAddress address) noexcept {
  return IsIdentity(address) ? DriveState::kOtherDevice : DriveState::kMisconfigured;
}

int Node::WidthOf(ObjectAddress address) const noexcept {
  const ObjectEntry* entry = profile_->objects.Find(address);
  return entry == nullptr ? 4 : TypeBytes(entry->type);
}

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
             feedback_.error_code, FindEmcy(profile_->emcy, feedback_.error_code).text);
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

// ---- transfers ----------------------------------------------------------------------------------

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
  const ObjectEntry* entry = profile_->objects.Find(sdo_.address());
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
      if (a.address == ObjectAddress{0x1018, 4}) serial_ = static_cast<std::uint32_t>(value);
      if (a.address.index == 0x603F) feedback_.error_code = static_cast<std::uint16_t>(value);
      if (a.address.index == 0x6041) feedback_.statusword = static_cast<std::uint16_t>(value);
      NextAction(now_ns);
      return;
    case BootAction::Kind::kExpectProduct:
      matches = std::find(product_codes_.begin(), product_codes_.end(), static_cast<std::uint32_t>(value)) !=
                product_codes_.end();
      break;
    case BootAction::Kind::kExpectBits:
      matches = (value & a.max) == a.value;
      break;
    case BootAction::Kind::kExpect:
      matches = value >= a.value && value <= a.max;
      break;
    case BootAction::Kind::kWrite:
    case BootAction::Kind::kStart:
      break;
  }
  if (a.address == ObjectAddress{0x1018, 2}) product_code_ = static_cast<std::uint32_t>(value);
  if (!matches) {
    ReportMismatch(value, now_ns);
    Fail(MismatchOf(a.address));
    return;
  }
  if (a.address == ObjectAddress{0x6076, 0} && value > 0) {
    drive_permille_per_permille_ = static_cast<double>(rated_torque_uNm_) /
                                   (static_cast<double>(value) * profile_->rated_torque_unit_uNm);
  }
  NextAction(now_ns);
}

/// The value read is not the one expected.
void Node::ReportMismatch(std::int64_t value, TimeNs now_ns) noexcept {
  const BootAction& a = action();
  const ValueText text = TextOf(a.address, value);
  if (a.kind == BootAction::Kind::kExpectProduct) {
    Report(now_ns, Status::kConfigurationMismatch,
           "%s: product code %04X:%02X is %s, not one of bus.identity.product_codes", a.step, a.address.index,
           a.address.sub, text.data());
  } else if (a.kind == BootAction::Kind::kExpectBits) {
    Report(now_ns, Status::kConfigurationMismatch, "%s: %04X:%02X is %s, %s", a.step, a.address.index,
           a.address.sub, text.data(),
           a.address.index == 0x1000 ? "no CiA 402 drive" : "no cyclic synchronous torque mode");
  } else if (a.address.index == 0x6076) {
    Report(now_ns, Status::kConfigurationMismatch,
           "%s: 6076:00 is %lld %s, expected %lld: rated_torque_Nm must be %s", a.step,
           static_cast<long long>(value), profile_->rated_torque_unit_uNm == 1 ? "uNm" : "mNm",
           static_cast<long long>((a.value + a.max) / 2), profile_->rated_torque_source);
  } else {
    Report(now_ns, Status::kConfigurationMismatch, "%s: %04X:%02X is %s, expected %s..%s (%s)", a.step,
           a.address.index, a.address.sub, text.data(), TextOf(a.address, a.value).data(),
           TextOf(a.address, a.max).data(), profile_->identity_source);
  }
}

void Node::OnReadBack(std::int64_t value, TimeNs now_ns) noexcept {
  const ObjectAddress address = action().address;
  // Bit 30 of a COB-ID states whether a remote request is allowed; drives differ in how they report it.
  const std::int64_t mask = IsPdoCobId(address) ? ~static_cast<std::int64_t>(kPdoNoRtr) : -1;
  if ((value & mask) == (written_ & mask)) {
    NextAction(now_ns);
    return;
  }
  Report(now_ns, Status::kConfigurationMismatch, "%s: %04X:%02X reads %s after %s was written", action().step,
         address.index, address.sub, TextOf(address, value).data(), TextOf(address, written_).data());
  Fail(DriveState::kMisconfigured);
}

}  // namespace tendril::canopen
