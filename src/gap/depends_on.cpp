// Functions of angles by regression, conditions by ranks, each against what chance makes of the same data.
#include "depends_on.h"

#include <fmt/core.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <random>
#include <utility>

#include "median.h"

namespace tendril::gap {
namespace {

constexpr int kDraws = 1999;  // of what chance would make
// Fewer independent stretches of time than this say nothing.
constexpr int kLeastBlocks = 8;
// An angle's period is told from drift by at least two of them; one that passes within two windows is
// averaged away.
constexpr double kLeastPeriods = 2, kWindowsAPeriod = 2;
constexpr int kMostOrders = 60;  // a turn: slots times poles of usual motors, and twice that
// Runs that have to be put in order: of five, chance puts one in sixty in order, up or down.
constexpr int kLeastInOrder = 6;
constexpr int kBins = 6;
// Dependence that chance makes as often is none; nor is one that makes less than half of the rms.
constexpr double kChance = 0.01, kLeastShare = 0.25;

/// The strongest that chance makes of all that is tried, draw by draw: a p-value is then of all together.
class Chance {
 public:
  Chance() : strongest_(kDraws, 0.0) {}
  void Add(int draw, double statistic) {
    double& strongest = strongest_[static_cast<std::size_t>(draw)];
    strongest = std::max(strongest, statistic);
  }
  /// Probability of a statistic as large.
  double As(double statistic) const {
    const auto as_large =
        std::count_if(strongest_.begin(), strongest_.end(), [&](double one) { return one >= statistic; });
    return (1.0 + static_cast<double>(as_large)) / (1.0 + kDraws);
  }

 private:
  std::vector<double> strongest_;
};

/// The strongest of what was tried, beside what chance makes.
struct Strongest {
  void Try(double its, int its_channel, const std::string& its_on) {
    if (its > statistic) statistic = its, channel = its_channel, on = its_on;
  }
  std::optional<std::pair<int, Dependence>> Found(double kinds, bool law) const {
    const double p = std::min(1.0, kinds * chance.As(statistic));
    if (statistic < 0 || p > kChance) return std::nullopt;
    return std::pair(channel, Dependence{on, p, law});
  }

  Chance chance;
  double statistic = -1;
  int channel = 0;
  std::string on;
};

// ---- functions of an angle ----

/// Each run's value less the mean of all runs there, and less its own mean: another zero is no dependence.
Eigen::MatrixXd Deviations(const Eigen::MatrixXd& values) {
  Eigen::MatrixXd off = values.colwise() - values.rowwise().mean();
  return off.rowwise() - off.colwise().mean();
}

Eigen::MatrixXd Direction(const RepeatedMotor& motor) { return motor.velocity_radps.cwiseSign(); }

/// All groups of a channel, run after run, as rows of one regression.
class Stack {
 public:
  explicit Stack(const std::vector<Repetitions>& groups) : groups_(groups) {
    int first = 0;
    std::vector<int> block;
    for (const Repetitions& g : groups) {
      for (Eigen::Index i = 0; i < g.off.cols(); ++i) {
        for (const int b : g.block) block.push_back(first + b);
      }
      if (g.block.size() > 0) first += g.block.maxCoeff() + 1;
    }
    blocks_ = first;
    block_ = Eigen::Map<Eigen::VectorXi>(block.data(), static_cast<Eigen::Index>(block.size()));
    off_ = Of([](const Repetitions& g) { return g.off; });
  }

  /// Column of what `of` makes of each group (W x n), as deviations.
  template <class F>
  Eigen::VectorXd Of(F&& of) const {
    Eigen::VectorXd column(block_.size());
    Eigen::Index row = 0;
    for (const Repetitions& g : groups_) {
      const Eigen::MatrixXd off = Deviations(of(g));
      column.segment(row, off.size()) = off.reshaped();
      row += off.size();
    }
    return column;
  }

  int blocks() const { return blocks_; }
  const Eigen::VectorXi& block() const { return block_; }
  const Eigen::VectorXd& off() const { return off_; }

