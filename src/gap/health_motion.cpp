// Checks of the motion: its beginning and richness, signals that have to move together, clocks, repetitions.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "health_checks.h"
#include "health_signal.h"
#include "prepare.h"

namespace tendril::gap {
namespace {

constexpr double kRest_s = 0.5;  // initial rest of a run

}  // namespace

void Checkup::Rest() {
  const Eigen::VectorXd& t = run_->time_s;
  const auto rest =
      static_cast<Eigen::Index>(std::upper_bound(t.data(), t.data() + t.size(), t[0] + kRest_s) - t.data());
  if (rest < 5 || rest == t.size() || StepsOf(t).usual > kQuasiStatic_s) return;
  double worst = 0;
  std::string channel;
  for (const SignalKind& kind : {kMotor, kTension, kTip}) {
    if (!Fits(kind)) continue;
    const Matrix& m = Of(kind);
    for (Eigen::Index c = 0; c < m.cols(); ++c) {
      const double whole = RangeOf(m.col(c)).width();
      const double noise = Scatter(m.col(c).head(rest));
      const double moved = std::max(RangeOf(m.col(c).head(rest)).width() - 8 * noise, 0.0);
      if (whole <= 0 || whole < 20 * noise || moved / whole < worst) continue;
      worst = moved / whole;
      channel = ChannelOf(kind, c);
    }
  }
  if (worst < 0.05) return;
  Add(Severity::kWarning, channel, worst,
      fmt::format("moves by {:.0f} % of its range in the first {} s; the initial state is therefore "
                  "unknown; begin runs straight, at pretension and at rest",
                  100 * worst, kRest_s));
}

void Checkup::Excitation() {
  std::string text;
  double value = 0;
  if (Fits(kTension)) {
    text += "tension ranges";
    for (Eigen::Index j = 0; j < run_->tension_N.cols(); ++j) {
      const double width = RangeOf(run_->tension_N.col(j)).width();
      value = std::max(value, width);
      text += fmt::format(" {:.3g}", width);
    }
    text += " N";
  }
  if (Fits(kMotor)) {
    int reversals = 0;
    double slow = 0, fast = 0;
    for (Eigen::Index j = 0; j < run_->motor_position_rad.cols(); ++j) {
      reversals += Reversals(run_->motor_position_rad.col(j));
      const auto [lower, upper] = Speeds(run_->time_s, run_->motor_position_rad.col(j));
      if (upper > fast) fast = upper, slow = lower;
    }
    text += fmt::format("{}{} reversals, motor speed {:.3g} to {:.3g} rad/s", text.empty() ? "" : ", ",
                        reversals, slow, fast);
  }
  if (const double bend = BendRange(); bend >= 0) {
    text += fmt::format("{}tip turns by up to {:.3g} rad", text.empty() ? "" : ", ", bend);
  }
  if (!text.empty()) Add(Severity::kInfo, "excitation", value, text);
}

double Checkup::BendRange() const {
  if (!Fits(kDirection)) return -1;
  const Matrix& q = Of(kDirection);
  Eigen::Vector3d first = Eigen::Vector3d::Zero();
  double most = -1;
  for (Eigen::Index i = 0; i < q.rows(); ++i) {
    if (!q.row(i).allFinite()) continue;
    const double w = q(i, 0), x = q(i, 1), y = q(i, 2), z = q(i, 3);
    const Eigen::Vector3d axis(2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y));
    if (most < 0) first = axis, most = 0;
    most = std::max(most, std::acos(std::clamp(first.dot(axis), -1.0, 1.0)));
  }
  return most;
}

