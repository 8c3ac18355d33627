// Evaluator, the comparison with runs of the same commands from before a change of the robot: model errors
// that were there before cancel.
#include <fmt/core.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <string>
#include <utility>

#include "evaluator.h"
#include "same_commands.h"

namespace tendril::gap {
namespace {

using Quantity = Channel::Quantity;

/// How alike the commands of run `i` and of its run from before are; throws RunError where they cannot be
/// compared.
CommandsCompared RequireComparable(std::size_t i, const PreparedRun& run, const PreparedRun& before) {
  const double step = run.signals.step_s, its = before.signals.step_s;
  if (run.signals.at_rest != before.signals.at_rest || std::abs(step - its) > 0.01 * step) {
    throw RunError(i, fmt::format("{}: a sample every {:.4g} s, and every {:.4g} s before; accepted: runs "
                                  "with the same commands, recorded at the same rate",
                                  run.name, step, its));
  }
  const CommandsCompared commands = CompareCommands(run, before);
  if (!commands.same()) {
    throw RunError(i, fmt::format("{}: not the same commands as before: {}; accepted: at most {:.0f} % of "
                                  "the difference between unrelated motions in one of these signals; send "
                                  "the same commands, or diagnose it without --before",
                                  run.name, commands.Text(true), 100 * CommandsCompared::kSame));
  }
  return commands;
}

}  // namespace

// The model error before the change, and the same relative error of every channel in the change.
void Evaluator::DistrustChange(const std::vector<char>& is_before) {
  std::map<std::pair<sim::Cut, Quantity>, std::pair<double, double>>
      wrong;  // squares: residual before, measurement
  for (std::size_t c = 0; c < channels_.size(); ++c) {
    auto& [left, measured] = wrong[{channels_[c].cut, channels_[c].quantity}];
    double square = 0, count = 0;
    for (std::size_t k = 0; k < runs_.size(); ++k) {
      for (Eigen::Index w = 0; is_before[k] && w < nominal_residuals_[k][c].size(); ++w) {
        if (!std::isfinite(variance_[k][c][w])) continue;
        square += std::pow(nominal_residuals_[k][c][w], 2) - variance_[k][c][w];
        count += 1;
      }
    }
    left += count > 0 ? std::max(0.0, square / count) : 0;
    measured += std::pow(Spread(channels_[c]), 2);
  }
  for (std::size_t c = 0; c < channels_.size(); ++c) {
    const auto& [left, measured] = wrong[{channels_[c].cut, channels_[c].quantity}];
    if (!(measured > 0)) continue;
    wrong_before_ = std::max(wrong_before_, std::sqrt(left / measured));
  }
  // Whether and where something changed then depends on the noise alone, and no cause is named.
  for (std::size_t c = 0; !useless() && c < channels_.size(); ++c) {
    const auto& [left, measured] = wrong[{channels_[c].cut, channels_[c].quantity}];
    if (!(measured > 0)) continue;
    double change = 0, count = 0;
    for (std::size_t i = 0; i < runs_.size(); ++i) {
      for (Eigen::Index w = 0; !is_before[i] && w < nominal_residuals_[i][c].size(); ++w) {
        if (!std::isfinite(variance_[i][c][w])) continue;
        change += std::pow(nominal_residuals_[i][c][w], 2);
        count += 1;
      }
    }
    if (count == 0) continue;
    const double square = left / measured * change / count;
    channels_[c].distrust = std::sqrt(square);
    for (std::size_t i = 0; i < runs_.size(); ++i) {
      if (!is_before[i]) variance_[i][c].array() += square;
    }
  }
}

// The nominal residual of a run less that of the same commands before: earlier model errors cancel, window by
// window, and the noise of both runs remains. The model is assumed to have the same relative error in the
// change as in the earlier motion; this is added to the noise.
void Evaluator::SubtractBefore() {
  std::map<std::string, std::size_t> by_name;
  for (std::size_t i = 0; i < runs_.size(); ++i) by_name[runs_[i].name] = i;
  std::vector<char> is_before(runs_.size(), 0);
  int compared = 0;
  CommandsCompared least_alike;
  for (const auto& run : runs_) {
    if (run.before.empty()) continue;
    if (by_name.contains(run.before)) is_before[by_name[run.before]] = 1;
    ++compared;
  }
  if (compared == 0) return;
  before_.resize(runs_.size());
  for (std::size_t i = 0; i < runs_.size(); ++i) {
    if (is_before[i]) continue;
    const auto partner = by_name.find(runs_[i].before);
    if (partner == by_name.end()) {
      throw RunError(i, fmt::format("{}: {}", runs_[i].name,
                                    runs_[i].before.empty() ? "no run from before, which other runs have"
                                                            : "its run from before is left out"));
    }
    const std::size_t k = partner->second;
    const CommandsCompared commands = RequireComparable(i, runs_[i], runs_[k]);
    if (!commands.by.empty() && (least_alike.by.empty() || commands.by[0].share > least_alike.by[0].share))
      least_alike = commands;
    before_[i].resize(channels_.size());
    for (std::size_t c = 0; c < channels_.size(); ++c) {
      auto &r = nominal_residuals_[i][c], &v = variance_[i][c];
      const auto &r0 = nominal_residuals_[k][c], &v0 = variance_[k][c];
      before_[i][c] = Eigen::VectorXd::Zero(r.size());
      for (Eigen::Index w = 0; w < r.size(); ++w) {
        v[w] = w < v0.size() ? v[w] + v0[w] : std::numeric_limits<double>::infinity();
        if (!std::isfinite(v[w])) {
          r[w] = 0;
          continue;
        }
        before_[i][c][w] = r0[w];
        r[w] -= r0[w];
      }
      white_[i][c] += white_[k][c];
    }
  }
  DistrustChange(is_before);
  const auto keep = [&](auto& all) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < is_before.size(); ++i) {
      if (is_before[i]) continue;
      if (kept != i) all[kept] = std::move(all[i]);
      ++kept;
    }
    all.resize(kept);
  };
  keep(runs_);
  keep(nominal_motion_);
  keep(nominal_residuals_);
  keep(variance_);
  keep(carried_);
  keep(white_);
  keep(before_);
  degradations_.push_back(
      fmt::format("compared with runs of the same commands from before ({}): the diagnosis concerns the "
                  "change since then; the earlier model error (up to {:.0f} % of the measurement) is "
                  "subtracted, and the same relative error is assumed for the change",
                  least_alike.by.empty() ? "matched by name only: no signal that both recorded moves"
                                         : least_alike.Text(false) + " at most",
                  100 * wrong_before_));
}

}  // namespace tendril::gap
