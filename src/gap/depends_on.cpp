// Regression of the differences between runs on functions of states, each compared with what chance gives on
// the same data.
#include "depends_on.h"

#include <fmt/core.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <utility>

#include "median.h"

namespace tendril::gap {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Columns = std::vector<VectorXd>;

constexpr int kDraws = 1999;  // random draws for the chance distribution
constexpr double kChance = 0.01;
// Of the mean square: a function that covers less than half of the rms does not explain the differences.
constexpr double kLeastShare = 0.25;
constexpr double kKinds = 2;  // functions of states, and the order of the runs
// With fewer blocks the signs alone would coincide in one of a hundred cases.
constexpr int kLeastBlocks = 8, kLeastInOrder = 6;
// An angle's period can be distinguished from drift with at least two of them; a period shorter than two
// windows is averaged out.
constexpr double kLeastPeriods = 2, kWindowsAPeriod = 2;
constexpr int kMostOrders = 60;  // per turn: slots times poles of usual motors, and twice that

/// Each run's value less the mean of all runs there and less its own mean: an offset is not a dependence.
VectorXd Deviations(const Repetitions& r, const VectorXd& values) {
  VectorXd off = values;
  Index first = 0;
  for (const auto& group : r.groups) {
    Eigen::Map<MatrixXd> its(off.data() + first, group.windows, group.runs);
    its.colwise() -= its.rowwise().mean().eval();
    its.rowwise() -= its.colwise().mean().eval();
    first += its.size();
  }
  return off;
}

/// Orthonormal basis of these columns' deviations, orthogonal to `taken`.
MatrixXd Base(const Repetitions& r, const Columns& columns, const MatrixXd& taken) {
  constexpr double kAdds = 1e-6;  // relative to the largest: less than this is linearly dependent
  MatrixXd all(r.residual.size(), static_cast<Index>(columns.size()));
  for (Index c = 0; c < all.cols(); ++c) all.col(c) = Deviations(r, columns[static_cast<std::size_t>(c)]);
  all -= taken * (taken.transpose() * all);
  const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(all.transpose() * all);
  const VectorXd& values = solver.eigenvalues();
  const Index count = values.tail(1)[0] > 0 ? (values.array() > kAdds * values.tail(1)[0]).count() : 0;
  return all * solver.eigenvectors().rightCols(count) *
         values.tail(count).cwiseSqrt().cwiseInverse().asDiagonal();
}

/// Correlation length of deviations in windows, to 1/e.
Index Alike(const Repetitions& r, const VectorXd& off) {
  const Index windows = r.groups.front().windows;
  const auto first = off.head(windows);
  Index lag = 1;
  while (2 * lag < windows &&
         first.head(windows - lag).dot(first.tail(windows - lag)) > first.squaredNorm() / M_E)
    ++lag;
  return lag;
}

/// Chance distribution of one channel by random signs of blocks: repeated runs are exchangeable.
class Signs {
 public:
  Signs(const Repetitions& r, const VectorXd& off, std::mt19937_64& random) : off_(off), block_(off.size()) {
    const Index width = std::max<Index>(std::lround(kDisturbance_s / r.window_s), 2 * Alike(r, off));
    Index blocks = 0, row = 0;
    for (const auto& group : r.groups) {
      for (Index k = 0; k < group.windows * group.runs; ++k)
        block_[row++] = blocks + k % group.windows / width;
      blocks += (group.windows + width - 1) / width;
    }
    signs_.resize(kDraws, blocks);
    for (double& sign : signs_.reshaped()) sign = random() % 2 == 0 ? 1 : -1;
  }
  bool enough() const { return signs_.cols() >= kLeastBlocks && off_.squaredNorm() > 0; }
  double Share(const MatrixXd& base) const {
    return (base.transpose() * off_).squaredNorm() / off_.squaredNorm();
  }
  /// Shares explained by chance (kDraws).
  VectorXd Drawn(const MatrixXd& base) const {
    MatrixXd sums = MatrixXd::Zero(signs_.cols(), base.cols());
    for (Index row = 0; row < off_.size(); ++row) sums.row(block_[row]) += off_[row] * base.row(row);
    return (signs_ * sums).rowwise().squaredNorm() / off_.squaredNorm();
  }

