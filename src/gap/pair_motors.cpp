// One shaft, two columns.
#include "pair_motors.h"

#include <fmt/format.h>

#include <cmath>
#include <stdexcept>

namespace tendril::gap {
namespace {

/// Mean and rms about it, of what is finite.
struct Spread {
  explicit Spread(const Eigen::VectorXd& of) {
    double sum = 0, squares = 0;
    for (const double x : of) {
      if (!std::isfinite(x)) continue;
      ++count;
      sum += x;
      squares += x * x;
    }
    if (count == 0) return;
    mean = sum / count;
    rms = std::sqrt(std::max(0.0, squares / count - mean * mean));
  }

  int count = 0;
  double mean = 0, rms = 0;
};

// Of the motion: two readings of one shaft differ by resolution and a moment, two motors by all they do.
constexpr double kOfOneShaft = 0.05;

void RequireOneShaft(const Run& run, const TendonPair& pair, const Eigen::VectorXd& a,
                     const Eigen::VectorXd& b) {
  const double moves_rad = Spread(a).rms, apart_rad = Spread(a + b).rms;
  if (Spread(a + b).count == 0 || apart_rad <= kOfOneShaft * std::max(moves_rad, Spread(b).rms)) return;
  const bool alike = Spread(a - b).rms <= kOfOneShaft * moves_rad;
  throw std::runtime_error(fmt::format(
      "run {}: motor positions of tendons {} and {}, a pair on one motor, {}; accepted: opposite positions, "
      "or those of one tendon alone; {}",
      run.name, pair.first + 1, pair.second + 1,
      alike ? "turn the same way"
            : fmt::format("move apart by {:.3g} rad rms of {:.3g}", apart_rad, moves_rad),
      alike ? "turn the sign of one column round" : "check columns and signs, or actuation.pairs"));
}

}  // namespace

void CompletePairs(const RobotParameters& robot, Run& run) {
  Eigen::MatrixXd& motor = run.motor_position_rad;
  const Eigen::Index recorded = motor.cols(), tendons = robot.body.tendons();
  if (!robot.actuation || robot.actuation->pairs.empty() || recorded == 0 || recorded > tendons) return;
  // A table may end with the last tendon that it names.
  motor.conservativeResize(Eigen::NoChange, tendons);
  motor.rightCols(tendons - recorded).setConstant(kNoReading);
  for (const TendonPair& pair : robot.actuation->pairs) {
    auto a = motor.col(pair.first), b = motor.col(pair.second);
    RequireOneShaft(run, pair, a, b);
    const double zero_rad = Spread(a + b).mean;  // of both columns together
    for (Eigen::Index i = 0; i < motor.rows(); ++i) {
      if (!std::isfinite(b[i])) {
        b[i] = zero_rad - a[i];
      } else if (!std::isfinite(a[i])) {
        a[i] = zero_rad - b[i];
      }
    }
  }
}

}  // namespace tendril::gap
