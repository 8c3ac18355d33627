// Homing on the plant: slack tendons wound in gently and zeroed at pretension, and each thing that can keep a
// tendon from it named; the rules of safety_rig.h hold in every cycle.
#include <gtest/gtest.h>

#include "safety_rig.h"

namespace tendril::daemon {
namespace {

SafetyOptions Rig() {
  SafetyOptions o;
  const std::string config = std::string(TENDRIL_SOURCE_DIR) + "/config/";
  o.daemon = config::LoadDaemon(config + "tendrild.yaml");
  o.robot = config::LoadRobot(config + "robots/rig_60mm.yaml");
  o.plant = o.robot;
  return o;
}

SafetyOptions WithSlack(double m1, double m2, double m3) {
  SafetyOptions o = Rig();
  for (const auto& [where, m] : {std::pair{"tendon:1", m1}, {"tendon:2", m2}, {"tendon:3", m3}}) {
    if (m > 0) o.plant.effects.push_back({.name = "slack", .where = where, .values = {{"m", m}}});
  }
  return o;
}

void ExpectNoViolations(const SafetyRig& r) {
  for (const std::string& v : r.violations()) ADD_FAILURE() << v;
}

bool Home(SafetyRig& r, double seconds = 40) {
  if (!r.RunUntil(Mode::kConfigured, 10)) return false;
  r.Step(r.Request(ModeRequest::kHome));
  if (r.output().mode != Mode::kHoming) return false;
  for (const double end_s = r.now_s() + seconds; r.now_s() < end_s && r.output().mode == Mode::kHoming;)
    r.Step();
  return r.output().mode == Mode::kHold;
}

struct Slack {
  double m1, m2, m3;
};
class Homing : public testing::TestWithParam<Slack> {};

TEST_P(Homing, FindsSlackGentlyAndZeroesAtPretension) {
  const Slack s = GetParam();
  const SafetyOptions o = WithSlack(s.m1, s.m2, s.m3);
  SafetyRig r(o);
  ASSERT_TRUE(r.RunUntil(Mode::kConfigured, 10));
  std::array<double, 3> start_m{}, last_m{};
  for (std::size_t j = 0; j < 3; ++j) start_m[j] = last_m[j] = r.rig().plant().tendon()[j].spool_pull_m;
  r.Step(r.Request(ModeRequest::kHome));
  double fastest_mps = 0, highest_N = 0;
  while (r.output().mode == Mode::kHoming && r.now_s() < 60) {
    r.Step();
    for (std::size_t j = 0; j < 3; ++j) {
      const auto& t = r.rig().plant().tendon()[j];
      fastest_mps = std::max(fastest_mps, std::abs(t.spool_pull_m - last_m[j]) / 1e-3);
      highest_N = std::max(highest_N, t.tension_motor_N);
      last_m[j] = t.spool_pull_m;
    }
  }
  ASSERT_EQ(r.output().mode, Mode::kHold)
      << StatusText(r.output().status) << ", tendon " << r.output().blamed_tendon;
  EXPECT_LT(fastest_mps, 1.5 * o.daemon.controller.take_up.max_speed_mps);
  EXPECT_LT(highest_N, o.daemon.controller.take_up.pull_N);
  r.Step();
  const double wound_m[] = {s.m1, s.m2, s.m3};
  for (std::size_t j = 0; j < 3; ++j) {
    const auto& t = r.rig().plant().tendon()[j];
    EXPECT_NEAR(t.tension_motor_N, o.robot.limits.min_tension_N, 0.15) << "tendon " << j + 1;
    EXPECT_NEAR(t.spool_pull_m - start_m[j], wound_m[j], 2e-4) << "tendon " << j + 1;
    EXPECT_NEAR(r.output().displacement_m[static_cast<Eigen::Index>(j)], 0, 1e-5) << "zeroed";
  }
  const Eigen::Vector3d tip = r.rig().plant().TipPose().p_WA;
  EXPECT_LT(tip.head<2>().norm(), 1.5e-3) << "the robot is straight";
  std::printf("slack %.1f %.1f %.1f mm: homed in %.1f s, at most %.1f mm/s and %.2f N; tip off by %.2f mm\n",
              1e3 * s.m1, 1e3 * s.m2, 1e3 * s.m3, r.now_s(), 1e3 * fastest_mps, highest_N,
              1e3 * tip.head<2>().norm());

  // It holds and takes no target before it is armed; then it follows.
  EXPECT_EQ(r.Step(r.Bend(0.3, 0)).output.command_status, Status::kCommandWrongMode);
  r.Step(r.Request(ModeRequest::kArm));
  ASSERT_EQ(r.output().mode, Mode::kRunning);
  for (int i = 0; i < 2500; ++i) {
    r.Step(i % 10 == 0 ? r.Circle(std::min(1., i * 1e-3), 0.5, i * 1e-3) : Command{});
    ASSERT_EQ(r.output().mode, Mode::kRunning) << StatusText(r.output().status);
  }
  ExpectNoViolations(r);
}

INSTANTIATE_TEST_SUITE_P(All, Homing,
                         testing::Values(Slack{0, 0, 0}, Slack{0, 0.004, 0}, Slack{0.005, 0.001, 0.003}));

struct Trouble {
  const char* name;
  rig::Wiring wiring;
  double slack_m;
  Status status;
};
class HomingTrouble : public testing::TestWithParam<Trouble> {};

TEST_P(HomingTrouble, IsNamedWithItsTendonAndNothingStaysPowered) {
  const Trouble& t = GetParam();
  SafetyRig r(WithSlack(0, t.slack_m, 0));
  r.rig().Connect(1, t.wiring);
  EXPECT_FALSE(Home(r));
  EXPECT_EQ(r.output().mode, Mode::kFault);
  EXPECT_EQ(r.output().status, t.status) << StatusText(r.output().status);
  EXPECT_EQ(r.output().blamed_tendon, 2);
  r.Run(2);
  for (int d = 0; d < 3; ++d) EXPECT_FALSE(r.rig().drives().enabled(d));
  ExpectNoViolations(r);
}

const Trouble kTroubles[] = {
    {"TendonBroken", {.tendon_off = true}, 0, Status::kTendonBroken},
    {"Jammed", {.jammed = true}, 0.003, Status::kTendonJammed},
    {"CellDead", {.cell_gain = 0}, 0.003, Status::kCellDead},
    {"CellDeadOnATautTendon", {.cell_gain = 0}, 0, Status::kCellDead},
    {"MotorReversed", {.motor_reversed = true}, 0.003, Status::kTravelOverLimit},
};
INSTANTIATE_TEST_SUITE_P(All, HomingTrouble, testing::ValuesIn(kTroubles),
                         [](const auto& c) { return std::string(c.param.name); });

// Drives need some cycles to go off; whoever asks for power again in the very cycle of configured, as a
// script does, must not find them in fault for it.
class AtOnceAfterDisarm : public testing::TestWithParam<ModeRequest> {};

TEST_P(AtOnceAfterDisarm, DrivesGoOffFirstAndThenOn) {
  SafetyRig r(Rig());
  ASSERT_TRUE(r.RunUntil(Mode::kConfigured, 10));
  // These answer a SYNC with what they did after the one before.
  r.Order({.kind = FaultKind::kDelay, .direction = FrameDirection::kFromDrives, .delay_s = 0.0009});
  for (int again = 0; again < 3; ++again) {
    r.Step(r.Request(ModeRequest::kCommission));
    r.Run(0.2);
    r.Step(r.Request(ModeRequest::kDisarm));
    ASSERT_EQ(r.output().mode, Mode::kSafeStop);
    ASSERT_EQ(r.Step().output.mode, Mode::kConfigured) << StatusText(r.output().status);
    ASSERT_EQ(r.record().input.drive[0].state, DriveState::kEnabled);
    r.Step(r.Request(GetParam()));
    if (GetParam() == ModeRequest::kCommission) {
      r.Run(0.5);
      EXPECT_EQ(r.output().mode, Mode::kCommissioning) << StatusText(r.output().status);
      r.Step(r.Request(ModeRequest::kDisarm));
      r.Run(0.1);
    } else {
      EXPECT_TRUE(r.RunUntil(GetParam() == ModeRequest::kArm ? Mode::kRunning : Mode::kHold, 40))
          << ModeText(r.output().mode) << ": " << StatusText(r.output().status);
      r.Step(r.Request(ModeRequest::kDisarm));
      ASSERT_TRUE(r.RunUntil(Mode::kConfigured, 10)) << StatusText(r.output().status);
    }
  }
  ExpectNoViolations(r);
}

INSTANTIATE_TEST_SUITE_P(All, AtOnceAfterDisarm,
                         testing::Values(ModeRequest::kArm, ModeRequest::kHome, ModeRequest::kCommission),
                         [](const auto& tested) {
                           return tested.param == ModeRequest::kArm    ? "Arm"
                                  : tested.param == ModeRequest::kHome ? "Home"
                                                                       : "Commission";
                         });

TEST(HomingEnds, OnDisarmAndByItsTimeLimit) {
  SafetyRig r(WithSlack(0.005, 0, 0));
  ASSERT_TRUE(r.RunUntil(Mode::kConfigured, 10));
  r.Step(r.Request(ModeRequest::kHome));
  r.Run(1.2);
  ASSERT_EQ(r.output().mode, Mode::kHoming);
  r.Step(r.Request(ModeRequest::kDisarm));
  EXPECT_TRUE(r.RunUntil(Mode::kConfigured, 2));
  ExpectNoViolations(r);

  SafetyOptions o = WithSlack(0.005, 0, 0);
  o.daemon.controller.take_up.timeout_s = 1;
  SafetyRig late(o);
  EXPECT_FALSE(Home(late));
  EXPECT_EQ(late.output().status, Status::kHomingTimedOut);
  ExpectNoViolations(late);
}

}  // namespace
}  // namespace tendril::daemon