void Checkup::Pairing(const SignalKind& from, const SignalKind& to) {
  if (!Fits(from) || !Fits(to)) return;
  const Eigen::Index n = std::min(Of(from).cols(), Of(to).cols());
  const Matrix c = ChangeCorrelation(run_->time_s, Of(from).leftCols(n), Of(to).leftCols(n));
  constexpr double kSurely = 0.95;
  const auto followed = [&](Eigen::Index j) {
    Eigen::Index best = j;
    for (Eigen::Index i = 0; i < n; ++i) {
      if (c(i, j) > c(best, j)) best = i;
    }
    return best;
  };
  for (Eigen::Index j = 0; j < n; ++j) {
    if (!std::isfinite(c(j, j))) continue;
    const Eigen::Index best = followed(j);
    Eigen::Index back = j;
    for (Eigen::Index i = 0; i < n; ++i) {
      if (c(j, i) > c(j, back)) back = i;
    }
    const bool has_its_own = followed(best) == best && std::isfinite(c(best, best));
    if (best != j && back != j && c(best, j) > (has_its_own ? kSurely : 0.7) && c(best, j) - c(j, j) > 0.4) {
      Add(Severity::kError, ChannelOf(to, j), c(j, j),
          fmt::format("follows the {} of tendon {} (correlation {:.2f}), not its own ({:.2f}); the columns "
                      "are in another order than the tendons, so causes would be attributed to the wrong "
                      "tendons; exchange them",
                      from.name, best + 1, c(best, j), c(j, j)));
    } else if (c(j, j) < -0.8 && (n == 1 || c(best, j) < 0.7)) {
      Add(Severity::kError, ChannelOf(to, j), c(j, j),
          fmt::format("falls when the {} of its tendon rises (correlation {:.2f}); one of the two has the "
                      "wrong sign; "
                      "pulling is positive for both",
                      from.name, c(j, j)));
    }
  }
}

void Checkup::TrackerClock() {
  if (!Fits(kMotor) || !Fits(kTip)) return;
  const auto shift = ClockShift(run_->time_s, Of(kMotor), Of(kTip));
  if (!shift) return;
  const double file_delay_s =
      set_.robot.actuation && set_.robot.actuation->tracker ? set_.robot.actuation->tracker->delay_s : 0;
  const double unknown_s = shift->seconds - file_delay_s;
  // A damped body lags its tensions by about its damping over its stiffness, which grows with its size.
  double own_s = 0;
  for (const SectionParameters& s : set_.robot.body.sections)
    own_s = std::max(own_s, s.bending_damping_Nms / s.UnitStiffness());
  const double most_s = std::max(0.015, 3 * own_s), resolved_s = 2 * StepsOf(run_->time_s).usual;
  const bool odd = unknown_s < -std::max(0.015, resolved_s) || unknown_s > std::max(most_s, resolved_s);
  Add(odd ? Severity::kWarning : Severity::kInfo, "tracker clock", shift->seconds,
      fmt::format("the tip follows the motors {:.1f} ms {} (correlation {:.3f}){}",
                  1e3 * std::abs(shift->seconds), shift->seconds < 0 ? "too early" : "later",
                  shift->correlation,
                  unknown_s < -0.015 ? "; no robot does, so the clocks differ; synchronise them"
                  : unknown_s > most_s
                      ? "; more than the usual lag of the body: a robot that is softer, heavier or more "
                        "damped than its file says, clocks that differ, or a slow tracker; synchronise the "
                        "clocks, or give the tracker's delay_s in the robot file"
                      : ""));
}

void Checkup::Repetition() {
  if (run_->repeat_of.empty()) return;
  const auto original = std::find_if(set_.runs.begin(), set_.runs.end(),
                                     [&](const Run& r) { return r.name == run_->repeat_of; });
  if (original == set_.runs.end()) return;
  for (const SignalKind& kind : {kActual, kMotor, kTension, kTip}) {
    const Matrix& theirs = (*original).*kind.matrix;
    if (!Fits(kind) || theirs.cols() != Of(kind).cols() || theirs.rows() != original->time_s.size()) continue;
    const double rms = RmsDifference(run_->time_s, Of(kind), original->time_s, theirs);
    const double range = Range::Of(Of(kind)).width();
    if (!std::isfinite(rms)) continue;
    const bool poor = rms > 0.1 * range && range > 0 && rms > 3 * Scatter(Of(kind).col(0));
    Add(poor ? Severity::kWarning : Severity::kInfo, kind.name, rms,
        fmt::format("differs from {} by {:.3g} {} rms{}", original->name, rms, kind.unit,
                    poor ? "; this is not a repetition, and its differences would count as noise; check "
                           "that commands and beginning were the same (repeat_of in runs.yaml)"
                         : ", the floor below which no gap can be seen"));
  }
}

}  // namespace tendril::gap
