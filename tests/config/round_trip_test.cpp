// Writing a configuration out and reading it back gives the same struct, bit for bit, whatever the numbers.
#include <gtest/gtest.h>

#include <bit>
#include <cstdint>
#include <random>
#include <vector>

#include "files.h"
#include "tendril/config/config.h"

namespace tendril::config {
namespace {

/// Every number of a robot as bits, in declaration order: written by hand, so that it does not share the
/// schema.
std::vector<std::uint64_t> Bits(const RobotParameters& r) {
  std::vector<std::uint64_t> bits;
  const auto put = [&](auto... values) {
    (bits.push_back(std::bit_cast<std::uint64_t>(static_cast<double>(values))), ...);
  };
  put(r.body.gravity_W_mps2.x(), r.body.gravity_W_mps2.y(), r.body.gravity_W_mps2.z(),
      r.body.sections.size());
  for (const SectionParameters& s : r.body.sections) {
    put(s.units, s.unit_length_m, s.unit_mass_kg, s.disk_inertia_xx_kgm2, s.disk_inertia_zz_kgm2,
        s.youngs_modulus_Pa, s.core_radius_m, s.bending_damping_Nms, s.tendons.size());
    for (const TendonRoute& t : s.tendons) put(t.angle_rad, t.radius_m);
  }
  put(r.limits.min_tension_N, r.limits.max_tension_base_N, r.limits.max_tension_motor_N,
      r.limits.max_bending_rad, r.actuation.has_value());
  if (!r.actuation) return bits;
  for (const TendonDriveParameters& t : r.actuation.value().tendons) {
    const MotorParameters& m = t.motor;
    put(m.torque_constant_NmpA, m.nominal_current_A, m.rotor_inertia_kgm2, m.coulomb_friction_Nm,
        m.coulomb_angle_rad, m.coulomb_damping_Nms, m.viscous_friction_Nms, m.torque_lag_s, m.torque_scale);
    put(t.drive.rated_torque_Nm, t.drive.current_limit_A, t.drive.encoder_counts_per_turn,
        t.drive.actual_torque_noise_permille);
    put(t.gear.ratio, t.gear.efficiency, t.gear.presliding_yields_rad.size());
    for (const double y : t.gear.presliding_yields_rad) put(y);
    put(t.spool.radius_m, t.tendon.stiffness_Npm, t.tendon.damping_Nspm, t.tendon.free_length_m);
    put(t.transmission.pulleys.size(), t.transmission.presliding_m, t.transmission.low_tension_N,
        t.transmission.coulomb_N);
    for (const PulleyParameters& p : t.transmission.pulleys) {
      put(static_cast<int>(p.law), p.wrap_rad, p.radius_ratio, p.alpha, p.exponent, p.entry_angle_rad);
    }
    put(static_cast<int>(t.load_cell.place), t.load_cell.gain_VpN, t.load_cell.resolution_V,
        t.load_cell.noise_N, t.load_cell.offset_N);
    put(t.node_id);
  }
  put(r.actuation->tracker.has_value());
  if (const auto& t = r.actuation->tracker)
    put(t->rate_Hz, t->position_noise_m, t->orientation_noise_rad, t->delay_s);
  return bits;
}

void ExpectRoundTrip(const RobotParameters& robot) {
  const std::string yaml = ToYaml(robot);
  RobotParameters again;
  ASSERT_NO_THROW(again = ParseRobot(yaml, "again")) << yaml;
  EXPECT_EQ(again.name, robot.name);
  EXPECT_EQ(Bits(again), Bits(robot)) << yaml;
  EXPECT_EQ(again.effects, robot.effects) << yaml;
  EXPECT_EQ(ToYaml(again), yaml);
}

TEST(RoundTrip, ShippedRobots) {
  for (const char* file : {"qi2021_90mm", "qi2021_60mm", "rig_90mm", "rig_60mm", "four_tendon_90mm",
                           "two_section", "pairs_90mm"}) {
    SCOPED_TRACE(file);
    ExpectRoundTrip(LoadRobot(ConfigPath(std::string("robots/") + file + ".yaml")));
  }
}

TEST(RoundTrip, RobotsWithUglyNumbersAndUnequalTendons) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> near(0.9, 1.1);
  const RobotParameters nominal = LoadRobot(ConfigPath("robots/two_section.yaml"));
  for (int i = 0; i < 50; ++i) {
    RobotParameters r = nominal;
    r.body.gravity_W_mps2 *= near(random);
    for (SectionParameters& s : r.body.sections) {
      for (double* x : {&s.unit_length_m, &s.unit_mass_kg, &s.disk_inertia_xx_kgm2, &s.youngs_modulus_Pa,
                        &s.core_radius_m, &s.bending_damping_Nms}) {
        *x *= near(random);
      }
      s.disk_inertia_zz_kgm2 = s.disk_inertia_xx_kgm2 * 1.7 * near(random);
      for (TendonRoute& t : s.tendons) t.angle_rad *= near(random), t.radius_m *= near(random);
    }
    for (TendonDriveParameters& t : r.actuation.value().tendons) {
      if (near(random) < 1) continue;  // some tendons stay like the first, some do not
      t.motor.rotor_inertia_kgm2 *= near(random);
      t.motor.torque_lag_s *= near(random);
      t.gear.presliding_yields_rad = {0.002 * near(random), 0.003 * near(random), 0.004};
      t.tendon.stiffness_Npm *= near(random);
      t.transmission.pulleys.push_back(t.transmission.pulleys[0]);
      t.transmission.pulleys[0].alpha *= near(random);
      t.transmission.pulleys[1].law = CapstanLaw::kLocal;
      t.load_cell.place = near(random) < 1 ? LoadCellPlace::kRobotSide : LoadCellPlace::kMotorSide;
      // Optional keys, left out by some: a tendon without one must not get that of the common block.
      if (near(random) < 1) t.motor.torque_scale = near(random);
      if (near(random) < 1) t.load_cell.offset_N = near(random) - 1;
      if (near(random) < 1) t.transmission.coulomb_N = 0.1 * near(random);
    }
    if (near(random) < 1) r.actuation.value().tracker.reset();
    if (near(random) < 1) {
      r.effects = {{"backlash", "tendon:2", {{"rad", 0.1 * near(random)}}},
                   {"tip_force", "all", {{"x_N", near(random) - 1}, {"z_N", 1e-3 * near(random)}}}};
    }
    ExpectRoundTrip(r);
    if (HasFailure()) return;
  }
}

TEST(RoundTrip, NoPulleyAndNoLoadCell) {
  RobotParameters r = LoadRobot(ConfigPath("robots/rig_60mm.yaml"));
  r.actuation.value().tendons[1].transmission.pulleys.clear();
  r.actuation.value().tendons[2].load_cell = {};
  ExpectRoundTrip(r);
}

TEST(RoundTrip, Daemons) {
  for (const char* file :
       {"tendrild.yaml", "tendrild_four_tendon.yaml", "tendrild_two_section.yaml", "tendrild_pairs.yaml"}) {
    SCOPED_TRACE(file);
    const DaemonParameters a = LoadDaemon(ConfigPath(file));
    const DaemonParameters b = ParseDaemon(ToYaml(a), "again");
    EXPECT_EQ(b.robot_file, a.robot_file);
    EXPECT_EQ(b.controller.pretension_settle_s, a.controller.pretension_settle_s);
    EXPECT_EQ(b.controller.trajectory.max_jerk_radps3, a.controller.trajectory.max_jerk_radps3);
    EXPECT_EQ(b.bus.cycle_ns, a.bus.cycle_ns);
    EXPECT_EQ(b.bus.identity.product_codes, a.bus.identity.product_codes);
    EXPECT_EQ(b.bus.identity.max_revision, a.bus.identity.max_revision);
    EXPECT_EQ(b.bus.nodes.size(), a.bus.nodes.size());
    EXPECT_EQ(b.lcm.url, a.lcm.url);
    EXPECT_EQ(ToYaml(b), ToYaml(a));
  }
}

}  // namespace
}  // namespace tendril::config
