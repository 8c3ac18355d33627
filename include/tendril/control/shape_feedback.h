// Slow integral feedback from tendon displacement to the bending moment that each section's model lacks.
// Knows nothing of how tensions follow from it.
#pragma once

#include <Eigen/Core>
#include <array>

#include "tendril/core/limits.h"
#include "tendril/core/status.h"
#include "tendril/model/body.h"

namespace tendril::control {

class StateArchive;

/// With b a section's reference bend and e its tracking error, by least squares on the tendons' displacement
/// (stretch removed), both as complex numbers us + i vs, and K the section's bending stiffness:
///   moment = K (c b + m),  tau dc/dt = f conj(b) / (|b|^2 + b0^2),  tau dm/dt = f b0^2 / (|b|^2 + b0^2),
/// K f being the moments that bend all sections by e, so that tau de/dt = -e at every bend. Errors that grow
/// and turn with the bend (stiffness, payload, friction) stay in c while the bending plane rotates. At rest
/// an error within what dry friction may leave is not corrected until it reaches kWake times that. Nor is
/// friction overcome at rest at any cost: the moment moves from its value at standstill by at most what
/// friction may hold, because a moment learnt on a stuck robot is wrong once it moves. When its total path
/// exceeds kRestWay times the largest error, the loop only hunts, and that error is left as well.
class ShapeFeedback {
 public:
  static constexpr double kMaxShare = 0.5;  // limit of |c|, and of |m| [rad]
  static constexpr double kWake = 4;
  static constexpr double kRestWay = 2;

  /// `time_constant_s`: tau, slow compared with the robot's oscillation; `friction_Nm`: moment error that dry
  /// friction may leave at rest.
  ShapeFeedback(const model::Body& body, double time_constant_s, double friction_Nm, double period_s);

  /// One cycle. `bending_rad` is the reference, `reference_m` the shortening that the torques now sent are
  /// meant for, `measured_m` that from drives and cells, each tendon with its `weight`; `force_per_tension`
  /// (2K x M) and `compliance` (2K x 2K, bend per moment) are those at the reference bend. `acts` false: the
  /// moment stays. `at_limit`: tensions saturate, and the moment decays with tau because no more can be
  /// commanded. `hold_Nm`: moment that friction holds at the present tensions. kLimitedShapeCorrection: c or
  /// m is at its limit.
  Status Step(const BendingVector& bending_rad, const TendonVector& reference_m,
              const TendonVector& measured_m, const TendonVector& weight,
              const Eigen::Ref<const Eigen::MatrixXd>& force_per_tension, const BendingMatrix& compliance,
              double hold_Nm, bool acts, bool at_limit = false) noexcept;

  /// Bending moment (us, vs) along each section that the model lacks [N·m].
  const BendingVector& moment_Nm() const noexcept { return moment_Nm_; }
  void Reset() noexcept;
  void Archive(StateArchive& archive) noexcept;

 private:
  static constexpr int kDelayCycles = 2;  // from a torque to the feedback that shows it

  double time_constant_s_, friction_Nm_, period_s_;
  BendingVector stiffness_Nm_;  // both entries of a section are equal
  std::array<TendonVector, kDelayCycles> reference_m_;
  BendingVector last_rad_, error_rad_;  // the error low-passed
  BendingVector share_, offset_rad_;    // c and m
  BendingVector moment_Nm_;
  BendingVector onset_Nm_;              // the moment when the reference came to rest
  double way_Nm_ = 0, largest_Nm_ = 0;  // since then: path of the moment, largest error
  bool asleep_ = false;
};

}  // namespace tendril::control
