// The robot's body: kinematics, straight tendons and Kane dynamics of a chain of units of constant strain.
// Pure maths: no I/O, no exceptions after construction, no allocation outside constructors. Knows nothing of
// motors.
//
// q = (u_1, v_1[, w_1][, e_1][, sx_1, sy_1], u_2, ...): of each unit the bend (u, v) = theta (cos beta, sin
// beta) [rad] and, where its section has them, torsion w [rad] about its backbone, extension e and shear (sx,
// sy), the motion of its end along and across it over unit_length_m; F_0 is the base frame. Forces on e, sx
// and sy are in N·m like those on angles.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <span>
#include <vector>

#include "tendril/core/robot.h"

namespace tendril::model {

using ConstVectorRef = const Eigen::Ref<const Eigen::VectorXd>&;
using VectorRef = Eigen::Ref<Eigen::VectorXd>;
using MatrixRef = Eigen::Ref<Eigen::MatrixXd>;
/// (u, v, w, e, sx, sy) of one unit.
using StrainVector = Eigen::Matrix<double, 6, 1>;

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

/// Force [N] and moment [N·m] at the centre of the last disk, both constant in F_0. A constant moment has no
/// potential: the tangent stiffness under it is not symmetric.
struct TipWrench {
  Eigen::Vector3d force_W_N = Eigen::Vector3d::Zero();
  Eigen::Vector3d moment_W_Nm = Eigen::Vector3d::Zero();

  TipWrench() = default;
  /// A force alone.
  template <class Derived>
  TipWrench(const Eigen::MatrixBase<Derived>& force) : force_W_N(force) {}
  TipWrench(const Eigen::Vector3d& force, const Eigen::Vector3d& moment)
      : force_W_N(force), moment_W_Nm(moment) {}
};

class StrainedChain;

class Body {
 public:
  /// Throws std::invalid_argument naming the invalid parameter.
  explicit Body(const BodyParameters& parameters);

  int units() const { return units_; }
  int dof() const { return dof_; }
  /// Whether q = (u_1, v_1, ..., u_N, v_N) and every unit ends at a disk. What only a body of this kind can
  /// do says so.
  bool bends_only() const { return parameters_.BendsOnly(); }
  /// Index in q of a unit's u; v follows, then w, e and (sx, sy) where the unit has them. dof() for units().
  int coordinate(int unit) const { return strained_ ? coordinate_[unit] : 2 * unit; }
  bool twists(int unit) const { return SectionOf(unit).torsion; }
  bool stretches(int unit) const { return SectionOf(unit).extension; }
  bool shears(int unit) const { return SectionOf(unit).shear; }
  /// Those of a unit; 0 where it does not have a strain.
  StrainVector StrainsOf(int unit, ConstVectorRef q) const;
  /// Disks, D; D = N where every unit ends at one.
  int disks() const { return static_cast<int>(disk_unit_.size()); }
  /// Unit (0-based) that ends at a disk (0-based).
  int disk_unit(int disk) const { return disk_unit_[disk]; }
  /// First unit (0-based) of those between a disk (0-based) and the one before.
  int span_unit(int disk) const { return disk > 0 ? disk_unit_[disk - 1] + 1 : 0; }
  int tendons() const { return static_cast<int>(tendons_.size()); }
  int sections() const { return static_cast<int>(parameters_.sections.size()); }
  /// First unit (0-based) of section k and one past its last.
  int first_unit(int section) const { return first_unit_[section]; }
  int end_unit(int section) const { return first_unit_[section + 1]; }
  /// Section in which tendon j (0-based) ends, and one past its last disk.
  int tendon_section(int tendon) const { return tendons_[tendon].section; }
  int tendon_end_disk(int tendon) const { return end_disk_[tendon]; }
  /// Bending stiffness of a unit (0-based) [N·m/rad] and the bend in which it is free of stress [rad].
  double unit_stiffness_Nm(int unit) const { return unit_[unit].stiffness_Nm; }
  Eigen::Vector2d rest_bend_rad(int unit) const { return {unit_[unit].rest_u, unit_[unit].rest_v}; }
  /// The shape in which the backbone is free of stress.
  void RestShape(VectorRef q) const noexcept;
  /// Stiffness times the strain from the rest shape [N·m].
  void ElasticForce(ConstVectorRef q, VectorRef force_Nm) const noexcept;
  /// Viscous damping on each coordinate's rate [N·m·s].
  const Eigen::VectorXd& damping_Nms() const { return damping_Nms_; }
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
    struct Strained;
    std::vector<Unit> units_;         // of a body that only bends
    std::vector<Strained> strained_;  // of any other
  };

  // ---- kinematics (paper eqs. 2-4, 10) ----

  /// Poses of frames 1..N, the units' ends, in F_0; `poses` has N entries.
  void Poses(ConstVectorRef q, std::span<Pose> poses) const noexcept;
  /// Pose of the last disk in F_0.
  Pose TipPose(ConstVectorRef q) const noexcept;
  /// Pose after the part `share` (0..1) of a unit (0-based), relative to the frame at its begin.
  Pose PoseWithin(int unit, ConstVectorRef q, double share) const noexcept;
  /// 6 x dof: rows (v_W, w_W) of the last disk per unit dq.
  void TipJacobian(ConstVectorRef q, MatrixRef jacobian) const noexcept;

