// Gauss-Newton along directions that follow the posterior; derivatives serve as long as they predict.
#include "learn.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <numeric>
#include <utility>

#include "tendril/core/parallel.h"

namespace tendril::gap {
namespace {

constexpr int kMostIterations = 12;
constexpr int kStepsPerColumns = 8;  // with the same derivatives
// Log posterior that a step still has to promise, or to bring.
constexpr double kWorthAStep = 0.1;
// Share of what a step promises that it brings as long as the derivatives hold there.
constexpr double kAsPromised = 0.5;
// Levenberg's damping where a full step fails, and where it gives up.
constexpr double kFirstDamping = 1e-2, kMostDamping = 1e4;
// Finite differences: the first along each number, its prior deviation within limits; later ones along
// principal directions of the posterior, in its deviations.
constexpr double kLeastProbe = 1e-3, kMostProbe = 0.02, kProbe_sd = 2;

class Learning {
 public:
  Learning(const Evaluator& evaluator, FreeNumbers free, const Folds& folds, const LearnOptions& options)
      : evaluator_(evaluator), folds_(folds), options_(options), every_(evaluator.runs().size()) {
    std::iota(every_.begin(), every_.end(), 0);
    found_.free = std::move(free);
  }

  std::optional<LearnedNumbers> Result() {
    if (!Begin()) return std::nullopt;
    bool stuck = false;
    for (; found_.iterations < MostIterations() && !found_.converged; ++found_.iterations) {
      if (found_.iterations > 0) TurnBasis();
      if (!begun_with_columns_ || found_.iterations > 0) FindColumns();
      const Outcome outcome = Walk();
      if (outcome == Outcome::kStuck && stuck) break;
      stuck = outcome == Outcome::kStuck;
      // Along single numbers alone the model of the posterior may be too poor to tell.
      found_.converged = outcome == Outcome::kSettled && (begun_with_columns_ || found_.iterations > 0);
    }
    if (away_ > 1 && !options_.quick) FindColumns();
    Linearise();
    return std::move(found_);
  }

 private:
  int size() const { return found_.free.size(); }
  int MostIterations() const { return options_.quick ? 1 : kMostIterations; }

  /// False where the robot there cannot be simulated.
  bool Begin() {
    const LearnedNumbers* from = options_.from;
    begun_with_columns_ = from != nullptr;
    found_.x = found_.free.StartAt(from != nullptr ? Eigen::VectorXd(from->x.head(Numbers()))
                                                   : Eigen::VectorXd::Zero(Numbers()));
    auto start = At(found_.x);
    if (!start) return false;
    found_.residuals = std::move(*start);
    if (from == nullptr) {
      found_.basis = found_.free.deviation.cwiseMin(kMostProbe).cwiseMax(kLeastProbe).asDiagonal();
      return true;
    }
    found_.basis = Eigen::MatrixXd::Zero(size(), size());
    found_.basis.topLeftCorner(Numbers(), Numbers()) = from->basis.topLeftCorner(Numbers(), Numbers());
    found_.columns.assign(from->columns.begin(), from->columns.begin() + Numbers());
    for (int k = Numbers(); k < size(); ++k) {
      found_.basis(k, k) = found_.free.cause->derivative_step;
      found_.columns.push_back(ColumnOf(k, false));
    }
    return true;
  }

  int Numbers() const { return static_cast<int>(found_.free.numbers.size()); }

  std::optional<Residuals> At(const Eigen::VectorXd& x) const {
    Progress(found_.iterations);
    return ResidualsWith(evaluator_, found_.free, x, every_, options_.threads);
  }

  /// In one run after the other: for callers that share the threads out themselves.
  Residuals AlongOne(const Eigen::VectorXd& x) const {
    try {
      return evaluator_.At(found_.free.Robot(evaluator_.nominal(), x), kAllCuts);
    } catch (const std::exception&) {
      return {};
    }
  }

