// The gate admits exactly what is finite, in range, fresh, in order and fits the mode, and says why it
// refuses.
#include "tendril/control/gate.h"

#include <gtest/gtest.h>

#include <limits>

#include "tendril/config/config.h"

namespace tendril::control {
namespace {

class GateTest : public testing::Test {
 protected:
  GateTest()
      : robot(config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_60mm.yaml")), gate(robot, 0.5, 2) {}

  Command Tip(double x, double y, double z) {
    Command c;
    c.kind = CommandKind::kTip;
    c.sequence = ++sequence;
    c.received_ns = now;
    c.valid_for_ns = 100 * kNsPerMs;
    c.tip_W_m = {x, y, z};
    return c;
  }
  Command ModeCommand(ModeRequest m) {
    Command c = Tip(0, 0, 0.06);
    c.kind = CommandKind::kMode;
    c.mode = m;
    return c;
  }
  Command Bending(int values) {
    Command c = Tip(0, 0, 0.06);
    c.kind = CommandKind::kBending;
    c.bending_rad = BendingVector::Zero(values);
    return c;
  }

  RobotParameters robot;
  CommandGate gate;
  TimeNs now = kNsPerS;
  std::uint32_t sequence = 0;
};

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

TEST_F(GateTest, AdmitsAGoodTarget) {
  EXPECT_EQ(gate.Admit(Tip(0.01, 0, 0.055), Mode::kRunning, now), Status::kOk);
  EXPECT_EQ(gate.target().kind, CommandKind::kTip);
}

TEST_F(GateTest, RefusedTargetLeavesTheLastOneInPlace) {
  ASSERT_EQ(gate.Admit(Tip(0.01, 0, 0.055), Mode::kRunning, now), Status::kOk);
  ASSERT_NE(gate.Admit(Tip(kNan, 0, 0.055), Mode::kRunning, now), Status::kOk);
  EXPECT_EQ(gate.target().tip_W_m.x(), 0.01);
}

TEST_F(GateTest, RefusesWhatIsNotFinite) {
  for (double bad : {kNan, kInf, -kInf}) {
    EXPECT_EQ(gate.Admit(Tip(bad, 0, 0.05), Mode::kRunning, now), Status::kCommandNotFinite);
    Command c = Tip(0, 0, 0.05);
    c.tip_velocity_W_mps.y() = bad;
    EXPECT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kCommandNotFinite);
    c = Tip(0, 0, 0.05);
    c.speed_radps = bad;
    EXPECT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kCommandNotFinite);
    c = Bending(2);
    c.bending_rad[1] = bad;
    EXPECT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kCommandNotFinite);
  }
}

TEST_F(GateTest, RefusesWrongSizes) {
  EXPECT_EQ(gate.Admit(Bending(1), Mode::kRunning, now), Status::kCommandWrongSize);
  EXPECT_EQ(gate.Admit(Bending(4), Mode::kRunning, now), Status::kCommandWrongSize);
  Command c = Tip(0, 0, 0.05);
  c.kind = CommandKind::kTension;
  c.tension_N = TendonVector::Constant(2, 1.0);
  EXPECT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kCommandWrongSize);
}

TEST_F(GateTest, RefusesWhatIsOutOfRange) {
  const double tenth_m = 0.006;  // of 60 mm
  EXPECT_EQ(gate.Admit(Tip(0, 0, 0.0659), Mode::kRunning, now, 0.999 * tenth_m), Status::kOk);
  for (double away_m : {1.001 * tenth_m, 57., kInf, kNan})
    EXPECT_EQ(gate.Admit(Tip(0, 0, 0.07), Mode::kRunning, now, away_m), Status::kTargetOutOfReach);
  EXPECT_EQ(gate.Admit(Tip(0, 0, 0.07), Mode::kConfigured, now, kInf), Status::kCommandWrongMode);
  Command c = Bending(2);
  c.bending_rad[0] = 1.01 * robot.limits.max_bending_rad;
  EXPECT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kCommandOutOfRange);
  c = Tip(0, 0, 0.05);
  c.kind = CommandKind::kTension;
  c.tension_N = TendonVector::Constant(3, 1.0);
  c.tension_N[2] = -0.1;
  EXPECT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kCommandOutOfRange);
}

