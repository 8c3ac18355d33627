#include "tendril/model/bending_model.h"

#include <Eigen/QR>
#include <algorithm>
#include <vector>

#include "tendril/model/body.h"
#include "tendril/model/inverse.h"
#include "tendril/model/pull_cone.h"
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

/// Tensions: all tendons at the minimum, then each in turn at the largest beside them.
std::vector<Eigen::VectorXd> Loads(const LimitParameters& limits, int tendons) {
  const Eigen::VectorXd least_N = Eigen::VectorXd::Constant(tendons, limits.min_tension_N);
  std::vector<Eigen::VectorXd> loads(static_cast<std::size_t>(tendons) + 1, least_N);
  for (int j = 0; j < tendons; ++j) loads[static_cast<std::size_t>(j) + 1][j] = limits.max_tension_base_N;
  return loads;
}

TendonVector ShorteningOf(const Body& body, ConstVectorRef q) {
  TendonVector shortening_m(body.tendons());
  body.TendonShortening(q, shortening_m);
  return shortening_m;
}

/// The bend of least norm whose arcs shorten the tendons so, or come nearest to that: Gauss-Newton.
BendingVector BendOfShortening(const Body& bending, const TendonVector& shortening_m) {
  constexpr int kSteps = 30;
  BendingVector bend_rad = BendingVector::Zero(2 * bending.sections());
  CoordinateVector q(bending.dof());
  Eigen::MatrixXd slope(bend_rad.size(), bending.tendons());
  for (int k = 0; k < kSteps; ++k) {
    bending.SpreadBending(bend_rad, q);
    SectionForcePerTension(bending, bend_rad, slope);
    const Eigen::VectorXd left_m = shortening_m - ShorteningOf(bending, q);
    bend_rad += slope.transpose().completeOrthogonalDecomposition().solve(left_m);
  }
  return bend_rad;
}

/// What a body's equilibria bend beyond the bend of `bending` whose tendons are as much shorter than straight
/// as the body's than at the first load. Nothing where there is no equilibrium.
std::vector<std::optional<BendingVector>> BeyondShortening(const Body& body, const Body& bending,
                                                           const std::vector<Eigen::VectorXd>& loads) {
  const TendonVector straight_m = ShorteningOf(bending, Eigen::VectorXd::Zero(bending.dof()));
  std::optional<TendonVector> first_m;
  std::vector<std::optional<BendingVector>> beyond;
  for (const Eigen::VectorXd& tension_N : loads) {
    const Equilibrium found = SolveStatics(body, tension_N, {});
    beyond.emplace_back();
    if (found.result != StaticsResult::kConverged) continue;
    const TendonVector shortening_m = ShorteningOf(body, found.q);
    if (!first_m) first_m = shortening_m;
    BendingVector bend_rad(2 * body.sections());
    body.SumBending(found.q, bend_rad);
    beyond.back() = bend_rad - BendOfShortening(bending, straight_m + shortening_m - *first_m);
  }
  return beyond;
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
  AlignHoles(robot.body);
  return robot;
}

std::optional<double> WorstTipErrorOfBending(const RobotParameters& robot) {
  const Body body(robot.body), bending(BendingModel(robot.body));
  double worst_m = 0;
  for (const Eigen::VectorXd& tension_N : Loads(robot.limits, body.tendons())) {
    const Equilibrium real = SolveStatics(body, tension_N, {}), model = SolveStatics(bending, tension_N, {});
    if (real.result != StaticsResult::kConverged || model.result != StaticsResult::kConverged)
      return std::nullopt;
    worst_m = std::max(worst_m, (body.TipPose(real.q).p_WA - bending.TipPose(model.q).p_WA).norm());
  }
  return worst_m;
}

BendingMatrix UnseenBending(const RobotParameters& robot) {
  const int size = 2 * static_cast<int>(robot.body.sections.size());
  BendingMatrix unseen_rad2 = BendingMatrix::Zero(size, size);
  if (robot.body.BendsOnly()) return unseen_rad2;
  const Body body(robot.body), bending(BendingModel(robot.body));
  const std::vector<Eigen::VectorXd> loads = Loads(robot.limits, body.tendons());
  const auto of_all = BeyondShortening(body, bending, loads),
             of_bends = BeyondShortening(bending, bending, loads);
  int counted = 0;
  for (std::size_t i = 0; i < loads.size(); ++i) {
    if (!of_all[i] || !of_bends[i]) continue;
    const BendingVector error_rad = *of_all[i] - *of_bends[i];
    unseen_rad2 += error_rad * error_rad.transpose();
    ++counted;
  }
  if (counted > 0) unseen_rad2 /= counted;
  return unseen_rad2;
}

}  // namespace tendril::model
