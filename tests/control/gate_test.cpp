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
  // No robot moves so, and what is computed with it would be no number.
  for (double wrong : {1.001e3, 1e9, 1e308}) {
    Command c = Tip(0, 0, 0.05);
    c.speed_radps = wrong;
    EXPECT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kCommandOutOfRange);
    c = Tip(0, 0, 0.05);
    c.tip_velocity_W_mps.z() = -wrong;
    EXPECT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kCommandOutOfRange);
    EXPECT_EQ(gate.Admit(Tip(0, -wrong, 0.05), Mode::kRunning, now, kInf), Status::kCommandOutOfRange);
    c = Bending(2);
    c.bending_rate_radps = BendingVector{{0, -wrong}};
    EXPECT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kCommandOutOfRange);
  }
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

// A validity of nothing, without end or that is no number (0 by then); what holds needs none.
TEST_F(GateTest, AValidityThatIsNoneIsOutOfRange) {
  for (const TimeNs none : {TimeNs{0}, -kNsPerS, kLongestValid_ns + 1}) {
    for (Command c : {Tip(0, 0, 0.05), ModeCommand(ModeRequest::kArm), ModeCommand(ModeRequest::kHold),
                      ModeCommand(ModeRequest::kDisarm)}) {
      c.valid_for_ns = none;
      const bool stops =
          c.kind == CommandKind::kMode && (c.mode == ModeRequest::kHold || c.mode == ModeRequest::kDisarm);
      EXPECT_EQ(gate.Admit(c, Mode::kRunning, now), stops ? Status::kOk : Status::kCommandOutOfRange) << none;
    }
  }
  Command hold = ModeCommand(ModeRequest::kHold);
  hold.speed_radps = std::nan("");
  EXPECT_EQ(gate.Admit(hold, Mode::kRunning, now), Status::kOk);
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

// Numbers are each sender's own: a panel that counts its clicks beside a program that counts by the clock,
// and whoever comes after either.
TEST_F(GateTest, OrderIsEachSendersOwn) {
  Command stream = Tip(0, 0, 0.05);
  stream.sender = 1;
  stream.sequence = 3'000'000'000u;
  ASSERT_EQ(gate.Admit(stream, Mode::kRunning, now), Status::kOk);
  Command click = ModeCommand(ModeRequest::kArm);
  click.sender = 2;
  click.sequence = 2'999'999'999u;
  EXPECT_EQ(gate.Admit(click, Mode::kHold, now), Status::kOk) << "its clock is behind";
  EXPECT_EQ(gate.Admit(click, Mode::kHold, now), Status::kCommandOutOfOrder) << "its own, twice";
  EXPECT_EQ(gate.Admit(stream, Mode::kRunning, now), Status::kCommandOutOfOrder)
      << "what others send in between changes nothing";
  stream.sequence += 1;
  EXPECT_EQ(gate.Admit(stream, Mode::kRunning, now), Status::kOk);
  // As many others as there may be, each from 1 on; then who was heard of last is still known.
  for (std::uint32_t sender = 3; sender < 30; ++sender) {
    Command c = ModeCommand(ModeRequest::kHold);
    c.sender = sender;
    c.sequence = 1;
    EXPECT_EQ(gate.Admit(c, Mode::kRunning, ++now), Status::kOk);
    c.mode = ModeRequest::kArm;
    EXPECT_EQ(gate.Admit(c, Mode::kHold, now), Status::kCommandOutOfOrder);
  }
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

TEST_F(GateTest, WhileCommissioningOnlyWhoCommissionsPulls) {
  Command commission = ModeCommand(ModeRequest::kCommission);
  commission.sender = 7;
  ASSERT_EQ(gate.Admit(commission, Mode::kConfigured, now), Status::kOk);
  now += 3 * kNsPerS;  // its operator reads, and nothing is pulled yet
  const auto pull = [&](std::uint32_t sender) {
    Command t = Tip(0, 0, 0.05);
    t.kind = CommandKind::kTension;
    t.tension_N = Eigen::Vector3d(0, 1, 0);
    t.sender = sender;
    return gate.Admit(t, Mode::kCommissioning, now);
  };
  for (const std::uint32_t other : {0, 8}) EXPECT_EQ(pull(other), Status::kAnotherSender) << other;
  EXPECT_EQ(pull(7), Status::kOk);
  now += 3 * kNsPerS;
  EXPECT_EQ(pull(8), Status::kAnotherSender) << "however long it waits between two pulls";
  EXPECT_EQ(pull(7), Status::kOk) << "and what was refused is not in the way";
  EXPECT_TRUE(gate.Contended(now));
}

// ---- two senders at once ----

// A target each 10 ms, of which each counts 100 ms, while another sends as well.
TEST_F(GateTest, OneSenderLeadsAndAnothersTargetsAreRefusedUntilItsOwnHaveStopped) {
  for (const bool moving : {false, true}) {
    const auto target = [&](std::uint32_t sender) {
      Command c = Tip(0, 0, 0.05);
      c.sender = sender;
      if (moving) c.tip_velocity_W_mps.x() = 1e-3;
      return c;
    };
    int refused = 0;
    for (int i = 0; i < 100; ++i, now += 10 * kNsPerMs) {
      ASSERT_EQ(gate.Admit(target(1), Mode::kRunning, now), Status::kOk) << i;
      if (i == 0) continue;  // from the second on it is known to be a stream
      Command other = target(2);
      other.sequence += 500'000;  // its clock is five seconds ahead
      refused += gate.Admit(other, Mode::kRunning, now) == Status::kAnotherSender;
      EXPECT_EQ(gate.target().tip_velocity_W_mps.x(), moving ? 1e-3 : 0);
    }
    EXPECT_EQ(refused, 99);
    EXPECT_TRUE(gate.Contended(now));
    now += 89 * kNsPerMs;
    EXPECT_EQ(gate.Admit(target(2), Mode::kRunning, now), Status::kAnotherSender);
    now += 2 * kNsPerMs;
    EXPECT_EQ(gate.Admit(target(2), Mode::kRunning, now), Status::kOk) << "the leader's last one expired";
    now += 4 * kNsPerS;
    EXPECT_FALSE(gate.Contended(now));
  }
}

TEST_F(GateTest, OfTwoThatBeginAtOnceOneLeads) {
  int accepted[2] = {};
  for (int i = 0; i < 100; ++i, now += 5 * kNsPerMs) {
    Command c = Tip(0, 0, 0.05);
    c.sender = 1 + i % 2;
    accepted[i % 2] += gate.Admit(c, Mode::kRunning, now) == Status::kOk;
  }
  EXPECT_EQ(accepted[0], 50);
  EXPECT_EQ(accepted[1], 1);
}

TEST_F(GateTest, AnybodyMayStopWhoeverLeads) {
  for (const ModeRequest request : {ModeRequest::kHold, ModeRequest::kDisarm}) {
    for (int i = 0; i < 3; ++i) {
      Command c = Tip(0, 0, 0.05);
      c.sender = 1;
      ASSERT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kOk);
    }
    Command stop = ModeCommand(request);
    stop.sender = 2;
    EXPECT_EQ(gate.Admit(stop, Mode::kRunning, now), Status::kOk);
  }
}

// Operators that give one command after the other, each by a program of its own.
TEST_F(GateTest, SingleTargetsLeadNothing) {
  for (std::uint32_t sender = 1; sender < 10; ++sender) {
    Command c = Tip(0, 0, 0.05);
    c.sender = sender;
    c.valid_for_ns = kNsPerS;
    EXPECT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kOk) << sender;
    now += 10 * kNsPerMs;
  }
  EXPECT_FALSE(gate.Contended(now));
}