TEST_F(GateTest, RefusesStaleAndUnorderedCommands) {
  Command old = Tip(0, 0, 0.05);
  EXPECT_EQ(gate.Admit(old, Mode::kRunning, now + old.valid_for_ns + 1), Status::kCommandStale);
  Command c = Tip(0, 0, 0.05);
  ASSERT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kOk);
  EXPECT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kCommandOutOfOrder) << "a duplicate";
  c.sequence -= 1;
  EXPECT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kCommandOutOfOrder) << "an older one";
}

// A stop from a sender whose clock is behind another's.
TEST_F(GateTest, HoldIsNeverOutOfOrder) {
  Command ahead = Tip(0, 0, 0.05);
  ahead.sequence += 1000;
  ASSERT_EQ(gate.Admit(ahead, Mode::kRunning, now), Status::kOk);
  EXPECT_EQ(gate.Admit(ModeCommand(ModeRequest::kArm), Mode::kHold, now), Status::kCommandOutOfOrder);
  EXPECT_EQ(gate.Admit(ModeCommand(ModeRequest::kHold), Mode::kRunning, now), Status::kOk);
  EXPECT_EQ(gate.Admit(Tip(0, 0, 0.05), Mode::kRunning, now), Status::kCommandOutOfOrder)
      << "the order stays";
}

TEST_F(GateTest, NothingMovesOnUnwatchedForLong) {
  Command moving = Tip(0, 0, 0.05);
  moving.tip_velocity_W_mps = {0.001, 0, 0};
  moving.valid_for_ns = 6 * kNsPerS;
  EXPECT_EQ(gate.Admit(moving, Mode::kRunning, now), Status::kCommandOutOfRange);
  Command pull = Tip(0, 0, 0.05);
  pull.kind = CommandKind::kTension;
  pull.tension_N = TendonVector::Constant(3, 1.0);
  pull.valid_for_ns = 6 * kNsPerS;
  EXPECT_EQ(gate.Admit(pull, Mode::kCommissioning, now), Status::kCommandOutOfRange);
  pull.sequence = ++sequence;
  EXPECT_EQ(gate.Admit(pull, Mode::kRunning, now), Status::kOk) << "held, not moving on";
  Command still = Tip(0, 0, 0.05);
  still.valid_for_ns = 3600 * kNsPerS;
  EXPECT_EQ(gate.Admit(still, Mode::kRunning, now), Status::kOk);
}

TEST_F(GateTest, SequenceMayWrap) {
  Command c = Tip(0, 0, 0.05);
  c.sequence = 0xFFFFFFFFu;
  ASSERT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kOk);
  c.sequence = 0;
  EXPECT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kOk);
}

// Numbers made of the time wrap every 12 hours, so that one sent 7 hours later looks older.
TEST_F(GateTest, AfterALongSilenceAnyNumberIsNew) {
  Command c = Tip(0, 0, 0.05);
  c.sequence = 1000;
  ASSERT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kOk);
  c.sequence = 999;
  EXPECT_EQ(gate.Admit(c, Mode::kRunning, now + 3000 * kNsPerS), Status::kCommandOutOfOrder);
  c.received_ns = now + 3601 * kNsPerS;
  EXPECT_EQ(gate.Admit(c, Mode::kRunning, c.received_ns), Status::kOk);
}

// Numbers made of the time go back with the clock that they are made of: by a minute and more that is a clock
// that was set, not a message that was overtaken.
TEST_F(GateTest, ASendersClockSetBackDoesNotLockItOut) {
  constexpr std::uint32_t kPerSecond = 100'000;
  Command c = Tip(0, 0, 0.05);
  c.sequence = 3'000'000'000u;
  ASSERT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kOk);
  c.sequence -= 59 * kPerSecond;
  EXPECT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kCommandOutOfOrder);
  c.sequence -= 3541 * kPerSecond;
  EXPECT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kOk) << "an hour";
  EXPECT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kCommandOutOfOrder) << "order counts from there";
  c.sequence += 1;
  EXPECT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kOk);
}

