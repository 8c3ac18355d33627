#include "tendril/model/bending_model.h"

#include <algorithm>

#include "tendril/model/body.h"
#include "tendril/model/statics.h"

namespace tendril::model {
namespace {

// Units in series: lengths add up, and the same bend is shared by all, so that rates are smaller. Single
// units differ only where every one ends at a disk; otherwise a spacing has the mean of its units' scales and
// the sum of their rest bends.
SectionParameters OneUnitADisk(SectionParameters s) {
  const int joined = s.units_per_disk;
  s.unit_mass_kg = joined * s.unit_mass_kg + s.disk_mass_kg;
  s.disk_mass_kg = 0;
  s.units /= joined;
  s.unit_length_m *= joined;
  s.bending_damping_Nms /= joined;
  s.units_per_disk = 1;
  s.torsion = s.extension = s.shear = false;
  s.poissons_ratio.reset();
  s.torsional_stiffness_Nm2.reset();
  s.axial_stiffness_N.reset();
  s.shear_stiffness_N.reset();
  s.torsional_damping_Nms = s.axial_damping_Nspm = s.shear_damping_Nspm = 0;
  s.rest_torsion_rad_per_m = s.rest_extension = 0;
  return s;
}

}  // namespace

BodyParameters BendingModel(const BodyParameters& body) {
  if (body.BendsOnly()) return body;
  BodyParameters bending = body;
  bending.unit_deviations.clear();
  int unit = 0, disk = 0;  // of the whole robot, from 0
  for (SectionParameters& s : bending.sections) {
    const int joined = s.units_per_disk;
    for (const UnitDeviation& d : body.unit_deviations) {
      if (d.unit <= unit || d.unit > unit + s.units) continue;
      UnitDeviation& of = bending.DeviationOf(disk + (d.unit - 1 - unit) / joined + 1);
      of.stiffness_scale += (d.stiffness_scale - 1) / joined;
      of.rest_u_rad += d.rest_u_rad;
      of.rest_v_rad += d.rest_v_rad;
    }
    unit += s.units;
    s = OneUnitADisk(s);
    disk += s.units;
  }
  return bending;
}

RobotParameters ControlModel(RobotParameters robot) {
  robot.body = BendingModel(robot.body);
  return robot;
}

std::optional<double> WorstTipErrorOfBending(const RobotParameters& robot) {
  const Body body(robot.body), bending(BendingModel(robot.body));
  double worst_m = 0;
  for (int pulled = -1; pulled < body.tendons(); ++pulled) {
    Eigen::VectorXd tension_N = Eigen::VectorXd::Constant(body.tendons(), robot.limits.min_tension_N);
    if (pulled >= 0) tension_N[pulled] = robot.limits.max_tension_base_N;
    const Equilibrium real = SolveStatics(body, tension_N, {}), model = SolveStatics(bending, tension_N, {});
    if (real.result != StaticsResult::kConverged || model.result != StaticsResult::kConverged)
      return std::nullopt;
    worst_m = std::max(worst_m, (body.TipPose(real.q).p_WA - bending.TipPose(model.q).p_WA).norm());
  }
  return worst_m;
}

}  // namespace tendril::model