  // ---- straight tendons between neighbouring disks (eqs. 17-19), over all units between them ----
  //
  // In a unit that only bends, of length l, between holes at angle a - delta and a + delta (delta half the
  // disks' twist against each other), a tendon has the length L with
  //   L^2 = 2 c2(theta^2) [(l - r cos(delta) g)^2 - (r sin(delta) h)^2] + (2 r sin(delta))^2,
  //   g = u cos a + v sin a,  h = v cos a - u sin a,  c2(x) = (1 - cos sqrt x) / x;
  // without twist L = (l - r g) 2 sin(theta / 2) / theta.

  /// Total straight length of each tendon inside the robot [m]; `length` has M entries.
  void TendonLengths(ConstVectorRef q, VectorRef length_m) const noexcept;
  /// L(straight) - L(q) [m], positive when the tendon is pulled.
  void TendonShortening(ConstVectorRef q, VectorRef shortening_m) const noexcept;
  /// M x dof, dL_j/dq [m/rad].
  void TendonLengthJacobian(ConstVectorRef q, MatrixRef jacobian) const noexcept;
  /// Both at once, at little more than the cost of one.
  void TendonShortening(ConstVectorRef q, VectorRef shortening_m, MatrixRef length_jacobian) const noexcept;
  /// M x D: straight length of each tendon up to each disk from the one before in the straight robot, less
  /// that at q [m]; a row's sum is the tendon's shortening. 0 beyond its end.
  void SpanShortening(ConstVectorRef q, MatrixRef shortening_m) const noexcept;
  /// M x D: angle by which each tendon turns at each disk, where it goes on to the next [rad]; 0 from its
  /// last disk on.
  void TendonTurns(ConstVectorRef q, MatrixRef turn_rad) const noexcept;
  /// Generalised force -sum_j T_j dL_j/dq [N·m] of uniform tensions (eqs. 20, 21), dof entries.
  void TendonForce(ConstVectorRef q, ConstVectorRef tension_N, VectorRef force_Nm) const noexcept;

  // ---- dynamics (eqs. 22-25, as O(N) recursions) ----

  /// Inverse: H(q) ddq + C(q, dq) - gravity + elastic + damping = generalised force that must be applied
  /// [N·m].
  void InverseDynamics(ConstVectorRef q, ConstVectorRef dq, ConstVectorRef ddq, VectorRef force_Nm,
                       Workspace& workspace) const noexcept;
  /// Forward: accelerations [rad/s^2] under the applied generalised force (tendons and any other).
  void ForwardDynamics(ConstVectorRef q, ConstVectorRef dq, ConstVectorRef force_Nm, VectorRef ddq,
                       Workspace& workspace) const noexcept;
  /// H(q), dof x dof, symmetric positive definite [kg·m^2].
  void MassMatrix(ConstVectorRef q, MatrixRef mass, Workspace& workspace) const noexcept;
  /// Elastic minus gravity minus tip-wrench terms of the equations at rest: the generalised force that holds
  /// q [N·m]. The wrench here and below adds to the parameters' own tip force.
  void StaticForce(ConstVectorRef q, const TipWrench& tip, VectorRef force_Nm) const noexcept;
  /// Exact derivative of (StaticForce - TendonForce) by q at given tensions: the tangent stiffness [N·m/rad],
  /// symmetric without a tip moment.
  void TangentStiffness(ConstVectorRef q, ConstVectorRef tension_N, const TipWrench& tip,
                        MatrixRef stiffness) const noexcept;
  /// Generalised force of a force on every unit's end, columns of a 3 x N matrix in F_0.
  void DiskForce(ConstVectorRef q, const Eigen::Ref<const Eigen::Matrix3Xd>& force_W_N,
                 VectorRef force_Nm) const noexcept;
  Energy EnergyOf(ConstVectorRef q, ConstVectorRef dq, Workspace& workspace) const noexcept;

  // ---- constant curvature over sections: all units of a section share its bend equally; other strains stay
  // at
  //      rest ----

  /// q of the arc shape: u_i = us_k / n_k; us_vs has 2K entries.
  void SpreadBending(ConstVectorRef us_vs, VectorRef q) const noexcept;
  /// Sum over each section's units: (us, vs) per section.
  void SumBending(ConstVectorRef q, VectorRef us_vs) const noexcept;
  /// Generalised force on (us, vs) of the arc motion: virtual work of a generalised force.
  void ProjectForce(ConstVectorRef force_Nm, VectorRef section_force_Nm) const noexcept;

 private:
  const SectionParameters& SectionOf(int unit) const;
  void CheckSections();
  void AddTwist();
  void SetDamping();
  void AddMomentStiffness(ConstVectorRef q, const Eigen::Vector3d& moment_W_Nm,
                          MatrixRef stiffness) const noexcept;

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
  int units_ = 0, dof_ = 0;
  std::vector<int> first_unit_, disk_unit_, end_disk_, coordinate_;
  Eigen::VectorXd damping_Nms_;
  std::vector<Tendon> tendons_;
  std::vector<UnitConstants> unit_;
  std::vector<TwistedSpan> twisted_;  // N x M, empty without twist
  // Of a body that does not only bend, or whose tendons are not straight; everything is computed there. Never
  // changed, so copies share it.
  std::shared_ptr<const StrainedChain> strained_;
};

}  // namespace tendril::model
