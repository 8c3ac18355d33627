#include "mjcf_motors.h"

#include <fmt/ranges.h>

#include <algorithm>

#include "tendril/model/capstan.h"

namespace tendril::exchange {
namespace {

/// Constant friction with the width of the real one's hysteresis at a tension [N].
double GearFriction_N(const GearParameters& gear, double tension_N) {
  return tension_N * (1 / gear.efficiency - gear.efficiency) / 2;
}
double PulleyFriction_N(const model::CapstanTable& table, const TransmissionParameters& transmission,
                        double tension_N) {
  return (table.Pull(tension_N) - table.Release(tension_N)) / 2 +
         transmission.coulomb_N * std::min(1.0, tension_N / transmission.low_tension_N);
}

}  // namespace

std::vector<SpoolSlide> SpoolSlides(const RobotParameters& robot, double friction_at_N,
                                    const std::vector<double>& straight_m) {
  const auto& tendons = robot.actuation->tendons;
  const auto tables =
      model::MakeCapstanTables(tendons, std::max(friction_at_N, robot.limits.max_tension_base_N));
  std::vector<SpoolSlide> slides;
  for (std::size_t j = 0; j < tendons.size(); ++j) {
    const TendonDriveParameters& t = tendons[j];
    const double per_m = 1 / t.SpoolTravelPerMotorRad(), pretension_N = robot.limits.min_tension_N;
    // Its own length straight above the spool must never be paid out.
    const double depth_m = std::max(t.tendon.free_length_m, robot.body.length_m());
    slides.push_back(
        {.number = static_cast<int>(j) + 1,
         .newton_per_Nm = per_m,
         .depth_m = depth_m,
         .reflected_kg = t.motor.rotor_inertia_kgm2 * per_m * per_m,
         .damping_Nspm = t.motor.viscous_friction_Nms * per_m * per_m,
         .friction_N = t.motor.coulomb_friction_Nm * per_m + GearFriction_N(t.gear, friction_at_N),
         .tendon_stiffness_Npm = t.tendon.stiffness_Npm,
         .tendon_damping_Nspm = t.tendon.damping_Nspm,
         .slack_length_m = depth_m + straight_m[j] - pretension_N / t.tendon.stiffness_Npm,
         .path_friction_N = PulleyFriction_N(*tables[j], t.transmission, friction_at_N),
         .max_torque_Nm = t.motor.torque_constant_NmpA * t.drive.current_limit_A,
         .torque_scale = t.motor.torque_scale,
         .lag_s = t.motor.torque_lag_s,
         .holding_torque_Nm = pretension_N / per_m / t.motor.torque_scale});
  }
  return slides;
}

void AddSpoolBody(Xml& xml, const SpoolSlide& s, const Eigen::Vector3d& hole_m) {
  xml.Open("<body name=\"spool{}\" pos=\"{:.10g} {:.10g} {:.10g}\" gravcomp=\"1\">", s.number, hole_m.x(),
           hole_m.y(), -s.depth_m);
  xml.Line(
      "<joint name=\"spool{}\" type=\"slide\" axis=\"0 0 -1\" damping=\"{:.10g}\" frictionloss=\"{:.10g}\"/>",
      s.number, s.damping_Nspm, s.friction_N);
  // A mass and no armature, which MuJoCo would leave out of what makes friction stiff.
  xml.Line("<inertial pos=\"0 0 0\" mass=\"{:.10g}\" diaginertia=\"1 1 1\"/>", s.reflected_kg);
  xml.Line("<site name=\"tendon{}_spool\"/>", s.number);
  xml.Close("body");
}

void AddMotor(Xml& xml, const SpoolSlide& s) {
  const std::string lag =
      s.lag_s > 0 ? fmt::format("dyntype=\"filterexact\" dynprm=\"{:.10g}\" ", s.lag_s) : std::string();
  xml.Line(
      "<general name=\"motor{0}\" joint=\"spool{0}\" {1}gear=\"{2:.10g}\" gainprm=\"{3:.10g}\" "
      "ctrlrange=\"{4:.10g} {5:.10g}\"/>",
      s.number, lag, s.newton_per_Nm, s.torque_scale, -s.max_torque_Nm, s.max_torque_Nm);
}

std::vector<std::string> LeftOutOfMotors(const std::vector<SpoolSlide>& slides, double friction_at_N) {
  std::vector<double> pulleys_N, spools_N;
  for (const SpoolSlide& s : slides) {
    pulleys_N.push_back(s.path_friction_N);
    spools_N.push_back(s.friction_N);
  }
  return {fmt::format("Friction that grows with the tension: it is constant, as wide as at {:g} N at the "
                      "base. Pulleys: {:.3g} N "
                      "a tendon; motors and gears: {:.3g} N.",
                      friction_at_N, fmt::join(pulleys_N, ", "), fmt::join(spools_N, ", ")),
          "Pre-sliding: the friction of pulleys, gears and motors reverses at once.",
          "Sticking: a tendon that friction holds creeps, by some hundredths of a millimetre a second.",
          "A slack tendon has no force here either, but keeps its damping."};
}

}  // namespace tendril::exchange
