// The calibration from end to end: prepare, learn the numbers, hold kinds of motion out, summarise.
#include "tendril/gap/calibrate.h"

#include <fmt/core.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <utility>

#include "comparable.h"
#include "free_numbers.h"
#include "interval.h"
#include "learn.h"
#include "measurement_check.h"
#include "postures/calibrate_postures.h"
#include "postures/learn_postures.h"
#include "readable.h"
#include "score.h"
#include "tendril/config/keys.h"
#include "tendril/core/parallel.h"

namespace tendril::gap {
namespace {

class Calibrating {
 public:
  Calibrating(const DataSet& given, const CalibrateOptions& options)
      : options_(options), threads_(options.threads > 0 ? options.threads : AllCores()), file_(given.robot) {
    ReadableSet readable = Readable(given, found_.notes);
    RefuseContradictions(readable);
    DiagnoseOptions reading;
    reading.seed = options.seed;
    reading.progress = options.progress;
    evaluator_.emplace(
        MeasurementCheck(readable.set, found_.notes, reading, threads_, false).PrepareComparable());
    for (const std::string& line : evaluator_->degradations()) found_.notes.push_back(line);
    learned_.free = FreeNumbersOf(evaluator_->nominal());
    if (learned_.free.size() == 0) {
      throw std::runtime_error(
          "every number of the robot file is known: nothing to calibrate; say how uncertain some are "
          "(youngs_modulus_Pa: {value: 2.3e10, within: 10 %})");
    }
    folds_ = MakeFolds(evaluator_->runs());
  }

  Calibration Result() {
    const LearnOptions learning{.threads = threads_,
                                .progress = [this](double fraction) { Progress(fraction); }};
    auto learned = Learn(*evaluator_, learned_.free, folds_, learning);
    if (!learned) throw std::runtime_error("the robot of the file cannot be simulated in these runs");
    learned_ = std::move(*learned);
    found_.converged = learned_.converged;
    found_.iterations = learned_.iterations;
    HoldOut();
    Summarise();
    return std::move(found_);
  }

 private:
  /// Predicts each fold with the numbers that the others give, one step from the common maximum.
  void HoldOut() {
    const int n = learned_.free.size();
    const Normal& normal = learned_.normal;
    std::vector<Eigen::VectorXd> without;
    Eigen::VectorXd mean = Eigen::VectorXd::Zero(n);
    for (std::size_t f = 0; f < normal.A.size(); ++f) {
      without.push_back((learned_.curvature - normal.A[f]).ldlt().solve(learned_.slope - normal.b[f]));
      mean += without.back() / static_cast<double>(normal.A.size());
    }
    held_out_ = learned_.residuals;
    for (int f = 0; f < folds_.count; ++f)
      PredictFold(f, learned_.x + learned_.basis * without[static_cast<std::size_t>(f)]);
    // Kinds of motion that ask for different numbers show the model's errors, which noise does not.
    const double folds = static_cast<double>(without.size());
    Eigen::MatrixXd covariance = learned_.curvature.ldlt().solve(Eigen::MatrixXd::Identity(n, n));
    for (const Eigen::VectorXd& z : without)
      covariance += (folds - 1) / folds * (z - mean) * (z - mean).transpose();
    covariance_ = learned_.basis * covariance * learned_.basis.transpose();
  }

  /// Residuals of one fold with the numbers that the others give. Where that robot cannot be simulated, those
  /// with all runs' numbers stay.
  void PredictFold(int fold, const Eigen::VectorXd& x) {
    std::vector<int> runs;
    for (int i = 0; i < static_cast<int>(held_out_.size()); ++i) {
      if (folds_.by_time || folds_.of_run[static_cast<std::size_t>(i)] == fold) runs.push_back(i);
    }
    const auto predicted = ResidualsWith(*evaluator_, learned_.free, x, runs, threads_);
    if (!predicted) return;
    for (const int i : runs) {
      for (std::size_t c = 0; c < evaluator_->channels().size(); ++c) {
        auto& r = held_out_[static_cast<std::size_t>(i)][c];
        const auto& p = (*predicted)[static_cast<std::size_t>(i)][c];
        const int windows = static_cast<int>(r.size());
        for (int w = 0; w < windows; ++w) {
          if (folds_.Of(i, w, windows) == fold) r[w] = p[w];
        }
      }
    }
  }

  void RoundToDeviation(const Eigen::VectorXd& deviation) {
    for (int k = 0; k < learned_.free.size(); ++k) {
      const FileNumber& number = learned_.free.numbers[static_cast<std::size_t>(k)];
      const double value = number.ValueAt(learned_.x[k]);
      const double rounded = RoundedTo(value, deviation[k] * (number.angle ? 1 : std::abs(value)));
      learned_.x[k] = number.angle ? rounded - number.in_file : std::log(rounded / number.in_file);
    }
  }

  void Summarise() {
    const Eigen::VectorXd deviation = covariance_.diagonal().cwiseSqrt();
    RoundToDeviation(deviation);
    found_.robot = learned_.free.Robot(file_, learned_.x);
    found_.known = learned_.free.known;
    found_.held_out_by = folds_.by;
    found_.correlation =
        deviation.cwiseInverse().asDiagonal() * covariance_ * deviation.cwiseInverse().asDiagonal();
    for (int k = 0; k < learned_.free.size(); ++k) {
      const FileNumber& number = learned_.free.numbers[static_cast<std::size_t>(k)];
      CalibratedNumber c;
      c.key = number.key;
      c.unit = config::UnitOfKey(number.key.substr(number.key.find_last_of(". ") + 1));
      c.additive = number.angle;
      c.in_file = number.in_file;
      c.value = number.ValueAt(learned_.x[k]);
      c.prior = learned_.free.deviation[k];
      c.deviation = std::min(deviation[k], c.prior);
      c.low = number.ValueAt(learned_.x[k] - kTwoSided95 * c.deviation);
      c.high = number.ValueAt(learned_.x[k] + kTwoSided95 * c.deviation);
      if (c.low > c.high) std::swap(c.low, c.high);
      found_.numbers.push_back(std::move(c));
    }
    const ChannelScore before = ScoreChannels(*evaluator_, evaluator_->AtNominal(), evaluator_->AtNominal());
    const ChannelScore after = ScoreChannels(*evaluator_, held_out_, evaluator_->AtNominal());
    const Eigen::VectorXd left = Leftover(*evaluator_, learned_.residuals);
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
  Folds folds_;
  LearnedNumbers learned_;
  Eigen::MatrixXd covariance_;
  Residuals held_out_;
};

}  // namespace

double CalibratedNumber::Moved() const {
  return (additive ? value - in_file : std::log(value / in_file)) / prior;
}

Calibration Calibrate(const DataSet& set, const CalibrateOptions& options) {
  if (Compared(set))
    throw std::runtime_error(
        "runs from before a change: accepted: runs of the robot as it is, without --before");
  if (CanCalibratePostures(set)) return CalibratePostures(set, options);
  RequireAMotorForEachTendon(set.robot);
  Calibration found = Calibrating(set, options).Result();
  if (ShowsPostures(set)) {
    found.notes.push_back(fmt::format(
        "not calibrated state by state: fewer than {} states in which motors and the same markers "
        "were read",
        kLeastPostures));
  }
  return found;
}

}  // namespace tendril::gap
