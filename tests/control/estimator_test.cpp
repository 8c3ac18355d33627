// What a robot file says of its own cell, motor and bearings is taken out of the estimates; the forward chain
// is written out by hand. The covariance is that of many noisy draws.
#include "tendril/control/estimator.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <numbers>
#include <random>

#include "tendril/config/config.h"
#include "tendril/model/bending_model.h"
#include "tendril/model/statics.h"

namespace tendril::control {
namespace {

/// What an estimator fills, for so many tendons.
CycleOutput OutputOf(int tendons) {
  CycleOutput output;
  output.displacement_m = output.tension_measured_N = output.tension_base_estimate_N =
      output.torque_measured_Nm = TendonVector::Zero(tendons);
  return output;
}

std::vector<std::shared_ptr<const model::CapstanTable>> TablesOf(const RobotParameters& robot) {
  return model::MakeCapstanTables(robot.actuation->tendons, robot.limits.max_tension_motor_N);
}

/// What a drive shows that has pulled in so much since zero and whose cell carries this tension.
DriveFeedback Shown(const TendonDriveParameters& t, double pull_m, double tension_N) {
  DriveFeedback d;
  d.position_counts = static_cast<std::int32_t>(std::lround(
      pull_m / t.SpoolTravelPerMotorRad() / (2 * std::numbers::pi) * t.drive.encoder_counts_per_turn));
  d.analog_mV = static_cast<std::int16_t>(std::lround(1000 * t.load_cell.gain_VpN * tension_N));
  return d;
}

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
  const auto tables = TablesOf(robot);
  Estimator estimator(robot, body, tables, 1e-3);

