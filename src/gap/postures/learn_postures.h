// The numbers of a robot inferred from its postures: the maximum of their posterior, Laplace's approximation
// about it, and the model's error in states that it was not fitted to. Knows nothing of changes.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <string>
#include <vector>

#include "numbers.h"
#include "tendril/gap/calibrate.h"

namespace tendril::gap {

/// These runs, which show postures, show that many.
bool EnoughPostures(const std::vector<const Run*>& runs, const RobotParameters& robot);

/// The states are held out in quarters: each is predicted from the other three.
inline constexpr int kQuarters = 4;
struct StateRange {
  Eigen::Index first = 0, count = 0;
};
StateRange QuarterOf(int quarter, Eigen::Index states);

/// The error of the best model of this kind, as a random function of state and time.
struct Discrepancy {
  Eigen::MatrixXd covariance;         // C x C of one state [m^2]
  double states_per_independent = 1;  // integrated autocorrelation time, in states

  /// S x C residuals -> values that are independent and of unit variance under this discrepancy, state by
  /// state.
  Eigen::VectorXd Whitened(const Eigen::MatrixXd& residuals) const;
  /// The same of several derivatives, a column each.
  Eigen::MatrixXd Whitened(const std::vector<Eigen::MatrixXd>& slopes) const;
};

struct LearnedPostures {
  std::vector<PostureNumber> numbers;
  PostureRobot file;
  Eigen::VectorXd x;           // changes at the maximum
  Eigen::VectorXd prior;       // precision of each change before any run
  Eigen::MatrixXd precision;   // of the posterior there
  Eigen::MatrixXd held_out_m;  // measured less predicted, each quarter with the numbers that the others give
  Eigen::MatrixXd as_filed_m;  // the same with the numbers of the file
  Eigen::VectorXd motion_m;    // by point, see Motion
  Discrepancy discrepancy;
  int unsolved = 0;  // states without an equilibrium
  int steps = 0;     // of all fits, those without a quarter included
  bool converged = false;

  PostureRobot RobotAt(const Eigen::VectorXd& changes) const { return WithNumbers(file, numbers, changes); }
  /// Rms distance that the learned robot misses a point by (from 0), held out [m].
  double Floor(int point) const;
  /// Rms distance of a point (from 0) from its mean over the states [m].
  double Motion(int point) const { return motion_m[point]; }
  /// Some point is predicted to better than half of its motion: otherwise this is not the robot of the runs.
  bool Predicts() const;
};

/// Rms distance of a point (from 0) over the rows of S x C residuals [m].
double PointRms(const Eigen::MatrixXd& residuals_m, int point);
/// Of one channel, rms of the same.
double ChannelRms(const Eigen::MatrixXd& residuals_m, Eigen::Index channel);

/// A value in metres of each point, in words: "1.4 / 3.8 mm and 1.2 deg".
std::string PointsText(const Postures& postures, const std::function<double(int point)>& value_m);
/// Why a robot that does not Predict was not learned from `runs`, and what to check.
std::string NotLearnedText(const LearnedPostures& learned, const Postures& postures, const char* runs);

/// What was learned of a tracker's clock that drifts against the motors', as a line; empty where it does not
/// by more than three standard deviations.
std::string ClockDriftText(const LearnedPostures& learned);

struct LearnPosturesOptions {
  int threads = 1;
  std::function<void(double)> progress{};  // from 0 to 1
};

/// Throws std::runtime_error where there are fewer states than kLeastPostures.
LearnedPostures LearnPostures(const RobotParameters& file, const Postures& postures, bool frame_is_known,
                              const LearnPosturesOptions& options);

}  // namespace tendril::gap
