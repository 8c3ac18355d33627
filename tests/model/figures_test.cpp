// The figures against closed forms: a slender rod of uniform mass, fixed at one end, cut into many units.
#include "tendril/model/figures.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace tendril::model {
namespace {

constexpr int kUnits = 32;
constexpr double kLength_m = 0.2, kMass_kg = 0.004, kHole_m = 0.005;

/// A rod with four tendons of almost no tension, stiff enough to sag by little.
RobotParameters Rod() {
  SectionParameters s{.units = kUnits,
                      .unit_length_m = kLength_m / kUnits,
                      .unit_mass_kg = kMass_kg / kUnits,
                      .disk_inertia_xx_kgm2 = 1e-14,
                      .disk_inertia_zz_kgm2 = 2e-14,
                      .youngs_modulus_Pa = 2e11,
                      .core_radius_m = 0.0005,
                      .bending_damping_Nms = 0,
                      .tendons = {}};
  for (int i = 0; i < 4; ++i) s.tendons.push_back({i * std::numbers::pi / 2, kHole_m});
  RobotParameters robot;
  robot.name = "rod";
  robot.body.sections = {s};
  robot.body.gravity_W_mps2 = {0, 0, 0};
  robot.limits = {
      .min_tension_N = 1e-3, .max_tension_base_N = 50, .max_tension_motor_N = 60, .max_bending_rad = 1};
  return robot;
}

double Stiffness_Nm2() { return 2e11 * std::numbers::pi * std::pow(0.0005, 4) / 4; }

TEST(Figures, BendingStiffnessIsThatOfTheRod) {
  const SectionFigures s = FiguresOf(Rod()).sections.at(0);
  EXPECT_NEAR(s.bending_stiffness_Nm2, Stiffness_Nm2(), 1e-12);
  EXPECT_NEAR(s.stiffness_Nm, Stiffness_Nm2() / kLength_m, 1e-12);
}

// q L^4 / (8 E I); with masses at the units' ends their sum is larger by the share 4/3 of a unit in L.
TEST(Figures, SagIsThatOfACantilever) {
  RobotParameters robot = Rod();
  const double closed_m = kMass_kg * 9.81 * std::pow(kLength_m, 3) / (8 * Stiffness_Nm2());
  const Figures figures = FiguresOf(robot);
  EXPECT_NEAR(*figures.sag_level_m / closed_m, 1, 0.05);
  EXPECT_GT(*figures.sag_level_m / closed_m, 1.005);
  EXPECT_NEAR(*figures.sag_mounted_m, 0, 1e-12);
  // Mounted level, it is the same; twice the gravity, twice the sag.
  robot.body.gravity_W_mps2 = {-19.62, 0, 0};
  EXPECT_NEAR(*FiguresOf(robot).sag_mounted_m / *figures.sag_level_m, 2, 0.01);
}

// f = 1.8751^2 / (2 pi L^2) sqrt(E I / (m / L)), in both planes, and 4.6941 for the second.
TEST(Figures, FrequenciesAreThoseOfACantilever) {
  const std::vector<double> f_Hz = FiguresOf(Rod()).frequencies_Hz;
  ASSERT_EQ(f_Hz.size(), 2U * kUnits);
  const double unit_Hz =
      std::sqrt(Stiffness_Nm2() * kLength_m / kMass_kg) / (2 * std::numbers::pi * kLength_m * kLength_m);
  EXPECT_NEAR(f_Hz[0] / (1.87510 * 1.87510 * unit_Hz), 1, 0.04);
  EXPECT_NEAR(f_Hz[1], f_Hz[0], 1e-6 * f_Hz[0]);
  EXPECT_NEAR(f_Hz[2] / (4.69409 * 4.69409 * unit_Hz), 1, 0.05);
}

// The moment E I theta / L of one tendon at its hole, the opposite one at the minimum.
TEST(Figures, FullBendTakesTheMomentOverTheHole) {
  const RobotParameters robot = Rod();
  const SectionFigures s = FiguresOf(robot).sections.at(0);
  ASSERT_TRUE(s.full_bend_base_N);
  EXPECT_NEAR(*s.full_bend_base_N, Stiffness_Nm2() * 1 / kLength_m / kHole_m, 0.01 * *s.full_bend_base_N);
  EXPECT_FALSE(s.full_bend_torque_Nm);
}

// Without pulleys the motor's pull is the base's; the torque is that at the spool, through gear and its
// losses.
TEST(Figures, MotorTorqueIsThatOfTheSpool) {
  RobotParameters robot = Rod();
  TendonDriveParameters t;
  t.motor.torque_constant_NmpA = 0.02;
  t.motor.coulomb_friction_Nm = 1e-4;
  t.drive.rated_torque_Nm = 0.01;
  t.gear = {.ratio = 20, .efficiency = 0.8, .presliding_yields_rad = {0.01}};
  t.spool.radius_m = 0.01;
  robot.actuation.emplace().tendons.assign(4, t);
  const SectionFigures s = FiguresOf(robot).sections.at(0);
  EXPECT_DOUBLE_EQ(*s.full_bend_motor_N, *s.full_bend_base_N);
  EXPECT_NEAR(*s.full_bend_torque_Nm, *s.full_bend_base_N * 0.01 / 20 / 0.8 + 1e-4, 1e-12);
  EXPECT_DOUBLE_EQ(*s.full_bend_rated_share, *s.full_bend_torque_Nm / 0.01);
}

TEST(Figures, WeightAndPretension) {
  RobotParameters robot = Rod();
  robot.body.gravity_W_mps2 = {0, 0, -9.81};
  robot.body.tip_payload_kg = 0.001;
  const Figures figures = FiguresOf(robot);
  EXPECT_NEAR(figures.weight_N, 0.005 * 9.81, 1e-12);
  EXPECT_NEAR(figures.pretension_N, 0.004, 1e-12);
}

// Greenhill: an upright rod buckles beyond m g L^2 of 7.84 E I.
TEST(Figures, WhatBucklesHasNeitherSagNorFrequencies) {
  for (const double load : {7.0, 8.6}) {
    RobotParameters robot = Rod();
    robot.body.gravity_W_mps2 = {0, 0, -load * Stiffness_Nm2() / (kMass_kg * kLength_m * kLength_m)};
    const Figures figures = FiguresOf(robot);
    EXPECT_EQ(figures.frequencies_Hz.empty(), load > 7.84) << load;
    EXPECT_EQ(figures.sag_mounted_m.has_value(), load < 7.84) << load;
  }
}

TEST(Figures, OneTendonHoldsItsOwnDirection) {
  RobotParameters robot = Rod();
  robot.body.sections[0].tendons.resize(1);
  EXPECT_TRUE(FiguresOf(robot).sections.at(0).full_bend_base_N);
}

}  // namespace
}  // namespace tendril::model