 private:
  VectorXd off_;
  Eigen::Matrix<Index, Eigen::Dynamic, 1> block_;
  MatrixXd signs_;
};

/// Orders per motor turn that these runs can resolve: those of the motor, and those of the spool between
/// them.
std::vector<std::pair<double, std::string>> Orders(const Repetitions& r, const Repetitions::Motor& motor) {
  const double turn = 2 * std::numbers::pi;
  const double turns = (motor.angle_rad.maxCoeff() - motor.angle_rad.minCoeff()) / turn;
  const VectorXd speed = motor.velocity_radps.cwiseAbs();
  const double a_window = Median(std::vector<double>(speed.begin(), speed.end())) * r.window_s / turn;
  std::vector<std::pair<double, std::string>> orders;
  const auto add = [&](double order, const char* what, int times) {
    if (order * turns < kLeastPeriods || order * a_window * kWindowsAPeriod > 1) return;
    orders.emplace_back(order,
                        fmt::format("the {} of {}, {}", what, motor.name,
                                    times == 1 ? "once a turn" : fmt::format("{} times a turn", times)));
  };
  for (int k = 1; k <= kMostOrders; ++k) add(k, "angle", k);
  for (int k = 1; k < motor.gear_ratio; ++k) add(k / motor.gear_ratio, "spool angle", k);
  return orders;
}

/// Torque and friction proportional to the cosine and sine of a multiple of the angle.
void AddWaves(const Repetitions::Motor& motor, double order, Columns& to) {
  const Eigen::ArrayXd at = order * motor.angle_rad.array(), sign = motor.velocity_radps.array().sign();
  for (const Eigen::ArrayXd& wave : {Eigen::ArrayXd(at.cos()), Eigen::ArrayXd(at.sin())}) {
    to.emplace_back(wave);
    to.emplace_back(wave * sign);
  }
}

/// A condition as one column per run, each with its own factor.
Columns ByRun(const Repetitions& r, const VectorXd& value) {
  Columns by_run;
  Index row = 0;
  for (const auto& group : r.groups) {
    for (Index i = 0; i < group.runs; ++i, row += group.windows) {
      by_run.emplace_back(VectorXd::Zero(value.size()));
      by_run.back().segment(row, group.windows) = value.segment(row, group.windows);
    }
  }
  return by_run;
}

std::vector<std::pair<std::string, VectorXd>> Conditions(const Repetitions& r) {
  std::vector<std::pair<std::string, VectorXd>> conditions{{"the time in the run", r.time_s}};
  for (const auto& motor : r.motors) {
    conditions.emplace_back("the speed of " + motor.name, motor.velocity_radps);
    conditions.emplace_back("the direction of " + motor.name, motor.velocity_radps.cwiseSign());
    if (motor.tension_N.size() > 0)
      conditions.emplace_back("the tension of " + motor.tendon, motor.tension_N);
  }
  return conditions;
}

/// Probability that repetitions in random order correlate with their number as much as these do; 1 where that
/// covers less than half of the rms, or where there are too few.
double OutOfOrder(const Repetitions& r, std::mt19937_64& random) {
  const Index n = r.groups.front().runs;
  const VectorXd all = Deviations(r, r.residual);
  const Eigen::Map<const MatrixXd> off(all.data(), r.groups.front().windows, n);
  VectorXd number = VectorXd::LinSpaced(n, -1, 1);
  const double its = (off * number).squaredNorm(),
               least = kLeastShare * number.squaredNorm() * off.squaredNorm();
  if (n < kLeastInOrder || its <= least) return 1;
  double as_much = 1;
  for (int draw = 0; draw < kDraws; ++draw) {
    std::shuffle(number.begin(), number.end(), random);
    as_much += (off * number).squaredNorm() >= its ? 1 : 0;
  }
  return as_much / (1 + kDraws);
}

/// Everything that is tried, each compared with chance; p-values are for all together.
class Attempts {
 public:
  /// Columns explain a part by chance, which is subtracted so that functions with many columns gain nothing.
  void Try(const Signs& signs, const MatrixXd& base, Dependence as) {
    const VectorXd drawn = signs.Drawn(base);
    const double share = signs.Share(base), by_chance = drawn.mean();
    strongest_ = strongest_.cwiseMax((drawn.array() - by_chance).matrix());
    const auto columns = static_cast<double>(base.cols());
    all_.push_back({share - by_chance, share, columns, columns / std::max(by_chance, 1e-9), std::move(as)});
  }