 private:
  const std::vector<Repetitions>& groups_;
  int blocks_ = 0;
  Eigen::VectorXi block_;
  Eigen::VectorXd off_;
};

/// Columns that span the same and are orthonormal; those that hardly add anything are left out.
Eigen::MatrixXd Orthonormal(const Eigen::MatrixXd& columns) {
  constexpr double kAdds = 1e-6;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(columns.transpose() * columns);
  const Eigen::VectorXd& values = solver.eigenvalues();
  Eigen::Index none = 0;
  while (none < values.size() && values[none] <= kAdds * values[values.size() - 1]) ++none;
  const Eigen::Index count = values.size() - none;
  return columns * solver.eigenvectors().rightCols(count) *
         values.tail(count).cwiseSqrt().cwiseInverse().asDiagonal();
}

/// Sums over each block of the products of `columns` with `off`: blocks x columns.
Eigen::MatrixXd ByBlock(const Stack& stack, const Eigen::MatrixXd& columns, const Eigen::VectorXd& off) {
  Eigen::MatrixXd sums = Eigen::MatrixXd::Zero(stack.blocks(), columns.cols());
  for (Eigen::Index row = 0; row < off.size(); ++row)
    sums.row(stack.block()[row]) += off[row] * columns.row(row);
  return sums;
}

/// Random signs of blocks [draw][block]: runs of the same commands may change names, and what is none's state
/// in particular follows none.
std::vector<Eigen::RowVectorXd> Signs(int blocks, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::vector<Eigen::RowVectorXd> signs(kDraws, Eigen::RowVectorXd(blocks));
  for (auto& draw : signs) {
    for (int b = 0; b < blocks; ++b) draw[b] = random() % 2 == 0 ? 1.0 : -1.0;
  }
  return signs;
}

/// Orders a turn of the motor that these runs can show: of the motor, and of the spool between them.
std::vector<std::pair<double, std::string>> Orders(const std::vector<Repetitions>& groups, std::size_t m) {
  double least = INFINITY, most = -INFINITY;
  std::vector<double> speeds;
  for (const Repetitions& g : groups) {
    const RepeatedMotor& motor = g.motors[m];
    least = std::min(least, motor.angle_rad.minCoeff());
    most = std::max(most, motor.angle_rad.maxCoeff());
    for (const double v : motor.velocity_radps.reshaped()) speeds.push_back(std::abs(v) * g.window_s);
  }
  const double turns = (most - least) / (2 * std::numbers::pi);
  const double a_window = Median(std::move(speeds)) / (2 * std::numbers::pi);
  const RepeatedMotor& motor = groups.front().motors[m];
  const auto seen = [&](double order) {
    return order * turns >= kLeastPeriods && order * a_window * kWindowsAPeriod <= 1;
  };
  std::vector<std::pair<double, std::string>> orders;
  for (int k = 1; k <= kMostOrders; ++k) {
    if (seen(k))
      orders.emplace_back(k, fmt::format("the angle of {}, {}", motor.name,
                                         k == 1 ? "once a turn" : fmt::format("{} times a turn", k)));
  }
  const double ratio = motor.gear_ratio;
  for (int k = 1; ratio > 1 && k < ratio; ++k) {
    if (seen(k / ratio))
      orders.emplace_back(k / ratio, fmt::format("the spool angle of {}, {}", motor.name,
                                                 k == 1 ? "once a turn" : fmt::format("{} times a turn", k)));
  }
  return orders;
}

/// What the motors of a channel's runs show of one angle.
class AngleLaw {
 public:
  AngleLaw(const std::vector<Repetitions>& groups, const Stack& stack, std::size_t motor)
      : groups_(groups), stack_(stack), motor_(motor), taken_(Orthonormal(Smooth())) {
    off_ = stack.off() - taken_ * (taken_.transpose() * stack.off());
  }

  double square() const { return off_.squaredNorm(); }

  /// Sums by block of what waves of this order make of the deviations.
  Eigen::MatrixXd Sums(double order) const {
    return ByBlock(stack_, Orthonormal(Waves(order, nullptr)), off_);
  }

  /// Share of the deviations' mean square that a function with this period makes: the order and its next
  /// three multiples, as a peak has them.
  double Share(double order) const {
    Eigen::MatrixXd all(off_.size(), 16);
    for (int k = 0; k < 4; ++k) all.middleCols(4 * k, 4) = Waves((k + 1) * order, nullptr);
    return (Orthonormal(all).transpose() * off_).squaredNorm() / stack_.off().squaredNorm();
  }

