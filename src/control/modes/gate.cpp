#include "tendril/control/gate.h"

#include <algorithm>
#include <limits>

#include "tendril/control/state_archive.h"

namespace tendril::control {
namespace {

constexpr TimeNs kSequenceHolds_ns = 3600 * kNsPerS;

// A stream that pauses longer than this gives up control, whatever the validity of its targets.
constexpr TimeNs kControlHolds_ns = kNsPerS;
// How long the status of two senders is reported after a refused target, so that an operator sees it.
constexpr TimeNs kContended_ns = 3 * kNsPerS;

// Sequence numbers of io::NextSequence count 10 us. A number more than a minute behind is not a reordered
// message: the sender's clock was set back, or it restarted.
constexpr std::int32_t kOvertaken = 60 * 100'000;

// Whether a kind of command may act in a mode: one row a mode. `start` is for arm, home and commission from
// rest, `resume` for arm out of hold.
struct Admission {
  bool start, resume, hold, clear, target, pull;
};
constexpr Admission AdmissionIn(Mode mode) {
  switch (mode) {
    //                          start  resume hold   clear  target pull
    case Mode::kDisconnected:  // clear: drives whose start-up failed are booted again
      return {false, false, false, true, false, false};
    case Mode::kConfigured:
      return {true, false, false, false, false, false};
    case Mode::kRunning:
      return {false, false, true, false, true, false};
    case Mode::kHold:
      return {false, true, true, false, false, false};
    case Mode::kFault:
      return {false, false, false, true, false, false};
    case Mode::kCommissioning:
      return {false, false, false, false, false, true};
    case Mode::kArmed:
    case Mode::kPretension:
    case Mode::kSafeStop:
    case Mode::kHoming:
      return {};
  }
  return {};
}

bool ModeAllowed(const Admission& may, const Command& c) {
  if (c.kind != CommandKind::kMode) return may.target || (may.pull && c.kind == CommandKind::kTension);
  switch (c.mode) {
    case ModeRequest::kArm:
      return may.start || may.resume;
    case ModeRequest::kHome:
    case ModeRequest::kCommission:
      return may.start;
    case ModeRequest::kNotCommissioned:
    case ModeRequest::kNotAlone:
    case ModeRequest::kDriveExchanged:
      return may.start || may.resume;
    case ModeRequest::kDisarm:
    case ModeRequest::kStop:
      return true;
    case ModeRequest::kHold:
      return may.hold;
    case ModeRequest::kClear:
      return may.clear;
  }
  return false;
}

// The refusal that the daemon encodes in a mode request that only it can judge.
Status RefusedByDaemon(ModeRequest request) {
  switch (request) {
    case ModeRequest::kNotCommissioned:
      return Status::kNotCommissioned;
    case ModeRequest::kNotAlone:
      return Status::kNotAlone;
    case ModeRequest::kDriveExchanged:
      return Status::kDriveExchanged;
    default:
      return Status::kOk;
  }
}

// Whether the command causes motion or a pull that continues without its sender.
bool OutlivesSender(const Command& c, Mode mode) {
  if (c.kind == CommandKind::kTip) return !c.tip_velocity_W_mps.isZero(0);
  if (c.kind == CommandKind::kBending)
    return c.bending_rate_radps.size() > 0 && !c.bending_rate_radps.isZero(0);
  return c.kind == CommandKind::kTension && mode == Mode::kCommissioning;
}

std::uint64_t NumberOf(const Command& c) { return (std::uint64_t{c.sender} << 32) | c.sequence; }

// Whether a command belongs to the sender of an earlier number. The difference is compared too, because a
// sender may count in all 64 bits.
bool IsFrom(const Command& c, std::uint64_t earlier) {
  const auto ahead = static_cast<std::int64_t>(NumberOf(c) - earlier);
  return c.sender == static_cast<std::uint32_t>(earlier >> 32) ||
         (ahead > std::numeric_limits<std::int32_t>::min() &&
          ahead < std::numeric_limits<std::int32_t>::max());
}

}  // namespace

double Target::ElapsedS(TimeNs t_ns) const noexcept {
  return ToSeconds(std::clamp<TimeNs>(t_ns - since_ns, 0, valid_for_ns));
}

bool Target::moving() const noexcept {
  if (kind == CommandKind::kTip) return !tip_velocity_W_mps.isZero(0);
  return kind == CommandKind::kBending && bending_rate_radps.size() > 0 && !bending_rate_radps.isZero(0);
}

CommandGate::CommandGate(const RobotParameters& robot, double default_speed_radps, double bare_pull_N)
    : sections_(static_cast<int>(robot.body.sections.size())),
      tendons_(robot.body.tendons()),
      out_of_reach_m_(kOutOfReach * robot.body.length_m()),
      max_bending_rad_(robot.limits.max_bending_rad),
      max_tension_N_(robot.limits.max_tension_base_N),
      default_speed_radps_(default_speed_radps),
      bare_pull_N_(bare_pull_N) {}

bool CommandGate::AcceptedIn(Mode mode, const Command& c) noexcept {
  return ModeAllowed(AdmissionIn(mode), c);
}

Status CommandGate::CheckValues(const Command& c, Mode mode) const noexcept {
  if (!std::isfinite(c.speed_radps)) return Status::kCommandNotFinite;
  if (c.valid_for_ns <= 0 || c.valid_for_ns > kLongestValid_ns) return Status::kCommandOutOfRange;
  if (c.speed_radps < 0 || c.speed_radps > kMostSpeed_radps) return Status::kCommandOutOfRange;
  switch (c.kind) {
    case CommandKind::kTip:
      if (!c.tip_W_m.allFinite() || !c.tip_velocity_W_mps.allFinite()) return Status::kCommandNotFinite;
      if (c.tip_W_m.cwiseAbs().maxCoeff() > kMostTip_m ||
          c.tip_velocity_W_mps.cwiseAbs().maxCoeff() > kMostTipSpeed_mps)
        return Status::kCommandOutOfRange;
      return Status::kOk;
    case CommandKind::kBending:
      if (c.bending_rad.size() != 2 * sections_) return Status::kCommandWrongSize;
      if (c.bending_rate_radps.size() != 0 && c.bending_rate_radps.size() != 2 * sections_) {
        return Status::kCommandWrongSize;
      }
      if (!c.bending_rad.allFinite() || !c.bending_rate_radps.allFinite()) return Status::kCommandNotFinite;
      if (c.bending_rate_radps.size() > 0 && c.bending_rate_radps.cwiseAbs().maxCoeff() > kMostSpeed_radps)
        return Status::kCommandOutOfRange;
      for (int k = 0; k < sections_; ++k) {
        if (c.bending_rad.segment<2>(2 * k).norm() > max_bending_rad_) return Status::kCommandOutOfRange;
      }
      return Status::kOk;
    case CommandKind::kTension:
      if (c.tension_N.size() != tendons_) return Status::kCommandWrongSize;
      if (!c.tension_N.allFinite()) return Status::kCommandNotFinite;
      if (mode == Mode::kCommissioning) {
        return c.tension_N.cwiseAbs().maxCoeff() > bare_pull_N_ ? Status::kCommandOutOfRange : Status::kOk;
      }
      if (c.tension_N.minCoeff() < 0 || c.tension_N.maxCoeff() > max_tension_N_)
        return Status::kCommandOutOfRange;
      return Status::kOk;
    case CommandKind::kMode:
    case CommandKind::kNone:
      return Status::kOk;
  }
  return Status::kCommandOutOfRange;
}

CommandGate::LastCommand& CommandGate::LastFrom(const Command& c) noexcept {
  LastCommand* longest = &last_commands_.front();
  for (LastCommand& s : last_commands_) {
    if (s.any && IsFrom(c, s.number)) return s;
    if (s.at_ns < longest->at_ns) longest = &s;
  }
  *longest = {};
  return *longest;
}

Status CommandGate::Admit(const Command& c, Mode mode, TimeNs now_ns, double away_m) noexcept {
  // Serial-number arithmetic: a counter may wrap, and after a long silence nothing can be said about its
  // order. A command refused for another reason still counts as seen.
  LastCommand& last = LastFrom(c);
  const bool fresh = last.any && now_ns - last.at_ns < kSequenceHolds_ns;
  const auto ahead = static_cast<std::int32_t>(c.sequence - static_cast<std::uint32_t>(last.number));
  if (c.kind == CommandKind::kMode && (c.mode == ModeRequest::kDisarm || c.mode == ModeRequest::kStop)) {
    // A stop acts even when it arrives late, out of order or twice.
    if (!fresh || ahead > 0) last.number = NumberOf(c);
    last.any = true;
    last.at_ns = now_ns;
    return Status::kOk;
  }
  if (c.kind != CommandKind::kMode && !IsFrom(c, in_control_) &&
      (mode == Mode::kCommissioning || (mode == Mode::kRunning && now_ns < in_control_until_ns_))) {
    contended_until_ns_ = now_ns + kContended_ns;
    return Status::kAnotherSender;
  }
  // A hold acts even when the sender's clock is behind.
  const bool hold = c.kind == CommandKind::kMode && c.mode == ModeRequest::kHold;
  const bool overtaken = fresh && ahead <= 0 && ahead > -kOvertaken;
  if (overtaken && !hold) return Status::kCommandOutOfOrder;
  last.any = true;
  if (!overtaken) last.number = NumberOf(c);
  last.at_ns = now_ns;
  // Nor is a hold refused for values that it does not use.
  if (const Status s = hold ? Status::kOk : CheckValues(c, mode); s != Status::kOk) return s;
  const TimeNs valid_for_ns = hold && c.valid_for_ns <= 0 ? kLongestValid_ns : c.valid_for_ns;
  if (now_ns - c.received_ns > valid_for_ns) return Status::kCommandStale;
  if (OutlivesSender(c, mode) && c.valid_for_ns > kLongestUnattended_ns) return Status::kCommandOutOfRange;
  if (!ModeAllowed(AdmissionIn(mode), c)) return Status::kCommandWrongMode;
  if (c.kind == CommandKind::kMode) {
    if (c.mode == ModeRequest::kCommission) in_control_ = NumberOf(c);
    return RefusedByDaemon(c.mode);
  }
  if (c.kind == CommandKind::kTip && !(away_m <= out_of_reach_m_)) return Status::kTargetOutOfReach;

  // When two senders start together their targets alternate, so the sender before the last one counts as
  // well.
  const bool same = IsFrom(c, in_control_);
  const bool one_of_many =
      target_.kind != CommandKind::kNone &&
      (same ? c.received_ns <= expires_ns_ : IsFrom(c, previous_) && c.received_ns <= previous_expires_ns_);
  if (!same) {
    previous_ = in_control_;
    previous_expires_ns_ = expires_ns_;
  }
  in_control_ = NumberOf(c);
  expires_ns_ = c.received_ns + c.valid_for_ns;
  in_control_until_ns_ =
      one_of_many || OutlivesSender(c, mode) ? std::min(expires_ns_, c.received_ns + kControlHolds_ns) : 0;

  const double since_s = ToSeconds(c.received_ns - target_.since_ns);
  const bool streamed = target_.kind == c.kind && since_s > 0 && since_s <= ToSeconds(target_.valid_for_ns);
  target_.tip_acceleration_W_mps2.setZero();
  target_.bending_acceleration_radps2.resize(0);
  if (streamed && c.kind == CommandKind::kTip) {
    target_.tip_acceleration_W_mps2 = (c.tip_velocity_W_mps - target_.tip_velocity_W_mps) / since_s;
  } else if (streamed && c.bending_rate_radps.size() == target_.bending_rate_radps.size()) {
    target_.bending_acceleration_radps2 = (c.bending_rate_radps - target_.bending_rate_radps) / since_s;
  }

  target_.kind = c.kind;
  target_.since_ns = c.received_ns;
  target_.valid_for_ns = c.valid_for_ns;
  target_.tip_W_m = c.tip_W_m;
  target_.tip_velocity_W_mps = c.tip_velocity_W_mps;
  target_.bending_rad = c.bending_rad;
  target_.bending_rate_radps = c.bending_rate_radps;
  target_.tension_N = c.tension_N;
  target_.speed_radps = c.speed_radps > 0 ? c.speed_radps : default_speed_radps_;
  return Status::kOk;
}

void CommandGate::Archive(StateArchive& a) noexcept {
  const Eigen::Index k2 = 2 * sections_, m = tendons_;
  for (LastCommand& s : last_commands_) {
    a.Value(s.any);
    a.Value(s.number);
    a.Value(s.at_ns);
  }
  a.Value(in_control_);
  a.Value(expires_ns_);
  a.Value(previous_);
  a.Value(previous_expires_ns_);
  a.Value(in_control_until_ns_);
  a.Value(contended_until_ns_);
  a.Choice(target_.kind, CommandKind::kMode);
  a.Value(target_.since_ns);
  a.Value(target_.valid_for_ns);
  a.Vector(target_.tip_W_m);
  a.Vector(target_.tip_velocity_W_mps);
  a.Vector(target_.bending_rad, {0, k2});
  a.Vector(target_.bending_rate_radps, {0, k2});
  a.Vector(target_.tension_N, {0, m});
  a.Value(target_.speed_radps);
  a.Vector(target_.tip_acceleration_W_mps2);
  a.Vector(target_.bending_acceleration_radps2, {0, k2});
  a.Require(target_.valid_for_ns >= 0);
  a.Require(target_.kind != CommandKind::kBending || target_.bending_rad.size() == k2);
  a.Require(target_.kind != CommandKind::kTension || target_.tension_N.size() == m);
}

}  // namespace tendril::control
