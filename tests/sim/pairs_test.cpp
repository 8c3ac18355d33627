// Antagonistic pairs in the plant: one shaft between two springs, its energy, and its rest against the
// statics.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "support/rig_file.h"
#include "tendril/model/statics.h"
#include "tendril/model/tendon_pairs.h"
#include "tendril/sim/effects.h"
#include "tendril/sim/plant.h"

namespace tendril::sim {
namespace {

using test::Rig;

/// Without friction, losses and damping.
RobotParameters Ideal() {
  RobotParameters robot = Rig("pairs_90mm");
  robot.body.sections[0].bending_damping_Nms = 0;
  for (TendonDriveParameters& t : robot.actuation->tendons) {
    t.motor.coulomb_friction_Nm = t.motor.coulomb_damping_Nms = t.motor.viscous_friction_Nms = 0;
    t.gear.efficiency = 1;
    t.tendon.damping_Nspm = 0;
    t.transmission.pulleys.clear();
  }
  return robot;
}

void Turn(Plant& plant, const Eigen::Vector2d& torque_Nm, int milliseconds) {
  plant.SetTorque(Eigen::Vector4d(torque_Nm[0], torque_Nm[1], 0, 0));
  for (int i = 0; i < milliseconds; ++i) plant.Advance(kNsPerMs);
}

TEST(PlantPairs, StayStraightAtTheirPretensionWithoutTorque) {
  Plant plant(Rig("pairs_90mm"));
  for (int i = 0; i < 500; ++i) plant.Advance(kNsPerMs);
  for (const TendonState& t : plant.tendon()) {
    EXPECT_NEAR(t.tension_motor_N, 4, 1e-3);
    EXPECT_NEAR(t.motor_torque_Nm, 0, 1e-12);
    EXPECT_NEAR(t.motor_angle_rad, 0, 1e-4);
  }
  EXPECT_LT(plant.q().norm(), 1e-6);
}

TEST(PlantPairs, TurnOneShaftAndShowItTwice) {
  Plant plant(Rig("pairs_90mm"));
  Turn(plant, {0.0030, -0.0020}, 300);
  const std::vector<TendonSensors> read = plant.ReadSensors();
  for (int j = 0; j < 2; ++j) {
    const auto first = static_cast<std::size_t>(j), second = first + 2;
    EXPECT_EQ(plant.tendon()[second].motor_angle_rad, -plant.tendon()[first].motor_angle_rad);
    EXPECT_EQ(plant.tendon()[second].motor_torque_Nm, -plant.tendon()[first].motor_torque_Nm);
    EXPECT_NEAR(read[second].encoder_counts, -read[first].encoder_counts, 1);
    EXPECT_NEAR(read[second].torque_Nm, -read[first].torque_Nm, 2e-5);
  }
  EXPECT_GT(plant.tendon()[0].tension_base_N, 5);
  EXPECT_LT(plant.tendon()[2].tension_base_N, 3);
  EXPECT_GT(plant.TipPose().p_WA.x(), 0.01);
  EXPECT_LT(plant.TipPose().p_WA.y(), 0);
}

// The shaft is at rest where the tensions differ by its torque, the springs give each tension, and the body
// is in the equilibrium of all four.
TEST(PlantPairs, RestWhereSpringsTorqueAndBodyBalance) {
  RobotParameters robot = Ideal();
  robot.body.sections[0].bending_damping_Nms = 2e-4;
  for (TendonDriveParameters& t : robot.actuation->tendons) t.motor.viscous_friction_Nms = 1e-6;
  Plant plant(robot);
  const double travel = robot.actuation->tendons[0].SpoolTravelPerMotorRad();
  const Eigen::Vector2d torque_Nm(3.0 * travel, 2.0 * travel);
  Turn(plant, torque_Nm, 20000);
  TendonVector shortening_m(4), tension_N(4);
  for (int j = 0; j < 4; ++j) {
    const TendonState& t = plant.tendon()[static_cast<std::size_t>(j)];
    EXPECT_NEAR(t.motor_velocity_radps, 0, 1e-6);
    shortening_m[j] = t.body_shortening_m;
    tension_N[j] = t.tension_base_N;
  }
  EXPECT_NEAR(tension_N[0] - tension_N[2], 3, 1e-6);
  EXPECT_NEAR(tension_N[1] - tension_N[3], 2, 1e-6);
  TendonVector taken_N = tension_N;
  EXPECT_FALSE(model::TendonPairs(robot).Share(shortening_m, 100, taken_N));
  EXPECT_LT((taken_N - tension_N).cwiseAbs().maxCoeff(), 1e-6);
  const model::Equilibrium still = model::SolveStatics(plant.body(), tension_N, {});
  ASSERT_EQ(still.result, model::StaticsResult::kConverged);
  EXPECT_LT((plant.q() - still.q).cwiseAbs().maxCoeff(), 1e-6);
}

// Rotors, springs and body keep what the motors' work brought in.
TEST(PlantPairs, KeepTheirEnergyWhereNothingTakesIt) {
  const RobotParameters robot = Ideal();
  Plant plant(robot, {.relative_tolerance = 1e-10, .absolute_tolerance = 1e-11});
  model::Body::Workspace workspace(plant.body());
  const TendonDriveParameters& p = robot.actuation->tendons[0];
  const double k = p.tendon.stiffness_Npm;
  const auto energy = [&] {
    double sum = plant.body().EnergyOf(plant.q(), plant.dq(), workspace).total();
    for (std::size_t j = 0; j < 4; ++j) {
      const TendonState& t = plant.tendon()[j];
      const double stretch_m = std::max(0.0, t.spool_pull_m - t.body_shortening_m + 4 / k);
      sum += 0.5 * k * stretch_m * stretch_m;
      if (j < 2) sum += 0.5 * p.motor.rotor_inertia_kgm2 * t.motor_velocity_radps * t.motor_velocity_radps;
    }
    return sum;
  };
  const double start = energy();
  double work = 0, last = 0, most = 0;
  constexpr double kStep_s = 20e-6;
  for (int i = 0; i < 10000; ++i) {
    const double t_s = i * kStep_s;
    if (i % 50 == 0) {
      const double pull = 1.5e-3 * std::sin(2 * std::numbers::pi * t_s / 0.1);
      plant.SetTorque(Eigen::Vector4d(pull, 0.6 * pull, 0, 0));
    }
    plant.Advance(20 * kNsPerUs);
    double power = 0;
    for (std::size_t j = 0; j < 2; ++j)
      power += plant.tendon()[j].motor_torque_Nm * plant.tendon()[j].motor_velocity_radps;
    work += 0.5 * kStep_s * (last + power);
    last = power;
    most = std::max(most, std::abs(work));
  }
  EXPECT_GT(most, 1e-3);
  EXPECT_NEAR(energy() - start, work, 2e-3 * most);
}

TEST(PlantPairs, AMotorsEffectIsNamedAtTheFirstTendon) {
  const RobotParameters robot = Rig("pairs_90mm");
  EXPECT_THAT([&] { ParseEffect("torque_saturation where=tendon:3 deficit_Nm=0.001", robot); },
              testing::ThrowsMessage<std::invalid_argument>(testing::AllOf(
                  testing::HasSubstr("tendon 3 has no motor"), testing::HasSubstr("tendon:1"))));
  EXPECT_THAT([&] { ParseEffect("encoder_offset where=tendon:3 rad=0.1", robot); },
              testing::ThrowsMessage<std::invalid_argument>(testing::HasSubstr("tendon 3 has no motor")));
  RobotParameters slack = robot;
  slack.effects.push_back(ParseEffect("backlash where=tendon:1 rad=0.05", robot));
  EXPECT_THAT([&] { CheckEffects(slack); },
              testing::ThrowsMessage<EffectError>(testing::HasSubstr("whose spool is that of a pair")));
  EXPECT_THAT([&] { Plant plant(slack); }, testing::ThrowsMessage<std::invalid_argument>(
                                               testing::HasSubstr("whose spool is that of a pair")));
}

}  // namespace
}  // namespace tendril::sim
