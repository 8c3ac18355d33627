// Infers the numbers of a robot file from runs of the robot as it is, each within what is known of it. Knows
// nothing of effects or of how the file is written.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "tendril/core/robot.h"
#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// States, means over a time in which the robot hardly moves, that a set shows of a position-controlled
/// robot: runs with motor positions and markers, and neither torques nor tensions. Empty: it is none. Throws
/// std::runtime_error where motors and the same markers are not read together.
std::optional<int> PostureStates(const DataSet& set);
inline constexpr int kLeastPostures = 40;  // from which the numbers of such a robot can be inferred

struct CalibrateOptions {
  int threads = 0;         // 0: all cores
  std::uint64_t seed = 1;  // of the alternative readings of the sensors
  /// Called from several threads concurrently.
  std::function<void(const std::string& stage, double fraction)> progress;
};

/// A number of the file, before and after the runs; of a position-controlled robot also what no file holds,
/// such as the zero of a tendon, 0 in the file.
struct CalibratedNumber {
  std::string key;        // "body.sections.youngs_modulus_Pa", "body.sections.tendons (tendon 2) angle_rad"
  std::string unit;       // "Pa"; empty: none
  bool additive = false;  // its deviations are in its unit; otherwise shares of the value
  bool of_file = true;    // the file says something of it
  double in_file = 0, value = 0;
  double prior = 0, deviation = 0;  // one standard deviation, before and after
  double low = 0, high = 0;         // 95 % interval of the value

  /// Share of the prior variance that the runs took away: 0 where they say nothing of the number.
  double Learned() const { return 1 - deviation * deviation / (prior * prior); }
  /// How far the runs moved it, in prior standard deviations.
  double Moved() const;
};

/// What is compared in the runs, before and after, rms over all of them.
struct CalibratedChannel {
  std::string name, unit;  // "tip x", "m"
  double in_file = 0;      // with the file's numbers
  double held_out = 0;     // each kind of motion predicted with the numbers found from the others
  double floor = 0;        // the sensors' noise
  double discrepancy =
      0;  // left beyond the noise with the numbers of all runs: what the model itself gets wrong
};

struct Calibration {
  RobotParameters robot;  // the file's with the numbers found
  std::vector<CalibratedNumber> numbers;
  Eigen::MatrixXd correlation;  // of `numbers`, after the runs
  std::vector<CalibratedChannel> channels;
  std::vector<std::string> known;  // numbers that the file takes as exact
  std::string held_out_by;         // "kinds of motion"
  int iterations = 0;
  bool converged = false;
  /// Why these are not runs of the robot of the file, if it is position-controlled; empty: they are.
  std::string not_learned;
  std::vector<std::string> notes;  // what was left out of the set, and why
};

/// Maximum of the posterior and its curvature there (Laplace), by Gauss-Newton steps; the model's discrepancy
/// is estimated with the numbers, by channel, and counts once in a correlation time. The result depends only
/// on set, options and seed. Runs with motor positions and markers, and neither torques nor tensions, are
/// compared state by state, as those of a position-controlled robot. Throws std::runtime_error where nothing
/// can be compared, or no number is free.
Calibration Calibrate(const DataSet& set, const CalibrateOptions& options);

}  // namespace tendril::gap