  // Pulled by far more than the pre-sliding, so friction is fully built up.
  const double motor_N = model::SolveCapstan(t.transmission.pulleys, kBase_N + kBearing_N);
  const double cell_N = (GetParam() == LoadCellPlace::kRobotSide ? kBase_N : motor_N) + kOffset_N;
  const double shaft_Nm = motor_N * t.SpoolTravelPerMotorRad() / t.gear.efficiency + 2e-4;
  CycleInput input;
  input.drives = 3;
  CycleOutput output = OutputOf(3);
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

// A slack tendon shows nothing; where the others show nothing either, the covariance is large.
TEST(SlackTendon, DoesNotCount) {
  const RobotParameters robot = config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_60mm.yaml");
  const model::Body body(robot.body);
  const auto& t = robot.actuation->tendons[0];
  const auto tables = TablesOf(robot);
  const BendingVector bend_rad = Eigen::Vector2d(0.5, -0.2);
  Eigen::VectorXd q(body.dof());
  TendonVector shortening_m(3);
  body.SpreadBending(bend_rad, q);
  body.TendonShortening(q, shortening_m);
  for (int hanging = 0; hanging < 3; ++hanging) {
    Estimator estimator(robot, body, tables, 1e-3);
    CycleInput input;
    input.drives = 3;
    CycleOutput output = OutputOf(3);
    estimator.ZeroDisplacement(input);
    for (int j = 0; j < 3; ++j) {
      const double tension_N = j < hanging ? 0 : 1.0, paid_out_m = j < hanging ? 1.5e-3 : 0;
      const double pull_m =
          shortening_m[j] - paid_out_m + (tension_N - robot.limits.min_tension_N) / t.tendon.stiffness_Npm;
      input.drive[static_cast<std::size_t>(j)] = Shown(t, pull_m, tension_N);
    }
    for (int i = 0; i < 5; ++i) estimator.Step(input, output);
    const double error_rad = (output.bending_estimate_rad - bend_rad).norm();
    const double deviation_rad = std::sqrt(output.bending_covariance_rad2.trace());
    if (hanging < 2) {
      EXPECT_LT(error_rad, 1e-3) << hanging;
      EXPECT_LT(deviation_rad, 1e-3) << hanging;
    } else {
      EXPECT_GT(deviation_rad, error_rad) << "one tendon tells of one direction only";
      EXPECT_GT(deviation_rad, 0.5);
    }
  }
}

// The base section of two hangs in its tendons, whose spools run on; those of the other one show what both
// bend together. The estimate goes no faster than a robot does that nothing holds, says how little is known,
// and agrees as soon as the tendons are taut again; a reading of a hanging tendon's cell that noise lifts now
// and then changes nothing.
TEST(SlackTendon, ASectionThatHangsIsWhereItWasAndLessAndLessSure) {
  const RobotParameters robot = config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/two_section.yaml");
  const model::Body body(robot.body);
  const auto tables = TablesOf(robot);
  Estimator estimator(robot, body, tables, 1e-3);
  const BendingVector bend_rad = Eigen::Vector4d(1.2, 0.4, -0.8, 0.3);
  UnitVector q(body.dof());
  TendonVector shortening_m(6);
  body.SpreadBending(bend_rad, q);
  body.TendonShortening(q, shortening_m);
  CycleInput input;
  input.drives = 6;
  CycleOutput output = OutputOf(6);
  estimator.ZeroDisplacement(input);
  const auto step = [&](double base_N, double paid_out_m) {
    for (int j = 0; j < 6; ++j) {
      const auto& t = robot.actuation->tendons[static_cast<std::size_t>(j)];
      const bool hangs = j < 3 && base_N < 0.1;
      const double tension_N = j < 3 ? base_N : 1.0;
      const double pull_m = shortening_m[j] - (hangs ? paid_out_m * (1 + 0.5 * j) : 0) +
                            (tension_N - robot.limits.min_tension_N) / t.tendon.stiffness_Npm;
      input.drive[static_cast<std::size_t>(j)] = Shown(t, pull_m, tension_N);
    }
    estimator.Step(input, output);
  };
  const auto deviation_rad = [&] { return std::sqrt(output.bending_covariance_rad2.trace()); };
  for (int i = 0; i < 10; ++i) step(1, 0);
  ASSERT_LT((output.bending_estimate_rad - bend_rad).norm(), 1e-3);
  ASSERT_LT(deviation_rad(), 2e-3);

  BendingVector last_rad = output.bending_estimate_rad;
  double sure_rad = deviation_rad(), farthest_rad = 0;
  for (int i = 0; i < 500; ++i) {
    const bool lifted = i % 100 == 99;
    step(lifted ? 0.025 : 0, 1.5e-3 + 1e-5 * i);
    farthest_rad = std::max(farthest_rad, (output.bending_estimate_rad - last_rad).norm());
    last_rad = output.bending_estimate_rad;
    if (i < 90) {
      EXPECT_GT(deviation_rad(), sure_rad) << i;
      sure_rad = deviation_rad();
    }
    const BendingVector error_rad = output.bending_estimate_rad - bend_rad;
    const double normalised = error_rad.dot(output.bending_covariance_rad2.ldlt().solve(error_rad));
    EXPECT_LT(i % 100 == 0 ? normalised : 0, 4 * 4) << i;
    EXPECT_LT((error_rad.head<2>() + error_rad.tail<2>()).norm(), 0.05) << "both together are seen";
  }
  EXPECT_LT(farthest_rad, 0.05) << "a hundredth of its way in a cycle";
  EXPECT_GT(deviation_rad(), 1);

  for (int i = 0; i < 60; ++i) step(1, 0);
  EXPECT_LT((output.bending_estimate_rad - bend_rad).norm(), 1e-3);
  EXPECT_LT(deviation_rad(), 2e-3);
}

// Sensors of a robot in a known shape under known tensions, each with its own noise and resolution.
class NoisyRobot {
 public:
  NoisyRobot(const RobotParameters& robot, const model::CapstanTable& table, unsigned seed)
      : robot_(robot), table_(table), body_(robot.body), random_(seed) {}

  /// A robot that has been bent from straight (in `zero`) to `bending_rad`; tensions and noise are drawn.
  void Draw(const BendingVector& bending_rad, CycleInput& zero, CycleInput& bent) {
    UnitVector q(body_.dof());
    body_.SpreadBending(bending_rad, q);
    TendonVector shortening_m(body_.tendons());
    body_.TendonShortening(q, shortening_m);
    zero.drives = bent.drives = body_.tendons();
    for (int j = 0; j < body_.tendons(); ++j) {
      const auto& t = robot_.actuation->tendons[static_cast<std::size_t>(j)];
      const double base_N = std::uniform_real_distribution<double>(1, 6)(random_);
      // Where friction has built up: far from the last reversal.
      const double z = shortening_m[j] > 0 ? 1 : -1;
      const double motor_N = z > 0 ? table_.Pull(base_N) : table_.Release(base_N);
      const double pull_m =
          shortening_m[j] + (motor_N - robot_.limits.min_tension_N) / t.tendon.stiffness_Npm;
      const double counts_per_m =
          t.drive.encoder_counts_per_turn / (2 * std::numbers::pi * t.SpoolTravelPerMotorRad());
      const double at_zero = std::uniform_real_distribution<double>(-1000, 1000)(random_);
      const double cell_N = (t.load_cell.place == LoadCellPlace::kRobotSide ? base_N : motor_N) +
                            t.load_cell.noise_N * normal_(random_);
      const double torque_Nm = (motor_N / std::pow(t.gear.efficiency, z) * t.SpoolTravelPerMotorRad() +
                                z * t.motor.coulomb_friction_Nm) /
                               t.motor.torque_scale;
      auto& before = zero.drive[static_cast<std::size_t>(j)];
      auto& now = bent.drive[static_cast<std::size_t>(j)];
      before.position_counts = static_cast<std::int32_t>(std::lround(at_zero));
      now.position_counts = static_cast<std::int32_t>(std::lround(at_zero + pull_m * counts_per_m));
      now.analog_mV = static_cast<std::int16_t>(std::lround(1000 * t.load_cell.gain_VpN * cell_N));
      now.torque_permille =
          static_cast<std::int16_t>(std::lround(1000 * torque_Nm / t.drive.rated_torque_Nm +
                                                t.drive.actual_torque_noise_permille * normal_(random_)));
    }
  }

