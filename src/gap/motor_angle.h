// The angle of a motor inside the counts of its encoder, and where the counts show that it slides. Knows
// nothing of runs.
#pragma once

#include <Eigen/Core>
#include <random>
#include <vector>

namespace tendril::gap {

/// True when the readings change by whole counts.
bool Quantised(const Eigen::VectorXd& angle, double count);

/// Whole counts for interpolated samples as well (`read`: samples with a reading).
void CountThroughDropouts(Eigen::Ref<Eigen::VectorXd> angle, const std::vector<char>& read, double count);

/// Angle within the counts: at the border where the count changes by one, at the reading where the motor is
/// faster. Where it rests or reverses within a count the travel is unknown: half way, or with `random`
/// anywhere. Starts at the middle of its count if `in_middle`.
Eigen::VectorXd InsideCounts(const Eigen::VectorXd& reading, double count, double step_s, bool in_middle,
                             std::mt19937_64* random);

/// Samples where a motor has moved in one direction by kSlidingCounts since it reversed or rested, and soon
/// reaches the next count. At rest and where samples were lost, its friction is unknown.
void MarkSliding(const Eigen::VectorXd& reading, const Eigen::Matrix<char, -1, 1>& valid, double count,
                 double step_s, double sampled_s, Eigen::Ref<Eigen::Matrix<char, -1, 1>> out);

}  // namespace tendril::gap
