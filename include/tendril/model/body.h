// The robot's body: kinematics, straight tendons and Kane dynamics of a chain of constant-curvature units in
// (u, v). Pure maths: no I/O, no exceptions after construction, no allocation outside constructors. Knows
// nothing of motors.
//
// q = (u_1, v_1, ..., u_N, v_N) with (u, v) = theta (cos beta, sin beta) of each unit [rad]; F_0 is the base
// frame.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "tendril/core/robot.h"

namespace tendril::model {

using ConstVectorRef = const Eigen::Ref<const Eigen::VectorXd>&;
using VectorRef = Eigen::Ref<Eigen::VectorXd>;
using MatrixRef = Eigen::Ref<Eigen::MatrixXd>;

/// Pose of frame A in frame W.
struct Pose {
  Eigen::Matrix3d R_WA = Eigen::Matrix3d::Identity();
  Eigen::Vector3d p_WA = Eigen::Vector3d::Zero();
};

/// Energies [J]; gravity (with the constant tip force's potential) is zero at the origin of F_0, elastic at
/// the rest shape.
struct Energy {
  double kinetic = 0, elastic = 0, gravity = 0;
  double total() const { return kinetic + elastic + gravity; }
};

class Body {
 public:
  /// Throws std::invalid_argument naming the invalid parameter.
  explicit Body(const BodyParameters& parameters);

  int units() const { return units_; }
  int dof() const { return 2 * units_; }
  int tendons() const { return static_cast<int>(tendons_.size()); }
  int sections() const { return static_cast<int>(parameters_.sections.size()); }
  /// First unit (0-based) of section k and one past its last.
  int first_unit(int section) const { return first_unit_[section]; }
  int end_unit(int section) const { return first_unit_[section + 1]; }
  /// Section in which tendon j (0-based) ends.
  int tendon_section(int tendon) const { return tendons_[tendon].section; }
  /// Bending stiffness of a unit (0-based) [N·m/rad] and the bend in which it is free of stress [rad].
  double unit_stiffness_Nm(int unit) const { return unit_[unit].stiffness_Nm; }
  Eigen::Vector2d rest_bend_rad(int unit) const { return {unit_[unit].rest_u, unit_[unit].rest_v}; }
  const BodyParameters& parameters() const { return parameters_; }

  /// Scratch memory of the dynamics, allocated once; one per thread.
  class Workspace {
   public:
    explicit Workspace(const Body& body);
    Workspace(const Workspace& other);
    Workspace(Workspace&& other) noexcept;
    Workspace& operator=(const Workspace& other);
    Workspace& operator=(Workspace&& other) noexcept;
    ~Workspace();

   private:
    friend class Body;
    struct Unit;
    std::vector<Unit> units_;
  };

  // ---- kinematics (paper eqs. 2-4, 10) ----

  /// Poses of frames 1..N in F_0; `poses` has N entries.
  void Poses(ConstVectorRef q, std::span<Pose> poses) const noexcept;
  /// Pose of the last disk in F_0.
  Pose TipPose(ConstVectorRef q) const noexcept;
  /// 6 x 2N: rows (v_W, w_W) of the last disk per unit dq.
  void TipJacobian(ConstVectorRef q, MatrixRef jacobian) const noexcept;

  // ---- straight tendons between neighbouring disks (eqs. 17-19) ----
  //
  // In a unit of length l, between holes at angle a - delta and a + delta (delta half the disks' twist
  // against each other), a tendon has the length L with
  //   L^2 = 2 c2(theta^2) [(l - r cos(delta) g)^2 - (r sin(delta) h)^2] + (2 r sin(delta))^2,
  //   g = u cos a + v sin a,  h = v cos a - u sin a,  c2(x) = (1 - cos sqrt x) / x;
  // without twist L = (l - r g) 2 sin(theta / 2) / theta.

