// The shipped files load, fit together and hold the numbers of the paper and of the nominal rig. The expected
// values are typed in here again, from the paper's table and the rig's data sheet, not taken from the files.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <numbers>

#include "files.h"
#include "tendril/config/config.h"

namespace tendril::config {
namespace {

using ::testing::ElementsAre;

TEST(Shipped, EveryFileLoads) {
  int files = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(ConfigPath(""))) {
    if (entry.path().extension() != ".yaml") continue;
    if (entry.path().stem().string().ends_with("_map"))
      continue;  // of foreign tables, held by the tests of gap
    SCOPED_TRACE(entry.path());
    ++files;
    if (KindOf(entry.path()) == "scenario") {
      EXPECT_FALSE(LoadScenario(entry.path()).empty());
    } else if (KindOf(entry.path()) == "robot") {
      const RobotParameters robot = LoadRobot(entry.path());
      EXPECT_EQ(robot.name, entry.path().stem());
    } else {
      const DaemonParameters daemon = LoadDaemon(entry.path());
      EXPECT_NO_THROW(CheckTogether(daemon, LoadRobot(daemon.robot_file), entry.path()));
    }
  }
  EXPECT_GE(files, 9);
}

void ExpectPaperSection(const SectionParameters& s, double unit_length_m) {
  EXPECT_EQ(s.units, 4);
  EXPECT_EQ(s.unit_length_m, unit_length_m);
  EXPECT_EQ(s.unit_mass_kg, 2.5e-3);
  EXPECT_NEAR(s.disk_inertia_xx_kgm2, 1.5625e-8, 1e-22);
  EXPECT_NEAR(s.disk_inertia_zz_kgm2, 3.125e-8, 1e-22);
  EXPECT_EQ(s.youngs_modulus_Pa, 2.3e10);
  EXPECT_EQ(s.core_radius_m, 0.5e-3);
  // Turn a third at a time.
  ASSERT_EQ(s.tendons.size(), 3u);
  for (int j = 0; j < 3; ++j) {
    EXPECT_DOUBLE_EQ(s.tendons[static_cast<std::size_t>(j)].angle_rad, 2 * std::numbers::pi * j / 3);
    EXPECT_EQ(s.tendons[static_cast<std::size_t>(j)].radius_m, 4e-3);
  }
}

TEST(Shipped, PaperRobot) {
  for (const auto& [file, unit_m, total_m] : {std::tuple{"robots/qi2021_90mm.yaml", 0.0225, 0.09},
                                              std::tuple{"robots/qi2021_60mm.yaml", 0.015, 0.06}}) {
    SCOPED_TRACE(file);
    const RobotParameters robot = LoadRobot(ConfigPath(file));
    ASSERT_EQ(robot.body.sections.size(), 1u);
    ExpectPaperSection(robot.body.sections[0], unit_m);
    EXPECT_EQ(robot.body.sections[0].bending_damping_Nms, 0);
    EXPECT_DOUBLE_EQ(robot.body.length_m(), total_m);
    EXPECT_EQ(robot.body.gravity_W_mps2, Eigen::Vector3d(0, 0, -9.81));
    EXPECT_FALSE(robot.actuation.has_value());
  }
}

void ExpectRigActuation(const RobotParameters& robot) {
  EXPECT_EQ(robot.limits.min_tension_N, 0.3);
  EXPECT_EQ(robot.limits.max_tension_base_N, 8);
  EXPECT_EQ(robot.limits.max_tension_motor_N, 10);
  EXPECT_EQ(robot.limits.max_bending_rad, 2.6);
  ASSERT_TRUE(robot.actuation);
  ASSERT_EQ(static_cast<int>(robot.actuation->tendons.size()), robot.body.tendons());
  int node = 0;
  for (const TendonDriveParameters& t : robot.actuation->tendons) {
    EXPECT_EQ(t.motor.torque_constant_NmpA, 0.0196);
    EXPECT_EQ(t.motor.nominal_current_A, 0.36);
    EXPECT_EQ(t.motor.rotor_inertia_kgm2, 4.1e-7);
    EXPECT_EQ(t.motor.coulomb_friction_Nm, 2e-4);
    EXPECT_EQ(t.motor.coulomb_angle_rad, 4e-3);
    EXPECT_EQ(t.motor.coulomb_damping_Nms, 1.6e-8);
    EXPECT_EQ(t.motor.viscous_friction_Nms, 1e-7);
    EXPECT_EQ(t.motor.torque_lag_s, 5e-4);
    EXPECT_EQ(t.drive.rated_torque_Nm, 7056e-6);
    EXPECT_EQ(t.drive.current_limit_A, 0.36);
    EXPECT_EQ(t.drive.encoder_counts_per_turn, 2048);
    EXPECT_EQ(t.drive.actual_torque_noise_permille, 0.3);
    EXPECT_EQ(t.gear.ratio, 19);
    EXPECT_EQ(t.gear.efficiency, 0.84);
    EXPECT_THAT(t.gear.presliding_yields_rad, ElementsAre(0.002, 0.004));
    EXPECT_EQ(t.spool.radius_m, 8e-3);
    EXPECT_EQ(t.tendon.free_length_m, 0.4);
    EXPECT_EQ(t.tendon.stiffness_Npm, 30e3);
    EXPECT_EQ(t.tendon.damping_Nspm, 20);
    ASSERT_EQ(t.transmission.pulleys.size(), 1u);
    const PulleyParameters& p = t.transmission.pulleys[0];
    EXPECT_EQ(p.law, CapstanLaw::kCumulative);
    EXPECT_EQ(p.wrap_rad, std::numbers::pi);
    EXPECT_EQ(p.radius_ratio, 10);
    EXPECT_EQ(p.alpha, 0.466);
    EXPECT_EQ(p.exponent, 0.67);
    EXPECT_EQ(p.entry_angle_rad, 0);
    EXPECT_EQ(t.transmission.presliding_m, 5e-5);
    EXPECT_EQ(t.transmission.low_tension_N, 0.05);
    EXPECT_EQ(t.load_cell.place, LoadCellPlace::kMotorSide);
    EXPECT_EQ(t.load_cell.gain_VpN, 0.2);
    EXPECT_EQ(t.load_cell.resolution_V, 1e-3);
    EXPECT_EQ(t.load_cell.noise_N, 5e-3);
    EXPECT_EQ(t.node_id, ++node);
  }
  ASSERT_TRUE(robot.actuation->tracker);
  EXPECT_EQ(robot.actuation->tracker->rate_Hz, 100);
  EXPECT_EQ(robot.actuation->tracker->position_noise_m, 5e-5);
  EXPECT_EQ(robot.actuation->tracker->orientation_noise_rad, 5e-4);
  EXPECT_EQ(robot.actuation->tracker->delay_s, 0);
}

TEST(Shipped, NominalRig) {
  for (const auto& [file, unit_m] :
       {std::pair{"robots/rig_90mm.yaml", 0.0225}, std::pair{"robots/rig_60mm.yaml", 0.015}}) {
    SCOPED_TRACE(file);
    const RobotParameters robot = LoadRobot(ConfigPath(file));
    ASSERT_EQ(robot.body.sections.size(), 1u);
    ExpectPaperSection(robot.body.sections[0], unit_m);
    EXPECT_EQ(robot.body.sections[0].bending_damping_Nms, 2e-4);
    ExpectRigActuation(robot);
  }
}

// What the rig was sized for: 1 per mille is 14.1 mN of tendon tension, full torque 13.7 N after the motor's
// friction.
TEST(Shipped, NominalRigIsStrongEnough) {
  const RobotParameters robot = LoadRobot(ConfigPath("robots/rig_90mm.yaml"));
  for (const TendonDriveParameters& t : robot.actuation->tendons) {
    const double tension_per_torque = t.gear.efficiency / t.SpoolTravelPerMotorRad();
    EXPECT_NEAR(t.drive.rated_torque_Nm / 1000 * tension_per_torque, 14.1e-3, 0.05e-3);
    EXPECT_NEAR((t.drive.rated_torque_Nm - t.motor.coulomb_friction_Nm) * tension_per_torque, 13.7, 0.05);
  }
}

TEST(Shipped, FourTendons) {
  const RobotParameters robot = LoadRobot(ConfigPath("robots/four_tendon_90mm.yaml"));
  ExpectRigActuation(robot);
  ASSERT_EQ(robot.body.tendons(), 4);
  for (std::size_t j = 0; j < 4; ++j) {
    EXPECT_DOUBLE_EQ(robot.body.sections[0].tendons[j].angle_rad,
                     std::numbers::pi / 2 * static_cast<double>(j));
  }
  EXPECT_DOUBLE_EQ(robot.body.length_m(), 0.09);
}

TEST(Shipped, TwoSections) {
  const RobotParameters robot = LoadRobot(ConfigPath("robots/two_section.yaml"));
  ExpectRigActuation(robot);
  ASSERT_EQ(robot.body.sections.size(), 2u);
  ASSERT_EQ(robot.body.tendons(), 6);
  for (std::size_t j = 0; j < 3; ++j) {
    EXPECT_NEAR(robot.body.sections[1].tendons[j].angle_rad - robot.body.sections[0].tendons[j].angle_rad,
                std::numbers::pi / 3, 1e-15);
  }
}

TEST(Shipped, Daemon) {
  const DaemonParameters d = LoadDaemon(ConfigPath("tendrild.yaml"));
  EXPECT_EQ(std::filesystem::path(d.robot_file),
            std::filesystem::path(ConfigPath("robots/rig_60mm.yaml")).lexically_normal());
  EXPECT_EQ(d.controller.law, ControlLaw::kPaper);
  EXPECT_FALSE(d.controller.tension_feedback);
  EXPECT_FALSE(d.controller.shape_feedback);
  EXPECT_FALSE(d.controller.tip_feedback);
  EXPECT_TRUE(d.controller.trajectory.look_ahead);
  EXPECT_TRUE(d.controller.capstan_compensation);
  EXPECT_EQ(d.bus.interface, "can0");
  EXPECT_EQ(d.bus.bitrate_bps, 1000000);
  EXPECT_EQ(d.bus.cycle_ns, kNsPerMs);
  EXPECT_EQ(d.bus.abort_connection_option, 2);
  EXPECT_EQ(d.bus.max_load, 0.8);
  EXPECT_EQ(d.bus.identity.vendor_id, 251u);
  EXPECT_THAT(d.bus.identity.product_codes, ElementsAre(0x60500000u, 0x61500000u, 0x65510000u, 0x65520000u));
  ASSERT_EQ(d.bus.nodes.size(), 3u);
  for (int j = 1; j <= 3; ++j) {
    EXPECT_EQ(d.bus.nodes[static_cast<std::size_t>(j - 1)].tendon, j);
    EXPECT_EQ(d.bus.nodes[static_cast<std::size_t>(j - 1)].node_id, j);
  }
  EXPECT_EQ(d.realtime.priority, 80);
  EXPECT_EQ(d.realtime.cpu, -1);
  EXPECT_FALSE(d.realtime.required);
  EXPECT_EQ(d.lcm.url, "udpm://239.255.76.67:7667?ttl=0");
  EXPECT_EQ(d.lcm.channel_prefix, "TENDRIL");
  // Four drives or more do not fit into 1 ms.
  for (const char* file : {"tendrild_four_tendon.yaml", "tendrild_two_section.yaml"}) {
    EXPECT_EQ(LoadDaemon(ConfigPath(file)).bus.cycle_ns, 2 * kNsPerMs) << file;
  }
}

}  // namespace
}  // namespace tendril::config
