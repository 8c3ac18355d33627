// Bounds and sizes of effects on robots of other sizes than the rig: they follow the robot by the dimension
// of their unit, and nothing of them is an absolute number.
#include "tendril/sim/yardstick.h"

#include <fmt/core.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <map>
#include <optional>

#include "motions.h"
#include "tendril/sim/effects.h"
#include "tendril/sim/plant.h"

namespace tendril::sim {
namespace {

RobotParameters Sized(const char* file) {
  return config::LoadRobot(std::string(TENDRIL_SOURCE_DIR "/tests/support/robots/") + file);
}

Target Somewhere(const Effect& effect) { return effect.on_all ? Target{} : Target{0}; }

std::vector<EffectParameter> On(std::string_view name, const RobotParameters& robot) {
  const Effect& effect = *FindEffect(name);
  return ParametersOf(effect, Somewhere(effect), robot);
}

TEST(Yardstick, TheRegistryHoldsTheReferenceRig) {
  const RobotParameters rig = test::Rig("rig_90mm");
  for (const Effect& effect : Effects()) {
    const Target places[] = {std::nullopt, 0, 2};
    for (const Target& place : places) {
      if (place ? !effect.on_one : !effect.on_all) continue;
      if (effect.scope == Scope::kSection && place == Target{2}) continue;
      const auto parameters = ParametersOf(effect, place, rig);
      for (std::size_t k = 0; k < effect.parameters.size(); ++k) {
        const EffectParameter &is = parameters[k], &held = effect.parameters[k];
        SCOPED_TRACE(fmt::format("{}.{}", effect.name, is.name));
        EXPECT_EQ(is.nominal, held.nominal);
        EXPECT_EQ(is.lower, held.lower);
        EXPECT_EQ(is.upper, held.upper);
        EXPECT_EQ(is.typical, held.typical);
        EXPECT_EQ(is.starts, held.starts);
      }
    }
  }
}

/// The robot as it would read in other units of length and mass: a length of 1 becomes `length`.
RobotParameters InUnits(RobotParameters robot, double length, double mass) {
  const double force = mass * length, torque = force * length;
  BodyParameters& body = robot.body;
  body.gravity_W_mps2 *= length;
  for (SectionParameters& s : body.sections) {
    s.unit_length_m *= length;
    s.unit_mass_kg *= mass;
    s.disk_inertia_xx_kgm2 *= mass * length * length;
    s.disk_inertia_zz_kgm2 *= mass * length * length;
    s.youngs_modulus_Pa *= force / (length * length);
    s.core_radius_m *= length;
    s.bending_damping_Nms *= torque;
    for (TendonRoute& route : s.tendons) route.radius_m *= length;
  }
  for (double* limit :
       {&robot.limits.min_tension_N, &robot.limits.max_tension_base_N, &robot.limits.max_tension_motor_N})
    *limit *= force;
  for (TendonDriveParameters& t : robot.actuation->tendons) {
    t.motor.torque_constant_NmpA *= torque;
    t.motor.rotor_inertia_kgm2 *= mass * length * length;
    t.motor.coulomb_friction_Nm *= torque;
    t.motor.viscous_friction_Nms *= torque;
    t.drive.rated_torque_Nm *= torque;
    t.spool.radius_m *= length;
    t.tendon.stiffness_Npm *= mass;
    t.tendon.damping_Nspm *= mass;
    t.tendon.free_length_m *= length;
    t.transmission.presliding_m *= length;
    t.transmission.low_tension_N *= force;
  }
  return robot;
}

/// What a parameter's value becomes in these units, by the unit at its name's end; times and currents stay.
std::optional<double> FactorOf(const std::string& name, double length, double mass) {
  const std::pair<const char*, double> ends[] = {{"rad_per_m", 1 / length},
                                                 {"m_per_rad", length},
                                                 {"N_per_s", mass * length},
                                                 {"_Npm", mass},
                                                 {"_Nm", mass * length * length},
                                                 {"_kg", mass},
                                                 {"_N", mass * length},
                                                 {"_m", length},
                                                 {"_radps", 1},
                                                 {"_rad", 1},
                                                 {"_s", 1},
                                                 {"per_turn", 1}};
  for (const auto& [end, factor] : ends) {
    if (name.ends_with(end)) return factor;
  }
  const std::map<std::string, double> whole{{"m", length},   {"N", mass * length}, {"rad", 1},
                                            {"s", 1},        {"scale", 1},         {"mu", 1},
                                            {"fraction", 1}, {"softening", 1},     {"spread", 1},
                                            {"compliance", 1}, {"shortening", 1}};
  const auto found = whole.find(name);
  return found == whole.end() ? std::nullopt : std::optional(found->second);
}

void ExpectTimes(double value, double factor, double was, const char* what) {
  // Three digits on both sides.
  EXPECT_NEAR(value, factor * was, 0.011 * std::abs(factor * was)) << what;
}

// An absolute constant among bounds, typical deviations or starts would stay where the units change.
TEST(Yardstick, WhatAnEffectMayBeFollowsTheDimensionOfItsUnit) {
  for (const char* file : {"small_30mm.yaml", "large_2m.yaml"}) {
    const RobotParameters robot = Sized(file);
    for (const auto& [length, mass] : {std::pair{3.7, 1.0}, std::pair{1.0, 0.23}, std::pair{0.19, 41.0}}) {
      const RobotParameters other = InUnits(robot, length, mass);
      for (const Effect& effect : Effects()) {
        const auto here = ParametersOf(effect, Somewhere(effect), robot);
        const auto there = ParametersOf(effect, Somewhere(effect), other);
        ASSERT_EQ(here.size(), there.size());
        for (std::size_t k = 0; k < here.size(); ++k) {
          SCOPED_TRACE(fmt::format("{}: {}.{}", file, effect.name, here[k].name));
          const auto factor = FactorOf(here[k].name, length, mass);
          ASSERT_TRUE(factor) << "a unit that this test does not know";
          ExpectTimes(there[k].nominal, *factor, here[k].nominal, "nominal");
          ExpectTimes(there[k].lower, *factor, here[k].lower, "lower");
          ExpectTimes(there[k].upper, *factor, here[k].upper, "upper");
          ExpectTimes(there[k].typical, *factor, here[k].typical, "typical");
          ASSERT_EQ(there[k].starts.size(), here[k].starts.size());
          for (std::size_t i = 0; i < here[k].starts.size(); ++i)
            ExpectTimes(there[k].starts[i], *factor, here[k].starts[i], "start");
        }
      }
    }
  }
}

// The registry's own rules hold on every size.
TEST(Yardstick, StartsAndTypicalDeviationsLieWithinTheBounds) {
  for (const char* file : {"small_30mm.yaml", "large_2m.yaml"}) {
    const RobotParameters robot = Sized(file);
    for (const Effect& effect : Effects()) {
      for (const EffectParameter& p : ParametersOf(effect, Somewhere(effect), robot)) {
        SCOPED_TRACE(fmt::format("{}: {}.{}", file, effect.name, p.name));
        EXPECT_TRUE(p.lower <= p.nominal && p.nominal <= p.upper);
        EXPECT_LE(p.nominal + p.typical, p.upper);
        EXPECT_TRUE(p.shape || p.typical > 0);
        for (const double start : p.starts) EXPECT_TRUE(start >= p.lower && start <= p.upper) << start;
      }
    }
  }
}

TEST(Yardstick, BoundsReachWhatSuchARobotMayMeet) {
  const RobotParameters small = Sized("small_30mm.yaml"), large = Sized("large_2m.yaml");
  // Loads of some times the robot's own weight, and none of hundreds of times.
  EXPECT_GT(On("tip_payload", large)[0].upper, 5);
  EXPECT_LT(On("tip_payload", large)[0].upper, 100);
  EXPECT_GT(On("tip_payload", small)[0].upper, 1e-3);
  EXPECT_LT(On("tip_payload", small)[0].upper, 0.1);
  EXPECT_GT(On("tip_force", large)[0].upper, 49);
  // Tendons may be off by a good part of what a bend takes, and no more than that.
  EXPECT_GT(On("slack", large)[0].upper, 0.02);
  EXPECT_LT(On("slack", small)[0].upper, 0.003);
  EXPECT_GT(On("backbone_hysteresis", large)[0].upper, 1);
  EXPECT_LT(On("backbone_hysteresis", small)[0].upper, 0.002);
  for (const char* text : {"tip_payload mass_kg=0.3", "tip_force x_N=10", "slack m=0.02", "cell_offset N=50",
                           "backbone_hysteresis moment_Nm=1", "encoder_offset rad=20"}) {
    EXPECT_NO_THROW(ParseEffect(text, large)) << text;
    EXPECT_THROW(ParseEffect(text, small), std::invalid_argument) << text;
  }
}

/// How far the tip rests from where it does without the effect, over the robot's length, all tendons at their
/// least tension and held there.
double TipMoved(const RobotParameters& robot, const std::string& effect) {
  RobotParameters with = robot;
  with.effects = {ParseEffect(effect, with)};
  const auto rests_at = [](const RobotParameters& r) {
    Plant plant(r, {.sensor_noise = false});
    Eigen::VectorXd torque_Nm(plant.tendons());
    for (int j = 0; j < plant.tendons(); ++j)
      torque_Nm[j] =
          r.limits.min_tension_N * r.actuation->tendons[static_cast<std::size_t>(j)].SpoolTravelPerMotorRad();
    plant.SetTorque(torque_Nm);
    for (int i = 0; i < 100; ++i) plant.Advance(20 * kNsPerMs);
    return plant.TipPose().p_WA;
  };
  return (rests_at(with) - rests_at(robot)).norm() / robot.body.length_m();
}

// What is called plainly visible is that, and leaves the robot in the small motions that a diagnosis is of,
// whether or not its own weight holds it up.
TEST(Yardstick, AVisibleForceMovesTheTipByAFewPerCentOfTheLength) {
  RobotParameters hanging = Sized("large_2m.yaml");
  hanging.body.gravity_W_mps2 *= -1;
  for (const RobotParameters& robot :
       {test::Rig("rig_90mm"), Sized("small_30mm.yaml"), Sized("large_2m.yaml"), hanging}) {
    const double typical_N = On("tip_force", robot)[0].typical;
    SCOPED_TRACE(fmt::format("{}: {} N", robot.name, typical_N));
    const double moved = TipMoved(robot, fmt::format("tip_force x_N={}", typical_N));
    EXPECT_GT(moved, 0.01);
    EXPECT_LT(moved, 0.1);
  }
}

// A section's own stiffness and a tendon's own travel count at their place.
TEST(Yardstick, APlaceHasItsOwn) {
  RobotParameters robot = test::Rig("two_section");
  robot.body.sections[1].youngs_modulus_Pa *= 0.25;
  const auto moment = [&](Target target) {
    return ParametersOf(*FindEffect("backbone_hysteresis"), target, robot)[0].upper;
  };
  const double ratio = robot.body.sections[1].UnitStiffness() / robot.body.sections[1].units /
                       (robot.body.sections[0].UnitStiffness() / robot.body.sections[0].units);
  EXPECT_NEAR(moment(1) / moment(0), ratio, 0.01 * ratio);
  EXPECT_NEAR(moment({}), 0.5 * (moment(0) + moment(1)), 0.01 * moment({}));
  const Effect& slack = *FindEffect("slack");
  EXPECT_GT(ParametersOf(slack, robot.body.tendons() - 1, robot)[0].upper,
            1.5 * ParametersOf(slack, 0, robot)[0].upper);
}

// Pulls each tendon in turn to half of what it may have, in half a second.
Eigen::MatrixXd MotionOf(const RobotParameters& robot) {
  Plant plant(robot, {.sensor_noise = false});
  constexpr int kSteps = 250;
  const int n = plant.body().dof(), m = plant.tendons();
  Eigen::MatrixXd motion(kSteps, n + 2 * m);
  for (int i = 0; i < kSteps; ++i) {
    Eigen::VectorXd torque(m);
    for (int j = 0; j < m; ++j) {
      const auto& drive = robot.actuation->tendons[static_cast<std::size_t>(j)];
      const double pull_N =
          i / 80 % m == j ? 0.5 * robot.limits.max_tension_base_N : robot.limits.min_tension_N;
      torque[j] = pull_N * drive.SpoolTravelPerMotorRad();
    }
    plant.SetTorque(torque);
    plant.Advance(2 * kNsPerMs);
    motion.row(i).head(n) = plant.q().transpose();
    for (int j = 0; j < m; ++j) {
      const TendonState& tendon = plant.tendon()[static_cast<std::size_t>(j)];
      motion(i, n + 2 * j) = tendon.motor_angle_rad;
      motion(i, n + 2 * j + 1) = tendon.tension_motor_N / robot.limits.max_tension_base_N;
    }
  }
  return motion;
}

TEST(Yardstick, EffectsAtZeroAreTheNominalRobotOnEverySize) {
  for (const char* file : {"small_30mm.yaml", "large_2m.yaml"}) {
    const RobotParameters robot = Sized(file);
    const Eigen::MatrixXd nominal = MotionOf(robot);
    ASSERT_TRUE(nominal.allFinite());
    EXPECT_GT(nominal.leftCols(2).cwiseAbs().maxCoeff(), 0.01) << "it moves";
    for (const Effect& effect : Effects()) {
      SCOPED_TRACE(fmt::format("{}: {}", file, effect.name));
      EffectSetting at_zero{std::string(effect.name), TargetText(effect, Somewhere(effect)), {}};
      for (const EffectParameter& p : ParametersOf(effect, Somewhere(effect), robot))
        at_zero.values.emplace_back(p.name, p.nominal);
      RobotParameters with = robot;
      with.effects = {at_zero};
      EXPECT_LT((MotionOf(with) - nominal).cwiseAbs().maxCoeff(), 1e-6);
    }
  }
}

}  // namespace
}  // namespace tendril::sim
