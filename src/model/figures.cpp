// Each figure by the functions that the programs compute with.
#include "tendril/model/figures.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <numbers>

#include "tendril/model/arc_tensions.h"
#include "tendril/model/bending_model.h"
#include "tendril/model/body.h"
#include "tendril/model/capstan.h"
#include "tendril/model/pull_cone.h"
#include "tendril/model/pull_map.h"
#include "tendril/model/statics.h"
#include "tendril/model/tendon_pairs.h"

namespace tendril::model {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr int kDirections = 24;

/// The tip under these tensions with another gravity; none where the branch from zero tension ends.
std::optional<Vector3d> TipUnder(BodyParameters parameters, const Vector3d& gravity_W_mps2,
                                 const VectorXd& tension_N) {
  parameters.gravity_W_mps2 = gravity_W_mps2;
  const Body body(parameters);
  const auto found = SolveStatics(body, tension_N, Vector3d::Zero());
  if (found.result != StaticsResult::kConverged) return std::nullopt;
  return body.TipPose(found.q).p_WA;
}

void AddSags(const RobotParameters& robot, Figures& figures) {
  const VectorXd rest_N = RestTensions_N(robot);
  const auto without = TipUnder(robot.body, Vector3d::Zero(), rest_N);
  if (!without) return;
  const auto sag_m = [&](const Vector3d& gravity_W_mps2) -> std::optional<double> {
    const auto with = TipUnder(robot.body, gravity_W_mps2, rest_N);
    if (!with) return std::nullopt;
    return (*with - *without).norm();
  };
  const double own_mps2 = robot.body.gravity_W_mps2.norm();
  const double level_mps2 = own_mps2 > 0 ? own_mps2 : BodyParameters{}.gravity_W_mps2.norm();
  figures.sag_mounted_m = sag_m(robot.body.gravity_W_mps2);
  figures.sag_level_m = sag_m(Vector3d(-level_mps2, 0, 0));
}

std::vector<double> Frequencies(const RobotParameters& robot) {
  const Body body(robot.body);
  const VectorXd tension_N = RestTensions_N(robot);
  const auto rest = SolveStatics(body, tension_N, Vector3d::Zero());
  if (rest.result != StaticsResult::kConverged) return {};
  const VectorXd frequencies_Hz = NaturalFrequencies(body, rest.q, tension_N, Vector3d::Zero());
  if (!(frequencies_Hz[0] > 0)) return {};
  return {frequencies_Hz.begin(), frequencies_Hz.end()};
}

/// Each tendon's largest tension over full bends of one section, and what the other tendon of its pair has
/// then; none where one cannot be held.
struct Tensions {
  TendonVector most_N, opposing_N;
};
std::optional<Tensions> FullBend(const RobotParameters& robot, const Body& body, int section) {
  const PullCone cone = PullConeOf(robot.body, section);
  ArcTensions tensions(body, TendonPairs(robot));
  Tensions most{TendonVector::Zero(body.tendons()), TendonVector::Zero(body.tendons())};
  bool any = false;
  for (int i = 0; i < kDirections; ++i) {
    const double angle_rad = cone.from_rad + 2 * std::numbers::pi * i / kDirections;
    const Vector2d bend_rad =
        robot.limits.max_bending_rad * Vector2d(std::cos(angle_rad), std::sin(angle_rad));
    if ((cone.Nearest(bend_rad) - bend_rad).norm() > 1e-9) continue;
    BendingVector us_vs = BendingVector::Zero(2 * body.sections());
    us_vs.segment<2>(2 * section) = bend_rad;
    const auto held = tensions.Hold(us_vs, robot.limits.min_tension_N, kMaxCapstanTension_N);
    if (held.bound != Status::kOk) return std::nullopt;
    for (int j = 0; j < body.tendons(); ++j) {
      if (held.tension_N[j] <= most.most_N[j]) continue;
      most.most_N[j] = held.tension_N[j];
      const TendonPair* pair = robot.actuation ? robot.actuation->PairOf(j) : nullptr;
      if (pair != nullptr) most.opposing_N[j] = held.tension_N[pair->first + pair->second - j];
    }
    any = true;
  }
  if (!any) return std::nullopt;
  return most;
}

/// A tendon's motor as it pulls: the tension at the spool, and what of it the motor holds, which of a pair is
/// the difference of both.
struct AtMotor {
  double tension_N, load_N;
};
AtMotor Pulling(const RobotParameters& robot, const Tensions& at_base, int tendon) {
  const std::vector<TendonDriveParameters>& tendons = robot.actuation->tendons;
  const TransmissionParameters& own = tendons[static_cast<std::size_t>(tendon)].transmission;
  const TendonPairs pairs(robot);
  for (const TendonPairs::Pair& pair : pairs.all()) {
    if (pair.first != tendon && pair.second != tendon) continue;
    const bool first = pair.first == tendon;
    const double own_N = at_base.most_N[tendon], other_N = at_base.opposing_N[tendon];
    const auto tables = MakeCapstanTables(tendons, std::max(2 * own_N, robot.limits.max_tension_motor_N));
    const auto a = static_cast<std::size_t>(pair.first), b = static_cast<std::size_t>(pair.second);
    PullMap map(pair, tendons[a].transmission, tables[a], tendons[b].transmission, tables[b]);
    const double share = first ? pair.first_share : 1 - pair.first_share;
    map.SetUnpulled((1 - share) * own_N + share * other_N);
    const double side = first ? 1 : -1, pull_N = map.BaseToMotor(side * (own_N - other_N), side);
    const PullMap::Tensions spool = map.AtMotor(pull_N);
    return {first ? spool.first_N : spool.second_N, std::abs(pull_N)};
  }
  const double motor_N = SolveCapstan(own.pulleys, at_base.most_N[tendon] + own.coulomb_N);
  return {motor_N, motor_N};
}

// Of friction that grows beyond all bounds the solver may find no tension: then there are no such figures.
void AddMotors(const RobotParameters& robot, const Tensions& at_base, SectionFigures& figures) {
  figures.full_bend_motor_N = figures.full_bend_torque_Nm = figures.full_bend_rated_share = 0;
  for (int j = 0; j < at_base.most_N.size(); ++j) {
    const TendonDriveParameters& t = robot.actuation->tendons[static_cast<std::size_t>(j)];
    const AtMotor at_motor = Pulling(robot, at_base, j);
    const double torque_Nm =
        at_motor.load_N * t.SpoolTravelPerMotorRad() / t.gear.efficiency + t.motor.coulomb_friction_Nm;
    figures.full_bend_motor_N = std::max(*figures.full_bend_motor_N, at_motor.tension_N);
    figures.full_bend_torque_Nm = std::max(*figures.full_bend_torque_Nm, torque_Nm);
    figures.full_bend_rated_share =
        std::max(*figures.full_bend_rated_share, torque_Nm / t.drive.rated_torque_Nm);
  }
}

SectionFigures Section(const RobotParameters& robot, const Body& body, int section) {
  const SectionParameters& p = robot.body.sections[static_cast<std::size_t>(section)];
  SectionFigures figures;
  figures.bending_stiffness_Nm2 = p.UnitStiffness() * p.unit_length_m;
  figures.stiffness_Nm = p.UnitStiffness() / p.units;
  if (const auto at_base = FullBend(robot, body, section)) {
    figures.full_bend_base_N = at_base->most_N.maxCoeff();
    try {
      if (robot.actuation) AddMotors(robot, *at_base, figures);
    } catch (const std::exception&) {
      figures.full_bend_motor_N = figures.full_bend_torque_Nm = figures.full_bend_rated_share = std::nullopt;
    }
  }
  return figures;
}

}  // namespace

Figures FiguresOf(const RobotParameters& robot) {
  const Body body(robot.body);
  Figures figures;
  figures.weight_N = robot.body.mass_kg() * robot.body.gravity_W_mps2.norm();
  figures.pretension_N = RestTensions_N(robot).sum();
  AddSags(robot, figures);
  figures.frequencies_Hz = Frequencies(robot);
  // Tensions of a bend are the controller's, which knows bending alone.
  RobotParameters bending = robot;
  bending.body = BendingModel(robot.body);
  const Body bends(bending.body);
  for (int k = 0; k < bends.sections(); ++k) figures.sections.push_back(Section(bending, bends, k));
  return figures;
}

}  // namespace tendril::model
