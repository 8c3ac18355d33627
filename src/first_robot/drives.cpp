// One drivetrain for all tendons; limits and the largest bend are suggested by what it can pull.
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "parts.h"
#include "tendril/control/controller.h"
#include "tendril/control/reach.h"
#include "tendril/model/body.h"

namespace tendril::first_robot {
namespace {

using config::Range;

void AskMotor(Asker& ask, TendonDriveParameters& t) {
  MotorParameters& motor = t.motor;
  const double rig_rated_Nm = t.drive.rated_torque_Nm;
  motor.torque_constant_NmpA = ask.Number("torque_constant_NmpA", motor.torque_constant_NmpA);
  motor.nominal_current_A = ask.Number("nominal_current_A", motor.nominal_current_A);
  motor.rotor_inertia_kgm2 = ask.Number("rotor_inertia_kgm2", motor.rotor_inertia_kgm2);
  const Range rated_Nm = ask.RangeOf("actuation.drive.rated_torque_Nm");
  t.drive.rated_torque_Nm =
      std::clamp(motor.torque_constant_NmpA * motor.nominal_current_A, rated_Nm.min, rated_Nm.max);
  t.drive.current_limit_A = ask.Number("current_limit_A", motor.nominal_current_A);
  t.drive.encoder_counts_per_turn = ask.Integer("encoder_counts_per_turn", t.drive.encoder_counts_per_turn);
  // Friction in proportion to the torque: the rig's share.
  const double larger = t.drive.rated_torque_Nm / rig_rated_Nm;
  motor.coulomb_friction_Nm = std::min(1., motor.coulomb_friction_Nm * larger);
  motor.coulomb_damping_Nms = std::min(1e-2, motor.coulomb_damping_Nms * larger);
  motor.viscous_friction_Nms = std::min(1e-2, motor.viscous_friction_Nms * larger);
}

void AskTransmission(Asker& ask, TendonDriveParameters& t) {
  t.gear.ratio = ask.Number("gear_ratio", t.gear.ratio);
  t.gear.efficiency = ask.Number("gear_efficiency", t.gear.efficiency);
  t.spool.radius_m = ask.Number("spool_radius_m", t.spool.radius_m);
  t.tendon.stiffness_Npm = ask.Number("tendon_stiffness_Npm", t.tendon.stiffness_Npm);
  t.tendon.free_length_m = ask.Number("free_length_m", t.tendon.free_length_m);
  t.transmission.pulleys.front().wrap_rad = ask.Number("wrap_rad", t.transmission.pulleys.front().wrap_rad);
  if (t.transmission.pulleys.front().wrap_rad == 0) t.transmission.pulleys.clear();
}

/// What the motor pulls at its rated torque bounds the suggestions; the rig's limits are its shares of that.
void AskLimits(Asker& ask, const TendonDriveParameters& t, LimitParameters& limits) {
  const double rated_N = t.drive.rated_torque_Nm * t.gear.efficiency / t.SpoolTravelPerMotorRad();
  limits.min_tension_N = ask.Number("min_tension_N", 0.021 * rated_N);
  const double above_N = 1.01 * limits.min_tension_N;
  limits.max_tension_motor_N =
      ask.Number("max_tension_motor_N", 0.71 * rated_N, {above_N, std::numeric_limits<double>::max()});
  limits.max_tension_base_N = ask.Number("max_tension_base_N", 0.8 * limits.max_tension_motor_N,
                                         {above_N, limits.max_tension_motor_N});
}

void AskSensors(Asker& ask, ActuationParameters& actuation, TendonDriveParameters& t,
                const LimitParameters& limits) {
  constexpr double kInput_V = 10, kRigMotor_N = 10;
  const std::string place = ask.Choice("load_cell", "motor_side");
  t.load_cell.place = place == "none"         ? LoadCellPlace::kNone
                      : place == "robot_side" ? LoadCellPlace::kRobotSide
                                              : LoadCellPlace::kMotorSide;
  const double larger = limits.max_tension_motor_N / kRigMotor_N;
  if (t.load_cell.place == LoadCellPlace::kNone) {
    t.load_cell.gain_VpN = t.load_cell.resolution_V = t.load_cell.noise_N = 0;
  } else {
    t.load_cell.gain_VpN = ask.Number("load_cell_gain_VpN", t.load_cell.gain_VpN / larger,
                                      {0, 0.999 * kInput_V / limits.max_tension_motor_N});
    t.load_cell.noise_N = std::min(100., t.load_cell.noise_N * larger);
  }
  t.transmission.low_tension_N = std::min(t.transmission.low_tension_N, limits.min_tension_N / 6);
  const double rate_Hz = ask.NumberOrNone("tracker_Hz", actuation.tracker->rate_Hz);
  if (rate_Hz > 0) {
    actuation.tracker->rate_Hz = rate_Hz;
  } else {
    actuation.tracker.reset();
  }
}

/// Suggested: the rig's bend, unless disks touch or the tendons cannot hold it.
void AskBend(Asker& ask, RobotParameters& robot) {
  double touch_rad = std::numeric_limits<double>::max();
  for (const SectionParameters& s : robot.body.sections)
    touch_rad = std::min(touch_rad, s.units * s.unit_length_m / s.tendons.front().radius_m);
  LimitParameters& limits = robot.limits;
  limits.max_bending_rad = std::min(limits.max_bending_rad, 0.8 * touch_rad);
  const model::Body body(robot.body);
  const double held_rad =
      control::Reach(robot, body, control::CommandedLimits(limits), 0, true).holdable_rad();
  const double usual_rad = held_rad > 0 ? std::min(limits.max_bending_rad, held_rad) : limits.max_bending_rad;
  limits.max_bending_rad = ask.Number("max_bending_rad", usual_rad, {0, 0.999 * touch_rad});
}

}  // namespace

void AskDrives(Asker& ask, NewRobot& made) {
  RobotParameters& robot = made.robot;
  TendonDriveParameters t = robot.actuation->tendons.front();
  AskMotor(ask, t);
  AskTransmission(ask, t);
  AskLimits(ask, t, robot.limits);
  AskSensors(ask, *robot.actuation, t, robot.limits);
  robot.actuation->tendons.assign(static_cast<std::size_t>(robot.body.tendons()), t);
  AskBend(ask, robot);
  robot.uncertain.insert(ask.uncertain().begin(), ask.uncertain().end());
}

}  // namespace tendril::first_robot
