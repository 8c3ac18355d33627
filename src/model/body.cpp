// The body's parameters, the poses of its disks, and its arcs of constant curvature.
#include "tendril/model/body.h"

#include <array>
#include <cmath>
#include <stdexcept>
#include <string>

#include "strained_chain.h"
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

void Require(bool ok, const std::string& what) {
  if (!ok) throw std::invalid_argument("body: " + what);
}

bool Positive(double x) { return std::isfinite(x) && x > 0; }

bool NotNegative(double x) { return std::isfinite(x) && x >= 0; }

void CheckStrains(const SectionParameters& s, const std::string& where) {
  Require(s.units_per_disk >= 1 && s.units % s.units_per_disk == 0,
          where + "units_per_disk must be at least 1 and divide units");
  Require(NotNegative(s.disk_mass_kg), where + "disk_mass_kg must not be negative");
  Require(!s.poissons_ratio || (*s.poissons_ratio > -1 && *s.poissons_ratio <= 0.5),
          where + "poissons_ratio must be above -1 and at most 0.5");
  if (s.torsion) {
    Require(s.torsional_stiffness_Nm2 || s.poissons_ratio,
            where + "torsion needs torsional_stiffness_Nm2 or poissons_ratio");
    Require(Positive(s.UnitTorsionalStiffness()), where + "torsional_stiffness_Nm2 must be positive");
  }
  if (s.extension) Require(Positive(s.UnitAxialStiffness()), where + "axial_stiffness_N must be positive");
  if (s.shear) {
    Require(s.shear_stiffness_N || s.poissons_ratio,
            where + "shear needs shear_stiffness_N or poissons_ratio");
    Require(Positive(s.UnitShearStiffness()), where + "shear_stiffness_N must be positive");
  }
  Require(NotNegative(s.torsional_damping_Nms), where + "torsional_damping_Nms must not be negative");
  Require(NotNegative(s.axial_damping_Nspm), where + "axial_damping_Nspm must not be negative");
  Require(NotNegative(s.shear_damping_Nspm), where + "shear_damping_Nspm must not be negative");
  Require(std::isfinite(s.rest_torsion_rad_per_m) && (s.torsion || s.rest_torsion_rad_per_m == 0),
          where + "rest_torsion_rad_per_m must be finite, and 0 without torsion");
  Require(s.rest_extension > -1 && std::isfinite(s.rest_extension) && (s.extension || s.rest_extension == 0),
          where + "rest_extension must be above -1, and 0 without extension");
}

}  // namespace

Body::Body(const BodyParameters& parameters) : parameters_(parameters) {
  CheckSections();
  const auto& sections = parameters_.sections;
  first_unit_.push_back(0);
  for (std::size_t k = 0; k < sections.size(); ++k) {
    const SectionParameters& s = sections[k];
    const int first_tendon = tendons();
    for (const TendonRoute& t : s.tendons)
      tendons_.push_back({static_cast<int>(k), std::cos(t.angle_rad), std::sin(t.angle_rad), t.radius_m});
    for (int i = 0; i < s.units; ++i) {
      unit_.push_back({s.unit_length_m, s.MassAt(i), s.InertiaXxAt(i), s.InertiaZzAt(i), s.UnitStiffness(),
                       s.bending_damping_Nms, first_tendon, 0, 0});
      coordinate_.push_back(dof_);
      dof_ += 2 + (s.torsion ? 1 : 0) + (s.extension ? 1 : 0) + (s.shear ? 2 : 0);
      if (s.EndsAtDisk(i)) disk_unit_.push_back(units_ + i);
    }
    units_ += s.units;
    first_unit_.push_back(units_);
  }
  coordinate_.push_back(dof_);
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
  if (parameters_.twist_rad_per_m != 0) AddTwist();
  for (int j = 0; j < tendons(); ++j) end_disk_.push_back(parameters_.EndDiskOf(j));
  if (!parameters_.BendsOnly() || !parameters_.HasStraightRoutes())
    strained_ = std::make_shared<const StrainedChain>(parameters_);
  SetDamping();
}

void Body::SetDamping() {
  damping_Nms_.resize(dof_);
  for (int i = 0; i < units_; ++i) {
    damping_Nms_.segment<2>(coordinate(i)).setConstant(unit_[i].damping_Nms);
    if (!strained_) continue;
    const StrainedUnit& unit = strained_->units()[static_cast<std::size_t>(i)];
    for (int a = 2; a < kStrains; ++a) {
      if (unit.Has(a)) damping_Nms_[unit.IndexOf(a)] = unit.damping[static_cast<std::size_t>(a)];
    }
  }
}

void Body::CheckSections() {
  const auto& sections = parameters_.sections;
  Require(!sections.empty() && sections.size() <= static_cast<std::size_t>(kMaxSections),
          "number of sections must be 1.." + std::to_string(kMaxSections));
  Require(parameters_.gravity_W_mps2.allFinite(), "gravity must be finite");
  Require(NotNegative(parameters_.tip_payload_kg), "tip_payload_kg must not be negative");
  Require(parameters_.tip_force_W_N.allFinite(), "tip_force_W_N must be finite");
  Require(std::isfinite(parameters_.twist_rad_per_m), "twist_rad_per_m must be finite");
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
    CheckStrains(s, where);
    Require(!s.tendons.empty(), where + "needs at least 1 tendon");
    for (const TendonRoute& t : s.tendons) {
      Require(std::isfinite(t.angle_rad), where + "tendon angle must be finite");
      Require(Positive(t.radius_m), where + "tendon radius must be positive");
      Require(std::isfinite(t.turn_rad_per_m), where + "tendon turn_rad_per_m must be finite");
      Require(!t.end_radius_m || Positive(*t.end_radius_m), where + "tendon end_radius_m must be positive");
      Require(t.ends_at_disk >= 0 && t.ends_at_disk <= s.units / s.units_per_disk,
              where + "tendon ends_at_disk must be one of its disks, from 1");
    }
  }
  Require(parameters_.units() <= kMaxUnits, "more than " + std::to_string(kMaxUnits) + " units");
  Require(parameters_.tendons() <= kMaxTendons, "more than " + std::to_string(kMaxTendons) + " tendons");
}

