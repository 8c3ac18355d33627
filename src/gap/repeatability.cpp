// From repeated runs to whether they repeat.
#include "repeatability.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "depends_on.h"
#include "evaluator.h"
#include "locate.h"
#include "tendril/core/parallel.h"

namespace tendril::gap {
namespace {

using Eigen::VectorXd;
using Quantity = Channel::Quantity;

// Run-to-run scatter (rms) of dry friction of a usual robot, by wear, temperature and lubricant.
constexpr double kFrictionScatter = 0.1;
constexpr double kFalseAlarm = 0.01;  // probability of calling a repeatable set non-repeatable
// Independent blocks of states at rest, and the fewest blocks that are conclusive.
constexpr int kBlockStates = 5, kFewestBlocks = 4;

/// Indices of repeated runs, two or more, the original first.
std::vector<std::vector<int>> RepeatedRuns(const Evaluator& evaluator) {
  const auto& runs = evaluator.runs();
  std::vector<std::vector<int>> groups;
  for (int i = 0; i < static_cast<int>(runs.size()); ++i) {
    std::vector<int> group{i};
    for (int k = 0; k < static_cast<int>(runs.size()); ++k) {
      if (k != i && runs[k].repeat_of == runs[i].name) group.push_back(k);
    }
    if (group.size() > 1) groups.push_back(std::move(group));
  }
  return groups;
}

/// The nominal robot with kFrictionScatter more dry friction from motor `tendon` to the body.
RobotParameters MoreFriction(RobotParameters robot, int tendon) {
  constexpr double kMore = 1 + kFrictionScatter;
  auto& p = robot.actuation->tendons[static_cast<std::size_t>(tendon)];
  p.motor.coulomb_friction_Nm *= kMore;
  if (p.gear.efficiency > 0)
    p.gear.efficiency = std::max(0.5 * p.gear.efficiency, 1 - kMore * (1 - p.gear.efficiency));
  for (auto& pulley : p.transmission.pulleys) pulley.alpha *= kMore;
  p.transmission.coulomb_N *= kMore;
  for (auto& effect : robot.effects) {
    const bool dry = effect.name == "routing_friction" || effect.name == "backbone_hysteresis";
    if (dry && !effect.values.empty()) effect.values.front().second *= kMore;
  }
  return robot;
}

/// Variance [run][channel] of a window's mean due to the scatter of friction from run to run.
std::vector<VectorXd> FrictionScatter(const Evaluator& evaluator, const std::vector<int>& repeated,
                                      int threads) {
  const int tendons = evaluator.nominal().body.tendons();
  const auto channels = static_cast<Eigen::Index>(evaluator.channels().size());
  std::vector<Residuals> with(static_cast<std::size_t>(tendons));
  ParallelFor(tendons, threads, [&](int j) {
    with[static_cast<std::size_t>(j)] =
        evaluator.At(MoreFriction(evaluator.nominal(), j), kAllCuts, repeated);
  });
  std::vector<VectorXd> scatter(evaluator.runs().size(), VectorXd::Zero(channels));
  for (const int i : repeated) {
    for (Eigen::Index c = 0; c < channels; ++c) {
      const VectorXd& nominal = evaluator.AtNominal()[i][c];
      const auto measured = evaluator.Variance()[i][c].array().isFinite().count();
      for (const Residuals& one : with) {
        if (one[i][c].size() == nominal.size() && measured > 0)
          scatter[i][c] += (one[i][c] - nominal).squaredNorm() / static_cast<double>(measured);
      }
    }
  }
  return scatter;
}

/// Variance of a torque that follows its target, if commands reach the drive up to a sample earlier or later
/// than the log says.
double LateCommands(const PreparedRun& run, const Channel& channel) {
  if (channel.quantity != Quantity::kTorque) return 0;
  const auto target = run.signals.torque_target_Nm.col(channel.index);
  const Eigen::Index steps = target.size() - 1;
  return (target.tail(steps) - target.head(steps)).squaredNorm() /
         static_cast<double>(3 * std::max<Eigen::Index>(1, steps));
}

/// Variance of a window's mean due to the resolution of a reading: the rounding error is constant while the
/// signal stays within a step; over k steps it averages to a k-th part.
double StepVariance(const Eigen::Ref<const VectorXd>& reading, double step) {
  int readings = 1;
  for (Eigen::Index i = 1; i < reading.size(); ++i) readings += reading[i] != reading[i - 1];
  return std::pow(step / readings, 2) / 12;
}

/// Variance due to the sensors in a window of a run.
double SensorVariance(const Evaluator& evaluator, int run, int c, Eigen::Index w) {
  const double variance = evaluator.Variance()[run][c][w];
  const Channel& channel = evaluator.channels()[c];
  if (!std::isfinite(variance) || channel.cut == sim::Cut::kShape)
    return variance;  // for a tip it is included
  const PreparedRun& its = evaluator.runs()[run];
  const Eigen::Index width = WindowSamples(its, channel), from = w * width;
  const auto j = static_cast<std::size_t>(channel.index);
  const TendonDriveParameters& drive = evaluator.nominal().actuation->tendons[j];
  const double torque_Nm = 1e-3 * drive.drive.rated_torque_Nm;
  const auto within = [&](const Eigen::MatrixXd& signal, double step) {
    return signal.rows() >= from + width ? StepVariance(signal.col(channel.index).segment(from, width), step)
                                         : 0;
  };
  if (channel.quantity == Quantity::kTorque)
    return std::max(variance, within(its.signals.torque_actual_Nm, torque_Nm));
  double steps = j < its.cell_step_N.size() ? within(its.cell_N, its.cell_step_N[j]) : 0;
  if (channel.cut == sim::Cut::kDrivetrain && drive.SpoolTravelPerMotorRad() > 0)
    steps += within(its.signals.torque_actual_Nm, torque_Nm / drive.SpoolTravelPerMotorRad());
  return std::max(variance, steps);
}

/// Repeatability of one channel.
struct Spread {
  double square = 0;    // half the mean square difference, weighted by information
  double noise = 0;     // its part due to the sensors
  double friction = 0;  // its part due to friction scatter
  double p_noise = 1;   // of sensor noise alone giving as much
  double p_usual = 1;   // of noise and friction scatter together
};

/// Probability that a sum of n squares of standard normals is as large.
double ChiSquare(int n, double sum) {
  const double x = 0.5 * std::max(0.0, sum);
  double a = n % 2 == 0 ? 1 : 0.5, q = n % 2 == 0 ? std::exp(-x) : std::erfc(std::sqrt(x));
  for (; a < 0.5 * n; ++a) q += std::exp(a * std::log(std::max(x, 1e-300)) - x - std::lgamma(a + 1));
  return q;
}

/// Worst case: noise is constant over a block, and the scatter of friction over a whole run.
Spread SpreadOf(const Evaluator& evaluator, int c, const std::vector<VectorXd>& scatter) {
  Spread s;
  int pairs = 0;
  double total = 0, blocks = 0;
  for (const auto& group : RepeatedRuns(evaluator)) {
    for (std::size_t k = 1; k < group.size(); ++k, ++pairs) {
      const int i = group[0], o = group[k];
      const VectorXd &a = evaluator.AtNominal()[i][c], &b = evaluator.AtNominal()[o][c];
      double windows = 0;
      for (Eigen::Index w = 0; w < std::min(a.size(), b.size()); ++w) {
        const double noise = 0.5 * (SensorVariance(evaluator, i, c, w) + SensorVariance(evaluator, o, c, w));
        if (!std::isfinite(noise)) continue;
        s.square += 0.5 * std::pow(a[w] - b[w], 2) / noise;
        total += 1 / noise;
        s.friction += 0.5 * (scatter[i][c] + scatter[o][c]) / noise;
        ++windows;
      }
      s.noise += windows;
      const bool at_rest = evaluator.runs()[i].signals.at_rest;
      blocks += windows / (at_rest ? kBlockStates : std::max(1.0, kDisturbance_s / evaluator.window_s(i, c)));
    }
  }
  if (blocks < kFewestBlocks) return s;
  s.square /= total, s.noise /= total, s.friction /= total;
  s.p_noise = ChiSquare(static_cast<int>(blocks), std::floor(blocks) * s.square / (kNoiseSlack * s.noise));
  const double beyond = s.square - kNoiseSlack * s.noise;
  s.p_usual = std::max(s.p_noise, s.friction > 0 ? ChiSquare(pairs, pairs * beyond / s.friction) : 0);
  return s;
}

/// Repeated runs in one channel, with the states of the motors that it may depend on: its own, or all for a
/// tip. Bridged samples are left out.
Repetitions Shown(const Evaluator& evaluator, int c, bool conditions) {
  const Channel& channel = evaluator.channels()[c];
  Repetitions all;
  all.conditions = conditions;
  all.angles =
      channel.cut != sim::Cut::kShape;  // a motor's angle acts only up to its tendon, which is measured
  std::vector<int> motors;
  for (int j = 0; j < evaluator.nominal().body.tendons(); ++j) {
    if (channel.cut != sim::Cut::kShape && channel.index != j) continue;
    const double ratio = evaluator.nominal().actuation->tendons[static_cast<std::size_t>(j)].gear.ratio;
    all.motors.push_back(
        {fmt::format("motor {}", j + 1), fmt::format("tendon {}", j + 1), ratio, {}, {}, {}});
    motors.push_back(j);
  }
  for (const auto& group : RepeatedRuns(evaluator)) {
    const Eigen::Index width = WindowSamples(evaluator.runs()[group[0]], channel);
    Eigen::Index windows = evaluator.Variance()[group[0]][c].size();
    for (const int i : group) windows = std::min(windows, evaluator.Variance()[i][c].size());
    std::vector<Eigen::Index> at;
    VectorXd variance = VectorXd::Zero(windows);
    for (Eigen::Index w = 0; w < windows; ++w) {
      for (const int i : group) {
        const auto bridged = [&](const Dropout& dropout) {
          return dropout.from < (w + 1) * width && w * width < dropout.to;
        };
        const auto& dropouts = evaluator.runs()[i].motor_dropouts;
        variance[w] += std::any_of(dropouts.begin(), dropouts.end(), bridged)
                           ? std::numeric_limits<double>::infinity()
                           : evaluator.Variance()[i][c][w];
      }
      if (std::isfinite(variance[w])) at.push_back(w);
    }
    if (at.empty()) continue;
    all.window_s = evaluator.window_s(group[0], c);
    all.groups.push_back({static_cast<Eigen::Index>(at.size()), static_cast<Eigen::Index>(group.size())});
    const VectorXd rms = (variance(at) / static_cast<double>(group.size())).cwiseSqrt();
    for (const int i : group) {
      const sim::ReplaySignals& s = evaluator.runs()[i].signals;
      const auto add = [&](VectorXd& to, const VectorXd& more) {
        to.conservativeResize(to.size() + more.size());
        to.tail(more.size()) = more;
      };
      const auto mean = [&](const Eigen::MatrixXd& grid, int j) {
        VectorXd of(rms.size());
        for (Eigen::Index k = 0; k < of.size(); ++k)
          of[k] = grid.col(j).segment(at[static_cast<std::size_t>(k)] * width, width).mean();
        return of;
      };
      add(all.residual, evaluator.AtNominal()[i][c](at).cwiseQuotient(rms));
      add(all.time_s, all.window_s * Eigen::Map<const Eigen::Matrix<Eigen::Index, Eigen::Dynamic, 1>>(
                                         at.data(), rms.size())
                                         .cast<double>());
      for (std::size_t m = 0; m < motors.size(); ++m) {
        add(all.motors[m].angle_rad, mean(s.motor_angle_rad, motors[m]));
        add(all.motors[m].velocity_radps, mean(s.motor_velocity_radps, motors[m]));
        if (s.tension_N.cols() > motors[m]) add(all.motors[m].tension_N, mean(s.tension_N, motors[m]));
      }
    }
  }
  return all;
}

double DeltaOf(const Channel& channel, const Evaluator::Options& options) {
  if (channel.quantity == Quantity::kTension) return options.delta_N;
  return channel.quantity == Quantity::kTipPosition ? options.delta_m : 0;
}

std::string Place(const Repeatability& r) {
  return fmt::format("{} ({}, {})", sim::CutName(r.cut), r.quantity, r.where);
}

std::string Differ(const Repeatability& r) {
  const std::string on = r.depends_on.empty() ? "none of the states tried"
                                              : fmt::format("{} (p = {:.2g})", r.depends_on, r.p_value);
  return fmt::format("repetitions differ by {:.2g} times the sensor noise{}, which depends on {}",
                     r.rms / r.floor, r.law ? "" : " and by more than the usual scatter of friction", on);
}

}  // namespace

std::optional<Repeatability> FindRepeatability(const Evaluator& evaluator,
                                               const Evaluator::Options& options) {
  std::vector<int> repeated;
  for (const auto& group : RepeatedRuns(evaluator))
    repeated.insert(repeated.end(), group.begin(), group.end());
  if (repeated.empty()) return std::nullopt;
  std::sort(repeated.begin(), repeated.end());
  repeated.erase(std::unique(repeated.begin(), repeated.end()), repeated.end());
  const std::size_t channels = evaluator.channels().size();
  std::vector<VectorXd> scatter;
  try {
    scatter = FrictionScatter(evaluator, repeated, options.threads);
  } catch (const std::runtime_error&) {
    return std::nullopt;  // the effect of friction is unknown then
  }
  for (const int i : repeated) {
    for (std::size_t c = 0; c < channels; ++c)
      scatter[i][static_cast<Eigen::Index>(c)] += LateCommands(evaluator.runs()[i], evaluator.channels()[c]);
  }
  std::vector<Spread> spreads(channels);
  std::vector<Repetitions> shown(channels);
  int worst = -1;
  const auto ratio = [&](int c) {
    return spreads[static_cast<std::size_t>(c)].square / spreads[static_cast<std::size_t>(c)].noise;
  };
  for (std::size_t c = 0; c < channels; ++c) {
    const int channel = static_cast<int>(c);
    const Spread& s = spreads[c] = SpreadOf(evaluator, channel, scatter);
    const double delta = DeltaOf(evaluator.channels()[c], options);
    if (s.p_noise > kFalseAlarm || s.square - s.noise <= delta * delta) continue;
    const bool beyond = s.p_usual * static_cast<double>(channels) <= kFalseAlarm;
    if (evaluator.channels()[c].quantity != Quantity::kTorque) shown[c] = Shown(evaluator, channel, beyond);
    if (beyond && (worst < 0 || ratio(channel) > ratio(worst))) worst = channel;
  }
  Repeatability r;
  // Friction scatter does not follow an angle, so a dependence on one counts however small it is.
  if (const auto on = DependsOn(shown, options.seed)) {
    worst = on->channel;
    r.depends_on = on->on, r.p_value = on->p_value, r.law = on->law;
  }
  if (worst < 0) return std::nullopt;
  const Spread& s = spreads[static_cast<std::size_t>(worst)];
  const Channel& channel = evaluator.channels()[static_cast<std::size_t>(worst)];
  r.cut = channel.cut;
  r.where = PlaceOf(channel, evaluator);
  r.quantity = NameOf(channel.quantity);
  r.unit = channel.unit;
  r.rms = std::sqrt(s.square);
  r.floor = std::sqrt(s.noise);
  r.sigma = std::sqrt(std::max(0.0, s.square / s.noise - 1));
  return r;
}

std::string Unrepeated(const Repeatability& r) {
  return fmt::format(
      "The robot does not repeat at {}: {}. {}", Place(r), Differ(r),
      r.law ? "No effect of the library that was tried makes runs differ in this way: the model lacks one "
              "that does."
            : "These logs cannot show whether the model has a smaller gap; if anything was changed or "
              "touched between the runs, they are not repetitions (repeat_of: none in runs.yaml).");
}

std::string UnrepeatedRemark(const Repeatability& r) {
  return fmt::format(
      " But {}: the robot does not repeat at {}{}.", Differ(r), Place(r),
      r.law ? "" : ", and if it was changed between the runs, they do not define the noise floor");
}

}  // namespace tendril::gap
