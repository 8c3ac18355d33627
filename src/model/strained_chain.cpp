// Units, spans and kinematics of the strained chain.
#include "strained_chain.h"

#include <cmath>

#include "unit_joint.h"

namespace tendril::model {
namespace {

std::array<double, kStrains> Stiffness(const SectionParameters& s) {
  const double bending = s.UnitStiffness(), sideways = s.shear ? s.UnitShearStiffness() : 0;
  return {
      bending,  bending, s.torsion ? s.UnitTorsionalStiffness() : 0, s.extension ? s.UnitAxialStiffness() : 0,
      sideways, sideways};
}

std::array<double, kStrains> Damping(const SectionParameters& s) {
  const double square = s.unit_length_m * s.unit_length_m;
  const double sideways = s.shear_damping_Nspm * square;
  return {s.bending_damping_Nms,
          s.bending_damping_Nms,
          s.torsional_damping_Nms,
          s.axial_damping_Nspm * square,
          sideways,
          sideways};
}

}  // namespace

StrainedChain::StrainedChain(const BodyParameters& parameters)
    : tendons_(parameters.tendons()),
      gravity_(parameters.gravity_W_mps2),
      tip_force_(parameters.tip_force_W_N) {
  MakeUnits(parameters);
  MakeSpans(parameters);
}

void StrainedChain::MakeUnits(const BodyParameters& parameters) {
  for (const SectionParameters& s : parameters.sections) {
    const std::array<bool, kStrains> has{true, true, s.torsion, s.extension, s.shear, s.shear};
    for (int i = 0; i < s.units; ++i) {
      StrainedUnit& unit = units_.emplace_back();
      unit.length_m = s.unit_length_m;
      unit.mass_kg = s.MassAt(i);
      unit.inertia_xx = s.InertiaXxAt(i);
      unit.inertia_zz = s.InertiaZzAt(i);
      for (std::size_t a = 0; a < kStrains; ++a) unit.index[a] = has[a] ? dof_++ : -1;
      unit.stiffness = Stiffness(s);
      unit.damping = Damping(s);
      unit.rest = {0, 0, s.rest_torsion_rad_per_m * s.unit_length_m, s.rest_extension, 0, 0};
    }
  }
  units_.back().mass_kg += parameters.tip_payload_kg;
  for (const UnitDeviation& d : parameters.unit_deviations) {
    StrainedUnit& unit = units_[static_cast<std::size_t>(d.unit - 1)];
    unit.stiffness[0] *= d.stiffness_scale;
    unit.stiffness[1] *= d.stiffness_scale;
    unit.rest[0] = d.rest_u_rad;
    unit.rest[1] = d.rest_v_rad;
  }
}

void StrainedChain::MakeSpans(const BodyParameters& parameters) {
  for (int t = 0; t < tendons_; ++t) end_span_.push_back(parameters.EndDiskOf(t));
  int unit = 0;
  double begin_m = 0;  // arc length
  for (const SectionParameters& s : parameters.sections) {
    const double span_m = s.units_per_disk * s.unit_length_m;
    for (int disk = 0; disk < s.units / s.units_per_disk; ++disk) {
      spans_.push_back({unit, unit + s.units_per_disk});
      for (int t = 0; t < tendons_; ++t) {
        const Vec begin(parameters.HoleOf(t, begin_m)), end(parameters.HoleOf(t, begin_m + span_m));
        const Vec line = end + -begin + Vec(0, 0, span_m);
        holes_.push_back({begin, end, std::sqrt(line.dot(line))});
      }
      unit += s.units_per_disk;
      begin_m += span_m;
    }
  }
}

void StrainedChain::Advance(const StrainedUnit& unit, ConstVectorRef q, Vec& p, Mat& r) noexcept {
  Advance(unit.length_m, unit.At(q), p, r);
}

void StrainedChain::Advance(double length_m, const Strains& at, Vec& p, Mat& r) noexcept {
  const StrainSeries k(at);
  p += length_m * (r * Along(at.rotation(), at.shift(1), k.c[1], k.c[2], k.c[3]));
  r = Turn(r, at, k);
}

Pose StrainedChain::PoseWithin(int unit, ConstVectorRef q, double share) const noexcept {
  const StrainedUnit& whole = units_[static_cast<std::size_t>(unit)];
  Strains part = whole.At(q);
  part.u *= share;
  part.v *= share;
  part.w *= share;
  Vec p = kZero;
  Mat r = kIdentity;
  Advance(share * whole.length_m, part, p, r);
  return ToPose(p, r);
}

void StrainedChain::Place(ConstVectorRef q, Placed& placed) const noexcept {
  placed.r[0] = kIdentity;
  for (std::size_t i = 0; i < units_.size(); ++i) {
    const StrainedUnit& unit = units_[i];
    const Strains at = unit.At(q);
    const StrainSeries k(at);
    PlaceJoint(placed.r[i], unit.length_m, at, k, placed.joints[i]);
    placed.r[i + 1] = Turn(placed.r[i], at, k);
  }
}

void StrainedChain::TipJacobian(ConstVectorRef q, MatrixRef jacobian) const noexcept {
  Placed placed;
  Place(q, placed);
  Vec to_tip = kZero;  // from B to the tip
  for (std::size_t i = units_.size(); i-- > 0;) {
    const StrainJoint& j = placed.joints[i];
    for (int a = 0; a < kStrains; ++a) {
      if (!units_[i].Has(a)) continue;
      const Vec turning = j.Turning(a);
      jacobian.col(units_[i].IndexOf(a)) << (j.jv[a] + Cross(turning, to_tip)).eigen(), turning.eigen();
    }
    to_tip += j.p;
  }
}

}  // namespace tendril::model
