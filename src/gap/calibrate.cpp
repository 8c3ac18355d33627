// The calibration from end to end: prepare, Gauss-Newton steps with the discrepancy re-estimated at each,
// Laplace's approximation at the maximum.
#include "tendril/gap/calibrate.h"

#include <fmt/core.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <numeric>
#include <optional>
#include <stdexcept>
#include <utility>

#include "comparable.h"
#include "free_numbers.h"
#include "linear_fit.h"
#include "measurement_check.h"
#include "readable.h"
#include "score.h"
#include "tendril/config/keys.h"
#include "tendril/core/parallel.h"

namespace tendril::gap {
namespace {

constexpr int kMostIterations = 12;
// Log posterior that a step still has to promise, or to bring.
constexpr double kWorthAStep = 0.1;
// Levenberg's damping where a full step fails, and where it gives up.
constexpr double kFirstDamping = 1e-2, kMostDamping = 1e4;
// Finite differences: the first along each number, its prior deviation within limits; later ones along
// principal directions of the posterior, in its deviations.
constexpr double kLeastProbe = 1e-3, kMostProbe = 0.02, kProbe_sd = 2;
constexpr double kTwoSided95 = 1.959964;

class Calibrating {
 public:
  Calibrating(const DataSet& given, const CalibrateOptions& options)
      : options_(options), threads_(options.threads > 0 ? options.threads : AllCores()), file_(given.robot) {
    auto [set, contradictions] = Readable(given, found_.notes);
    if (!contradictions.empty()) {
      throw std::runtime_error(
          fmt::format("{}: a unit of the runs, or a number of the robot file is wrong; correct it "
                      "before the others are inferred",
                      contradictions.front()));
    }
    DiagnoseOptions reading;
    reading.seed = options.seed;
    reading.progress = options.progress;
    evaluator_.emplace(MeasurementCheck(set, found_.notes, reading, threads_, false).PrepareComparable());
    for (const std::string& line : evaluator_->degradations()) found_.notes.push_back(line);
    free_ = FreeNumbersOf(evaluator_->nominal());
    if (free_.size() == 0) {
      throw std::runtime_error(
          "every number of the robot file is known: nothing to calibrate; say how uncertain some are "
          "(youngs_modulus_Pa: {value: 2.3e10, within: 10 %})");
    }
    folds_ = MakeFolds(evaluator_->runs());
  }

  Calibration Result() {
    Climb();
    HoldOut();
    Summarise();
    return std::move(found_);
  }

 private:
  /// A set of changes with what it leaves.
  struct Point {
    Eigen::VectorXd x;
    Residuals residuals;
  };

  std::optional<Point> At(const Eigen::VectorXd& x) const {
    std::vector<int> every(evaluator_->runs().size());
    std::iota(every.begin(), every.end(), 0);
    return At(x, every);
  }

  /// The robot at x in some of the runs, the file's robot in the others; empty where it cannot be simulated.
  std::optional<Point> At(const Eigen::VectorXd& x, const std::vector<int>& runs) const {
    const RobotParameters robot = free_.Robot(evaluator_->nominal(), x);
    Point point{x, Residuals(evaluator_->runs().size())};
    std::atomic<bool> failed{false};
    ParallelFor(static_cast<int>(runs.size()), threads_, [&](int k) {
      const int i = runs[static_cast<std::size_t>(k)];
      try {
        point.residuals[static_cast<std::size_t>(i)] =
            std::move(evaluator_->At(robot, kAllCuts, {i})[static_cast<std::size_t>(i)]);
      } catch (const std::exception&) {
        failed = true;
      }
    });
    if (failed) return std::nullopt;
    point.residuals = Completed(point.residuals, evaluator_->AtNominal());
    for (const auto& run : point.residuals) {
      for (const auto& channel : run) {
        if (!channel.allFinite()) return std::nullopt;
      }
    }
    return point;
  }

  double LogPosterior(const Point& point, const Weights& weights) const {
    return LogScore(weights, point.residuals, evaluator_->AtNominal()) -
           0.5 * point.x.dot(free_.precision * point.x);
  }

  /// Residuals of the robot at x; empty where it cannot be simulated.
  Residuals ResidualsAt(const Eigen::VectorXd& x) const {
    try {
      return evaluator_->At(free_.Robot(evaluator_->nominal(), x), kAllCuts);
    } catch (const std::exception&) {
      return {};
    }
  }

  /// d simulated / d z of one direction of the basis at the point, by central differences.
  Column ColumnOf(int direction, const Point& at) const {
    Residuals more = ResidualsAt(at.x + basis_.col(direction));
    Residuals less = ResidualsAt(at.x - basis_.col(direction));
    double width = 2;
    if (more.empty() || less.empty()) {
      // One of the two sides is a robot that cannot be simulated.
      width = 1;
      (more.empty() ? more : less) = at.residuals;
    }
    Column column(at.residuals.size(), std::vector<Eigen::VectorXd>(evaluator_->channels().size()));
    if (more.empty() || less.empty()) return column;
    for (std::size_t i = 0; i < column.size(); ++i) {
      for (std::size_t c = 0; c < column[i].size(); ++c) {
        if (more[i][c].size() > 0) column[i][c] = (less[i][c] - more[i][c]) / width;
      }
    }
    return column;
  }