  /// d simulated / d z of one direction of the basis, by central differences; along single numbers, which
  /// only show the way, by forward ones.
  Column ColumnOf(int direction, bool central) const {
    Residuals more = AlongOne(found_.x + found_.basis.col(direction)), less;
    if (central || more.empty()) less = AlongOne(found_.x - found_.basis.col(direction));
    const double width = more.empty() || less.empty() ? 1 : 2;
    // One of the two sides is not asked for, or a robot that cannot be simulated.
    const Residuals& upper = more.empty() ? found_.residuals : more;
    const Residuals& lower = less.empty() ? found_.residuals : less;
    Column column(found_.residuals.size(), std::vector<Eigen::VectorXd>(evaluator_.channels().size()));
    if (more.empty() && less.empty()) return column;
    for (std::size_t i = 0; i < column.size(); ++i) {
      for (std::size_t c = 0; c < column[i].size(); ++c) {
        if (upper[i][c].size() > 0 && lower[i][c].size() > 0)
          column[i][c] = (lower[i][c] - upper[i][c]) / width;
      }
    }
    return column;
  }

  void FindColumns() {
    found_.columns.resize(static_cast<std::size_t>(size()));
    std::atomic<int> done{0};
    const bool central = begun_with_columns_ || found_.iterations > 0;
    away_ = 0;
    ParallelFor(size(), options_.threads, [&](int k) {
      found_.columns[static_cast<std::size_t>(k)] = ColumnOf(k, central);
      Progress(found_.iterations + ++done / static_cast<double>(size()));
    });
  }

  void Progress(double iterations) const {
    if (options_.progress) options_.progress(iterations / kMostIterations);
  }

  /// Quadratic model of the log posterior about the present point, with the columns found last.
  void Linearise() {
    weights_.emplace(evaluator_, Leftover(evaluator_, found_.residuals));
    std::vector<const Column*> columns;
    for (const Column& column : found_.columns) columns.push_back(&column);
    const Eigen::MatrixXd &basis = found_.basis, &precision = found_.free.precision;
    found_.normal = Accumulate(columns, found_.residuals, evaluator_.AtNominal(), *weights_, folds_);
    found_.curvature = basis.transpose() * precision * basis;
    found_.slope = -basis.transpose() * precision * found_.x;
    for (std::size_t f = 0; f < found_.normal.A.size(); ++f)
      found_.curvature += found_.normal.A[f], found_.slope += found_.normal.b[f];
  }

  /// Turns the basis into the principal directions of the posterior, a few deviations long. Numbers that only
  /// together are known, such as all forces, are then varied together: along single numbers their effects
  /// would have to cancel to better than a replay is smooth.
  void TurnBasis() {
    const int n = Numbers(), causes = size() - n;
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> principal(found_.curvature.topLeftCorner(n, n));
    const auto lengths = [](const auto& curvature) {
      return (kProbe_sd / curvature.cwiseMax(1e-12).cwiseSqrt().array()).matrix().eval();
    };
    found_.basis.topLeftCorner(n, n) *=
        principal.eigenvectors() * lengths(principal.eigenvalues()).asDiagonal();
    found_.basis.bottomRightCorner(causes, causes) *=
        lengths(Eigen::VectorXd(found_.curvature.diagonal().tail(causes))).asDiagonal();
  }

  enum class Outcome {
    kElsewhere,  // a step, to where other derivatives hold
    kTaken,      // a step, about as the derivatives promised
    kSettled,    // none promises or brings anything
    kStuck,      // one promises much, and none that is tried brings it
  };

  /// Steps without new columns, for as long as they predict.
  Outcome Walk() {
    for (int steps = 0; steps < kStepsPerColumns; ++steps) {
      Linearise();
      const Outcome outcome = Step();
      if (outcome == Outcome::kTaken || (outcome == Outcome::kElsewhere && options_.quick)) continue;
      return outcome == Outcome::kStuck && steps > 0 ? Outcome::kElsewhere : outcome;
    }
    return Outcome::kElsewhere;
  }