  /// Total straight length of each tendon inside the robot [m]; `length` has M entries.
  void TendonLengths(ConstVectorRef q, VectorRef length_m) const noexcept;
  /// L(straight) - L(q) [m], positive when the tendon is pulled.
  void TendonShortening(ConstVectorRef q, VectorRef shortening_m) const noexcept;
  /// M x 2N, dL_j/dq [m/rad].
  void TendonLengthJacobian(ConstVectorRef q, MatrixRef jacobian) const noexcept;
  /// Both at once, at little more than the cost of one.
  void TendonShortening(ConstVectorRef q, VectorRef shortening_m, MatrixRef length_jacobian) const noexcept;
  /// M x N: straight length of each tendon within each unit of the straight robot, less that at q [m]; a
  /// row's sum is the tendon's shortening. 0 beyond its end.
  void SpanShortening(ConstVectorRef q, MatrixRef shortening_m) const noexcept;
  /// M x N: angle by which each tendon turns at the disk that ends each unit, where it goes on into the next
  /// [rad]; 0 from its last disk on.
  void TendonTurns(ConstVectorRef q, MatrixRef turn_rad) const noexcept;
  /// Generalised force -sum_j T_j dL_j/dq [N·m] of uniform tensions (eqs. 20, 21), 2N entries.
  void TendonForce(ConstVectorRef q, ConstVectorRef tension_N, VectorRef force_Nm) const noexcept;

  // ---- dynamics (eqs. 22-25, as O(N) recursions) ----

  /// Inverse: H(q) ddq + C(q, dq) - gravity + elastic + damping = generalised force that must be applied
  /// [N·m].
  void InverseDynamics(ConstVectorRef q, ConstVectorRef dq, ConstVectorRef ddq, VectorRef force_Nm,
                       Workspace& workspace) const noexcept;
  /// Forward: accelerations [rad/s^2] under the applied generalised force (tendons and any other).
  void ForwardDynamics(ConstVectorRef q, ConstVectorRef dq, ConstVectorRef force_Nm, VectorRef ddq,
                       Workspace& workspace) const noexcept;
  /// H(q), 2N x 2N, symmetric positive definite [kg·m^2].
  void MassMatrix(ConstVectorRef q, MatrixRef mass, Workspace& workspace) const noexcept;
  /// Elastic minus gravity minus tip-force terms of the equations at rest: the generalised force that holds q
  /// [N·m]. The tip force here and below adds to the parameters' own.
  void StaticForce(ConstVectorRef q, const Eigen::Vector3d& tip_force_W_N, VectorRef force_Nm) const noexcept;
  /// Exact derivative of (StaticForce - TendonForce) by q at given tensions: the tangent stiffness [N·m/rad].
  void TangentStiffness(ConstVectorRef q, ConstVectorRef tension_N, const Eigen::Vector3d& tip_force_W_N,
                        MatrixRef stiffness) const noexcept;
  /// Generalised force of a force on every disk's centre, columns of a 3 x N matrix in F_0.
  void DiskForce(ConstVectorRef q, const Eigen::Ref<const Eigen::Matrix3Xd>& force_W_N,
                 VectorRef force_Nm) const noexcept;
  Energy EnergyOf(ConstVectorRef q, ConstVectorRef dq, Workspace& workspace) const noexcept;

  // ---- constant curvature over sections: all units of a section share its bend equally ----

  /// q of the arc shape: u_i = us_k / n_k; us_vs has 2K entries.
  void SpreadBending(ConstVectorRef us_vs, VectorRef q) const noexcept;
  /// Sum over each section's units: (us, vs) per section.
  void SumBending(ConstVectorRef q, VectorRef us_vs) const noexcept;
  /// Generalised force on (us, vs) of the arc motion: virtual work of a 2N generalised force.
  void ProjectForce(ConstVectorRef force_Nm, VectorRef section_force_Nm) const noexcept;

 private:
  struct Tendon {
    int section;
    double cos_angle, sin_angle, radius_m;
  };
  struct UnitConstants {
    double length_m, mass_kg, inertia_xx, inertia_zz, stiffness_Nm, damping_Nms;
    int first_tendon;  // tendons that pass this unit: first_tendon..M-1
    double rest_u, rest_v;
  };
  // One tendon within one unit whose disks are twisted against each other.
  struct TwistedSpan {
    double cos_mid, sin_mid;  // of the mean hole angle a
    double lever_m, side_m;   // r cos(delta), r sin(delta)
  };
  struct SpanSlopes;

  const TwistedSpan& Twisted(int unit, int tendon) const { return twisted_[unit * tendons() + tendon]; }
  SpanSlopes TwistedSlopes(int unit, int tendon, double u, double v) const noexcept;

  BodyParameters parameters_;
  int units_ = 0;
  std::vector<int> first_unit_;
  std::vector<Tendon> tendons_;
  std::vector<UnitConstants> unit_;
  std::vector<TwistedSpan> twisted_;  // N x M, empty without twist
};

}  // namespace tendril::model
