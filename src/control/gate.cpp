#include "tendril/control/gate.h"

#include <algorithm>

#include "state_archive.h"

namespace tendril::control {
namespace {

constexpr TimeNs kSequenceHolds_ns = 3600 * kNsPerS;

// Longest that a command may hold for which somebody must be there.
constexpr TimeNs kUnwatched_ns = 5 * kNsPerS;

// Numbers of io::SequenceFromTime count 10 us. One that is more than a minute behind was not overtaken on its
// way: its sender's clock was set back, or it began anew.
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

// What the daemon made of a request that only it can judge.
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

// Motion or a pull that would go on after its sender is gone.
bool GoesOnByItself(const Command& c, Mode mode) {
  if (c.kind == CommandKind::kTip) return !c.tip_velocity_W_mps.isZero(0);
  if (c.kind == CommandKind::kBending)
    return c.bending_rate_radps.size() > 0 && !c.bending_rate_radps.isZero(0);
  return c.kind == CommandKind::kTension && mode == Mode::kCommissioning;
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

Status CommandGate::CheckValues(const Command& c, Mode mode) const noexcept {
  if (!std::isfinite(c.speed_radps)) return Status::kCommandNotFinite;
  if (c.speed_radps < 0) return Status::kCommandOutOfRange;
  switch (c.kind) {
    case CommandKind::kTip:
      if (!c.tip_W_m.allFinite() || !c.tip_velocity_W_mps.allFinite()) return Status::kCommandNotFinite;
      return Status::kOk;
    case CommandKind::kBending:
      if (c.bending_rad.size() != 2 * sections_) return Status::kCommandWrongSize;
      if (c.bending_rate_radps.size() != 0 && c.bending_rate_radps.size() != 2 * sections_) {
        return Status::kCommandWrongSize;
      }
      if (!c.bending_rad.allFinite() || !c.bending_rate_radps.allFinite()) return Status::kCommandNotFinite;
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

Status CommandGate::Admit(const Command& c, Mode mode, TimeNs now_ns, double away_m) noexcept {
  // Serial-number arithmetic: a counter may wrap, and after a long silence nothing can be said about its
  // order. What was refused for another reason still counts as seen.
  const bool fresh = any_ && now_ns - last_seen_ns_ < kSequenceHolds_ns;
  const auto ahead = static_cast<std::int32_t>(c.sequence - last_sequence_);
  if (c.kind == CommandKind::kMode && (c.mode == ModeRequest::kDisarm || c.mode == ModeRequest::kStop)) {
    // Late, overtaken or sent twice: a robot that was told to stop stops.
    if (!fresh || ahead > 0) last_sequence_ = c.sequence;
    any_ = true;
    last_seen_ns_ = now_ns;
    return Status::kOk;
  }
  // Whoever asks a robot to hold may have a clock that is behind.
  const bool hold = c.kind == CommandKind::kMode && c.mode == ModeRequest::kHold;
  const bool overtaken = fresh && ahead <= 0 && ahead > -kOvertaken;
  if (overtaken && !hold) return Status::kCommandOutOfOrder;
  any_ = true;
  if (!overtaken) last_sequence_ = c.sequence;
  last_seen_ns_ = now_ns;
  if (const Status s = CheckValues(c, mode); s != Status::kOk) return s;
  if (c.valid_for_ns <= 0 || now_ns - c.received_ns > c.valid_for_ns) return Status::kCommandStale;
  if (GoesOnByItself(c, mode) && c.valid_for_ns > kUnwatched_ns) return Status::kCommandOutOfRange;
  if (!ModeAllowed(AdmissionIn(mode), c)) return Status::kCommandWrongMode;
  if (c.kind == CommandKind::kMode) return RefusedByDaemon(c.mode);
  if (c.kind == CommandKind::kTip && !(away_m <= out_of_reach_m_)) return Status::kTargetOutOfReach;

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

void CommandGate::Remember(StateArchive& a) noexcept {
  const Eigen::Index k2 = 2 * sections_, m = tendons_;
  a.Value(any_);
  a.Value(last_sequence_);
  a.Value(last_seen_ns_);
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