void Body::AddTwist() {
  double mid_m = 0;  // arc length of the unit's middle
  for (int i = 0; i < units_; ++i) {
    mid_m += 0.5 * unit_[i].length_m;
    const double delta = 0.5 * parameters_.twist_rad_per_m * unit_[i].length_m;
    for (const SectionParameters& s : parameters_.sections) {
      for (const TendonRoute& t : s.tendons) {
        const double angle = t.angle_rad + parameters_.twist_rad_per_m * mid_m;
        twisted_.push_back(
            {std::cos(angle), std::sin(angle), t.radius_m * std::cos(delta), t.radius_m * std::sin(delta)});
      }
    }
    mid_m += 0.5 * unit_[i].length_m;
  }
}

const SectionParameters& Body::SectionOf(int unit) const {
  std::size_t k = 0;
  while (unit >= first_unit_[k + 1]) ++k;
  return parameters_.sections[k];
}

StrainVector Body::StrainsOf(int unit, ConstVectorRef q) const {
  if (!strained_) return StrainVector{q[2 * unit], q[2 * unit + 1], 0, 0, 0, 0};
  const Strains at = strained_->units()[static_cast<std::size_t>(unit)].At(q);
  return StrainVector{at.u, at.v, at.w, at.e, at.sx, at.sy};
}

void Body::RestShape(VectorRef q) const noexcept {
  for (int i = 0; i < units_; ++i) {
    const int at = coordinate(i);
    q[at] = unit_[i].rest_u;
    q[at + 1] = unit_[i].rest_v;
    if (!strained_) continue;
    const StrainedUnit& unit = strained_->units()[static_cast<std::size_t>(i)];
    for (int a = 2; a < kStrains; ++a) {
      if (unit.Has(a)) q[unit.IndexOf(a)] = unit.rest[a];
    }
  }
}

void Body::ElasticForce(ConstVectorRef q, VectorRef force_Nm) const noexcept {
  for (int i = 0; i < units_; ++i) {
    const UnitConstants& k = unit_[i];
    const int at = coordinate(i);
    force_Nm[at] = k.stiffness_Nm * (q[at] - k.rest_u);
    force_Nm[at + 1] = k.stiffness_Nm * (q[at + 1] - k.rest_v);
    if (!strained_) continue;
    const StrainedUnit& unit = strained_->units()[static_cast<std::size_t>(i)];
    for (int a = 2; a < kStrains; ++a) {
      if (unit.Has(a)) force_Nm[unit.IndexOf(a)] = unit.stiffness[a] * (q[unit.IndexOf(a)] - unit.rest[a]);
    }
  }
}

// ---- kinematics ----

void Body::Poses(ConstVectorRef q, std::span<Pose> poses) const noexcept {
  if (strained_)
    return strained_->Walk(q, [&](std::size_t i, const Vec& p, const Mat& r) { poses[i] = ToPose(p, r); });
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
  if (strained_) {
    strained_->Walk(q, [&](std::size_t, const Vec& p_end, const Mat& r_end) {
      p = p_end;
      r = r_end;
    });
    return ToPose(p, r);
  }
  for (int i = 0; i < units_; ++i) Advance(unit_[i].length_m, q[2 * i], q[2 * i + 1], p, r);
  return ToPose(p, r);
}

Pose Body::PoseWithin(int unit, ConstVectorRef q, double share) const noexcept {
  if (strained_) return strained_->PoseWithin(unit, q, share);
  const double u = share * q[2 * unit], v = share * q[2 * unit + 1], length = share * unit_[unit].length_m;
  const Stumpffs c = Stumpff(u * u + v * v);
  return ToPose(length * Vec(c[2] * u, c[2] * v, c[1]), Turn(kIdentity, u, v, c));
}

void Body::TipJacobian(ConstVectorRef q, MatrixRef jacobian) const noexcept {
  if (strained_) return strained_->TipJacobian(q, jacobian);
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
  if (strained_) RestShape(q);
  for (int s = 0; s < sections(); ++s) {
    const double share = end_unit(s) - first_unit(s);
    for (int i = first_unit(s); i < end_unit(s); ++i) {
      q[coordinate(i)] = us_vs[2 * s] / share;
      q[coordinate(i) + 1] = us_vs[2 * s + 1] / share;
    }
  }
}

void Body::SumBending(ConstVectorRef q, VectorRef us_vs) const noexcept {
  us_vs.setZero();
  for (int s = 0; s < sections(); ++s) {
    for (int i = first_unit(s); i < end_unit(s); ++i) {
      us_vs[2 * s] += q[coordinate(i)];
      us_vs[2 * s + 1] += q[coordinate(i) + 1];
    }
  }
}

void Body::ProjectForce(ConstVectorRef force_Nm, VectorRef section_force_Nm) const noexcept {
  // Equal shares of us move each unit by us / n, so a section's force is the mean of its units'.
  SumBending(force_Nm, section_force_Nm);
  for (int s = 0; s < sections(); ++s) section_force_Nm.segment<2>(2 * s) /= end_unit(s) - first_unit(s);
}

}  // namespace tendril::model