  std::vector<Column> Columns(const Point& at) const {
    std::vector<Column> columns(static_cast<std::size_t>(free_.size()));
    std::atomic<int> done{0};
    ParallelFor(free_.size(), threads_, [&](int k) {
      columns[static_cast<std::size_t>(k)] = ColumnOf(k, at);
      Progress((found_.iterations + ++done / static_cast<double>(free_.size())) / kMostIterations);
    });
    return columns;
  }

  /// Quadratic model of the log posterior about a point, in coordinates z along the basis: x = point + basis
  /// z.
  void Linearise(const Point& at) {
    columns_ = Columns(at);
    weights_.emplace(*evaluator_, Leftover(*evaluator_, at.residuals));
    std::vector<const Column*> columns;
    for (const Column& column : columns_) columns.push_back(&column);
    normal_ = Accumulate(columns, at.residuals, evaluator_->AtNominal(), *weights_, folds_);
    curvature_ = basis_.transpose() * free_.precision * basis_;
    slope_ = -basis_.transpose() * free_.precision * at.x;
    for (std::size_t f = 0; f < normal_.A.size(); ++f) curvature_ += normal_.A[f], slope_ += normal_.b[f];
  }

  /// Turns the basis into the principal directions of the posterior, a deviation long. Numbers that only
  /// together are known, such as all forces, are then varied together: along single numbers their effects
  /// would have to cancel to better than a replay is smooth.
  void TurnBasis() {
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> principal(curvature_);
    basis_ = basis_ * principal.eigenvectors() *
             (kProbe_sd / principal.eigenvalues().cwiseMax(1e-12).cwiseSqrt().array()).matrix().asDiagonal();
  }

  void Climb() {
    auto start = At(Eigen::VectorXd::Zero(free_.size()));
    if (!start) throw std::runtime_error("the robot of the file cannot be simulated in these runs");
    best_ = std::move(*start);
    basis_ = free_.deviation.cwiseMin(kMostProbe).cwiseMax(kLeastProbe).asDiagonal();
    bool stuck = false;
    for (; found_.iterations < kMostIterations && !found_.converged; ++found_.iterations) {
      Linearise(best_);
      const Outcome outcome = Step();
      if (outcome == Outcome::kStuck && stuck) break;
      stuck = outcome == Outcome::kStuck;
      // Along single numbers alone the model of the posterior may be too poor to tell.
      found_.converged = outcome == Outcome::kSettled && found_.iterations > 0;
      TurnBasis();
    }
    Linearise(best_);
  }

  enum class Outcome {
    kTaken,    // a step
    kSettled,  // none promises or brings anything
    kStuck,    // one promises much, and none that is tried brings it
  };
  Outcome Step() {
    const double here = LogPosterior(best_, *weights_);
    for (double damping = 0; damping <= kMostDamping; damping = damping == 0 ? kFirstDamping : 10 * damping) {
      Eigen::MatrixXd damped = curvature_;
      damped.diagonal() *= 1 + damping;
      const Eigen::VectorXd step = damped.ldlt().solve(slope_);
      const double promised = step.dot(slope_) - 0.5 * step.dot(curvature_ * step);
      if (!(promised > kWorthAStep)) return Outcome::kSettled;
      auto there = At(best_.x + basis_ * step);
      if (!there) continue;
      const double gained = LogPosterior(*there, *weights_) - here;
      if (gained <= 0) continue;
      best_ = std::move(*there);
      return gained > kWorthAStep ? Outcome::kTaken : Outcome::kSettled;
    }
    return Outcome::kStuck;
  }

  /// Predicts each fold with the numbers that the others give, one step from the common maximum.
  void HoldOut() {
    const int n = free_.size();
    std::vector<Eigen::VectorXd> without;
    Eigen::VectorXd mean = Eigen::VectorXd::Zero(n);
    for (std::size_t f = 0; f < normal_.A.size(); ++f) {
      without.push_back((curvature_ - normal_.A[f]).ldlt().solve(slope_ - normal_.b[f]));
      mean += without.back() / static_cast<double>(normal_.A.size());
    }
    held_out_ = best_.residuals;
    for (int f = 0; f < folds_.count; ++f)
      PredictFold(f, best_.x + basis_ * without[static_cast<std::size_t>(f)]);
    // Kinds of motion that ask for different numbers show the model's errors, which noise does not.
    const double folds = static_cast<double>(without.size());
    Eigen::MatrixXd covariance = curvature_.ldlt().solve(Eigen::MatrixXd::Identity(n, n));
    for (const Eigen::VectorXd& z : without)
      covariance += (folds - 1) / folds * (z - mean) * (z - mean).transpose();
    covariance_ = basis_ * covariance * basis_.transpose();
  }

