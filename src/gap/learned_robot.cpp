// Fits the numbers beside causes, and turns what is open of them into independent directions.
#include "learned_robot.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <string>
#include <utility>

namespace tendril::gap {
namespace {

// Information of the runs on a direction, in that of its prior, below which they leave it to the prior.
constexpr double kLeastInformation = 0.05;

Column Combined(const std::vector<Column>& columns, const Eigen::VectorXd& by) {
  Column sum = columns.front();
  for (std::size_t i = 0; i < sum.size(); ++i) {
    for (std::size_t c = 0; c < sum[i].size(); ++c) {
      auto& of_channel = sum[i][c];
      of_channel *= by[0];
      for (std::size_t k = 1; k < columns.size(); ++k) {
        const Eigen::VectorXd& j = columns[k][i][c];
        if (j.size() == 0) continue;
        if (of_channel.size() == 0) of_channel.setZero(j.size());
        of_channel += by[static_cast<Eigen::Index>(k)] * j;
      }
    }
  }
  return sum;
}

double LogEvidence(const Weights& weights, const Residuals& nominal, const LearnedNumbers& numbers) {
  return LogScore(weights, numbers.residuals, nominal) + numbers.LogPrior() + numbers.LogOccam();
}

/// Progress of a part that begins at `from` and is `length` of the whole.
std::function<void(double)> Part(const std::function<void(double)>& whole, double from, double length) {
  if (!whole) return {};
  return [=](double share) { whole(from + length * share); };
}

}  // namespace

std::vector<LearnedNumber> LearnedRobot::At(const Fit* fit) const {
  Eigen::VectorXd x = numbers.x;
  if (fit != nullptr) x += directions * fit->nuisances.head(directions.cols());
  std::vector<LearnedNumber> all;
  for (int k = 0; k < numbers.free.size(); ++k) {
    const FileNumber& number = numbers.free.numbers[static_cast<std::size_t>(k)];
    // More digits would only burden whoever reads the file.
    const double value = std::stod(fmt::format("{:.6g}", number.ValueAt(x[k])));
    all.push_back({number.key, number.in_file, value, x[k] / numbers.free.deviation[k]});
  }
  std::stable_sort(all.begin(), all.end(), [](const LearnedNumber& a, const LearnedNumber& b) {
    return std::abs(a.moved) > std::abs(b.moved);
  });
  return all;
}

LearnedRobot RobotWith(LearnedNumbers numbers, const RobotParameters& file) {
  // Directions that are independent for prior and runs alike, one deviation of the prior long.
  const Eigen::MatrixXd prior = numbers.basis.transpose() * numbers.free.precision * numbers.basis;
  const Eigen::GeneralizedSelfAdjointEigenSolver<Eigen::MatrixXd> independent(numbers.curvature - prior,
                                                                              prior);
  const Eigen::MatrixXd all = numbers.basis * independent.eigenvectors();
  const Eigen::VectorXd center = -all.transpose() * numbers.free.precision * numbers.x;
  LearnedRobot robot;
  for (int k = 0; k < numbers.free.size(); ++k) {
    if (independent.eigenvalues()[k] < kLeastInformation) continue;
    robot.open.push_back(
        {nullptr, std::make_shared<Column>(Combined(numbers.columns, independent.eigenvectors().col(k))), 1,
         center[k]});
    robot.directions.conservativeResize(all.rows(), robot.directions.cols() + 1);
    robot.directions.rightCols(1) = all.col(k);
  }
  FreeNumbers alone = numbers.free;
  alone.cause.reset();
  robot.robot = alone.Robot(file, numbers.x);
  robot.numbers = std::move(numbers);
  return robot;
}

double LogEvidence(const Evaluator& evaluator, const LearnedNumbers& numbers) {
  const Weights weights(evaluator, Leftover(evaluator, numbers.residuals));
  const Residuals& nominal = evaluator.AtNominal();
  return LogEvidence(weights, nominal, numbers) - LogScore(weights, nominal, nominal);
}

std::optional<LearnedNumbers> LearnBesideCause(const Evaluator& evaluator, const LearnedNumbers& alone,
                                               const std::vector<Model>& causes, const Folds& folds,
                                               const LearnOptions& options) {
  constexpr double kQuick = 0.6;  // share of the progress
  std::vector<LearnedNumbers> beside;
  Eigen::VectorXd left = Leftover(evaluator, alone.residuals);
  const double each = kQuick / std::max<double>(1, static_cast<double>(causes.size()));
  for (std::size_t k = 0; k < causes.size(); ++k) {
    const LearnOptions quick{options.threads, Part(options.progress, static_cast<double>(k) * each, each),
                             &alone, true};
    auto with = Learn(evaluator, alone.free.WithFree(causes[k]), folds, quick);
    if (!with) continue;
    left = left.cwiseMin(Leftover(evaluator, with->residuals));
    beside.push_back(std::move(*with));
  }
  // With one discrepancy for all; one of several causes has as many chances to fit by accident.
  const Weights weights(evaluator, left);
  const auto evidence = [&](const LearnedNumbers& l) {
    return LogEvidence(weights, evaluator.AtNominal(), l);
  };
  const auto best = std::max_element(beside.begin(), beside.end(),
                                     [&](const auto& a, const auto& b) { return evidence(a) < evidence(b); });
  if (best == beside.end() ||
      evidence(*best) - std::log(static_cast<double>(beside.size())) < evidence(alone))
    return std::nullopt;
  const auto together =
      Learn(evaluator, best->free, folds,
            {options.threads, Part(options.progress, kQuick, 0.5 * (1 - kQuick)), &*best, false});
  if (!together) return std::nullopt;
  return Learn(
      evaluator, alone.free.With(together->free.CauseAt(together->x)), folds,
      {options.threads, Part(options.progress, 0.5 * (1 + kQuick), 0.5 * (1 - kQuick)), &*together, false});
}

}  // namespace tendril::gap
