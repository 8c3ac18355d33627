// The body's parameters, the poses of its disks, and its arcs of constant curvature.
#include "tendril/model/body.h"

#include <array>
#include <cmath>
#include <stdexcept>
#include <string>

#include "tendril/core/limits.h"
#include "unit_joint.h"

namespace tendril::model {
namespace {

// From the pose of A to that of B.
inline void Advance(double l, double u, double v, Vec& p, Mat& r) {
  const Stumpffs c = Stumpff(u * u + v * v);
  p += Times(r, l * c[2] * u, l * c[2] * v, l * c[1]);
  r = Turn(r, u, v, c);
}

inline Pose ToPose(const Vec& p, const Mat& r) {
  Pose pose;
  pose.p_WA = p.eigen();
  pose.R_WA << r.x.eigen(), r.y.eigen(), r.z.eigen();
  return pose;
}

void Require(bool ok, const std::string& what) {
  if (!ok) throw std::invalid_argument("body: " + what);
}

bool Positive(double x) { return std::isfinite(x) && x > 0; }

bool NotNegative(double x) { return std::isfinite(x) && x >= 0; }

}  // namespace

Body::Body(const BodyParameters& parameters) : parameters_(parameters) {
  const auto& sections = parameters_.sections;
  Require(!sections.empty() && sections.size() <= static_cast<std::size_t>(kMaxSections),
          "number of sections must be 1.." + std::to_string(kMaxSections));
  Require(parameters_.gravity_W_mps2.allFinite(), "gravity must be finite");
  Require(NotNegative(parameters_.tip_payload_kg), "tip_payload_kg must not be negative");
  Require(parameters_.tip_force_W_N.allFinite(), "tip_force_W_N must be finite");
  Require(std::isfinite(parameters_.twist_rad_per_m), "twist_rad_per_m must be finite");
  first_unit_.push_back(0);
  for (std::size_t k = 0; k < sections.size(); ++k) {
    const SectionParameters& s = sections[k];
    const std::string where = "section " + std::to_string(k + 1) + ": ";
    Require(s.units >= 1, where + "units must be at least 1");
    Require(Positive(s.unit_length_m), where + "unit_length_m must be positive");
    Require(Positive(s.unit_mass_kg), where + "unit_mass_kg must be positive");
    Require(Positive(s.disk_inertia_xx_kgm2), where + "disk_inertia_xx_kgm2 must be positive");
    Require(Positive(s.disk_inertia_zz_kgm2), where + "disk_inertia_zz_kgm2 must be positive");
    Require(Positive(s.youngs_modulus_Pa), where + "youngs_modulus_Pa must be positive");
    Require(Positive(s.core_radius_m), where + "core_radius_m must be positive");
    Require(NotNegative(s.bending_damping_Nms), where + "bending_damping_Nms must not be negative");
    Require(!s.tendons.empty(), where + "needs at least 1 tendon");
    const int first_tendon = tendons();
    for (const TendonRoute& t : s.tendons) {
      Require(std::isfinite(t.angle_rad), where + "tendon angle must be finite");
      Require(Positive(t.radius_m), where + "tendon radius must be positive");
      tendons_.push_back({static_cast<int>(k), std::cos(t.angle_rad), std::sin(t.angle_rad), t.radius_m});
    }
    units_ += s.units;
    Require(units_ <= kMaxUnits, "more than " + std::to_string(kMaxUnits) + " units");
    first_unit_.push_back(units_);
    for (int i = 0; i < s.units; ++i) {
      unit_.push_back({s.unit_length_m, s.unit_mass_kg, s.disk_inertia_xx_kgm2, s.disk_inertia_zz_kgm2,
                       s.UnitStiffness(), s.bending_damping_Nms, first_tendon, 0, 0});
    }
  }
  Require(tendons() <= kMaxTendons, "more than " + std::to_string(kMaxTendons) + " tendons");
  unit_.back().mass_kg += parameters_.tip_payload_kg;
  for (const UnitDeviation& d : parameters_.unit_deviations) {
    const std::string where = "unit " + std::to_string(d.unit) + ": ";
    Require(d.unit >= 1 && d.unit <= units_, where + "there are units 1.." + std::to_string(units_));
    Require(Positive(d.stiffness_scale), where + "stiffness_scale must be positive");
    Require(std::isfinite(d.rest_u_rad) && std::isfinite(d.rest_v_rad), where + "rest bend must be finite");
    UnitConstants& unit = unit_[d.unit - 1];
    unit.stiffness_Nm *= d.stiffness_scale;
    unit.rest_u = d.rest_u_rad;
    unit.rest_v = d.rest_v_rad;
  }
  if (parameters_.twist_rad_per_m != 0) {
    double mid_m = 0;  // arc length of the unit's middle
    for (int i = 0; i < units_; ++i) {
      mid_m += 0.5 * unit_[i].length_m;
      const double delta = 0.5 * parameters_.twist_rad_per_m * unit_[i].length_m;
      for (const SectionParameters& s : sections) {
        for (const TendonRoute& t : s.tendons) {
          const double angle = t.angle_rad + parameters_.twist_rad_per_m * mid_m;
          twisted_.push_back(
              {std::cos(angle), std::sin(angle), t.radius_m * std::cos(delta), t.radius_m * std::sin(delta)});
        }
      }
      mid_m += 0.5 * unit_[i].length_m;
    }
  }
}

// ---- kinematics ----

void Body::Poses(ConstVectorRef q, std::span<Pose> poses) const noexcept {
  Vec p = kZero;
  Mat r = kIdentity;
  for (int i = 0; i < units_; ++i) {
    Advance(unit_[i].length_m, q[2 * i], q[2 * i + 1], p, r);
    poses[i] = ToPose(p, r);
  }
}

Pose Body::TipPose(ConstVectorRef q) const noexcept {
  Vec p = kZero;
  Mat r = kIdentity;
  for (int i = 0; i < units_; ++i) Advance(unit_[i].length_m, q[2 * i], q[2 * i + 1], p, r);
  return ToPose(p, r);
}

void Body::TipJacobian(ConstVectorRef q, MatrixRef jacobian) const noexcept {
  std::array<Joint, kMaxUnits> joints;
  PlaceJoints(
      units_, [this](int i) { return unit_[i].length_m; }, q, joints);
  Vec to_tip = kZero;  // from B to the tip
  for (int i = units_ - 1; i >= 0; --i) {
    const Joint& j = joints[i];
    jacobian.col(2 * i).head<3>() = (j.jv_u + Cross(j.jw_u, to_tip)).eigen();
    jacobian.col(2 * i).tail<3>() = j.jw_u.eigen();
    jacobian.col(2 * i + 1).head<3>() = (j.jv_v + Cross(j.jw_v, to_tip)).eigen();
    jacobian.col(2 * i + 1).tail<3>() = j.jw_v.eigen();
    to_tip += j.p;
  }
}

// ---- constant curvature over sections ----

void Body::SpreadBending(ConstVectorRef us_vs, VectorRef q) const noexcept {
  for (int s = 0; s < sections(); ++s) {
    const double share = end_unit(s) - first_unit(s);
    for (int i = first_unit(s); i < end_unit(s); ++i) {
      q[2 * i] = us_vs[2 * s] / share;
      q[2 * i + 1] = us_vs[2 * s + 1] / share;
    }
  }
}

void Body::SumBending(ConstVectorRef q, VectorRef us_vs) const noexcept {
  us_vs.setZero();
  for (int s = 0; s < sections(); ++s) {
    for (int i = first_unit(s); i < end_unit(s); ++i) {
      us_vs[2 * s] += q[2 * i];
      us_vs[2 * s + 1] += q[2 * i + 1];
    }
  }
}

void Body::ProjectForce(ConstVectorRef force_Nm, VectorRef section_force_Nm) const noexcept {
  // Equal shares of us move each unit by us / n, so a section's force is the mean of its units'.
  SumBending(force_Nm, section_force_Nm);
  for (int s = 0; s < sections(); ++s) section_force_Nm.segment<2>(2 * s) /= end_unit(s) - first_unit(s);
}

}  // namespace tendril::model
