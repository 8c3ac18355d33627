// The numbers of the robot file as unknowns with a prior each. Knows nothing of runs.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "file_numbers.h"
#include "hypothesis.h"
#include "tendril/core/uncertainty.h"

namespace tendril::gap {

/// Numbers that may change together, by `change` as FileNumber::apply takes it: x = 0 is the file.
struct FreeNumbers {
  std::vector<FileNumber> numbers;
  Eigen::VectorXd deviation;       // prior standard deviation of each change
  Eigen::MatrixXd precision;       // inverse of the prior covariance
  std::vector<std::string> known;  // keys of numbers taken as exact
  std::optional<Model> cause{};    // that the robot has besides
  /// Its parameters change too: after the numbers, in plainly visible deviations from no effect.
  bool cause_is_free = false;

  int size() const { return static_cast<int>(numbers.size()) + (cause_is_free ? cause->size() : 0); }
  RobotParameters Robot(const RobotParameters& file, const Eigen::VectorXd& x) const;
  /// With a cause of free size; a nearly flat prior.
  FreeNumbers WithFree(const Model& its) const;
  /// With a cause as it is.
  FreeNumbers With(const Model& its) const;
  /// The cause at x.
  Model CauseAt(const Eigen::VectorXd& x) const;
  /// Changes of the numbers, then those of a free cause at its present values.
  Eigen::VectorXd StartAt(const Eigen::VectorXd& of_numbers) const;
};

/// Standard deviation of the change of a number that is `in_file`, as FileNumber::apply takes it: of the
/// exponent of a factor, or of an angle; none for one that is known.
std::optional<double> DeviationOf(double in_file, bool angle, const Uncertainty& uncertainty);

/// Priors are those of the file, else the usual ones of such numbers. Holes drilled alike are off alike:
/// their priors are correlated.
FreeNumbers FreeNumbersOf(const RobotParameters& file);

}  // namespace tendril::gap
