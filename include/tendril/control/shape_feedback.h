// What tendon displacement shows of the robot's bend, integrated slowly into the bending moment that the
// model of each section must lack. Knows nothing of how tensions come from it.
#pragma once

#include <Eigen/Core>
#include <array>

#include "tendril/core/limits.h"
#include "tendril/core/status.h"
#include "tendril/model/body.h"

namespace tendril::control {

class StateArchive;

/// With b a section's wanted bend and e how much of it is missing, by least squares of the tendons'
/// displacement (stretch taken out), both as complex numbers us + i vs, and K the section's bending
/// stiffness:
///   moment = K (c b + m),  tau dc/dt = f conj(b) / (|b|^2 + b0^2),  tau dm/dt = f b0^2 / (|b|^2 + b0^2),
/// K f the moments that bend all sections by e, so that tau de/dt = -e at every bend, and what grows with the
/// bend and turns with it (stiffness, payload, friction) stays known while the robot is led round. At rest an
/// error that dry friction may leave is let alone until it is kWake times that. Nor is friction overcome at
/// rest whatever it takes: the moment goes no farther from where it was than friction may hold, for what it
/// learns of a robot that sticks is wrong once it moves, and no longer a way, to and fro, than kRestWay times
/// the largest error: then it only hunts, and that error is let alone as well.
class ShapeFeedback {
 public:
  static constexpr double kMaxShare = 0.5;  // of |c|, and of |m| [rad]
  static constexpr double kWake = 4;
  static constexpr double kRestWay = 2;

  /// `time_constant_s`: tau, slow beside the robot's swinging; `friction_Nm`: of a moment, what dry friction
  /// may leave at rest.
  ShapeFeedback(const model::Body& body, double time_constant_s, double friction_Nm, double period_s);

  /// One cycle. `bending_rad` is wanted, `wanted_m` the shortening that the torques now sent are meant for,
  /// `shown_m` what drives and cells show, of which each tendon counts by its `weight`; `force_per_tension`
  /// (2K x M) and `compliance` (2K x 2K, bend a moment) are those at the wanted bend. `acts` false: what is
  /// known of the moment stays. `at_limit`: tensions are, and the moment fades at tau's pace, for what they
  /// cannot give is not to be asked for. `hold_Nm`: of a moment, what friction holds at
  /// the present tensions. kLimitedShapeCorrection: c or m is at its limit.
  Status Step(const BendingVector& bending_rad, const TendonVector& wanted_m, const TendonVector& shown_m,
              const TendonVector& weight, const Eigen::Ref<const Eigen::MatrixXd>& force_per_tension,
              const BendingMatrix& compliance, double hold_Nm, bool acts, bool at_limit = false) noexcept;

  /// Bending moment (us, vs) along each section that the model lacks [N·m].
  const BendingVector& moment_Nm() const noexcept { return moment_Nm_; }
  void Reset() noexcept;
  void Remember(StateArchive& archive) noexcept;

 private:
  static constexpr int kDelayCycles = 2;  // from a torque to what shows of it

  double time_constant_s_, friction_Nm_, period_s_;
  BendingVector stiffness_Nm_;  // both entries of a section alike
  std::array<TendonVector, kDelayCycles> wanted_m_;
  BendingVector last_rad_, error_rad_;  // the error behind a low-pass
  BendingVector share_, offset_rad_;    // c and m
  BendingVector moment_Nm_;
  BendingVector onset_Nm_;              // the moment when the wanted bend came to rest
  double way_Nm_ = 0, largest_Nm_ = 0;  // since then: pushed in all, and the error at most
  bool asleep_ = false;
};

}  // namespace tendril::control
