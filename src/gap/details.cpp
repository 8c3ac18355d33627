// Plots and the next experiment.
#include "details.h"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <random>

#include "closure.h"
#include "sentence.h"
#include "tendril/core/parallel.h"

namespace tendril::gap {
namespace {

constexpr int kBins = 12;
constexpr int kResamples = 200;

/// A condition on the grid of a run, for one channel.
struct Condition {
  const char* name;
  const char* unit;
  Eigen::VectorXd (*of)(const PreparedRun& run, int tendon);
};

/// Column j, NaN without a reading.
Eigen::VectorXd WithGaps(const PreparedRun& run, const Eigen::MatrixXd& matrix,
                         const std::vector<Dropout>& dropouts, int j) {
  if (j >= matrix.cols()) return {};
  Eigen::VectorXd column = matrix.col(j);
  run.TakeOut(dropouts, j, column);
  return column;
}

Eigen::VectorXd Speed(const PreparedRun& run, int j) {
  return WithGaps(run, run.signals.motor_velocity_radps, run.motor_dropouts, j);
}
Eigen::VectorXd Tension(const PreparedRun& run, int j) {
  return WithGaps(run, run.signals.tension_N, run.cell_dropouts, j);
}
Eigen::VectorXd Angle(const PreparedRun& run, int j) {
  return WithGaps(run, run.signals.motor_angle_rad, run.motor_dropouts, j);
}
Eigen::VectorXd Time(const PreparedRun& run, int) {
  return Eigen::VectorXd::LinSpaced(run.samples(), 0, (run.samples() - 1) * run.signals.step_s);
}
Eigen::VectorXd Total(const PreparedRun& run, int) {
  if (run.signals.tension_N.cols() == 0) return {};
  Eigen::VectorXd sum = Tension(run, 0);
  for (int j = 1; j < run.signals.tension_N.cols(); ++j) sum += Tension(run, j);
  return sum;
}
Eigen::VectorXd BendX(const PreparedRun& run, int) {
  if (run.tip_m.rows() < 2) return {};
  Eigen::VectorXd x(run.samples());
  int k = 0;
  for (int i = 0; i < x.size(); ++i) {
    while (k + 1 < run.tracker_s.size() && run.tracker_s[k + 1] <= i * run.signals.step_s) ++k;
    x[i] = run.tip_m(k, 0);
  }
  return x;
}

const Condition kOfTension[] = {{"motor speed", "rad/s", Speed},
                                {"tension", "N", Tension},
                                {"motor angle", "rad", Angle},
                                {"time in the run", "s", Time}};
const Condition kOfTip[] = {
    {"total tension", "N", Total}, {"tip x", "m", BendX}, {"time in the run", "s", Time}};

Eigen::VectorXd OnWindows(const Eigen::VectorXd& grid, int windows) {
  Eigen::VectorXd mean(windows);
  const int width = windows > 0 ? static_cast<int>(grid.size()) / windows : 1;
  for (int w = 0; w < windows; ++w) mean[w] = grid.segment(w * width, std::max(width, 1)).mean();
  return mean;
}

ConditionMap MapOf(const Evaluator& evaluator, int channel, const Condition& condition,
                   const Residuals& after, bool with_after, std::uint64_t seed) {
  const Channel& c = evaluator.channels()[channel];
  ConditionMap map;
  map.cut = c.cut;
  map.channel = c.name;
  map.unit = c.unit;
  map.condition = condition.name;
  map.condition_unit = condition.unit;
  struct Point {
    double x, before, after;
    int block;
  };
  std::vector<Point> points;
  int block = 0;
  for (int i = 0; i < static_cast<int>(evaluator.runs().size()); ++i) {
    const auto& r = evaluator.AtNominal()[i][channel];
    const auto& v = evaluator.Variance()[i][channel];
    const Eigen::VectorXd grid = condition.of(evaluator.runs()[i], c.index);
    if (grid.size() == 0 || r.size() == 0) continue;
    const Eigen::VectorXd x = OnWindows(grid, static_cast<int>(r.size()));
    const int per_block = evaluator.WindowsPerBlock(i, channel);
    for (int w = 0; w < r.size(); ++w) {
      if (w % per_block == 0) ++block;
      if (std::isfinite(v[w]) && std::isfinite(x[w]))
        points.push_back({x[w], r[w], after[i][channel][w], block});
    }
  }
  if (points.size() < 100) return map;
  std::vector<double> sorted;
  for (const auto& p : points) sorted.push_back(p.x);
  std::sort(sorted.begin(), sorted.end());
  const double low = sorted[sorted.size() / 200], high = sorted[sorted.size() - 1 - sorted.size() / 200];
  if (!(high > low)) return map;
  std::vector<std::vector<std::pair<int, double>>> bins(kBins);
  std::vector<double> sum_after(kBins, 0);
  for (const auto& p : points) {
    if (p.x < low || p.x >= high) continue;
    const int b = std::min(kBins - 1, static_cast<int>((p.x - low) / (high - low) * kBins));
    bins[b].emplace_back(p.block, p.before);
    sum_after[b] += p.after;
  }
  std::mt19937_64 random(seed);
  for (int b = 0; b < kBins; ++b) {
    if (bins[b].size() < 10) continue;
    // Resamples blocks of a second instead of single samples, which are correlated.
    std::vector<std::pair<double, int>> blocks;
    int last = -1;
    for (const auto& [k, value] : bins[b]) {
      if (k != last) blocks.emplace_back(0.0, 0);
      last = k;
      blocks.back().first += value;
      ++blocks.back().second;
    }
    double sum = 0;
    for (const auto& [s, n] : blocks) sum += s;
    std::vector<double> draws;
    std::uniform_int_distribution<std::size_t> pick(0, blocks.size() - 1);
    for (int k = 0; k < kResamples; ++k) {
      double s = 0;
      int n = 0;
      for (std::size_t i = 0; i < blocks.size(); ++i) {
        const auto& drawn = blocks[pick(random)];
        s += drawn.first;
        n += drawn.second;
      }
      draws.push_back(s / n);
    }
    std::sort(draws.begin(), draws.end());
    map.at.push_back(low + (b + 0.5) * (high - low) / kBins);
    map.mean.push_back(sum / static_cast<double>(bins[b].size()));
    map.low.push_back(draws[static_cast<std::size_t>(0.025 * kResamples)]);
    map.high.push_back(draws[static_cast<std::size_t>(0.975 * (kResamples - 1))]);
    if (with_after) map.after.push_back(sum_after[b] / static_cast<double>(bins[b].size()));
  }
  return map;
}

/// The channel with the largest excess of each kind.
std::vector<int> Shown(const Evaluator& evaluator) {
  const ChannelScore score = ScoreChannels(evaluator, evaluator.AtNominal(), evaluator.AtNominal());
  std::vector<int> shown;
  for (const sim::Cut cut :
       {sim::Cut::kCurrentLoop, sim::Cut::kDrivetrain, sim::Cut::kTendon, sim::Cut::kShape}) {
    int best = -1;
    for (int c = 0; c < static_cast<int>(evaluator.channels().size()); ++c) {
      const Channel& channel = evaluator.channels()[c];
      const bool beside = channel.quantity == Channel::Quantity::kTipDirection && evaluator.has_position();
      if (channel.cut != cut || beside) continue;
      if (best < 0 || score.Excess(c) / channel.floor > score.Excess(best) / evaluator.channels()[best].floor)
        best = c;
    }
    if (best >= 0) shown.push_back(best);
  }
  return shown;
}

/// The run in which a channel's residual is largest.
int WorstRun(const Evaluator& evaluator, int channel) {
  int worst = 0;
  double most = -std::numeric_limits<double>::infinity();
  for (int i = 0; i < static_cast<int>(evaluator.runs().size()); ++i) {
    if (evaluator.AtNominal()[i][channel].size() == 0) continue;  // 0 over 0 must not hide a residual
    const ChannelScore score = ScoreChannels(evaluator, evaluator.AtNominal(), evaluator.AtNominal(), {i});
    const double over = score.square[channel] - score.noise[channel];
    if (over > most) most = over, worst = i;
  }
  return worst;
}

std::vector<double> ToVector(const Eigen::VectorXd& v) { return {v.data(), v.data() + v.size()}; }

/// The channel in its worst run, measured and simulated. `model` as for AddDetails.
Overlay OverlayOf(const Evaluator& evaluator, int c, const Model* model, const Residuals& after) {
  const Channel& channel = evaluator.channels()[c];
  const int i = WorstRun(evaluator, c);
  const Evaluator::Curve before = evaluator.NominalCurve(i, c);
  Overlay overlay;
  overlay.run = evaluator.runs()[i].name;
  overlay.channel = channel.name;
  overlay.unit = channel.unit;
  overlay.cut = channel.cut;
  overlay.floor = channel.floor;
  overlay.time_s = ToVector(before.time_s);
  overlay.measured = ToVector(before.measured);
  overlay.before = ToVector(before.simulated);
  // Held out: predicted by the fit to the other families.
  if (model) overlay.after = ToVector(before.measured - after[i][c]);
  const int windows = static_cast<int>(before.time_s.size());
  if (channel.quantity == Channel::Quantity::kTension) {
    overlay.against = fmt::format("motor angle {}", channel.index + 1);
    overlay.against_unit = "rad";
    overlay.x = ToVector(OnWindows(evaluator.runs()[i].signals.motor_angle_rad.col(channel.index), windows));
  } else if (channel.quantity == Channel::Quantity::kTipPosition && !evaluator.runs()[i].without_motors()) {
    overlay.against = "motor angle 1";
    overlay.against_unit = "rad";
    overlay.x = ToVector(OnWindows(evaluator.runs()[i].signals.motor_angle_rad.col(0), windows));
  }
  return overlay;
}

/// Correlation of a channel's residual with a condition; empty where there is too little of either.
std::optional<double> Correlation(const Evaluator& evaluator, int c, const Condition& condition,
                                  const Residuals& after) {
  const Channel& channel = evaluator.channels()[c];
  double rr = 0, xx = 0, rx = 0, r1 = 0, x1 = 0, n = 0;
  for (int k = 0; k < static_cast<int>(evaluator.runs().size()); ++k) {
    const auto& r = after[k][c];
    const auto& v = evaluator.Variance()[k][c];
    const Eigen::VectorXd grid = condition.of(
        evaluator.runs()[k], channel.quantity == Channel::Quantity::kTension ? channel.index : 0);
    if (grid.size() == 0 || r.size() == 0) continue;
    const Eigen::VectorXd x = OnWindows(grid, static_cast<int>(r.size()));
    for (int w = 0; w < r.size(); ++w) {
      if (!std::isfinite(v[w]) || !std::isfinite(x[w])) continue;
      rr += r[w] * r[w], xx += x[w] * x[w], rx += r[w] * x[w], r1 += r[w], x1 += x[w], n += 1;
    }
  }
  const double spread = (rr - r1 * r1 / n) * (xx - x1 * x1 / n);
  if (!(n > 100 && spread > 0)) return std::nullopt;
  return (rx - r1 * x1 / n) / std::sqrt(spread);
}

/// Growth of the tip's residual with time: its change over a time interval.
void AddHorizon(const Evaluator& evaluator, Diagnosis& d) {
  for (const double horizon : {0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0}) {
    double square = 0, noise = 0;
    int count = 0;
    for (int i = 0; i < static_cast<int>(evaluator.runs().size()); ++i) {
      for (int c = 0; c < static_cast<int>(evaluator.channels().size()); ++c) {
        if (evaluator.channels()[c].quantity != Channel::Quantity::kTipPosition) continue;
        const auto& r = evaluator.AtNominal()[i][c];
        const auto& v = evaluator.Variance()[i][c];
        const int step = static_cast<int>(std::lround(horizon / evaluator.window_s(i, c)));
        for (int w = 0; step > 0 && w + step < r.size(); w += std::max(1, step / 2)) {
          if (!std::isfinite(v[w]) || !std::isfinite(v[w + step])) continue;
          square += std::pow(r[w + step] - r[w], 2);
          noise += v[w + step] + v[w];
          ++count;
        }
      }
    }
    // Three axes.
    if (count > 20)
      d.horizon.push_back({horizon, std::sqrt(3 * square / count), std::sqrt(3 * noise / count)});
  }
}

}  // namespace

void AddDetails(const Evaluator& evaluator, const Model* model, const Residuals& after, std::uint64_t seed,
                Diagnosis& d) {
  for (const int c : Shown(evaluator)) {
    const Channel& channel = evaluator.channels()[c];
    d.overlays.push_back(OverlayOf(evaluator, c, model, after));
    const auto add = [&](const Condition& condition) {
      ConditionMap map = MapOf(evaluator, c, condition, after, model != nullptr, seed);
      if (map.at.size() >= 3) d.maps.push_back(std::move(map));
    };
    if (channel.quantity == Channel::Quantity::kTension) {
      for (const auto& condition : kOfTension) add(condition);
    } else if (channel.quantity == Channel::Quantity::kTipPosition) {
      for (const auto& condition : kOfTip) add(condition);
    }
    // A correct model leaves no correlation of the residual with the inputs.
    for (const auto& condition : kOfTension) {
      if (channel.quantity == Channel::Quantity::kTorque) break;
      if (const auto r = Correlation(evaluator, c, condition, after)) {
        d.input_correlations.emplace_back(fmt::format("{} against {}", channel.name, condition.name), *r);
      }
    }
  }
  if (evaluator.has_position()) AddHorizon(evaluator, d);
}

void AddOrders(const Evaluator& evaluator, const SearchResult& search, const std::vector<char>& with_gap,
               std::uint64_t seed, Diagnosis& d) {
  for (int one = 0; one < 2; ++one) {
    const std::string name = NameOf(d.accepted[one]), other = NameOf(d.accepted[1 - one]);
    for (const Fit& fit : search.members) {
      if (fit.model.parts.front().effect->name != d.accepted[one].effect ||
          fit.model.parts.front().where != d.accepted[one].where)
        continue;
      const auto alone = PooledClosure(evaluator, evaluator.AtNominal(),
                                       Completed(fit.held_out, evaluator.AtNominal()), with_gap, seed);
      if (!alone || !d.closed) continue;
      d.order_effects.emplace_back(name + " alone", alone->value);
      d.order_effects.emplace_back(other + " after " + name, d.closed->value - alone->value);
    }
  }
}

std::vector<Profile> ProfilesOf(const Evaluator& evaluator, const Folds& folds, const SearchResult& search,
                                const Fit& fit, int threads) {
  constexpr std::array<double, 7> kAt = {-4, -2, -1, 0, 1, 2, 4};
  const Weights weights(evaluator, search.leftover);
  const Nuisances beside = search.nuisances.Beside(fit.model);
  const Fitter fitter(evaluator, folds, weights, beside);
  std::vector<Profile> profiles;
  for (int part = 0; part < static_cast<int>(fit.model.parts.size()); ++part) {
    const Candidate& candidate = fit.model.parts[part];
    for (int i = 0; i < candidate.size(); ++i) {
      const int k = fit.model.offset(part) + i;
      const auto& p = fit.model.parameter(k);
      const double deviation = std::sqrt(std::max(0.0, fit.covariance(k, k)));
      if (p.shape || !(deviation > 0)) continue;
      std::vector<double> values, lost(kAt.size());
      for (const double at : kAt) {
        const double value = std::clamp(fit.model.values[k] + at * deviation, p.lower, p.upper);
        if (values.empty() || value > values.back()) values.push_back(value);
      }
      ParallelFor(static_cast<int>(values.size()), threads, [&](int v) {
        try {
          lost[v] = fitter.Lost(fit, k, values[v]);
        } catch (const std::exception&) {
          lost[v] = std::nan("");
        }
      });
      Profile profile{std::string(candidate.effect->name), candidate.where, std::string(p.name), {}, {}};
      for (std::size_t v = 0; v < values.size(); ++v) {
        if (!std::isfinite(lost[v])) continue;
        profile.value.push_back(values[v]);
        profile.score.push_back(lost[v]);
      }
      profiles.push_back(profile);
    }
  }
  return profiles;
}

NextExperiment FindNextExperiment(const Evaluator& evaluator, const SearchResult& search, const Diagnosis& d,
                                  const ExperimentMenu& menu, int threads) {
  NextExperiment next;
  if (menu.families.empty() || search.fits.size() < 2) return next;
  const bool ambiguous = d.verdict == Verdict::kAmbiguousGroup;
  if (!ambiguous && d.verdict != Verdict::kUnexplained && d.verdict != Verdict::kInsufficientData)
    return next;
  const Fit &a = search.fits[0], &b = search.fits[1];
  const RobotParameters robot_a = a.model.Robot(evaluator.nominal());
  std::vector<double> separation(menu.families.size(), 0);
  ParallelFor(static_cast<int>(menu.families.size()), threads, [&](int k) {
    try {
      DataSet set;
      set.robot = evaluator.nominal();
      set.runs.push_back(menu.simulate(menu.families[k], robot_a));
      const Evaluator there(set, {1, d.delta_N, d.delta_m, d.seed});
      const unsigned cuts = there.CutsOf(*a.model.parts[0].effect) | there.CutsOf(*b.model.parts[0].effect);
      const Residuals with_a = there.At(robot_a, cuts);
      const Residuals with_b = there.At(b.model.Robot(evaluator.nominal()), cuts);
      // The part that the other rival cannot reproduce by changing its own parameters, to first order.
      const Folds folds = MakeFolds(there.runs());
      const Weights weights(there, Eigen::VectorXd::Zero(static_cast<int>(there.channels().size())));
      std::vector<Column> columns;
      for (int p = 0; p < b.model.size(); ++p) {
        columns.push_back(Sensitivity(there, b.model, p, 0.1 * ScaleOf(b.model.parameter(p)), with_b, cuts));
      }
      std::vector<const Column*> pointers;
      for (const auto& column : columns) pointers.push_back(&column);
      Residuals difference = with_b;
      for (std::size_t c = 0; c < difference[0].size(); ++c) {
        if (difference[0][c].size() > 0 && with_a[0][c].size() > 0) difference[0][c] -= with_a[0][c];
      }
      Residuals zero = there.AtNominal();
      for (auto& r : zero[0]) r.setZero();
      const int n = static_cast<int>(pointers.size());
      Bounds bounds;
      for (int p = 0; p < n; ++p) bounds.Add(b.model.parameter(p), b.model.values[p]);
      const LinearFit taken = SolveLinear(Accumulate(pointers, difference, zero, weights, folds), bounds);
      for (int p = 0; p < n; ++p) {
        for (std::size_t c = 0; c < difference[0].size(); ++c) {
          if (columns[p][0][c].size() > 0) difference[0][c] -= taken.value[p] * columns[p][0][c];
        }
      }
      double most = 0;
      for (std::size_t c = 0; c < difference[0].size(); ++c) {
        const auto& r = difference[0][c];
        if (r.size() > 0)
          most = std::max(most, std::sqrt(r.squaredNorm() / r.size()) / there.channels()[c].floor);
      }
      separation[k] = most;
    } catch (const std::exception&) {
      separation[k] = 0;  // the robot cannot perform this run
    }
  });
  int best = 0;
  for (int k = 1; k < static_cast<int>(separation.size()); ++k) {
    if (separation[k] > separation[best]) best = k;
  }
  if (separation[best] <= 0) return next;
  next.family = menu.families[best];
  next.separation_sigma = separation[best];
  next.reason = fmt::format("{} and {} differ most there: {:.2g} sigma after refitting each",
                            a.model.parts[0].Name(), b.model.parts[0].Name(), separation[best]);
  next.yaml = menu.plan ? menu.plan(next.family) : "";
  for (int k = 0; k < static_cast<int>(separation.size()); ++k) {
    if (k != best) next.alternatives.emplace_back(menu.families[k], separation[k]);
  }
  std::stable_sort(next.alternatives.begin(), next.alternatives.end(),
                   [](const auto& x, const auto& y) { return x.second > y.second; });
  return next;
}

}  // namespace tendril::gap