  /// Probability that waves as short as these, but of a phase that wanders with the angle, make as much: they
  /// follow any function of the angle as well as periodic ones do, but for one with this very period.
  double OfWanderingPhase(double order, std::mt19937_64& random) const {
    const double periodic = (Orthonormal(Waves(order, nullptr)).transpose() * off_).squaredNorm();
    int as_much = 0;
    for (int draw = 0; draw < kWanderings; ++draw) {
      const Wandering phase(least_, most_, order, random);
      as_much += (Orthonormal(Waves(order, &phase)).transpose() * off_).squaredNorm() >= periodic;
    }
    return (1.0 + as_much) / (1.0 + kWanderings);
  }

 private:
  static constexpr int kWanderings = 399;

  /// A smooth random function of the angle, of rms pi, that forgets within about a period.
  class Wandering {
   public:
    Wandering(double least, double most, double order, std::mt19937_64& random)
        : least_(least), step_(2 * std::numbers::pi / order / kPerPeriod) {
      constexpr int kReach = 4 * kForgets;
      const int count = static_cast<int>((most - least) / step_) + 2;
      std::normal_distribution<double> normal;
      Eigen::VectorXd white(count + 2 * kReach), kernel(2 * kReach + 1);
      for (double& w : white) w = normal(random);
      for (int k = -kReach; k <= kReach; ++k)
        kernel[k + kReach] = std::exp(-0.5 * std::pow(k / double{kForgets}, 2));
      kernel *= std::numbers::pi / kernel.norm();
      value_.resize(count);
      for (int i = 0; i < count; ++i) value_[i] = kernel.dot(white.segment(i, kernel.size()));
    }
    double operator()(double angle) const {
      const double at = std::clamp((angle - least_) / step_, 0.0, static_cast<double>(value_.size() - 2));
      const auto i = static_cast<Eigen::Index>(at);
      return value_[i] + (at - static_cast<double>(i)) * (value_[i + 1] - value_[i]);
    }

   private:
    static constexpr int kPerPeriod = 16, kForgets = 8;
    double least_, step_;
    Eigen::VectorXd value_;
  };

  /// What drives a motor off its way moves it too: what follows the deviation of the angle smoothly is no
  /// periodic law.
  Eigen::MatrixXd Smooth() {
    for (const Repetitions& g : groups_) {
      least_ = std::min(least_, Angle(g).minCoeff());
      most_ = std::max(most_, Angle(g).maxCoeff());
    }
    const auto scaled = [&](const Repetitions& g) {
      return Eigen::ArrayXXd((2 * Angle(g).array() - least_ - most_) / std::max(most_ - least_, 1e-9));
    };
    Eigen::MatrixXd smooth(stack_.off().size(), 4);
    smooth.col(0) = stack_.Of([&](const Repetitions& g) { return Eigen::MatrixXd(scaled(g)); });
    smooth.col(1) = stack_.Of([&](const Repetitions& g) { return Eigen::MatrixXd(scaled(g).square()); });
    smooth.col(2) = stack_.Of([&](const Repetitions& g) { return Eigen::MatrixXd(scaled(g).cube()); });
    smooth.col(3) = stack_.Of([&](const Repetitions& g) { return Direction(g.motors[motor_]); });
    return smooth;
  }

  /// Torque and friction that go as cosine and sine of the angle, without what is smooth.
  Eigen::MatrixXd Waves(double order, const Wandering* wandering) const {
    Eigen::MatrixXd waves(off_.size(), 4);
    for (int c = 0; c < 4; ++c) {
      waves.col(c) = stack_.Of([&](const Repetitions& g) {
        Eigen::ArrayXXd phase = order * Angle(g).array();
        if (wandering) phase += Angle(g).unaryExpr(*wandering).array();
        const Eigen::ArrayXXd wave = c % 2 == 0 ? Eigen::ArrayXXd(phase.cos()) : Eigen::ArrayXXd(phase.sin());
        return Eigen::MatrixXd(c < 2 ? wave : Eigen::ArrayXXd(wave * Direction(g.motors[motor_]).array()));
      });
    }
    waves -= taken_ * (taken_.transpose() * waves);
    return waves;
  }

