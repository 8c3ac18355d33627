// Learns the numbers and turns what is open of them into independent directions.
#include "learned_robot.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <utility>

namespace tendril::gap {
namespace {

// Information of the runs on a direction, in that of its prior, below which they say nothing of it.
constexpr double kTold = 0.05;

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

}  // namespace

std::vector<LearnedNumber> LearnedRobot::At(const Fit* fit) const {
  Eigen::VectorXd x = numbers.x;
  if (fit != nullptr) x += directions * fit->nuisances.head(directions.cols());
  std::vector<LearnedNumber> all;
  for (int k = 0; k < numbers.free.size(); ++k) {
    const FileNumber& number = numbers.free.numbers[static_cast<std::size_t>(k)];
    // Digits that no runs tell would only burden whoever reads the file.
    const double value = std::stod(fmt::format("{:.6g}", number.ValueAt(x[k])));
    all.push_back({number.key, number.in_file, value, x[k] / numbers.free.deviation[k]});
  }
  std::stable_sort(all.begin(), all.end(), [](const LearnedNumber& a, const LearnedNumber& b) {
    return std::abs(a.moved) > std::abs(b.moved);
  });
  return all;
}

std::optional<LearnedRobot> LearnRobot(LearnedNumbers numbers, const DataSet& set,
                                       const Evaluator::Options& evaluation) {
  // Directions that prior and runs both see as independent, one deviation of the prior long.
  const Eigen::MatrixXd prior = numbers.basis.transpose() * numbers.free.precision * numbers.basis;
  Eigen::MatrixXd told = Eigen::MatrixXd::Zero(prior.rows(), prior.cols());
  for (const Eigen::MatrixXd& A : numbers.normal.A) told += A;
  const Eigen::GeneralizedSelfAdjointEigenSolver<Eigen::MatrixXd> independent(told, prior);
  DataSet learned = set;
  FreeNumbers alone = numbers.free;
  alone.cause.reset();
  learned.robot = alone.Robot(set.robot, numbers.x);
  std::optional<Evaluator> evaluator;
  try {
    evaluator.emplace(learned, evaluation);
  } catch (const std::exception&) {
    return std::nullopt;
  }
  LearnedRobot robot{std::move(numbers), std::move(*evaluator), {}, {}};
  const LearnedNumbers& of = robot.numbers;
  const Eigen::MatrixXd all = of.basis * independent.eigenvectors();
  const Eigen::VectorXd file = -all.transpose() * of.free.precision * of.x;
  robot.directions.resize(of.free.size(), 0);
  for (int k = 0; k < of.free.size(); ++k) {
    if (independent.eigenvalues()[k] < kTold) continue;
    robot.open.push_back({nullptr,
                          std::make_shared<Column>(Combined(of.columns, independent.eigenvectors().col(k))),
                          1, file[k]});
    robot.directions.conservativeResize(Eigen::NoChange, robot.directions.cols() + 1);
    robot.directions.rightCols(1) = all.col(k);
  }
  return robot;
}

double LogEvidence(const Evaluator& evaluator, const LearnedNumbers& numbers) {
  const Weights weights(evaluator, Leftover(evaluator, numbers.residuals));
  const Residuals& nominal = evaluator.AtNominal();
  return LogScore(weights, numbers.residuals, nominal) - LogScore(weights, nominal, nominal) +
         numbers.LogPrior() + numbers.LogOccam();
}

std::optional<LearnedNumbers> LearnBesideCause(const Evaluator& evaluator, const LearnedNumbers& alone,
                                               const std::vector<Model>& causes, const Folds& folds,
                                               const LearnOptions& options) {
  // Log posterior by which a cause has to be better than none: chance alone brings a few.
  constexpr double kEnough = 9;
  std::vector<LearnedNumbers> beside;
  Eigen::VectorXd left = Leftover(evaluator, alone.residuals);
  for (const Model& cause : causes) {
    try {
      beside.push_back(Learn(evaluator, alone.free.WithFree(cause), folds,
                             {.threads = options.threads, .from = &alone, .quick = true}));
      left = left.cwiseMin(Leftover(evaluator, beside.back().residuals));
    } catch (const std::exception&) {
      // This cause cannot be simulated beside the numbers.
    }
    if (options.progress)
      options.progress(0.7 * static_cast<double>(beside.size()) / static_cast<double>(causes.size()));
  }
  const Weights weights(evaluator, left);
  const auto posterior = [&](const LearnedNumbers& l) {
    return LogScore(weights, l.residuals, evaluator.AtNominal()) + l.LogPrior();
  };
  const auto best = std::max_element(beside.begin(), beside.end(), [&](const auto& a, const auto& b) {
    return posterior(a) < posterior(b);
  });
  if (best == beside.end() || posterior(*best) - posterior(alone) < kEnough) return std::nullopt;
  const LearnedNumbers together =
      Learn(evaluator, best->free, folds, {.threads = options.threads, .from = &*best});
  return Learn(evaluator, alone.free.With(together.free.CauseAt(together.x)), folds,
               {.threads = options.threads, .from = &together});
}

}  // namespace tendril::gap