  /// Broyden's update: the columns then predict the step that was taken.
  void LearnFrom(const Eigen::VectorXd& step, const Residuals& before) {
    const Eigen::VectorXd shares = step / step.squaredNorm();
    for (std::size_t i = 0; i < before.size(); ++i) {
      for (std::size_t c = 0; c < before[i].size(); ++c) {
        Eigen::VectorXd missing = before[i][c] - found_.residuals[i][c];
        for (std::size_t k = 0; k < found_.columns.size(); ++k) {
          const Eigen::VectorXd& j = found_.columns[k][i][c];
          if (j.size() > 0) missing -= step[static_cast<Eigen::Index>(k)] * j;
        }
        for (std::size_t k = 0; k < found_.columns.size(); ++k) {
          Eigen::VectorXd& j = found_.columns[k][i][c];
          if (j.size() > 0) j += shares[static_cast<Eigen::Index>(k)] * missing;
        }
      }
    }
    away_ += step.norm();
  }

  Outcome Step() {
    const double here = LogPosterior(found_.x, found_.residuals);
    for (double damping = 0; damping <= kMostDamping; damping = damping == 0 ? kFirstDamping : 10 * damping) {
      Eigen::MatrixXd damped = found_.curvature;
      damped.diagonal() *= 1 + damping;
      const Eigen::VectorXd step = damped.ldlt().solve(found_.slope);
      const double promised = step.dot(found_.slope) - 0.5 * step.dot(found_.curvature * step);
      if (!(promised > kWorthAStep)) return Outcome::kSettled;
      const Eigen::VectorXd x = found_.x + found_.basis * step;
      auto there = At(x);
      if (!there) continue;
      const double gained = LogPosterior(x, *there) - here;
      if (gained <= 0) continue;
      found_.x = x;
      std::swap(found_.residuals, *there);
      LearnFrom(step, *there);
      if (gained <= kWorthAStep) return Outcome::kSettled;
      return gained > kAsPromised * promised ? Outcome::kTaken : Outcome::kElsewhere;
    }
    return Outcome::kStuck;
  }

  double LogPosterior(const Eigen::VectorXd& x, const Residuals& residuals) const {
    return LogScore(*weights_, residuals, evaluator_.AtNominal()) - 0.5 * x.dot(found_.free.precision * x);
  }

  const Evaluator& evaluator_;
  const Folds& folds_;
  const LearnOptions& options_;
  std::vector<int> every_;           // every run
  bool begun_with_columns_ = false;  // of another maximum
  double away_ = 0;                  // steps taken since the columns were found
  std::optional<Weights> weights_;
  LearnedNumbers found_;
};

}  // namespace

double LearnedNumbers::LogOccam() const {
  const Eigen::MatrixXd prior = basis.transpose() * free.precision * basis;
  const auto log_determinant = [](const Eigen::MatrixXd& m) {
    return m.ldlt().vectorD().cwiseMax(1e-300).array().log().sum();
  };
  return 0.5 * (log_determinant(prior) - log_determinant(curvature));
}

std::optional<LearnedNumbers> Learn(const Evaluator& evaluator, FreeNumbers free, const Folds& folds,
                                    const LearnOptions& options) {
  return Learning(evaluator, std::move(free), folds, options).Result();
}

std::optional<Residuals> ResidualsWith(const Evaluator& evaluator, const FreeNumbers& free,
                                       const Eigen::VectorXd& x, const std::vector<int>& runs, int threads) {
  const RobotParameters robot = free.Robot(evaluator.nominal(), x);
  Residuals with(evaluator.runs().size());
  std::atomic<bool> failed{false};
  ParallelFor(static_cast<int>(runs.size()), threads, [&](int k) {
    const auto i = static_cast<std::size_t>(runs[static_cast<std::size_t>(k)]);
    try {
      with[i] = std::move(evaluator.At(robot, kAllCuts, {static_cast<int>(i)})[i]);
    } catch (const std::exception&) {
      failed = true;
    }
  });
  if (failed) return std::nullopt;
  with = Completed(with, evaluator.AtNominal());
  for (const auto& run : with) {
    for (const auto& channel : run) {
      if (!channel.allFinite()) return std::nullopt;
    }
  }
  return with;
}

}  // namespace tendril::gap