  const Eigen::MatrixXd& Angle(const Repetitions& g) const { return g.motors[motor_].angle_rad; }

  const std::vector<Repetitions>& groups_;
  const Stack& stack_;
  const std::size_t motor_;
  double least_ = INFINITY, most_ = -INFINITY;
  Eigen::MatrixXd taken_;
  Eigen::VectorXd off_;
};

/// The order of one motor's angle that makes most of a channel's deviations.
struct BestOrder {
  int channel = 0;
  std::size_t motor = 0;
  double order = 0, statistic = -1;
  std::string on;
};

/// A function of a motor's angle that the model has not makes runs differ by its difference between their
/// angles, with the direction's sign where it is friction.
void TryAngles(const std::vector<Repetitions>& groups, int channel, std::uint64_t seed, Chance& chance,
               std::vector<BestOrder>& best) {
  const Stack stack(groups);
  if (stack.blocks() < kLeastBlocks) return;
  const auto signs = Signs(stack.blocks(), seed);
  for (std::size_t m = 0; m < groups.front().motors.size(); ++m) {
    const AngleLaw law(groups, stack, m);
    if (!(law.square() > 0)) continue;
    BestOrder of_motor{channel, m, 0, -1, ""};
    for (const auto& [order, on] : Orders(groups, m)) {
      const Eigen::MatrixXd sums = law.Sums(order);
      const double statistic = sums.colwise().sum().squaredNorm() / law.square();
      if (statistic > of_motor.statistic) of_motor = {channel, m, order, statistic, on};
      for (int draw = 0; draw < kDraws; ++draw)
        chance.Add(draw, (signs[static_cast<std::size_t>(draw)] * sums).squaredNorm() / law.square());
    }
    if (of_motor.statistic >= 0) best.push_back(of_motor);
  }
}

/// The one that makes most of what runs differ by, of those that chance does not make: neither runs that
/// change their names from block to block, nor waves without a period.
std::optional<std::pair<int, Dependence>> OnAngle(const std::vector<std::vector<Repetitions>>& channels,
                                                  std::uint64_t seed, double kinds) {
  Chance chance;
  std::vector<BestOrder> best;
  for (std::size_t c = 0; c < channels.size(); ++c) {
    if (!channels[c].empty()) TryAngles(channels[c], static_cast<int>(c), seed, chance, best);
  }
  std::optional<std::pair<int, Dependence>> found;
  double most = kLeastShare;
  std::mt19937_64 random(seed);
  for (const BestOrder& one : best) {
    double p = kinds * chance.As(one.statistic);
    if (p > kChance) continue;
    const auto& groups = channels[static_cast<std::size_t>(one.channel)];
    const Stack stack(groups);
    const AngleLaw law(groups, stack, one.motor);
    const double share = law.Share(one.order);
    if (share <= most) continue;
    p = std::max(p, law.OfWanderingPhase(one.order, random));
    if (p > kChance) continue;
    most = share;
    found = {one.channel, {one.on, p, true}};
  }
  return found;
}

// ---- the order of the repetitions ----

/// Share of what runs deviate by that goes with their number, whatever it looks like over time; against their
/// order in other orders.
void TryOrder(const std::vector<Repetitions>& groups, int channel, std::uint64_t seed, Strongest& strongest) {
  std::mt19937_64 random(seed);
  for (const Repetitions& g : groups) {
    const auto n = static_cast<int>(g.off.cols());
    if (n < kLeastInOrder || g.off.squaredNorm() <= 0) continue;
    const auto share = [&](const std::vector<int>& number) {
      Eigen::VectorXd t(n);
      for (int i = 0; i < n; ++i) t[i] = number[static_cast<std::size_t>(i)] - 0.5 * (n - 1);
      return (g.off * t).squaredNorm() / t.squaredNorm() / g.off.squaredNorm();
    };
    std::vector<int> number(static_cast<std::size_t>(n));
    std::iota(number.begin(), number.end(), 0);
    strongest.Try(share(number), channel, "the number of the repetition");
    for (int draw = 0; draw < kDraws; ++draw) {
      for (std::size_t i = number.size(); i > 1; --i) std::swap(number[i - 1], number[random() % i]);
      strongest.chance.Add(draw, share(number));
    }
  }
}

// ---- how much runs scatter ----

/// Edges of bins that hold about as many values each.
std::vector<double> Edges(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  std::vector<double> edges;
  for (int b = 0; b <= kBins; ++b) edges.push_back(values[b * (values.size() - 1) / kBins]);
  return edges;
}

/// Logs of the mean squares of a group's windows; the sensors' own noise keeps them from running away.
Eigen::VectorXd LogScatter(const Repetitions& g) {
  return (1 + g.off.rowwise().squaredNorm().array() / static_cast<double>(g.off.cols() - 1)).log();
}

/// Whether the scatter is larger in some bins of a condition than in others; against the same course of the
/// scatter, shifted in time.
void TryCondition(const std::vector<Repetitions>& groups, std::size_t condition, int channel,
                  std::uint64_t seed, Strongest& strongest) {
  std::vector<double> all;
  for (const Repetitions& g : groups) {
    const auto& value = g.conditions[condition].value;
    if (!value.allFinite()) return;
    all.insert(all.end(), value.begin(), value.end());
  }
  const std::vector<double> edges = Edges(std::move(all));
  if (!(edges.back() > edges.front())) return;
  std::vector<Eigen::VectorXd> scatter;
  std::vector<std::vector<int>> bins;
  for (const Repetitions& g : groups) {
    scatter.push_back(LogScatter(g));
    std::vector<int> bin;
    for (const double v : g.conditions[condition].value) {
      const auto at = std::upper_bound(edges.begin() + 1, edges.end() - 1, v) - edges.begin() - 1;
      bin.push_back(static_cast<int>(at));
    }
    bins.push_back(std::move(bin));
  }
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(kBins);
  /// Variance between bins, of all.
  const auto between = [&](auto&& shift) {
    Eigen::VectorXd sum = Eigen::VectorXd::Zero(kBins), count = sum;
    double square = 0;
    for (std::size_t k = 0; k < scatter.size(); ++k) {
      const Eigen::Index size = scatter[k].size(), by = shift(size);
      for (Eigen::Index w = 0; w < size; ++w) {
        const double s = scatter[k][(w + by) % size];
        const int b = bins[k][static_cast<std::size_t>(w)];
        sum[b] += s, count[b] += 1, square += s * s;
      }
    }
    const double n = count.sum(), total = square - sum.sum() * sum.sum() / n;
    mean = sum.array() / count.array().max(1);
    return total > 0
               ? (mean.array().square() * count.array()).sum() / total - sum.sum() * sum.sum() / n / total
               : 0;
  };
  const Condition& first = groups.front().conditions[condition];
  const double statistic = between([](Eigen::Index) { return Eigen::Index{0}; });
  Eigen::Index most = 0;
  mean.maxCoeff(&most);
  strongest.Try(
      statistic, channel,
      fmt::format("{} (most from {:.3g} to {:.3g} {})", first.name, edges[static_cast<std::size_t>(most)],
                  edges[static_cast<std::size_t>(most + 1)], first.unit));
  std::mt19937_64 random(seed);
  for (int draw = 0; draw < kDraws; ++draw)
    strongest.chance.Add(draw, between([&](Eigen::Index size) {
                           return static_cast<Eigen::Index>(random() % static_cast<std::uint64_t>(size));
                         }));
}

}  // namespace

std::optional<std::pair<int, Dependence>> DependsOn(const std::vector<std::vector<Repetitions>>& channels,
                                                    std::uint64_t seed) {
  constexpr double kKinds = 3;  // of states: angles, the order, conditions
  if (auto law = OnAngle(channels, seed, kKinds)) return law;
  Strongest order, scatter;
  for (std::size_t c = 0; c < channels.size(); ++c) {
    const auto& groups = channels[c];
    if (groups.empty()) continue;
    const int channel = static_cast<int>(c);
    TryOrder(groups, channel, seed, order);
    std::size_t conditions = groups.front().conditions.size();
    for (const Repetitions& g : groups) conditions = std::min(conditions, g.conditions.size());
    for (std::size_t k = 0; k < conditions; ++k) TryCondition(groups, k, channel, seed, scatter);
  }
  if (auto law = order.Found(kKinds, true)) return law;
  return scatter.Found(kKinds, false);
}

}  // namespace tendril::gap