// Whoever does not know that the high half names a sender may count nanoseconds of the epoch.
TEST_F(GateTest, WhoCountsOnInAllBitsIsOneSender) {
  std::uint64_t number = 1'700'000'000'123'456'789;
  for (int i = 0; i < 1000; ++i) {
    Command c = Tip(0, 0, 0.05);
    c.sequence = static_cast<std::uint32_t>(number);
    c.sender = static_cast<std::uint32_t>(number >> 32);
    ASSERT_EQ(gate.Admit(c, Mode::kRunning, now), Status::kOk) << i;
    number += 10'000'000;
    now += 10 * kNsPerMs;
  }
}

// Its targets have ended with the mode that they counted in.
TEST_F(GateTest, NobodyLeadsAfterTheTargetWasDropped) {
  Command stream = Bending(2);
  stream.sender = 1;
  stream.bending_rate_radps = Eigen::Vector2d(0.1, 0);
  stream.received_ns = now;
  ASSERT_EQ(gate.Admit(stream, Mode::kRunning, now), Status::kOk);
  Command other = Bending(2);
  other.sender = 2;
  other.received_ns = now;
  EXPECT_EQ(gate.Admit(other, Mode::kRunning, now), Status::kAnotherSender);
  gate.Drop();
  ++other.sequence;
  EXPECT_EQ(gate.Admit(other, Mode::kRunning, now), Status::kOk);
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
