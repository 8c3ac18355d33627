// Each cut of the replay, fed with the plant's own signals, gives the plant's signals behind it: for the
// nominal rig, for other robots, for every effect, from either kind of start; and nonsense is refused or
// survived.
#include "tendril/sim/replay.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <thread>

#include "recording.h"

namespace tendril::sim {
namespace {

using test::Record;
using test::Recording;
using test::Rig;
using test::Rms;
using testing::HasSubstr;
using testing::ThrowsMessage;

constexpr double kPermille_Nm = 7.056e-6;

/// rms of what replay gives less what the plant did, from sample `from` on.
struct Misfit {
  double torque_Nm, from_torque_N, from_stretch_N, base_N, tip_m, turn_rad, shortening_m;
};

Misfit Compare(const Recording& r, const Replay& replay, Replay::DrivenBy driven_by, int from = 0) {
  const auto late = [&](const Eigen::MatrixXd& x) { return x.bottomRows(x.rows() - from); };
  const ReplaySignals& s = r.signals;
  const BodyMotion body = replay.Body(s, driven_by);
  return {Rms(late(replay.ActualTorque(s) - s.torque_actual_Nm)),
          Rms(late(replay.CellFromTorque(s, r.shortening_m) - s.tension_N)),
          Rms(late(replay.CellFromStretch(s, r.shortening_m) - s.tension_N)),
          Rms(late(body.tension_base_N - r.tension_base_N)),
          Rms(late(body.tip_m - r.tip_m)),
          Rms(late(body.tip_rotation - r.tip_rotation)),
          Rms(late(body.shortening_m - r.shortening_m))};
}

void Print(const std::string& what, const Misfit& m) {
  std::printf(
      "%-34s C1 %.4f permille, C2 %5.2f mN, C3 %5.2f mN, base %5.2f mN, tip %6.2f um %6.3f mrad, d %6.3f "
      "um\n",
      what.c_str(), m.torque_Nm / kPermille_Nm, 1e3 * m.from_torque_N, 1e3 * m.from_stretch_N, 1e3 * m.base_N,
      1e6 * m.tip_m, 1e3 * m.turn_rad, 1e6 * m.shortening_m);
}

void ExpectTheCutsToFit(const Misfit& m) {
  EXPECT_LT(m.torque_Nm, 0.1 * kPermille_Nm);
  EXPECT_LT(m.from_torque_N, 0.010);
  EXPECT_LT(m.from_stretch_N, 0.005);
}

Recording RobotSide(Recording r) {
  r.signals.load_cell = LoadCellPlace::kRobotSide;
  r.signals.tension_N = r.tension_base_N;
  return r;
}

class ReplayOfThePlant : public testing::TestWithParam<bool> {};

TEST_P(ReplayOfThePlant, EveryCutGivesWhatThePlantDid) {
  const RobotParameters robot = Rig();
  const Replay replay(robot);
  const Recording r = Record(robot, GetParam() ? test::Multisine(robot) : test::Triangles(robot), 6000);
  EXPECT_GT((r.tip_m.colwise().maxCoeff() - r.tip_m.colwise().minCoeff()).maxCoeff(), 0.03);

  const Misfit cell = Compare(r, replay, Replay::DrivenBy::kCell);
  Print("driven by cells", cell);
  ExpectTheCutsToFit(cell);
  EXPECT_LT(cell.tip_m, 1e-5);

  const Misfit motor = Compare(r, replay, Replay::DrivenBy::kMotor);
  Print("driven by motors", motor);
  EXPECT_LT(motor.tip_m, 1e-5);

  // What is left is what C2 left, some mN.
  const Misfit torque = Compare(r, replay, Replay::DrivenBy::kTorque);
  Print("driven by torques", torque);
  EXPECT_LT(torque.tip_m, 4e-5);

  const Misfit beyond = Compare(RobotSide(r), replay, Replay::DrivenBy::kCell);
  Print("driven by cells beyond the pulleys", beyond);
  ExpectTheCutsToFit(beyond);
  EXPECT_LT(beyond.tip_m, 1e-5);
}
INSTANTIATE_TEST_SUITE_P(SlowAndFast, ReplayOfThePlant, testing::Bool(),
                         [](const auto& with) { return with.param ? "multisine" : "triangles"; });

TEST(ReplayOfOtherRobots, FourTendonsTwoSectionsAndAllStrains) {
  for (const char* file : {"four_tendon_90mm", "two_section", "rod_90mm"}) {
    const RobotParameters robot = Rig(file);
    const Recording r = Record(robot, test::Multisine(robot), 3000);
    for (const auto by : {Replay::DrivenBy::kCell, Replay::DrivenBy::kMotor}) {
      const Misfit m = Compare(r, Replay(robot), by);
      Print(file, m);
      ExpectTheCutsToFit(m);
      EXPECT_LT(m.tip_m, 2e-5);
    }
  }
}

class ReplayOfEffect : public testing::TestWithParam<const Effect*> {};

// With the effect every cut fits as it does without any; the nominal replay misses it somewhere.
TEST_P(ReplayOfEffect, IsInItsCut) {
  const Effect& effect = *GetParam();
  const RobotParameters nominal = Rig();
  RobotParameters robot = nominal;
  EffectSetting setting{std::string(effect.name), effect.on_all ? "all" : TargetText(effect, 1), {}};
  for (const auto& p : effect.parameters) {
    if (!p.shape) setting.values.emplace_back(p.name, p.nominal + p.typical);
  }
  robot.effects.push_back(setting);
  const Recording r = Record(robot, test::Multisine(nominal), 1500);
  // What the start leaves in memories fades with the first motion.
  const Misfit with = Compare(r, Replay(robot), Replay::DrivenBy::kCell, 700);
  Print(std::string(effect.name), with);
  ExpectTheCutsToFit(with);
  EXPECT_LT(with.tip_m, 2e-5);

  const Misfit without = Compare(r, Replay(nominal), Replay::DrivenBy::kCell, 700);
  EXPECT_TRUE(without.torque_Nm > 2 * kPermille_Nm || without.from_torque_N > 0.02 ||
              without.from_stretch_N > 0.02 || without.tip_m > 1e-4);
}

std::vector<const Effect*> AllEffects() {
  std::vector<const Effect*> all;
  for (const Effect& effect : Effects()) all.push_back(&effect);
  return all;
}
INSTANTIATE_TEST_SUITE_P(Registry, ReplayOfEffect, testing::ValuesIn(AllEffects()),
                         [](const auto& with) { return std::string(with.param->name); });

// A robot that is bent at rest falls into its rest at once, held by motor friction; a log may begin with that
// or later. What the pulleys remember of it moves the tip by a millimetre until the motors turn.
TEST(ReplayStart, FromTheFallAndFromTheRestAfterIt) {
  for (const char* effect : {"precurvature u_rad=0.05 v_rad=0.02", "base_tilt x_rad=0.1"}) {
    RobotParameters robot = Rig();
    robot.effects.push_back(ParseEffect(effect, robot));
    for (const int hold_ms : {0, 1000}) {
      const Recording r = Record(robot, test::Triangles(robot), 1500, hold_ms);
      for (const auto by : {Replay::DrivenBy::kCell, Replay::DrivenBy::kMotor}) {
        const Misfit m = Compare(r, Replay(robot), by);
        Print(std::string(effect) + (hold_ms > 0 ? ", held" : ""), m);
        EXPECT_LT(m.tip_m, 1e-5) << effect << ", hold " << hold_ms << " ms";
      }
    }
  }
}

TEST(ReplayBending, ShorteningFollowsTheTrackerWhereTheModelIsWrong) {
  const RobotParameters robot = Rig();
  RobotParameters softer = robot;
  softer.body.sections[0].youngs_modulus_Pa *= 0.9;
  Recording r = Record(robot, test::Triangles(robot), 4000);
  const Replay replay(softer);
  const auto off = [&] {
    return Rms(replay.Body(r.signals, Replay::DrivenBy::kCell).shortening_m - r.shortening_m);
  };
  const double blind = off();
  EXPECT_GT(blind, 1e-4);

  const model::Body body(robot.body);
  r.signals.bending_rad.resize(r.q.rows(), 2);
  Eigen::VectorXd sum(2);
  for (int i = 0; i < r.q.rows(); ++i) {
    body.SumBending(r.q.row(i).transpose(), sum);
    r.signals.bending_rad.row(i) = sum.transpose();
  }
  const double seen = off();
  EXPECT_LT(seen, 0.05 * blind);

  // A tracker that looks away for a while; one that sees nothing at all.
  r.signals.bending_rad.middleRows(2500, 100).setConstant(NAN);
  EXPECT_LT(off(), 0.05 * blind);
  r.signals.bending_rad.setConstant(NAN);
  EXPECT_DOUBLE_EQ(off(), blind);
}

// What coarse steps leave out is nearly the same for two robots that differ a little: they rank candidates to
// within a fiftieth. The last sample lies beyond the last coarse step.
TEST(ReplayGrid, CoarseStepsKeepTheDifferenceOfTwoRobots) {
  const RobotParameters robot = Rig();
  const Recording r = Record(robot, test::Triangles(robot), 3000);
  RobotParameters stiff = robot;
  stiff.body.sections.front().youngs_modulus_Pa *= 1.05;
  const auto moved = [&](Replay::Steps steps) -> Eigen::MatrixXd {
    return Replay(stiff).Body(r.signals, Replay::DrivenBy::kCell, steps).tip_m -
           Replay(robot).Body(r.signals, Replay::DrivenBy::kCell, steps).tip_m;
  };
  const Eigen::MatrixXd fine = moved(Replay::Steps::kFine), coarse = moved(Replay::Steps::kCoarse);
  ASSERT_EQ(coarse.rows(), 3000);
  EXPECT_GT(Rms(fine), 1e-4);
  EXPECT_LT(Rms(coarse - fine), 0.02 * Rms(fine));
  EXPECT_GT(Rms(coarse - fine), 0);
}

TEST(ReplayGrid, CoarseGridsGiveTheSameMotion) {
  const RobotParameters robot = Rig();
  const Replay replay(robot);
  const Recording r = Record(robot, test::Triangles(robot), 3001);
  const BodyMotion all = replay.Body(r.signals, Replay::DrivenBy::kCell);

  ReplaySignals coarse = r.signals;
  coarse.step_s = 4e-3;
  for (auto* m : {&coarse.tension_N, &coarse.motor_angle_rad, &coarse.motor_velocity_radps}) {
    const Eigen::MatrixXd fine = *m;
    m->resize(751, fine.cols());
    for (int i = 0; i < 751; ++i) m->row(i) = fine.row(4 * i);
  }
  const BodyMotion slow = replay.Body(coarse, Replay::DrivenBy::kCell);
  double worst = 0;
  for (int i = 0; i < 751; ++i) {
    worst = std::max(worst, (slow.tip_m.row(i) - all.tip_m.row(4 * i)).norm());
  }
  EXPECT_LT(worst, 2e-4);
}

// The integrator resolves a bend of 1e-5 rad; over less than ten times the displacement that this makes at
// the holes its steps would not converge.
TEST(ReplayGrid, FrictionBuildsUpOverWhatTheIntegratorResolves) {
  const auto tip = [r = Record(Rig(), test::Triangles(Rig()), 1000)](double presliding_m) {
    RobotParameters robot = Rig();
    for (auto& t : robot.actuation->tendons) t.transmission.presliding_m = presliding_m;
    return Replay(robot).Body(r.signals, Replay::DrivenBy::kCell).tip_m;
  };
  const double least_m = 10 * 1e-5 * Rig().body.sections[0].tendons[0].radius_m;
  EXPECT_EQ(tip(1e-9), tip(least_m));
  EXPECT_NE(tip(least_m), tip(1.2 * least_m));
}

TEST(ReplayThreads, SeveralAtOnceGiveWhatOneGives) {
  const RobotParameters robot = Rig();
  RobotParameters other = robot;
  for (auto& t : other.actuation->tendons) t.transmission.pulleys[0].alpha *= 1.01;
  const Recording r = Record(robot, test::Triangles(robot), 1000);
  const Replay shared(robot);
  const Eigen::MatrixXd alone = shared.Body(r.signals, Replay::DrivenBy::kCell).tip_m;
  std::vector<Eigen::MatrixXd> tips(8);
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < tips.size(); ++i) {
    threads.emplace_back([&, i] {
      const Replay own(i % 2 ? other : robot);
      tips[i] = (i < 4 ? own : shared).Body(r.signals, Replay::DrivenBy::kCell).tip_m;
    });
  }
  for (auto& thread : threads) thread.join();
  for (const std::size_t i : {0, 2, 4, 5, 6, 7}) EXPECT_EQ(tips[i], alone);
  EXPECT_EQ(tips[1], tips[3]);
  EXPECT_NE(tips[1], alone);
}

TEST(ReplayInput, NonsenseIsRefusedWithWhatIsWrong) {
  const RobotParameters robot = Rig();
  EXPECT_THAT([] { Replay replay(Rig("qi2021_90mm")); },
              ThrowsMessage<std::invalid_argument>(HasSubstr("no actuation")));
  const Replay replay(robot);
  const Recording r = Record(robot, test::Triangles(robot), 50);
  const auto with = [&](auto change) {
    ReplaySignals s = r.signals;
    change(s);
    return [s, &replay] { replay.Body(s, Replay::DrivenBy::kCell); };
  };
  EXPECT_THAT(with([](ReplaySignals& s) { s.step_s = 0; }),
              ThrowsMessage<std::invalid_argument>(HasSubstr("step")));
  EXPECT_THAT(with([](ReplaySignals& s) { s.tension_N.resize(50, 2); }),
              ThrowsMessage<std::invalid_argument>(HasSubstr("tension is 50 x 2; needed 50 x 3")));
  EXPECT_THAT(with([](ReplaySignals& s) { s.tension_N.resize(0, 3); }),
              ThrowsMessage<std::invalid_argument>(HasSubstr("tension")));
  EXPECT_THAT(with([](ReplaySignals& s) { s.motor_angle_rad.resize(0, 0); }),
              ThrowsMessage<std::invalid_argument>(HasSubstr("motor")));
  EXPECT_THAT(with([](ReplaySignals& s) { s.motor_velocity_radps.resize(49, 3); }),
              ThrowsMessage<std::invalid_argument>(HasSubstr("motor velocity is 49 x 3")));
  EXPECT_THAT(with([](ReplaySignals& s) { s.bending_rad.setZero(49, 2); }),
              ThrowsMessage<std::invalid_argument>(HasSubstr("bending")));
  EXPECT_THAT(with([](ReplaySignals& s) { s.load_cell = LoadCellPlace::kNone; }),
              ThrowsMessage<std::invalid_argument>(HasSubstr("no load cell")));
  EXPECT_THAT(with([](ReplaySignals& s) { s.tension_N.col(1).setConstant(NAN); }),
              ThrowsMessage<std::runtime_error>(HasSubstr("tension of tendon 2 is nowhere known")));
  EXPECT_THAT([&] { replay.CellFromStretch(r.signals, {}); },
              ThrowsMessage<std::invalid_argument>(HasSubstr("shortening")));
}

TEST(ReplayInput, GapsAreBridged) {
  const RobotParameters robot = Rig();
  const Replay replay(robot);
  Recording r = Record(robot, test::Triangles(robot), 3000);
  for (auto* m : {&r.signals.tension_N, &r.signals.motor_angle_rad, &r.signals.torque_actual_Nm}) {
    for (int i = 5; i < 3000; i += 37) m->row(i).setConstant(i % 2 ? NAN : INFINITY);
    m->bottomRows(3).setConstant(NAN);
  }
  EXPECT_LT(Rms(replay.Body(r.signals, Replay::DrivenBy::kCell).tip_m - r.tip_m), 2e-5);
  EXPECT_TRUE(replay.CellFromTorque(r.signals, r.shortening_m).allFinite());
}

// A log may begin anywhere: until its first target acts, however late, a drive has what it reports.
TEST(ReplayInput, ADriveBeginsWithTheTorqueThatItReports) {
  RobotParameters robot = Rig();
  robot.effects.push_back(ParseEffect("command_delay s=0.0016", robot));
  const double lag_s = robot.actuation->tendons[0].motor.torque_lag_s, was_Nm = 3e-3, sent_Nm = 2e-3;
  ReplaySignals s;
  s.step_s = 1e-3;
  s.torque_target_Nm = Eigen::MatrixXd::Constant(8, 3, sent_Nm);
  s.torque_actual_Nm = Eigen::MatrixXd::Constant(8, 3, was_Nm);
  const Eigen::MatrixXd torque_Nm = Replay(robot).ActualTorque(s);
  for (int i = 0; i < 8; ++i) {
    const double since_s = 1e-3 * i - 2.6e-3;  // it acts a cycle and the delay after it was sent
    const double right_Nm = since_s < 0 ? was_Nm : sent_Nm + (was_Nm - sent_Nm) * std::exp(-since_s / lag_s);
    for (int j = 0; j < 3; ++j) EXPECT_NEAR(torque_Nm(i, j), right_Nm, 1e-12) << i;
  }
}

// Every third row of a log holds what the motors obeyed, where targets went straight between: on ramps.
TEST(ReplayInput, TargetsBetweenTheSamplesAreStraight) {
  const Replay replay(Rig());
  ReplaySignals every, third;
  every.step_s = 1e-3;
  third.step_s = 3e-3;
  third.commands_a_sample = 3;
  every.torque_target_Nm.resize(601, 3);
  for (int i = 0; i < 601; ++i) every.torque_target_Nm.row(i).setConstant(1e-5 * (i < 300 ? i : 600 - i));
  const auto rows = Eigen::seq(0, 600, 3);
  third.torque_target_Nm = every.torque_target_Nm(rows, Eigen::all);
  const Eigen::MatrixXd whole = replay.ActualTorque(every);
  EXPECT_LT(Rms(replay.ActualTorque(third) - whole(rows, Eigen::all)), 1e-3 * kPermille_Nm);
  third.commands_a_sample = 0;
  EXPECT_THROW(replay.ActualTorque(third), std::invalid_argument);
  third.commands_a_sample = 1;
  EXPECT_GT(Rms(replay.ActualTorque(third) - whole(rows, Eigen::all)), kPermille_Nm);
}

// Signals that no robot gives, on robots that cannot exist: the fit of a diagnosis passes through such
// values.
TEST(ReplayInput, WildSignalsOnWildRobotsGiveFiniteMotionOrAReason) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> one(0, 1);
  std::normal_distribution<double> normal;
  int finite = 0, refused = 0;
  for (int trial = 0; trial < 60; ++trial) {
    RobotParameters robot = Rig();
    auto& section = robot.body.sections[0];
    section.youngs_modulus_Pa *= std::pow(10, 2 * one(random) - 1.3);
    section.bending_damping_Nms *= trial % 5 ? 2 * one(random) : 0;
    section.unit_mass_kg *= std::pow(10, 2 * one(random) - 1);
    for (auto& t : robot.actuation->tendons) t.transmission.presliding_m *= std::pow(10, -one(random));
    ReplaySignals s;
    s.step_s = 1e-3;
    constexpr int kSamples = 400;
    for (auto* m : {&s.tension_N, &s.torque_actual_Nm, &s.motor_angle_rad, &s.motor_velocity_radps,
                    &s.motor_acceleration_radps2}) {
      m->setZero(kSamples, 3);
    }
    const double most_N = std::pow(10, 2 * one(random) - 0.5), noise = trial % 3 ? 0.01 : 1;
    for (int j = 0; j < 3; ++j) {
      double level = 0;
      for (int i = 0; i < kSamples; ++i) {
        if (i % 80 == 0) level = most_N * one(random);
        s.tension_N(i, j) = one(random) < 0.02 ? std::nan("") : level + noise * normal(random);
        s.motor_angle_rad(i, j) = 0.5 * level + 0.1 * noise * normal(random);
        s.motor_velocity_radps(i, j) = 10 * noise * normal(random);
        s.torque_actual_Nm(i, j) = level * 0.008 / 19;
      }
    }
    for (const auto by : {Replay::DrivenBy::kCell, Replay::DrivenBy::kTorque, Replay::DrivenBy::kMotor}) {
      try {
        const BodyMotion m = Replay(robot).Body(s, by);
        EXPECT_TRUE(m.tip_m.allFinite() && m.tip_rotation.allFinite() && m.shortening_m.allFinite() &&
                    m.tension_base_N.allFinite());
        ++finite;
      } catch (const std::runtime_error& e) {
        EXPECT_THAT(e.what(), HasSubstr("replay: the body has"));
        ++refused;
      }
    }
  }
  std::printf("%d finite, %d refused\n", finite, refused);
  EXPECT_GT(finite, 20 * refused);
}

}  // namespace
}  // namespace tendril::sim
