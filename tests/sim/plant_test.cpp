// The plant against its laws, an independent integration, energy, statics, and its own tolerances.
#include "tendril/sim/plant.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <fstream>
#include <numbers>
#include <sstream>

#include "motions.h"
#include "tendril/model/statics.h"
#include "tendril/model/stop_operator.h"
#include "tendril/sim/effects.h"

namespace tendril::sim {
namespace {

using test::Rig;

constexpr double kCellNoise_N = 0.005;
const double kCountNoise = 1 / std::sqrt(12.0);  // rms of rounding to a count
constexpr double kTrackerNoise_m = 5e-5;

double HoldingTorque(const RobotParameters& robot, int tendon) {
  return robot.limits.min_tension_N *
         robot.actuation->tendons[static_cast<std::size_t>(tendon)].SpoolTravelPerMotorRad();
}

Eigen::VectorXd Holding(const RobotParameters& robot) {
  Eigen::VectorXd torque(robot.body.tendons());
  for (int j = 0; j < torque.size(); ++j) torque[j] = HoldingTorque(robot, j);
  return torque;
}

void Hold(Plant& plant, const Eigen::VectorXd& torque, int milliseconds) {
  plant.SetTorque(torque);
  for (int i = 0; i < milliseconds; ++i) plant.Advance(kNsPerMs);
}

TEST(PlantStart, StraightRobotUnderHoldingTorqueStays) {
  const RobotParameters robot = Rig();
  Plant plant(robot);
  for (const auto& t : plant.tendon()) {
    EXPECT_DOUBLE_EQ(t.tension_motor_N, 0.3);
    EXPECT_DOUBLE_EQ(t.motor_torque_Nm, 0.3 * 0.008 / 19);
    EXPECT_EQ(t.sliding, 0);
  }
  for (int i = 0; i < 2000; ++i) plant.Advance(kNsPerMs);
  for (const auto& t : plant.tendon()) {
    EXPECT_NEAR(t.tension_motor_N, 0.3, 0.01 * kCellNoise_N);
    EXPECT_NEAR(t.motor_angle_rad, 0, 1e-6);
  }
  EXPECT_LT(plant.q().norm(), 1e-9);
}

TEST(PlantStart, RobotWithoutMotorsIsRefused) {
  EXPECT_THAT([] { Plant plant(Rig("qi2021_90mm")); },
              testing::ThrowsMessage<std::invalid_argument>(testing::HasSubstr("no actuation")));
}

TEST(PlantInput, NonsenseIsRefused) {
  Plant plant(Rig());
  EXPECT_THROW(plant.SetTorque(Eigen::Vector2d::Zero()), std::invalid_argument);
  EXPECT_THROW(plant.SetTorque(Eigen::Vector3d(0, NAN, 0)), std::invalid_argument);
  EXPECT_THROW(plant.Advance(0), std::invalid_argument);
  EXPECT_THROW(plant.Advance(-1), std::invalid_argument);
}

TEST(PlantSigns, PositiveTorquePullsTheTendonAndBendsTowardsIt) {
  const RobotParameters robot = Rig();
  Plant plant(robot);
  Eigen::VectorXd torque = Holding(robot);
  torque[0] = 0.002;  // tendon 1 is at 0 deg: bending plane +x
  Hold(plant, torque, 500);
  const auto& pulled = plant.tendon()[0];
  EXPECT_GT(pulled.motor_angle_rad, 0.5);
  EXPECT_GT(pulled.spool_pull_m, 2e-4);
  EXPECT_GT(pulled.body_shortening_m, 2e-4);
  EXPECT_GT(pulled.tension_motor_N, 2);
  EXPECT_GT(plant.TipPose().p_WA.x(), 0.003);
  EXPECT_NEAR(plant.TipPose().p_WA.y(), 0, 1e-6);
  EXPECT_LT(plant.tendon()[1].motor_angle_rad, 0);
}

// With every strain: at rest where the statics say, twisted by a force across the bend.
TEST(PlantOfARod, SettlesInTheEquilibriumOfItsTensions) {
  RobotParameters robot = Rig("rod_90mm");
  robot.body.tip_force_W_N = {0, 0.03, 0};
  Plant plant(robot);
  Eigen::VectorXd torque = Holding(robot);
  torque[0] = 0.002;
  Hold(plant, torque, 4000);
  Eigen::VectorXd tension(3);
  for (int j = 0; j < 3; ++j) tension[j] = plant.tendon()[static_cast<std::size_t>(j)].tension_base_N;
  const model::Body& body = plant.body();
  const model::Equilibrium still = model::SolveStatics(body, tension, {});
  ASSERT_EQ(still.result, model::StaticsResult::kConverged);
  EXPECT_LT((plant.q() - still.q).cwiseAbs().maxCoeff(), 1e-5);
  EXPECT_LT((plant.TipPose().p_WA - body.TipPose(still.q).p_WA).norm(), 1e-6);
  const model::StrainVector first = body.StrainsOf(0, plant.q());
  EXPECT_GT(std::abs(first[2]), 1e-3);
  EXPECT_LT(first[3], -1e-5);
}

// The same laws in another language, formulation and integrator (tests/sim/reference/plant_reference.py): a
// hard pull of one tendon to 5 N with the others paid out and slack, a reversal, a stop; and the pull again
// on a body that is not as drawn.
class PlantReference : public testing::Test {
 protected:
  struct Row {
    double t;
    Eigen::Vector3d wanted;
    Eigen::Matrix<double, 8, 1> q;
    Eigen::Vector3d angle, velocity, torque, motor, base, sliding;
  };
  static std::vector<Row> Load(const char* name) {
    std::ifstream file(std::string(TENDRIL_SOURCE_DIR "/tests/sim/reference/") + name);
    std::string line;
    std::getline(file, line);
    std::vector<Row> rows;
    while (std::getline(file, line)) {
      std::replace(line.begin(), line.end(), ',', ' ');
      std::istringstream in(line);
      Row r;
      in >> r.t;
      for (int i = 0; i < 3; ++i) in >> r.wanted[i];
      for (int i = 0; i < 8; ++i) in >> r.q[i];
      for (auto* v : {&r.angle, &r.velocity, &r.torque, &r.motor, &r.base, &r.sliding}) {
        for (int i = 0; i < 3; ++i) in >> (*v)[i];
      }
      EXPECT_TRUE(in) << line;
      rows.push_back(r);
    }
    return rows;
  }
  struct Worst {
    double motor_N = 0, base_N = 0, angle_rad = 0, q_rad = 0, sliding = 0;
  };
  static constexpr const char* kNominal = "plant_rig_90mm.csv";
  static Worst Compare(const PlantOptions& options, const RobotParameters& robot = Rig(),
                       const char* name = kNominal) {
    Plant plant(robot, options);
    Worst worst;
    for (const Row& row : Load(name)) {
      plant.SetTorque(row.wanted);
      plant.Advance(kNsPerMs);
      worst.q_rad = std::max(worst.q_rad, (plant.q() - row.q).cwiseAbs().maxCoeff());
      for (int j = 0; j < 3; ++j) {
        const auto& t = plant.tendon()[static_cast<std::size_t>(j)];
        EXPECT_NEAR(t.motor_torque_Nm, row.torque[j], 1e-12);
        worst.motor_N = std::max(worst.motor_N, std::abs(t.tension_motor_N - row.motor[j]));
        worst.base_N = std::max(worst.base_N, std::abs(t.tension_base_N - row.base[j]));
        worst.angle_rad = std::max(worst.angle_rad, std::abs(t.motor_angle_rad - row.angle[j]));
        worst.sliding = std::max(worst.sliding, std::abs(t.sliding - row.sliding[j]));
      }
    }
    return worst;
  }
};

TEST_F(PlantReference, TightTolerancesAgreeToAHundredthOfTheNoise) {
  ASSERT_EQ(Load(kNominal).size(), 240u);
  const Worst worst = Compare({.relative_tolerance = 1e-9, .absolute_tolerance = 1e-10});
  EXPECT_LT(worst.motor_N, 0.01 * kCellNoise_N);
  EXPECT_LT(worst.base_N, 0.01 * kCellNoise_N);
  EXPECT_LT(worst.angle_rad, 0.05 * kCountNoise * 2 * std::numbers::pi / 2048);
  EXPECT_LT(worst.q_rad, 1e-6);
  EXPECT_LT(worst.sliding, 1e-4);
}

// The same values as in with_effects() of the script.
TEST_F(PlantReference, ABodyWithEverythingThatCanBeWrongWithItAgreesToo) {
  RobotParameters robot = Rig();
  for (const char* effect :
       {"tip_payload mass_kg=0.002", "unit_stiffness where=unit:2 scale=0.8",
        "precurvature where=unit:3 u_rad=0.02 v_rad=0.05", "base_tilt y_rad=0.1",
        "tip_force y_N=0.02 z_N=0.01", "torsion rad_per_m=4", "routing_friction mu=0.2",
        "backbone_hysteresis moment_Nm=0.002 yield_rad=0.05", "superelastic softening=0.4 onset_rad=0.2",
        "contact stiffness_Npm=100 gap_m=0.008 angle_rad=0.3"}) {
    robot.effects.push_back(ParseEffect(effect, robot));
  }
  constexpr const char* kEffects = "plant_rig_90mm_effects.csv";
  ASSERT_EQ(Load(kEffects).size(), 160u);
  const Worst worst = Compare({.relative_tolerance = 1e-11, .absolute_tolerance = 1e-12}, robot, kEffects);
  EXPECT_LT(worst.motor_N, 0.01 * kCellNoise_N);
  EXPECT_LT(worst.base_N, 0.01 * kCellNoise_N);
  EXPECT_LT(worst.angle_rad, 0.05 * kCountNoise * 2 * std::numbers::pi / 2048);
  EXPECT_LT(worst.q_rad, 1e-6);
  EXPECT_LT(worst.sliding, 1e-4);
}

TEST_F(PlantReference, DefaultTolerancesStayBelowTheNoise) {
  const Worst worst = Compare({});
  EXPECT_LT(worst.motor_N, 0.5 * kCellNoise_N);
  EXPECT_LT(worst.base_N, 0.5 * kCellNoise_N);
  EXPECT_LT(worst.angle_rad, kCountNoise * 2 * std::numbers::pi / 2048);
}

// Work of the motors = what rotors, tendons and body store + what motor friction, gear, damper, pulley and
// bending damping take. Gear and motor friction states are followed here by their own laws from the shown
// motor angles.
TEST(PlantEnergy, WorkOfTheMotorsIsStoredOrDissipated) {
  const RobotParameters robot = Rig();
  const auto& p = robot.actuation->tendons[0];
  Plant plant(robot, {.relative_tolerance = 1e-9, .absolute_tolerance = 1e-10});
  model::Body::Workspace workspace(plant.body());
  const double travel = p.SpoolTravelPerMotorRad(), k = p.tendon.stiffness_Npm;

  std::vector<model::DahlState> dahl(3, model::DahlState(p.motor.coulomb_angle_rad));
  std::vector<model::StopOperators<2>> gear(3, model::StopOperators<2>({0.002, 0.004}));
  const auto stored = [&] {
    double energy = plant.body().EnergyOf(plant.q(), plant.dq(), workspace).total();
    for (const auto& t : plant.tendon()) {
      const double stretch = std::max(0.0, t.spool_pull_m - t.body_shortening_m + 0.3 / k);
      energy += 0.5 * k * stretch * stretch +
                0.5 * p.motor.rotor_inertia_kgm2 * t.motor_velocity_radps * t.motor_velocity_radps;
    }
    return energy;
  };
  struct Power {
    double work = 0, friction = 0, gear = 0, damper = 0, pulley = 0, bending = 0;
  };
  Eigen::MatrixXd jacobian(3, 8);
  const auto power = [&] {
    Power now;
    plant.body().TendonLengthJacobian(plant.q(), jacobian);
    const Eigen::VectorXd rate = -jacobian * plant.dq();
    for (std::size_t j = 0; j < 3; ++j) {
      const auto& t = plant.tendon()[j];
      const double w = t.motor_velocity_radps;
      const double zeta = dahl[j].Commit(t.motor_angle_rad);
      const double factor = std::pow(p.gear.efficiency, -gear[j].Commit(t.motor_angle_rad));
      const double stretch = std::max(0.0, t.spool_pull_m - t.body_shortening_m + 0.3 / k);
      const double zeta_rate = (w - std::abs(w) * zeta) / p.motor.coulomb_angle_rad;
      const double body_rate = rate[static_cast<Eigen::Index>(j)];
      now.work += t.motor_torque_Nm * w;
      now.friction += w * (p.motor.coulomb_friction_Nm * zeta + p.motor.coulomb_damping_Nms * zeta_rate +
                           p.motor.viscous_friction_Nms * w);
      now.gear += t.tension_motor_N * travel * (factor - 1) * w;
      now.damper += (t.tension_motor_N - k * stretch) * (travel * w - body_rate);
      now.pulley += (t.tension_motor_N - t.tension_base_N) * body_rate;
    }
    now.bending = robot.body.sections[0].bending_damping_Nms * plant.dq().squaredNorm();
    return now;
  };

  const double start = stored();
  Power sum, last = power();
  constexpr TimeNs kStep = 20 * kNsPerUs;
  constexpr double kStep_s = 20e-6;
  for (int ms = 0; ms < 300; ++ms) {
    const double t = ms * 1e-3;
    const double pull = 0.0022 * std::sin(std::numbers::pi * t / 0.2);
    plant.SetTorque(Eigen::Vector3d(HoldingTorque(robot, 0) + pull,
                                    HoldingTorque(robot, 1) + 0.3 * std::abs(pull), HoldingTorque(robot, 2)));
    for (TimeNs done = 0; done < kNsPerMs; done += kStep) {
      plant.Advance(kStep);
      const Power now = power();
      const auto add = [&](double Power::*part) { sum.*part += 0.5 * kStep_s * (last.*part + now.*part); };
      for (auto part :
           {&Power::work, &Power::friction, &Power::gear, &Power::damper, &Power::pulley, &Power::bending})
        add(part);
      last = now;
    }
  }
  const double taken = sum.friction + sum.gear + sum.damper + sum.pulley + sum.bending;
  EXPECT_GT(sum.work, 0.005);  // [J]
  EXPECT_NEAR(sum.work, stored() - start + taken, 1e-3 * sum.work);
  for (const double part : {sum.friction, sum.gear, sum.damper, sum.pulley, sum.bending}) {
    EXPECT_GT(part, 1e-4 * sum.work);  // each of them is there and takes; the damper the least
  }
}

TEST(PlantFriction, SlidingPulleyIsTheCapstanBothWaysAndTurnsRoundOverTwiceThePresliding) {
  const RobotParameters robot = Rig();
  const auto& transmission = robot.actuation->tendons[0].transmission;
  Plant plant(robot, {.relative_tolerance = 1e-9, .absolute_tolerance = 1e-9});
  const auto slide = [&] {
    return 0.5 * (plant.tendon()[0].spool_pull_m + plant.tendon()[0].body_shortening_m);
  };
  int pulling = 0, paying_out = 0;
  double reversal = 0, turned = 0, work_of_loop = 0, last_body = 0;
  Eigen::VectorXd torque = Holding(robot);
  for (int ms = 0; ms < 3000; ++ms) {
    const double t = ms * 1e-3;
    torque[0] =
        HoldingTorque(robot, 0) + (t < 1.5 ? 0.0025 * t / 1.5 : 0.0025 * std::max(0.0, (3 - t) / 1.5));
    plant.SetTorque(torque);
    plant.Advance(kNsPerMs);
    const auto& tendon = plant.tendon()[0];
    if (t < 2) reversal = std::max(reversal, slide());
    if (tendon.sliding == -1 && turned == 0) turned = slide();
    work_of_loop += (tendon.tension_motor_N - tendon.tension_base_N) * (tendon.body_shortening_m - last_body);
    last_body = tendon.body_shortening_m;
    if (ms % 5 == 0 && tendon.sliding == 1 && tendon.tension_motor_N > 0.2) {
      ++pulling;
      const double base = model::SolveCapstanInverse(transmission.pulleys, tendon.tension_motor_N);
      EXPECT_NEAR(tendon.tension_base_N, base, 2e-6 * base);
    } else if (ms % 5 == 0 && tendon.sliding == -1 && tendon.tension_motor_N > 0.2) {
      ++paying_out;
      const double base = model::SolveCapstan(transmission.pulleys, tendon.tension_motor_N);
      EXPECT_NEAR(tendon.tension_base_N, base, 2e-6 * base);
    }
  }
  EXPECT_GT(pulling, 60);
  EXPECT_GT(paying_out, 40);
  EXPECT_GT(work_of_loop, 1e-4);  // [J] lost on the way up and down
  // From +1 to -1: each stop operator goes from +y to -y, the stiffest last, over 2 x 0.05 mm of sliding.
  EXPECT_NEAR(reversal - turned, 2 * transmission.presliding_m, 0.1 * transmission.presliding_m);
}

TEST(PlantSlack, SlackTendonTransmitsNothingAndComesBack) {
  const RobotParameters robot = Rig();
  Plant plant(robot);
  Eigen::VectorXd torque = Holding(robot);
  torque[0] = 0.002;
  Hold(plant, torque, 300);
  torque[0] = -0.002;
  int slack = 0;
  plant.SetTorque(torque);
  for (int ms = 0; ms < 300; ++ms) {
    plant.Advance(kNsPerMs);
    const auto& t = plant.tendon()[0];
    EXPECT_GE(t.tension_motor_N, 0);
    if (t.tension_motor_N == 0) {
      ++slack;
      EXPECT_EQ(t.tension_base_N, 0);
      EXPECT_LT(t.spool_pull_m - t.body_shortening_m, 0);
    }
  }
  EXPECT_GT(slack, 200);
  torque[0] = 0.002;
  Hold(plant, torque, 3000);  // it comes back fast and swings
  EXPECT_GT(plant.tendon()[0].tension_motor_N, 1);
  EXPECT_LT(plant.dq().norm(), 0.001);
}

TEST(PlantTorqueLoop, ActsWithItsLagAndContinuesFromWhereItIs) {
  const RobotParameters robot = Rig();
  Plant plant(robot);
  const double hold = HoldingTorque(robot, 0), lag_s = 0.0005;
  Eigen::VectorXd torque = Holding(robot);
  torque[0] = 0.003;
  plant.SetTorque(torque);
  for (int i = 1; i <= 7; ++i) {
    plant.Advance(100 * kNsPerUs);
    EXPECT_NEAR(plant.tendon()[0].motor_torque_Nm, 0.003 + (hold - 0.003) * std::exp(-i * 1e-4 / lag_s),
                1e-12);
  }
  const double reached = plant.tendon()[0].motor_torque_Nm;
  torque[0] = 0.001;
  plant.SetTorque(torque);
  plant.Advance(500 * kNsPerUs);
  EXPECT_NEAR(plant.tendon()[0].motor_torque_Nm, 0.001 + (reached - 0.001) * std::exp(-1), 1e-12);
  // The rotor feels it: 0.7 ms of a step to 0.003 N·m against little friction.
  EXPECT_GT(plant.tendon()[0].motor_velocity_radps, 1);
}

// At rest the body is in the static equilibrium of its base tensions, found by a Newton iteration that knows
// no dynamics.
TEST(PlantStatics, SettlesInTheStaticEquilibrium) {
  const RobotParameters robot = Rig();
  Plant plant(robot);
  Eigen::VectorXd torque = Holding(robot);
  torque[0] = 0.0015;
  torque[1] = 0.0006;
  Hold(plant, torque, 4000);
  ASSERT_LT(plant.dq().norm(), 1e-6);
  Eigen::VectorXd tension(3);
  for (int j = 0; j < 3; ++j) tension[j] = plant.tendon()[static_cast<std::size_t>(j)].tension_base_N;
  const auto rest = model::SolveStatics(plant.body(), tension, Eigen::Vector3d::Zero());
  ASSERT_EQ(rest.result, model::StaticsResult::kConverged);
  EXPECT_GT(rest.q.norm(), 0.1);
  EXPECT_LT((plant.q() - rest.q).cwiseAbs().maxCoeff(), 1e-6);
}

struct Moments {
  double mean, std;
};
Moments MomentsOf(const std::vector<double>& values) {
  double sum = 0, squares = 0;
  for (const double v : values) sum += v;
  const double mean = sum / static_cast<double>(values.size());
  for (const double v : values) squares += (v - mean) * (v - mean);
  return {mean, std::sqrt(squares / static_cast<double>(values.size() - 1))};
}

TEST(PlantSensors, NoiseHasTheFilesStatisticsAndQuantisation) {
  const RobotParameters robot = Rig();
  Plant plant(robot, {.seed = 7});
  Eigen::VectorXd torque = Holding(robot);
  torque[0] = 0.0013;
  Hold(plant, torque, 100);
  constexpr int kReads = 20000;
  std::vector<double> cell, drive;
  std::vector<double> position[3], turn[3];
  const auto truth = plant.tendon()[0];
  const model::Pose pose = plant.TipPose();
  const double permille = 7.056e-6;
  for (int i = 0; i < kReads; ++i) {
    const auto s = plant.ReadSensors()[0];
    EXPECT_EQ(s.encoder_counts, std::lround(truth.motor_angle_rad * 2048 / (2 * std::numbers::pi)));
    EXPECT_NEAR(s.load_cell_V * 1e3, std::round(s.load_cell_V * 1e3), 1e-9);
    EXPECT_NEAR(s.torque_Nm / permille, std::round(s.torque_Nm / permille), 1e-9);
    cell.push_back(s.load_cell_V);
    drive.push_back(s.torque_Nm / permille);
    const TrackerReading tracker = plant.ReadTracker();
    const Eigen::AngleAxisd error(
        Eigen::Matrix3d(pose.R_WA.transpose() * tracker.orientation_WT.toRotationMatrix()));
    for (int a = 0; a < 3; ++a) {
      position[a].push_back(tracker.tip_W_m[a] - pose.p_WA[a]);
      turn[a].push_back(error.angle() * error.axis()[a]);
    }
  }
  // 4.5 standard errors of a mean and of a standard deviation.
  const auto expect = [](const std::vector<double>& values, double mean, double std) {
    const Moments m = MomentsOf(values);
    EXPECT_NEAR(m.mean, mean, 4.5 * std / std::sqrt(kReads));
    EXPECT_NEAR(m.std, std, 4.5 * std / std::sqrt(2.0 * kReads));
  };
  expect(cell, 0.2 * truth.tension_motor_N, std::hypot(0.2 * 0.005, 0.001 / std::sqrt(12.0)));
  // Noise of 0.3 steps rounded to steps: moments from the normal distribution's own sums.
  const double exact = truth.motor_torque_Nm / permille;
  double mean = 0, square = 0;
  for (int i = -4; i <= 4; ++i) {
    const double value = std::round(exact) + i;
    const auto below = [&](double x) { return 0.5 * std::erfc(-(x - exact) / 0.3 / std::numbers::sqrt2); };
    const double share = below(value + 0.5) - below(value - 0.5);
    mean += share * value;
    square += share * value * value;
  }
  expect(drive, mean, std::sqrt(square - mean * mean));
  for (int a = 0; a < 3; ++a) {
    expect(position[a], 0, kTrackerNoise_m);
    expect(turn[a], 0, 0.0005);
  }
}

TEST(PlantSensors, LoadCellSitsWhereTheFileSaysAndNoiseCanBeOff) {
  RobotParameters robot = Rig();
  robot.actuation->tendons[1].load_cell.place = LoadCellPlace::kRobotSide;
  robot.actuation->tendons[2].load_cell.place = LoadCellPlace::kNone;
  Plant plant(robot, {.sensor_noise = false});
  Hold(plant, Eigen::Vector3d(0.0015, 0.0015, 0.0015), 200);
  const auto sensors = plant.ReadSensors();
  EXPECT_NEAR(sensors[0].load_cell_V, 0.2 * plant.tendon()[0].tension_motor_N, 0.00051);
  EXPECT_NEAR(sensors[1].load_cell_V, 0.2 * plant.tendon()[1].tension_base_N, 0.00051);
  EXPECT_GT(plant.tendon()[1].tension_motor_N - plant.tendon()[1].tension_base_N, 0.1);
  EXPECT_EQ(sensors[2].load_cell_V, 0);
  EXPECT_EQ(plant.ReadTracker().tip_W_m, plant.TipPose().p_WA);
}

TEST(PlantSensors, TrackerDelayShowsThePast) {
  RobotParameters robot = Rig();
  robot.actuation->tracker->delay_s = 0.0105;
  Plant plant(robot, {.sensor_noise = false});
  plant.SetTorque(Eigen::Vector3d(0.002, 0.0003, 0.0003));
  std::vector<Eigen::Vector3d> past;
  for (int ms = 0; ms < 40; ++ms) {
    past.push_back(plant.TipPose().p_WA);
    plant.Advance(kNsPerMs);
  }
  // 10.5 ms ago is half way between two milliseconds.
  const Eigen::Vector3d expected = 0.5 * (past[29] + past[30]);
  EXPECT_LT((plant.ReadTracker().tip_W_m - expected).norm(), 1e-6);
  EXPECT_GT((plant.TipPose().p_WA - expected).norm(), 1e-4);
}

TEST(PlantDeterminism, SameSeedSameBitsOtherSeedOtherNoiseOnly) {
  const RobotParameters robot = Rig();
  const test::CircleTorque circle(robot);
  const auto run = [&](std::uint64_t seed) {
    Plant plant(robot, {.seed = seed});
    std::vector<double> sensed;
    for (int ms = 0; ms < 400; ++ms) {
      plant.SetTorque(circle.At(ms * 1e-3));
      plant.Advance(kNsPerMs);
      for (const auto& s : plant.ReadSensors()) sensed.insert(sensed.end(), {s.load_cell_V, s.torque_Nm});
      if (ms % 10 == 0) sensed.push_back(plant.ReadTracker().tip_W_m.x());
    }
    std::vector<double> truth(plant.q().begin(), plant.q().end());
    for (const auto& t : plant.tendon()) truth.insert(truth.end(), {t.motor_angle_rad, t.tension_motor_N});
    return std::pair(sensed, truth);
  };
  const auto same_bits = [](const std::vector<double>& a, const std::vector<double>& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(double)) == 0;
  };
  const auto first = run(3), again = run(3), other = run(4);
  EXPECT_TRUE(same_bits(first.first, again.first));
  EXPECT_TRUE(same_bits(first.second, again.second));
  EXPECT_TRUE(same_bits(first.second, other.second));
  EXPECT_FALSE(same_bits(first.first, other.first));
}

struct Channels {
  double cell_N = 0, count = 0, tip_m = 0;  // rms of a difference
};
Channels Difference(Plant& a, Plant& b, const test::CircleTorque& circle, int milliseconds,
                    const std::function<void(Plant&)>& advance_b) {
  Channels sum;
  const double counts_per_rad = 2048 / (2 * std::numbers::pi);
  const auto square = [](double x) { return x * x; };
  for (int ms = 0; ms < milliseconds; ++ms) {
    a.SetTorque(circle.At(ms * 1e-3));
    b.SetTorque(circle.At(ms * 1e-3));
    a.Advance(kNsPerMs);
    advance_b(b);
    for (std::size_t j = 0; j < 3; ++j) {
      sum.cell_N += square(a.tendon()[j].tension_motor_N - b.tendon()[j].tension_motor_N) / 3;
      sum.count +=
          square(counts_per_rad * (a.tendon()[j].motor_angle_rad - b.tendon()[j].motor_angle_rad)) / 3;
    }
    sum.tip_m += (a.TipPose().p_WA - b.TipPose().p_WA).squaredNorm() / 3;
  }
  return {std::sqrt(sum.cell_N / milliseconds), std::sqrt(sum.count / milliseconds),
          std::sqrt(sum.tip_m / milliseconds)};
}

TEST(PlantTolerance, HalvingItChangesNoSensorByATwentiethOfItsNoise) {
  const RobotParameters robot = Rig();
  const PlantOptions defaults;
  Plant plant(robot, defaults);
  Plant finer(robot, {.relative_tolerance = 0.5 * defaults.relative_tolerance,
                      .absolute_tolerance = 0.5 * defaults.absolute_tolerance});
  const Channels change =
      Difference(plant, finer, test::CircleTorque(robot), 6000, [](Plant& p) { p.Advance(kNsPerMs); });
  EXPECT_LT(change.cell_N, 0.05 * kCellNoise_N);
  EXPECT_LT(change.count, 0.05);  // of the encoder's step
  EXPECT_LT(change.tip_m, 0.05 * kTrackerNoise_m);
  EXPECT_GT(change.cell_N, 1e-9);  // the tolerance does act
}

// In real time the plant is advanced whenever frames arrive, in uneven pieces.
TEST(PlantTolerance, PiecesOfACycleGiveTheSameMotion) {
  const RobotParameters robot = Rig();
  Plant plant(robot), pieces(robot);
  const Channels change = Difference(plant, pieces, test::CircleTorque(robot), 3000, [](Plant& p) {
    for (const TimeNs us : {7, 130, 3, 560, 300}) p.Advance(us * kNsPerUs);
  });
  EXPECT_LT(change.cell_N, 0.2 * kCellNoise_N);
  EXPECT_LT(change.count, 0.2);
  EXPECT_LT(change.tip_m, 0.2 * kTrackerNoise_m);
}

TEST(PlantCost, OneCycleTakesFewStepsAndEvaluations) {
  const RobotParameters robot = Rig();
  const test::CircleTorque circle(robot);
  Plant plant(robot);
  for (int ms = 0; ms < 4000; ++ms) {
    plant.SetTorque(circle.At(ms * 1e-3));
    plant.Advance(kNsPerMs);
  }
  const auto c = plant.counters();
  EXPECT_LT(static_cast<double>(c.solver_steps) / 4000, 2.6);
  EXPECT_LT(static_cast<double>(c.rhs_evaluations) / 4000, 3.6);
  EXPECT_LT(static_cast<double>(c.jacobian_evaluations) / 4000, 0.02);
}

TEST(PlantManyTendons, TendonOfTheSecondSectionBendsBoth) {
  const RobotParameters robot = Rig("two_section");
  ASSERT_EQ(robot.body.tendons(), 6);
  Plant plant(robot);
  Eigen::VectorXd torque = Holding(robot);
  Hold(plant, torque, 300);
  EXPECT_LT(plant.q().norm(), 1e-6);
  torque[3] = 0.002;  // first tendon of section 2
  Hold(plant, torque, 1000);
  Eigen::VectorXd bend(4);
  plant.body().SumBending(plant.q(), bend);
  const double angle = robot.body.sections[1].tendons[0].angle_rad;
  const Eigen::Vector2d towards(std::cos(angle), std::sin(angle));
  EXPECT_GT(bend.head(2).dot(towards), 0.05);
  EXPECT_GT(bend.tail(2).dot(towards), 0.05);
  EXPECT_GT(plant.tendon()[3].tension_base_N, 1);
}

TEST(PlantManyTendons, SixteenTendonsOnFourSections) {
  RobotParameters robot = Rig();
  SectionParameters section = robot.body.sections[0];
  section.units = 3;
  section.tendons.clear();
  for (int i = 0; i < 4; ++i) section.tendons.push_back({0.1 + i * std::numbers::pi / 2, 0.004});
  robot.body.sections.assign(4, section);
  for (auto& s : robot.body.sections) s.youngs_modulus_Pa *= 8;  // 270 mm upright would buckle
  robot.actuation->tendons.assign(16, robot.actuation->tendons[0]);
  Plant plant(robot);
  Eigen::VectorXd torque = Holding(robot);
  Hold(plant, torque, 100);
  EXPECT_LT(plant.q().norm(), 1e-6);
  for (int j = 0; j < 16; j += 5) torque[j] = 0.0012;
  Hold(plant, torque, 1000);
  EXPECT_TRUE(plant.q().allFinite());
  for (int j = 0; j < 16; j += 5) EXPECT_GT(plant.tendon()[static_cast<std::size_t>(j)].tension_motor_N, 0.8);
  EXPECT_EQ(plant.ReadSensors().size(), 16u);
}

}  // namespace
}  // namespace tendril::sim