  /// The function that explains most for its number of columns (Akaike), angles before conditions.
  std::optional<Dependence> Best() const {
    std::optional<Dependence> found;
    double most = 0, free = 0, most_beyond = 0;
    for (const Tried& one : all_) {
      if (one.beyond > most_beyond) most_beyond = one.beyond, free = one.free;
    }
    for (const Tried& one : all_) {
      const auto as_much = static_cast<double>((strongest_.array() >= one.beyond).count());
      const double p = kKinds * (1 + as_much) / (1 + kDraws);
      if (p > kChance || one.share < kLeastShare) continue;
      const double akaike = -free * std::log(std::max(1e-9, 1 - one.share)) - 2 * one.columns;
      if (found && (found->law > one.as.law || (found->law == one.as.law && akaike <= most))) continue;
      most = akaike, found = one.as, found->p_value = p;
    }
    return found;
  }

 private:
  struct Tried {
    double beyond, share;  // the share less what chance explains, and the share
    double columns, free;  // number of columns; degrees of freedom left, by the share that chance explains
    Dependence as;
  };
  VectorXd strongest_ = VectorXd::Zero(kDraws);  // the best of all functions in each random draw
  std::vector<Tried> all_;
};

void TryAngles(const Repetitions& r, int channel, const Signs& signs, Attempts& attempts) {
  for (const auto& motor : r.motors) {
    // A disturbance moves the motor too, so a smooth dependence on its own angle is not a periodic law.
    const VectorXd& angle = motor.angle_rad;
    const MatrixXd smooth = Base(r, {angle, angle.cwiseAbs2(), motor.velocity_radps.cwiseSign()},
                                 MatrixXd::Zero(angle.size(), 1));
    for (const auto& [order, on] : Orders(r, motor)) {
      Columns waves;
      AddWaves(motor, order, waves);
      attempts.Try(signs, Base(r, waves, smooth), {channel, on, 1, true});
      // A narrow peak has the next three harmonics too.
      for (int k = 2; k <= 4; ++k) AddWaves(motor, k * order, waves);
      attempts.Try(signs, Base(r, waves, smooth), {channel, on, 1, true});
    }
  }
}

}  // namespace

std::optional<Dependence> DependsOn(const std::vector<Repetitions>& channels, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  Attempts attempts;
  double p_order = 1;
  int in_order = 0;
  for (std::size_t c = 0; c < channels.size(); ++c) {
    const Repetitions& r = channels[c];
    if (r.groups.empty()) continue;
    const int channel = static_cast<int>(c);
    const Signs signs(r, Deviations(r, r.residual), random);
    if (!signs.enough()) continue;
    if (r.angles) TryAngles(r, channel, signs, attempts);
    if (!r.conditions) continue;
    for (const auto& [name, value] : Conditions(r)) {
      attempts.Try(signs, Base(r, ByRun(r, value), MatrixXd::Zero(value.size(), 1)),
                   {channel, name, 1, false});
    }
    if (const double p = OutOfOrder(r, random); p < p_order) p_order = p, in_order = channel;
  }
  std::optional<Dependence> found = attempts.Best();
  if (!found && kKinds * p_order <= kChance)
    found = {in_order, "the number of the repetition", kKinds * p_order, false};
  return found;
}

}  // namespace tendril::gap
