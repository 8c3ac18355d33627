// The numbers of the robot file as unknowns with a prior each. Knows nothing of runs.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "file_numbers.h"

namespace tendril::gap {

/// Numbers that may change together, by `change` as FileNumber::apply takes it: x = 0 is the file.
struct FreeNumbers {
  std::vector<FileNumber> numbers;
  Eigen::VectorXd deviation;       // prior standard deviation of each change
  Eigen::MatrixXd precision;       // inverse of the prior covariance
  std::vector<std::string> known;  // keys of numbers taken as exact

  int size() const { return static_cast<int>(numbers.size()); }
  RobotParameters Robot(const RobotParameters& file, const Eigen::VectorXd& x) const;
};

/// Priors are those of the file, else the usual ones of such numbers. Holes drilled alike are off alike:
/// their priors are correlated.
FreeNumbers FreeNumbersOf(const RobotParameters& file);

}  // namespace tendril::gap
