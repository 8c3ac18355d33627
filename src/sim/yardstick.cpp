// Scales from the numbers of a robot file, and those of the reference rig.
#include "tendril/sim/yardstick.h"

#include <cmath>
#include <numbers>

namespace tendril::sim {
namespace {

/// The numbers of config/robots/rig_90mm.yaml used for the scales.
RobotParameters ReferenceRig() {
  SectionParameters section;
  section.units = 4;
  section.unit_length_m = 0.0225;
  section.unit_mass_kg = 0.0025;
  section.youngs_modulus_Pa = 2.3e10;
  section.core_radius_m = 0.0005;
  section.tendons = {{0, 0.004}, {2 * std::numbers::pi / 3, 0.004}, {4 * std::numbers::pi / 3, 0.004}};
  TendonDriveParameters drive;
  drive.motor.torque_constant_NmpA = 0.0196;
  drive.motor.nominal_current_A = drive.drive.current_limit_A = 0.360;
  drive.gear.ratio = 19;
  drive.spool.radius_m = 0.008;
  drive.tendon.stiffness_Npm = 30000;
  RobotParameters rig;
  rig.body.sections = {section};
  rig.limits = {
      .min_tension_N = 0.3, .max_tension_base_N = 8, .max_tension_motor_N = 10, .max_bending_rad = 2.6};
  rig.actuation = ActuationParameters{.tendons = {drive, drive, drive}, .pairs = {}, .tracker = {}};
  return rig;
}

/// Without a payload.
double MassOf(const BodyParameters& body) { return body.mass_kg() - body.tip_payload_kg; }

/// EI / L^2, sections in series.
double BendingForce(const BodyParameters& body) {
  double give_radpNm = 0;
  for (const SectionParameters& s : body.sections) give_radpNm += s.units / s.UnitStiffness();
  return 1 / (give_radpNm * body.length_m());
}

/// What may pull at the tip is measured by stiffness and weight. What shows is a part of the length, by the
/// stiffness alone: a hanging robot's weight adds to it, and a standing one's takes it away until at 7.84 EI
/// / L^2 the straight robot falls over (Greenhill), from where on its tendons hold it.
Measure TipForce(const BodyParameters& body) {
  constexpr double kFallsOver = 7.84, kHeldByTendons = 0.1;
  const double bending_N = BendingForce(body), mass_kg = MassOf(body);
  const double hanging_N = mass_kg * body.gravity_W_mps2.z();
  return {bending_N + mass_kg * body.gravity_W_mps2.norm(),
          std::max(bending_N + hanging_N / kFallsOver, kHeldByTendons * bending_N)};
}

Measure TipMass(const BodyParameters& body) {
  const double g_mps2 = body.gravity_W_mps2.norm();
  if (!(g_mps2 > 0)) return {MassOf(body), MassOf(body)};
  const Measure force = TipForce(body);
  return {force.bound / g_mps2, force.visible / g_mps2};
}

/// Hole radius times the largest bend of every section that the tendon passes.
double BodyTravel(const RobotParameters& robot, int tendon) {
  int passed = 0;
  for (const SectionParameters& s : robot.body.sections) {
    ++passed;
    const int own = static_cast<int>(s.tendons.size());
    if (tendon < own)
      return s.tendons[static_cast<std::size_t>(tendon)].radius_m * robot.limits.max_bending_rad * passed;
    tendon -= own;
  }
  return 0;
}

Measure OfTendon(Yardstick yardstick, const RobotParameters& robot, int tendon) {
  const TendonDriveParameters& p = robot.actuation->tendons[static_cast<std::size_t>(tendon)];
  const double travel_m = BodyTravel(robot, tendon);
  const double stretch_m = robot.limits.max_tension_base_N / p.tendon.stiffness_Npm;
  const auto both = [](double value) { return Measure{value, value}; };
  switch (yardstick) {
    case Yardstick::kMotorTorque:
      return both(p.motor.torque_constant_NmpA * p.motor.nominal_current_A);
    case Yardstick::kTorqueLimit:
      return both(p.motor.torque_constant_NmpA * p.drive.current_limit_A);
    case Yardstick::kSpool:
      return both(p.spool.radius_m);
    case Yardstick::kMotorSpeed:
      return both(travel_m / robot.limits.max_bending_rad / p.SpoolTravelPerMotorRad());
    default:
      break;
  }
  const double per = yardstick == Yardstick::kMotorTravel ? p.SpoolTravelPerMotorRad() : 1;
  return {(travel_m + stretch_m) / per, travel_m * stretch_m / (travel_m + stretch_m) / per};
}

Measure MeanOfTendons(Yardstick yardstick, const RobotParameters& robot, const Place& place) {
  if (!robot.actuation || static_cast<int>(robot.actuation->tendons.size()) != robot.body.tendons())
    return {};
  if (place.tendon) return OfTendon(yardstick, robot, *place.tendon);
  Measure mean;
  const int count = robot.body.tendons();
  for (int j = 0; j < count; ++j) {
    const Measure one = OfTendon(yardstick, robot, j);
    mean.bound += one.bound / count;
    mean.visible += one.visible / count;
  }
  return mean;
}

double MeanOfSections(Yardstick yardstick, const RobotParameters& robot, const Place& place) {
  const auto of = [&](const SectionParameters& s) {
    const double bend_rad = robot.limits.max_bending_rad / s.units;
    return yardstick == Yardstick::kUnitBend ? bend_rad : s.UnitStiffness() * bend_rad;
  };
  const auto& sections = robot.body.sections;
  if (place.section) return of(sections[static_cast<std::size_t>(*place.section)]);
  double mean = 0;
  for (const SectionParameters& s : sections) mean += of(s) / static_cast<double>(sections.size());
  return mean;
}

Measure Of(Yardstick yardstick, const RobotParameters& robot, const Place& place) {
  const auto both = [](double value) { return Measure{value, value}; };
  switch (yardstick) {
    case Yardstick::kNone:
      return {1, 1};
    case Yardstick::kLength:
      return both(robot.body.length_m());
    case Yardstick::kPerLength:
      return both(1 / robot.body.length_m());
    case Yardstick::kTipForce:
      return TipForce(robot.body);
    case Yardstick::kTipMass:
      return TipMass(robot.body);
    case Yardstick::kTipStiffness:
      return both(TipForce(robot.body).bound / robot.body.length_m());
    case Yardstick::kUnitBend:
    case Yardstick::kUnitMoment:
      return both(MeanOfSections(yardstick, robot, place));
    case Yardstick::kTension:
      return both(robot.limits.max_tension_base_N);
    default:
      return MeanOfTendons(yardstick, robot, place);
  }
}

double Ratio(double value, double reference) {
  const double ratio = value / reference;
  return ratio > 0 && std::isfinite(ratio) ? ratio : 1;
}

}  // namespace

Measure OverReference(Yardstick yardstick, const RobotParameters& robot, const Place& place) {
  static const RobotParameters rig = ReferenceRig();
  if (yardstick == Yardstick::kNone) return {1, 1};
  const Measure here = Of(yardstick, robot, place), there = Of(yardstick, rig, {});
  return {Ratio(here.bound, there.bound), Ratio(here.visible, there.visible)};
}

std::string_view TextOf(Yardstick yardstick) {
  switch (yardstick) {
    case Yardstick::kNone:
      return "alike on every robot";
    case Yardstick::kLength:
      return "robot length";
    case Yardstick::kPerLength:
      return "1 / robot length";
    case Yardstick::kTipForce:
      return "EI / L^2 and weight";
    case Yardstick::kTipMass:
      return "EI / (L^2 g) and mass";
    case Yardstick::kTipStiffness:
      return "(EI / L^2 + weight) / L";
    case Yardstick::kUnitBend:
      return "largest bend a unit";
    case Yardstick::kUnitMoment:
      return "EI / l x largest bend a unit";
    case Yardstick::kTension:
      return "largest tension";
    case Yardstick::kMotorTorque:
      return "nominal torque of the motor";
    case Yardstick::kTorqueLimit:
      return "torque at the current limit";
    case Yardstick::kSpool:
      return "spool radius";
    case Yardstick::kTendonTravel:
      return "travel and stretch of the tendon";
    case Yardstick::kMotorTravel:
      return "travel and stretch of the tendon, at the motor";
    case Yardstick::kMotorSpeed:
      return "motor speed per bending rate";
  }
  return "";
}

}  // namespace tendril::sim
