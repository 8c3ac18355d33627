// The numbers of a robot inferred from its postures: the maximum of their posterior, Laplace's approximation
// about it, and what the model gets wrong wherever it is not fitted. Knows nothing of changes.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "numbers.h"

namespace tendril::gap {

/// Of the states, each predicted in turn from the others.
inline constexpr int kQuarters = 4;
inline constexpr int kLeastPostures = 40;  // for the numbers of a robot to be told from them

/// What the best model of this kind still gets wrong, as a random function of state and time.
struct Discrepancy {
  Eigen::MatrixXd covariance;  // 3P x 3P of one state [m^2]
  double states_a_bit = 1;     // correlated states that count as one

  /// Rows r in which independent errors of one unit are expected: inverse of the covariance's factor, over
  /// the root of states_a_bit.
  Eigen::MatrixXd Whitened(const Eigen::MatrixXd& rows) const;
};

struct LearnedPostures {
  std::vector<PostureNumber> numbers;
  PostureRobot file;
  Eigen::VectorXd x;           // changes at the maximum
  Eigen::MatrixXd precision;   // of the posterior there
  Eigen::MatrixXd left_m;      // measured less predicted, S x 3P
  Eigen::MatrixXd held_out_m;  // the same, each quarter predicted with the numbers that the others give
  Eigen::MatrixXd as_filed_m;  // the same with the numbers of the file
  Discrepancy discrepancy;     // of held_out_m
  int iterations = 0;
  int unsolved = 0;  // states without an equilibrium
  bool converged = false;

  PostureRobot RobotAt(const Eigen::VectorXd& changes) const { return WithNumbers(file, numbers, changes); }
};

struct LearnPosturesOptions {
  int threads = 1;
  std::function<void(double)> progress{};  // from 0 to 1
};

/// Throws std::runtime_error where the robot of the file cannot be solved, or there are too few states.
LearnedPostures LearnPostures(const RobotParameters& file, const Postures& postures, bool frame_is_known,
                              const LearnPosturesOptions& options);

}  // namespace tendril::gap
