// Compares the signals of two runs.
#include "same_commands.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "health_signal.h"

namespace tendril::gap {
namespace {

/// Below this multiple of its noise variance a signal does not move: a difference is noise.
constexpr double kMoves = 4;

Eigen::VectorXd TimesOf(const PreparedRun& run) {
  const int samples = run.samples();
  return Eigen::VectorXd::LinSpaced(samples, 0, (samples - 1) * run.signals.step_s);
}

/// S x M, NaN without a reading.
Eigen::MatrixXd Known(const PreparedRun& run, const Eigen::MatrixXd& values,
                      const std::vector<Dropout>& dropouts) {
  Eigen::MatrixXd known = values;
  for (const Dropout& dropout : dropouts)
    known.col(dropout.tendon).segment(dropout.from, dropout.size()).setConstant(NAN);
  for (int i = 0; i < known.rows(); ++i) {
    if (!run.valid[static_cast<std::size_t>(i)]) known.row(i).setConstant(NAN);
  }
  return known;
}

double Variance(const Signal& x) {
  double sum = 0, square = 0, count = 0;
  for (const double v : x) {
    if (std::isfinite(v)) sum += v, square += v * v, count += 1;
  }
  return count > 0 ? std::max(0.0, square / count - std::pow(sum / count, 2)) : 0;
}

/// One kind of signal in one run; times increase.
struct Recorded {
  Eigen::VectorXd time_s;
  Eigen::MatrixXd values;
  bool at_rest = false;  // differences between states are motion, not noise

  double NoiseVariance(Eigen::Index column) const {
    return at_rest ? 0 : std::pow(Scatter(values.col(column)), 2);
  }
};

/// Empty where either run lacks it, or where it does not move.
std::optional<SignalCompared> Compare(const char* name, const char* unit, const Recorded& a,
                                      const Recorded& b) {
  if (a.values.cols() != b.values.cols()) return std::nullopt;
  double square = 0, unrelated = 0;
  bool any = false;
  for (Eigen::Index j = 0; j < a.values.cols(); ++j) {
    const double rms = RmsDifference(a.time_s, a.values.col(j), b.time_s, b.values.col(j));
    if (!std::isfinite(rms)) continue;
    const double noise = a.NoiseVariance(j) + b.NoiseVariance(j);
    const double motion = Variance(a.values.col(j)) + Variance(b.values.col(j));
    square = std::max(square, rms * rms - noise);
    if (motion <= (1 + kMoves) * noise) continue;
    unrelated = std::max(unrelated, motion - noise);
    any = true;
  }
  if (!any || unrelated <= 0) return std::nullopt;
  return SignalCompared{name, unit, std::sqrt(square), std::sqrt(square / unrelated)};
}

}  // namespace

std::string CommandsCompared::Text(bool all) const {
  std::string text;
  for (const SignalCompared& one : by) {
    text += fmt::format("{}{}{} by {:.2g} {} rms ({:.0f} %)", text.empty() ? "" : ", ", one.name,
                        text.empty() ? " differ" : "", one.rms, one.unit, 100 * one.share);
    if (!all) break;
  }
  return text;
}

CommandsCompared CompareCommands(const PreparedRun& run, const PreparedRun& before) {
  CommandsCompared compared;
  const auto add = [&](const char* name, const char* unit, auto&& values) {
    const auto recorded = [&](const PreparedRun& of) {
      return Recorded{TimesOf(of), values(of), of.signals.at_rest};
    };
    if (const auto one = Compare(name, unit, recorded(run), recorded(before))) compared.by.push_back(*one);
  };
  const auto has_targets = [](const PreparedRun& of) {
    return of.signals.torque_target_Nm.cols() > 0 &&
           of.LeaveSamples(of.target_dropouts, of.signals.torque_target_Nm.cols());
  };
  if (has_targets(run) && has_targets(before)) {
    add("torque targets", "N·m",
        [](const PreparedRun& of) { return Known(of, of.signals.torque_target_Nm, of.target_dropouts); });
    if (!compared.by.empty()) return compared;
  }
  add("actual torques", "N·m",
      [](const PreparedRun& of) { return Known(of, of.signals.torque_actual_Nm, of.torque_dropouts); });
  add("motor positions", "rad",
      [](const PreparedRun& of) { return Known(of, of.signals.motor_angle_rad, of.motor_dropouts); });
  add("tensions", "N", [](const PreparedRun& of) { return of.cell_N; });
  if (run.tracked() && before.tracked()) {
    const auto tip = [](const PreparedRun& of) {
      return Recorded{of.tracker_s, of.tip_m, of.signals.at_rest};
    };
    if (const auto one = Compare("tip positions", "m", tip(run), tip(before))) compared.by.push_back(*one);
  }
  std::stable_sort(compared.by.begin(), compared.by.end(),
                   [](const SignalCompared& a, const SignalCompared& b) { return a.share < b.share; });
  return compared;
}

}  // namespace tendril::gap
