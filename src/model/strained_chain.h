// The chain of units of constant strain: what a Body computes where a section twists, stretches or shears or
// has several units a disk. Functions, frames and units as in tendril/model/body.h. Knows nothing of motors.
#pragma once

#include <algorithm>
#include <array>
#include <vector>

#include "strain_joint.h"
#include "tendril/core/limits.h"
#include "tendril/model/body.h"

namespace tendril::model {

/// Strains of the chain's units and the coordinates that carry them.
struct StrainedUnit {
  double length_m = 0, mass_kg = 0, inertia_xx = 0, inertia_zz = 0;
  std::array<int, kStrains> index{};         // of each strain in q; -1 where switched off
  std::array<double, kStrains> stiffness{};  // N·m per rad, per 1 of e, sx and sy
  std::array<double, kStrains> damping{};    // N·m·s
  std::array<double, kStrains> rest{};

  bool Has(int strain) const { return IndexOf(strain) >= 0; }
  int IndexOf(int strain) const { return index[static_cast<std::size_t>(strain)]; }
  int end() const { return 1 + std::max({index[1], index[2], index[3], index[5]}); }  // of its part of q
  double Value(ConstVectorRef q, int strain) const { return Has(strain) ? q[IndexOf(strain)] : 0; }
  Strains At(ConstVectorRef q) const {
    return {q[index[0]], q[index[1]], Value(q, 2), Value(q, 3), Value(q, 4), Value(q, 5)};
  }
};

/// What a unit keeps between the passes of a recursion.
struct StrainedState {
  StrainJoint joint;
  Vec bias_v, bias_w;                // acceleration of B with the joint's and A's accelerations zero
  Vec f, n;                          // force and moment at the origin of B
  std::array<Vec, kStrains> uf, un;  // articulated inertia times the motion subspace, strain by strain
  std::array<double, kStrains> inverse_inertia, left;  // of the strain alone; its force left for acceleration
  Vec z;                                               // axis of the frame at the unit's end
};

class StrainedChain {
 public:
  /// Of valid parameters.
  explicit StrainedChain(const BodyParameters& parameters);

  const std::vector<StrainedUnit>& units() const { return units_; }

  Pose PoseWithin(int unit, ConstVectorRef q, double share) const noexcept;
  template <class Visit>
  void Walk(ConstVectorRef q, const Visit& visit) const noexcept {
    Vec p = kZero;
    Mat r = kIdentity;
    for (std::size_t i = 0; i < units_.size(); ++i) {
      Advance(units_[i], q, p, r);
      visit(i, p, r);
    }
  }
  void TipJacobian(ConstVectorRef q, MatrixRef jacobian) const noexcept;

  void TendonLengths(ConstVectorRef q, VectorRef length_m) const noexcept;
  void TendonShortening(ConstVectorRef q, VectorRef shortening_m) const noexcept;
  void TendonShortening(ConstVectorRef q, VectorRef shortening_m, MatrixRef length_jacobian) const noexcept;
  void SpanShortening(ConstVectorRef q, MatrixRef shortening_m) const noexcept;
  void TendonTurns(ConstVectorRef q, MatrixRef turn_rad) const noexcept;
  void TendonForce(ConstVectorRef q, ConstVectorRef tension_N, VectorRef force_Nm) const noexcept;

  void InverseDynamics(ConstVectorRef q, ConstVectorRef dq, ConstVectorRef ddq, VectorRef force_Nm,
                       StrainedState* state) const noexcept;
  void ForwardDynamics(ConstVectorRef q, ConstVectorRef dq, ConstVectorRef force_Nm, VectorRef ddq,
                       StrainedState* state) const noexcept;
  void MassMatrix(ConstVectorRef q, MatrixRef mass, StrainedState* state) const noexcept;
  Energy EnergyOf(ConstVectorRef q, ConstVectorRef dq) const noexcept;

  void StaticForce(ConstVectorRef q, const TipWrench& tip, VectorRef force_Nm) const noexcept;
  void TangentStiffness(ConstVectorRef q, ConstVectorRef tension_N, const TipWrench& tip,
                        MatrixRef stiffness) const noexcept;
  void DiskForce(ConstVectorRef q, const Eigen::Ref<const Eigen::Matrix3Xd>& force_W_N,
                 VectorRef force_Nm) const noexcept;

 private:
  /// Joints of the whole chain in F_0, and the frames 0..N.
  struct Placed {
    std::array<StrainJoint, kMaxUnits> joints;
    std::array<Mat, kMaxUnits + 1> r;
  };
  /// The units between two neighbouring disks.
  struct Span {
    int first_unit, end_unit;
  };
  /// A tendon's holes in the axes of the disks that begin and end a span, and its length when straight.
  struct Holes {
    Vec begin, end;
    double straight_m;
  };
  /// A tendon within one span, in F_0.
  struct Line {
    double length_m;
    Vec direction;  // from the hole at the begin to that at the end
    Vec arm;        // from the centre of the disk at the end to its hole
  };
  /// Constant forces on what lies beyond a point: their sum, their moment about the point, and what turns a
  /// small rotation into the change of that moment, sum of d F^T - (d . F) 1 over their arms d.
  struct Load {
    Vec force = kZero, moment = kZero;
    Mat turning{kZero, kZero, kZero};

    void Add(const Vec& f, const Vec& arm) {
      force += f;
      Count(f, arm);
    }
    /// To a point at -way.
    void ShiftBy(const Vec& way) { Count(force, way); }

   private:
    void Count(const Vec& f, const Vec& arm);
  };

  void MakeUnits(const BodyParameters& parameters);
  void MakeSpans(const BodyParameters& parameters);
  void Place(ConstVectorRef q, Placed& placed) const noexcept;
  static void Advance(const StrainedUnit& unit, ConstVectorRef q, Vec& p, Mat& r) noexcept;
  static void Advance(double length_m, const Strains& at, Vec& p, Mat& r) noexcept;
  bool Passes(int tendon, std::size_t span) const {
    return static_cast<int>(span) < end_span_[static_cast<std::size_t>(tendon)];
  }
  const Holes& HolesOf(std::size_t span, int tendon) const {
    return holes_[span * static_cast<std::size_t>(tendons_) + static_cast<std::size_t>(tendon)];
  }
  Line LineOf(const Placed& placed, std::size_t span, int tendon) const noexcept;
  void AddSecondDerivatives(const Placed& placed, int unit, int lowest, ConstVectorRef q, const Load& load,
                            MatrixRef stiffness) const noexcept;
  void AddTendons(const Placed& placed, std::size_t span, ConstVectorRef q, ConstVectorRef tension_N,
                  MatrixRef stiffness) const noexcept;
  void AddTipMoment(const Placed& placed, ConstVectorRef q, const Vec& moment,
                    MatrixRef stiffness) const noexcept;

  std::vector<StrainedUnit> units_;
  std::vector<Span> spans_;
  std::vector<Holes> holes_;   // spans x M
  std::vector<int> end_span_;  // of each tendon, one past its last
  int dof_ = 0, tendons_ = 0;
  Vec gravity_, tip_force_;
};

}  // namespace tendril::model