  /// Residuals of one fold with the numbers that the others give. Where that robot cannot be simulated, those
  /// with all runs' numbers stay.
  void PredictFold(int fold, const Eigen::VectorXd& x) {
    std::vector<int> runs;
    for (int i = 0; i < static_cast<int>(held_out_.size()); ++i) {
      if (folds_.by_time || folds_.of_run[static_cast<std::size_t>(i)] == fold) runs.push_back(i);
    }
    const auto predicted = At(x, runs);
    if (!predicted) return;
    for (const int i : runs) {
      for (std::size_t c = 0; c < evaluator_->channels().size(); ++c) {
        auto& r = held_out_[static_cast<std::size_t>(i)][c];
        const auto& p = predicted->residuals[static_cast<std::size_t>(i)][c];
        const int windows = static_cast<int>(r.size());
        for (int w = 0; w < windows; ++w) {
          if (folds_.Of(i, w, windows) == fold) r[w] = p[w];
        }
      }
    }
  }

  /// Digits far beyond a number's uncertainty would only burden its reader.
  void RoundToDeviation(const Eigen::VectorXd& deviation) {
    constexpr double kFiner = 0.01;
    for (int k = 0; k < free_.size(); ++k) {
      const FileNumber& number = free_.numbers[static_cast<std::size_t>(k)];
      const double value = number.ValueAt(best_.x[k]);
      const double fine = kFiner * deviation[k] * (number.angle ? 1 : std::abs(value));
      if (!(fine > 0)) continue;
      const double unit = std::pow(10, std::floor(std::log10(fine)));
      const double rounded = std::round(value / unit) * unit;
      best_.x[k] = number.angle ? rounded - number.in_file : std::log(rounded / number.in_file);
    }
  }

  void Summarise() {
    const Eigen::VectorXd deviation = covariance_.diagonal().cwiseSqrt();
    RoundToDeviation(deviation);
    found_.robot = free_.Robot(file_, best_.x);
    found_.known = free_.known;
    found_.held_out_by = folds_.by;
    found_.correlation =
        deviation.cwiseInverse().asDiagonal() * covariance_ * deviation.cwiseInverse().asDiagonal();
    for (int k = 0; k < free_.size(); ++k) {
      const FileNumber& number = free_.numbers[static_cast<std::size_t>(k)];
      CalibratedNumber c;
      c.key = number.key;
      c.unit = config::UnitOfKey(number.key.substr(number.key.find_last_of(". ") + 1));
      c.angle = number.angle;
      c.in_file = number.in_file;
      c.value = number.ValueAt(best_.x[k]);
      c.prior = free_.deviation[k];
      c.deviation = std::min(deviation[k], c.prior);
      c.low = number.ValueAt(best_.x[k] - kTwoSided95 * c.deviation);
      c.high = number.ValueAt(best_.x[k] + kTwoSided95 * c.deviation);
      if (c.low > c.high) std::swap(c.low, c.high);
      found_.numbers.push_back(std::move(c));
    }
    const ChannelScore before = ScoreChannels(*evaluator_, evaluator_->AtNominal(), evaluator_->AtNominal());
    const ChannelScore after = ScoreChannels(*evaluator_, held_out_, evaluator_->AtNominal());
    const Eigen::VectorXd left = Leftover(*evaluator_, best_.residuals);
    for (int k = 0; k < left.size(); ++k) {
      const Channel& channel = evaluator_->channels()[static_cast<std::size_t>(k)];
      found_.channels.push_back({channel.name, channel.unit, std::sqrt(before.square[k]),
                                 std::sqrt(after.square[k]), std::sqrt(after.noise[k]), left[k]});
    }
  }

  void Progress(double fraction) const {
    if (options_.progress) options_.progress("learning the robot's numbers", std::min(1.0, fraction));
  }

  const CalibrateOptions& options_;
  const int threads_;
  const RobotParameters& file_;
  Calibration found_;
  std::optional<Evaluator> evaluator_;
  FreeNumbers free_;
  Folds folds_;
  Point best_;
  // About best_:
  Eigen::MatrixXd basis_;  // directions of z, as columns of changes
  std::vector<Column> columns_;
  std::optional<Weights> weights_;
  Normal normal_;
  Eigen::MatrixXd curvature_, covariance_;
  Eigen::VectorXd slope_;
  Residuals held_out_;
};

}  // namespace

double CalibratedNumber::Moved() const {
  return (angle ? value - in_file : std::log(value / in_file)) / prior;
}

Calibration Calibrate(const DataSet& set, const CalibrateOptions& options) {
  if (Compared(set))
    throw std::runtime_error(
        "runs from before a change: accepted: runs of the robot as it is, without --before");
  return Calibrating(set, options).Result();
}

}  // namespace tendril::gap