// However late, however often, whatever came before: who says stop is believed.
TEST_F(GateTest, DisarmIsNeverTooOldAndNeverOutOfOrder) {
  ASSERT_EQ(gate.Admit(Tip(0, 0, 0.05), Mode::kRunning, now), Status::kOk);
  Command c = ModeCommand(ModeRequest::kDisarm);
  c.sequence = 0;
  c.received_ns -= 60 * kNsPerS;
  EXPECT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kOk);
  EXPECT_EQ(gate.Admit(Tip(0, 0, 0.05), Mode::kRunning, now), Status::kOk) << "and it moves no number back";
}

TEST_F(GateTest, WhileCommissioningOnlyGentlePullsOfEitherSignAreTaken) {
  Command c = Tip(0, 0, 0.05);
  EXPECT_EQ(gate.Admit(c, Mode::kCommissioning, now), Status::kCommandWrongMode);
  const auto pull = [&](double n) {
    Command t = Tip(0, 0, 0.05);
    t.kind = CommandKind::kTension;
    t.tension_N = Eigen::Vector3d(0, n, 0);
    return gate.Admit(t, Mode::kCommissioning, now);
  };
  EXPECT_EQ(pull(2), Status::kOk);
  EXPECT_EQ(pull(-2), Status::kOk);
  EXPECT_EQ(pull(2.01), Status::kCommandOutOfRange);
  EXPECT_EQ(pull(-2.01), Status::kCommandOutOfRange);
  EXPECT_EQ(pull(std::nan("")), Status::kCommandNotFinite);
}

TEST_F(GateTest, ARobotThatWasNeverCommissionedIsRefusedAsSuch) {
  // Arming is also what leads on from hold.
  for (const Mode m : {Mode::kConfigured, Mode::kHold}) {
    EXPECT_EQ(gate.Admit(ModeCommand(ModeRequest::kNotCommissioned), m, now), Status::kNotCommissioned);
  }
}

TEST_F(GateTest, NothingMovesUnlessRunning) {
  for (Mode m : {Mode::kDisconnected, Mode::kConfigured, Mode::kArmed, Mode::kPretension, Mode::kHold,
                 Mode::kSafeStop, Mode::kFault, Mode::kHoming, Mode::kCommissioning}) {
    EXPECT_EQ(gate.Admit(Tip(0, 0, 0.05), m, now), Status::kCommandWrongMode) << ModeText(m);
    EXPECT_EQ(gate.target().kind, CommandKind::kNone);
  }
}

TEST_F(GateTest, DisarmIsAlwaysAdmittedAndClearWhereSomethingFailed) {
  for (Mode m : {Mode::kDisconnected, Mode::kConfigured, Mode::kArmed, Mode::kPretension, Mode::kRunning,
                 Mode::kHold, Mode::kSafeStop, Mode::kFault, Mode::kHoming, Mode::kCommissioning}) {
    EXPECT_EQ(gate.Admit(ModeCommand(ModeRequest::kDisarm), m, now), Status::kOk) << ModeText(m);
    EXPECT_EQ(gate.Admit(ModeCommand(ModeRequest::kClear), m, now) == Status::kOk,
              m == Mode::kFault || m == Mode::kDisconnected)
        << ModeText(m);
  }
}

TEST_F(GateTest, MovingTargetStopsWhenItExpires) {
  Command c = Tip(0.01, 0, 0.055);
  c.tip_velocity_W_mps = {0.02, 0, 0};
  ASSERT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kOk);
  EXPECT_DOUBLE_EQ(gate.target().TipAt(now - kNsPerS).x(), 0.01);
  EXPECT_DOUBLE_EQ(gate.target().TipAt(now + 50 * kNsPerMs).x(), 0.011);
  EXPECT_DOUBLE_EQ(gate.target().TipAt(now + 100 * kNsPerMs).x(), 0.012);
  EXPECT_DOUBLE_EQ(gate.target().TipAt(now + 10 * kNsPerS).x(), 0.012);
}

}  // namespace
}  // namespace tendril::control