 private:
  const RobotParameters& robot_;
  const model::CapstanTable& table_;
  model::Body body_;
  std::mt19937 random_;
  std::normal_distribution<double> normal_;
};

class Covariance : public testing::TestWithParam<std::tuple<const char*, LoadCellPlace>> {};

TEST_P(Covariance, IsThatOfManyNoisyDraws) {
  const auto [file, place] = GetParam();
  RobotParameters robot = config::LoadRobot(std::string(TENDRIL_SOURCE_DIR "/config/robots/") + file);
  for (auto& t : robot.actuation->tendons) {
    t.load_cell.place = place;
    // Coarse enough to matter beside the encoder.
    t.load_cell.noise_N = 0.03;
    t.motor.coulomb_friction_Nm = 1e-4;
  }
  const model::Body body(robot.body);
  const auto tables = TablesOf(robot);
  Estimator estimator(robot, body, tables, 1e-3);
  NoisyRobot noisy(robot, *tables[0], 5);
  const int n = 2 * body.sections();
  BendingVector truth(n);
  for (int i = 0; i < n; ++i) truth[i] = 0.5 * std::cos(1.0 + 2.0 * i);

  constexpr int kDraws = 3000;
  double normalised = 0;
  Eigen::MatrixXd drawn = Eigen::MatrixXd::Zero(n, n), said = drawn;
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(n);
  CycleInput zero, bent;
  CycleOutput output = OutputOf(body.tendons());
  for (int draw = 0; draw < kDraws; ++draw) {
    noisy.Draw(truth, zero, bent);
    estimator.ZeroDisplacement(zero);
    for (int i = 0; i < 4; ++i) estimator.Step(bent, output);
    const Eigen::VectorXd error = output.bending_estimate_rad - truth;
    const Eigen::MatrixXd p = output.bending_covariance_rad2;
    ASSERT_EQ(p.rows(), n);
    ASSERT_EQ((p - p.transpose()).cwiseAbs().maxCoeff(), 0);
    ASSERT_GT(Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(p).eigenvalues().minCoeff(), 0);
    normalised += error.dot(p.ldlt().solve(error)) / kDraws;
    drawn += error * error.transpose() / kDraws;
    said += p / kDraws;
    mean += error / kDraws;
  }
  // The sum of n squares of unit variance: n, over the draws within sqrt(2 n / draws), of which five are
  // allowed. Two sides: a covariance that covers everything says nothing.
  EXPECT_NEAR(normalised, n, 5 * std::sqrt(2.0 * n / kDraws));
  EXPECT_LT((drawn - said).norm(), 0.12 * said.norm()) << drawn << "\n" << said;
  EXPECT_LT(mean.norm(), 5 * std::sqrt(said.trace() / kDraws)) << "unbiased";
  RecordProperty("normalised_error_squared", std::to_string(normalised / n));
}

INSTANTIATE_TEST_SUITE_P(Robots, Covariance,
                         testing::Combine(testing::Values("rig_60mm.yaml", "two_section.yaml",
                                                          "four_tendon_90mm.yaml"),
                                          testing::Values(LoadCellPlace::kMotorSide,
                                                          LoadCellPlace::kRobotSide, LoadCellPlace::kNone)));

// Sensors without noise of a body that tensions compress as much as they bend it. By the sensors alone the
// error would be tens of deviations.
TEST(CovarianceOf, ABodyThatShortensIsSeenAsWellAsItSays) {
  RobotParameters soft = config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rod_90mm.yaml");
  soft.body.gravity_W_mps2.setZero();
  soft.body.sections[0].axial_stiffness_N = 150;
  for (auto& t : soft.actuation->tendons) t.transmission.pulleys.clear();
  const RobotParameters robot = model::ControlModel(soft);
  const model::Body real(soft.body), body(robot.body);
  const auto& t = robot.actuation->tendons[0];
  const auto tables = TablesOf(robot);
  const BendingMatrix unseen_rad2 = model::UnseenBending(soft);
  std::mt19937 random(3);
  std::uniform_real_distribution<double> tension(soft.limits.min_tension_N, soft.limits.max_tension_base_N);
  const auto shortening_at = [&](const Eigen::VectorXd& tension_N, BendingVector& bend_rad) {
    const model::Equilibrium found = model::SolveStatics(real, tension_N, {});
    EXPECT_EQ(found.result, model::StaticsResult::kConverged);
    real.SumBending(found.q, bend_rad);
    TendonVector shortening_m(3);
    real.TendonShortening(found.q, shortening_m);
    return shortening_m;
  };
  BendingVector bend_rad(2);
  const Eigen::VectorXd least_N = Eigen::VectorXd::Constant(3, soft.limits.min_tension_N);
  const TendonVector least_m = shortening_at(least_N, bend_rad);

  constexpr int kDraws = 200;
  double square_rad2 = 0, by_sensors_rad2 = 0;
  for (int draw = 0; draw < kDraws; ++draw) {
    const Eigen::VectorXd tension_N = Eigen::VectorXd::NullaryExpr(3, [&] { return tension(random); });
    const TendonVector pull_m =
        shortening_at(tension_N, bend_rad) - least_m + (tension_N - least_N) / t.tendon.stiffness_Npm;
    Estimator estimator(robot, body, tables, 1e-3, unseen_rad2);
    CycleInput input;
    input.drives = 3;
    CycleOutput output = OutputOf(3);
    estimator.ZeroDisplacement(input);
    for (int j = 0; j < 3; ++j) {
      input.drive[static_cast<std::size_t>(j)] = Shown(t, pull_m[j], tension_N[j]);
    }
    for (int i = 0; i < 4; ++i) estimator.Step(input, output);
    square_rad2 += (output.bending_estimate_rad - bend_rad).squaredNorm() / kDraws;
    by_sensors_rad2 += (output.bending_covariance_rad2 - unseen_rad2).trace() / kDraws;
  }
  const double ratio = square_rad2 / (by_sensors_rad2 + unseen_rad2.trace());
  EXPECT_GT(square_rad2, 100 * by_sensors_rad2);
  EXPECT_GT(ratio, 0.2);
  EXPECT_LT(ratio, 1.5);
}

TEST(CovarianceOf, WhatTendonsDoNotSeeIsAdded) {
  const RobotParameters robot = config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_60mm.yaml");
  const model::Body body(robot.body);
  const auto tables = TablesOf(robot);
  BendingMatrix unseen_rad2(2, 2);
  unseen_rad2 << 4e-3, 1e-3, 1e-3, 2e-3;
  Estimator without(robot, body, tables, 1e-3), with(robot, body, tables, 1e-3, unseen_rad2);
  CycleInput input;
  input.drives = 3;
  for (auto& d : input.drive) d.analog_mV = 800;
  CycleOutput sensors = OutputOf(3), all = sensors;
  without.ZeroDisplacement(input);
  with.ZeroDisplacement(input);
  // Twice, since what is added must not add up.
  for (int i = 0; i < 2; ++i) {
    without.Step(input, sensors);
    with.Step(input, all);
    EXPECT_LT((all.bending_covariance_rad2 - sensors.bending_covariance_rad2 - unseen_rad2).norm(), 1e-15);
  }
}

TEST(CovarianceOf, FrictionThatHasNotBuiltUpIsUncertain) {
  RobotParameters robot = config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_60mm.yaml");
  for (auto& t : robot.actuation->tendons) t.load_cell.place = LoadCellPlace::kRobotSide;
  const model::Body body(robot.body);
  const auto tables = TablesOf(robot);
  Estimator estimator(robot, body, tables, 1e-3);
  CycleInput input;
  input.drives = 3;
  for (auto& d : input.drive) d.analog_mV = 800;
  CycleOutput output = OutputOf(3);
  estimator.ZeroDisplacement(input);
  estimator.Step(input, output);
  const double at_reversal = output.bending_covariance_rad2.trace();
  for (int i = 0; i < 200; ++i) {
    for (auto& d : input.drive) d.position_counts += 1;
    estimator.Step(input, output);
  }
  EXPECT_GT(at_reversal, 20 * output.bending_covariance_rad2.trace());
}

INSTANTIATE_TEST_SUITE_P(Places, EstimatorTest,
                         testing::Values(LoadCellPlace::kMotorSide, LoadCellPlace::kRobotSide,
                                         LoadCellPlace::kNone));

}  // namespace
}  // namespace tendril::control
