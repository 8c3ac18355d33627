// What a robot file says of its own cell, motor and bearings is taken out of the estimates; the forward chain
// is written out by hand.
#include "tendril/control/estimator.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tendril/config/config.h"

namespace tendril::control {
namespace {

class EstimatorTest : public testing::TestWithParam<LoadCellPlace> {
 protected:
  static constexpr double kBase_N = 3, kBearing_N = 0.2, kOffset_N = 0.07, kScale = 1.25;

  EstimatorTest() : robot(config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_90mm.yaml")) {
    for (auto& t : robot.actuation->tendons) {
      t.load_cell.place = GetParam();
      t.load_cell.offset_N = kOffset_N;
      t.transmission.coulomb_N = kBearing_N;
      t.motor.torque_scale = kScale;
    }
  }

  RobotParameters robot;
};

TEST_P(EstimatorTest, SeesThroughOffsetBearingsAndAStrongMotor) {
  const model::Body body(robot.body);
  const auto& t = robot.actuation->tendons[0];
  const std::vector<std::shared_ptr<const model::CapstanTable>> tables(
      3, std::make_shared<const model::CapstanTable>(t.transmission, robot.limits.max_tension_motor_N));
  Estimator estimator(robot, body, tables);

  // Pulled by far more than the pre-sliding, so friction is fully built up.
  const double motor_N = model::SolveCapstan(t.transmission.pulleys, kBase_N + kBearing_N);
  const double cell_N = (GetParam() == LoadCellPlace::kRobotSide ? kBase_N : motor_N) + kOffset_N;
  const double shaft_Nm = motor_N * t.SpoolTravelPerMotorRad() / t.gear.efficiency + 2e-4;
  CycleInput input;
  input.drives = 3;
  CycleOutput output;
  output.displacement_m = output.tension_measured_N = output.tension_base_estimate_N =
      output.torque_measured_Nm = TendonVector::Zero(3);
  estimator.ZeroDisplacement(input);
  for (int j = 0; j < 3; ++j) {
    auto& d = input.drive[static_cast<std::size_t>(j)];
    d.position_counts = 1000;
    d.analog_mV = static_cast<std::int16_t>(std::lround(1000 * t.load_cell.gain_VpN * cell_N));
    d.torque_permille =
        static_cast<std::int16_t>(std::lround(1000 * shaft_Nm / kScale / t.drive.rated_torque_Nm));
  }
  estimator.Step(input, output);

  const double millivolt_N = 1e-3 / t.load_cell.gain_VpN;
  const double permille_N = 1e-3 * kScale * t.drive.rated_torque_Nm / t.SpoolTravelPerMotorRad();
  const double resolution_N = GetParam() == LoadCellPlace::kNone ? permille_N : millivolt_N;
  EXPECT_NEAR(output.tension_base_estimate_N[0], kBase_N, resolution_N);
  const double shown_N = GetParam() == LoadCellPlace::kRobotSide ? kBase_N : motor_N;
  EXPECT_NEAR(output.tension_measured_N[0], shown_N, resolution_N);
}

INSTANTIATE_TEST_SUITE_P(Places, EstimatorTest,
                         testing::Values(LoadCellPlace::kMotorSide, LoadCellPlace::kRobotSide,
                                         LoadCellPlace::kNone));

}  // namespace
}  // namespace tendril::control
