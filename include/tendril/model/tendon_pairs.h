// Antagonistic pairs: opposite tendons on one motor, whose tensions differ by what it pulls. Safe in the
// tick: noexcept, no allocation after construction.
#pragma once

#include <algorithm>
#include <vector>

#include "tendril/core/limits.h"
#include "tendril/core/robot.h"

namespace tendril::model {

class TendonPairs {
 public:
  struct Pair {
    int first, second;    // 0-based
    double pretension_N;  // of both, straight and not pulled
    double series_Npm;    // k_a k_b / (k_a + k_b) of the tendons' stiffnesses
    double first_share;   // k_a / (k_a + k_b): of a pull D the first gains this, the second loses the rest

    struct Range {
      double least_N, most_N;
    };
    /// Pulls with which neither tendon has less than `least_N`, nor more than its bound; 0 where there are
    /// none.
    Range PullsWithin(double unpulled_N, double least_N, double most_first_N,
                      double most_second_N) const noexcept;
    /// Sets both tensions: what they have unpulled, and their shares of the pull.
    void Split(double unpulled_N, double pull_N, TendonVector& tension_N) const noexcept;
  };

  /// Of the robot's actuation; none without.
  TendonPairs() = default;
  explicit TendonPairs(const RobotParameters& robot);

  bool empty() const noexcept { return pairs_.empty(); }
  bool Has(int tendon) const noexcept {
    return std::any_of(pairs_.begin(), pairs_.end(),
                       [tendon](const Pair& p) { return p.first == tendon || p.second == tendon; });
  }
  const std::vector<Pair>& all() const noexcept { return pairs_; }
  /// Neither tendon of a pair is to have less, limits.min_tension_N.
  double least_N() const noexcept { return least_N_; }

  /// Tension [N] of both tendons at the spool while the motor does not pull, where the body shortens their
  /// paths by `shortening_m`: with T_a = T_0 + k_a (s - d_a), T_b = T_0 + k_b (-s - d_b) and T_a = T_b.
  /// Negative where they are slack.
  static double Unpulled_N(const Pair& pair, const TendonVector& shortening_m) noexcept {
    return pair.pretension_N - pair.series_Npm * (shortening_m[pair.first] + shortening_m[pair.second]);
  }
  /// Replaces the tensions of every pair by those that it takes for their difference, as far as neither
  /// tendon has less than least_N() or more than `most_N`; without friction. True where that limited it.
  bool Share(const TendonVector& shortening_m, double most_N, TendonVector& tension_N) const noexcept;

 private:
  std::vector<Pair> pairs_;
  double least_N_ = 0;
};

/// Base tension of every tendon of the straight robot at rest.
TendonVector RestTensions_N(const RobotParameters& robot);

}  // namespace tendril::model
