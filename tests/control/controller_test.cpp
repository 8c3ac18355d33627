// The whole tick against drives that do exactly what is commanded: modes, limits, reactions, no allocation,
// same bits.
#include "tendril/control/controller.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>
#include <span>
#include <utility>
#include <vector>

#include "ideal_loop.h"

namespace tendril::control {
namespace {

TEST(Controller, RefusesABodyWithoutActuation) {
  const auto body_only = config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/qi2021_60mm.yaml");
  EXPECT_THROW(Controller(body_only, kParameters, kNsPerMs), std::invalid_argument);
}

TEST(Controller, NoTorqueBeforeArmAndNoneAfterDisarm) {
  IdealLoop loop;
  for (int i = 0; i < 50; ++i) {
    EXPECT_EQ(loop.Step().drive_request, DriveRequest::kDisable);
    EXPECT_EQ(loop.output.mode, Mode::kDisconnected);
  }
  loop.Ready();
  EXPECT_EQ(loop.output.mode, Mode::kConfigured);
  loop.Run(50);
  for (int j = 0; j < 3; ++j) EXPECT_EQ(loop.output.torque_target_permille[j], 0);
  loop.RunUntilRunning();
  loop.Step(loop.ModeCommand(ModeRequest::kDisarm));
  loop.Run(3000);
  EXPECT_EQ(loop.output.mode, Mode::kConfigured);
  EXPECT_EQ(loop.output.drive_request, DriveRequest::kDisable);
  for (int j = 0; j < 3; ++j) EXPECT_EQ(loop.output.torque_target_permille[j], 0);
}

TEST(Controller, ClearBootsDrivesAgainThatFailedToStart) {
  IdealLoop loop;
  loop.Step();
  ASSERT_EQ(loop.output.mode, Mode::kDisconnected);
  EXPECT_FALSE(loop.output.clear_drive_faults);
  EXPECT_TRUE(loop.Step(loop.ModeCommand(ModeRequest::kClear)).clear_drive_faults);
  EXPECT_EQ(loop.output.mode, Mode::kDisconnected);
  EXPECT_FALSE(loop.Step().clear_drive_faults);
  loop.Ready();
  EXPECT_EQ(loop.output.mode, Mode::kConfigured);
}

TEST(Controller, DisconnectedTellsWhatToDo) {
  IdealLoop loop;
  const auto drives = [&](DriveState a, DriveState b) {
    for (int j = 0; j < loop.input.drives; ++j) loop.input.drive[j].state = j == 1 ? b : a;
    return loop.Step().status;
  };
  EXPECT_EQ(drives(DriveState::kBooting, DriveState::kBooting), Status::kOk);
  EXPECT_EQ(drives(DriveState::kReady, DriveState::kOffline), Status::kDriveAbsent);
  EXPECT_EQ(drives(DriveState::kOffline, DriveState::kOtherDevice), Status::kOtherDevice);
  EXPECT_EQ(drives(DriveState::kOffline, DriveState::kMisconfigured), Status::kDriveMisconfigured);
  EXPECT_EQ(drives(DriveState::kFault, DriveState::kIdTwice), Status::kNodeIdTwice);
  EXPECT_EQ(drives(DriveState::kOffline, DriveState::kFault), Status::kDriveHasFault);
  EXPECT_EQ(loop.output.mode, Mode::kDisconnected);
  const CycleOutput& refused = loop.Step(loop.ModeCommand(ModeRequest::kArm));
  EXPECT_EQ(refused.command_status, Status::kCommandWrongMode);
  EXPECT_EQ(refused.status, Status::kDriveHasFault);
  EXPECT_EQ(drives(DriveState::kReady, DriveState::kReady), Status::kOk);
  EXPECT_EQ(loop.output.mode, Mode::kConfigured);
}

TEST(Controller, PretensionRisesAtItsRateToTheMinimum) {
  IdealLoop loop;
  loop.Ready();
  loop.Step(loop.ModeCommand(ModeRequest::kArm));
  double last = 0;
  for (int i = 0; i < 2000 && loop.output.mode != Mode::kRunning; ++i) {
    loop.Step();
    const double now = loop.output.tension_desired_base_N.maxCoeff();
    EXPECT_LE(now - last, 2e-3 + 1e-12);
    last = now;
  }
  EXPECT_NEAR(loop.output.tension_desired_base_N.minCoeff(), loop.robot.limits.min_tension_N, 1e-9);
}

TEST(Controller, ReachesTheTipAndEstimatesIt) {
  IdealLoop loop;
  loop.RunUntilRunning();
  const double theta = std::numbers::pi / 3, l = loop.robot.body.length_m();
  const Eigen::Vector3d target(l / theta * (1 - std::cos(theta)), 0, l * std::sin(theta) / theta);
  loop.Step(loop.Tip(target));
  loop.Run(2000);
  EXPECT_EQ(loop.output.status, Status::kOk) << StatusText(loop.output.status);
  EXPECT_LT((loop.output.reference_tip_W_m - target).norm(), 1e-9);
  // The ideal loop's sensors differ from the truth by their resolution only: a count is 1.3 um, a millivolt 5
  // mN.
  EXPECT_LT((loop.output.tip_estimate_W_m - target).norm(), 3e-5);
  EXPECT_GE(loop.output.tension_desired_base_N.minCoeff(), loop.robot.limits.min_tension_N - 1e-12);
}

TEST(Controller, UnreachableTipGoesToTheNearestAndSaysHowFarOff) {
  IdealLoop loop;
  loop.RunUntilRunning();
  loop.Step(loop.Tip({0, 0, 0.065}));
  EXPECT_EQ(loop.output.status, Status::kTargetUnreachable);
  EXPECT_NEAR(loop.output.target_distance_m, 0.005, 1e-9);
}

// The base itself, a slip of a digit, millimetres, and a tip that arcs reach and tensions do not hold: a
// motion to the point that happens to be nearest is not what was meant.
TEST(Controller, ATipFarOutOfReachIsRefusedWithTheNearestPointAndMovesNothing) {
  const double theta = 2.5, r = 0.06 / theta;
  for (const Eigen::Vector3d& tip :
       {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(0, 0, 0.0661), Eigen::Vector3d(0.1, 0, 0.0589),
        Eigen::Vector3d(10, 0, 58.9), Eigen::Vector3d(1e300, 0, 0),
        Eigen::Vector3d(r * (1 - std::cos(theta)), 0, r * std::sin(theta))}) {
    SCOPED_TRACE(tip.transpose());
    IdealLoop loop;
    loop.RunUntilRunning();
    const CycleOutput answer = loop.Step(loop.Tip(tip));
    EXPECT_EQ(answer.command_status,
              tip.x() > kMostTip_m ? Status::kCommandOutOfRange : Status::kTargetOutOfReach);
    loop.Run(500);
    EXPECT_TRUE(loop.output.target_bending_rad.isZero(0));
    EXPECT_TRUE(std::isnan(loop.output.target_tip_W_m.x()));
    // What is named can be had.
    loop.Step(loop.Tip(answer.nearest_tip_W_m));
    EXPECT_EQ(loop.output.command_status, Status::kOk);
    loop.Run(3000);
    EXPECT_LT((loop.output.reference_tip_W_m - answer.nearest_tip_W_m).norm(), 5e-4);
  }
}

// Beyond the tension limits, target_distance_m is measured from the point to which the robot really moves.
TEST(Controller, HowFarOffATipIsCountsFromWhereTheRobotIsLed) {
  IdealLoop loop;
  loop.RunUntilRunning();
  const double theta = 2.5, r = 0.06 / theta;
  const Eigen::Vector3d arc(r * (1 - std::cos(theta)), 0, r * std::sin(theta));
  const Eigen::Vector3d nearest = loop.Step(loop.Tip(arc)).nearest_tip_W_m;
  loop.Step(loop.Tip(nearest + 0.004 * (arc - nearest).normalized()));
  loop.Run(3000);
  EXPECT_EQ(loop.output.command_status, Status::kOk);
  EXPECT_NEAR(loop.output.target_distance_m,
              (loop.output.target_tip_W_m - loop.output.reference_tip_W_m).norm(), 1e-5);
  EXPECT_GT(loop.output.target_distance_m, 1e-3);
}

// After power was lost under tension the minimum tension may not turn the motors: the robot does not move
// with slack tendons and a meaningless zero.
TEST(Controller, PretensionDoesNotEndWithATendonThatHangs) {
  IdealLoop loop;
  loop.RunUntilRunning();
  loop.Step(loop.Bending(0.5, 0));
  loop.Run(1000);
  loop.input.drive[1].state = DriveState::kFault;
  loop.hangs = 2;
  loop.Run(3000);
  ASSERT_EQ(loop.output.mode, Mode::kFault);
  loop.input.drive[1].state = DriveState::kReady;
  loop.Step(loop.ModeCommand(ModeRequest::kClear));
  loop.Run(10);
  ASSERT_EQ(loop.output.mode, Mode::kConfigured);
  const TimeNs asked_ns = loop.input.time_ns;
  loop.Step(loop.ModeCommand(ModeRequest::kArm));
  for (int i = 0; i < 5000 && loop.output.mode != Mode::kFault; ++i) {
    loop.Step();
    ASSERT_NE(loop.output.mode, Mode::kRunning);
  }
  EXPECT_EQ(loop.output.mode, Mode::kFault);
  EXPECT_EQ(loop.output.status, Status::kTendonSlack);
  EXPECT_EQ(loop.output.blamed_tendon, 2);
  // 0.3 N at 2 N/s, 0.1 s to settle, 2 s to become taut.
  EXPECT_NEAR(ToSeconds(loop.input.time_ns - asked_ns), 2.25, 0.1);
  loop.hangs = 0;
  loop.Run(3000);
  loop.Step(loop.ModeCommand(ModeRequest::kClear));
  loop.Run(10);
  loop.RunUntilRunning();
}

// A slack tendon, which is the more severe, does not hide that the tip is out of reach.
TEST(Controller, TellsAllThatACycleHasToSay) {
  IdealLoop loop;
  loop.RunUntilRunning();
  loop.hangs = 2;
  loop.Step(loop.Tip({0, 0, 0.065}));
  loop.Run(10);
  EXPECT_EQ(loop.output.status, Status::kSlack);
  EXPECT_THAT(loop.output.reported, ::testing::IsSupersetOf({Status::kSlack, Status::kTargetUnreachable}));
  EXPECT_EQ(std::count(loop.output.reported.begin(), loop.output.reported.end(), Status::kSlack), 1);
}

// As the table of modes says: whoever reads the log sees a disarm lead through a safe stop, from wherever it
// comes, and a clear through disconnected.
TEST(Controller, EveryModeThatACommandLeadsToIsSeen) {
  ControllerParameters parameters = kParameters;
  for (const ControlLaw law : {ControlLaw::kPaper, ControlLaw::kEquilibrium}) {
    parameters.law = law;
    parameters.tension_feedback = law == ControlLaw::kEquilibrium;
    IdealLoop loop(IdealLoop().robot, parameters);
    loop.Ready();
    loop.Step(loop.ModeCommand(ModeRequest::kArm));
    for (int i = 0; i < 2000 && loop.output.mode != Mode::kPretension; ++i) loop.Step();
    loop.Run(20);
    ASSERT_EQ(loop.output.mode, Mode::kPretension);
    ASSERT_GT(loop.output.tension_desired_base_N.maxCoeff(), 0);
    EXPECT_EQ(loop.Step(loop.ModeCommand(ModeRequest::kDisarm)).mode, Mode::kSafeStop);
    EXPECT_EQ(loop.Step().mode, Mode::kConfigured) << "nothing pulled by more than pretension";
    EXPECT_EQ(loop.output.drive_request, DriveRequest::kDisable);

    loop.Run(10);
    loop.Step(loop.ModeCommand(ModeRequest::kArm));
    EXPECT_EQ(loop.Step(loop.ModeCommand(ModeRequest::kDisarm)).mode, Mode::kSafeStop);
    for (int j = 0; j < 3; ++j) EXPECT_EQ(loop.output.torque_target_permille[j], 0);
    EXPECT_EQ(loop.Step().mode, Mode::kConfigured) << "not even armed";

    loop.input.drive[1].state = DriveState::kFault;
    loop.Step();
    ASSERT_EQ(loop.output.mode, Mode::kFault);
    loop.Run(10);
    // The drive hears of the clear after this cycle.
    const CycleOutput cleared = loop.Step(loop.ModeCommand(ModeRequest::kClear));
    EXPECT_EQ(cleared.mode, Mode::kDisconnected);
    EXPECT_EQ(cleared.status, Status::kOk) << "that it is still in fault is nothing to tell";
    EXPECT_EQ(loop.Step().status, Status::kDriveHasFault);
    loop.input.drive[1].state = DriveState::kReady;
    EXPECT_EQ(loop.Step().mode, Mode::kConfigured);
  }
}

// Not for ever armed: a drive that does not switch on is named.
TEST(Controller, ADriveThatDoesNotSwitchOnIsAFaultWithinThreeSeconds) {
  for (const ModeRequest request : {ModeRequest::kArm, ModeRequest::kHome, ModeRequest::kCommission}) {
    IdealLoop loop;
    loop.Ready();
    loop.obey = false;
    loop.Step(loop.ModeCommand(request));
    const Mode mode = loop.output.mode;
    for (int j : {0, 2}) loop.input.drive[j].state = DriveState::kEnabled;
    loop.Run(2990);
    EXPECT_EQ(loop.output.mode, mode);
    loop.Run(20);
    EXPECT_EQ(loop.output.mode, Mode::kFault);
    EXPECT_EQ(loop.output.status, Status::kEnableTimedOut) << StatusText(loop.output.status);
    EXPECT_EQ(loop.output.drive_request, DriveRequest::kDisable);
    for (int j = 0; j < 3; ++j) EXPECT_EQ(loop.output.torque_target_permille[j], 0);
  }
}

TEST(Controller, TorqueNeverJumpsOnACircleWithReversals) {
  IdealLoop loop;
  loop.RunUntilRunning();
  std::array<std::int16_t, kMaxTendons> last{};
  double largest = 0;
  loop.Step(loop.Bending(0.5, 0));
  loop.Run(1500);
  last = loop.output.torque_target_permille;
  for (int i = 0; i < 8000; ++i) {
    const double a = i * 1e-3 * std::numbers::pi / 4;
    loop.Step(loop.Bending(0.5 * std::cos(a), 0.5 * std::sin(a)));
    for (int j = 0; j < 3; ++j)
      largest = std::max(largest, std::abs(1.0 * loop.output.torque_target_permille[j] - last[j]));
    last = loop.output.torque_target_permille;
  }
  // Rated torque is 1000: a sign switch of the friction terms would show as some 60 at once.
  EXPECT_LE(largest, 12);
}

TEST(Controller, HoldStopsSoftlyAndRefusesTargetsUntilArmed) {
  IdealLoop loop;
  loop.RunUntilRunning();
  loop.Step(loop.Bending(1.0, 0));
  loop.Run(300);
  loop.Step(loop.ModeCommand(ModeRequest::kHold));
  loop.Run(300);
  EXPECT_EQ(loop.output.mode, Mode::kHold);
  const BendingVector held = loop.output.reference.position_rad;
  EXPECT_GT(held[0], 0.1);
  EXPECT_LT(held[0], 0.9);
  EXPECT_EQ(loop.Step(loop.Bending(0, 0)).command_status, Status::kCommandWrongMode);
  loop.Run(300);
  EXPECT_EQ((loop.output.reference.position_rad - held).norm(), 0);
  loop.Step(loop.ModeCommand(ModeRequest::kArm));
  EXPECT_EQ(loop.output.mode, Mode::kRunning);
  loop.Run(300);
  EXPECT_LT((loop.output.reference.position_rad - held).norm(), 1e-12) << "resumes where it stopped";
}

// The way back is at the ramp's rate and the motion waits for it: 0.7 N at 2 N/s. The motion itself is then
// that of a robot that never followed a tension command, bit for bit: 2.2 N/s at 0.5 rad/s
// and 4.4 at 1 rad/s, for that is the stiffness of this backbone over its tendons' lever.
TEST(Controller, TensionCommandIsFollowedAtTheRampAndReturnsSmoothly) {
  for (const double speed_radps : {0.5, 1.0}) {
    SCOPED_TRACE(speed_radps);
    IdealLoop loop, straight;
    loop.RunUntilRunning();
    straight.RunUntilRunning();
    Command c = loop.Make(CommandKind::kTension);
    c.tension_N = TendonVector::Constant(3, 1.0);
    loop.Step(c);
    TendonVector last = loop.output.tension_desired_base_N;
    for (int i = 0; i < 1000; ++i) {
      loop.Step();
      EXPECT_LE((loop.output.tension_desired_base_N - last).cwiseAbs().maxCoeff(), 2e-3 + 1e-12);
      last = loop.output.tension_desired_base_N;
    }
    EXPECT_NEAR(last.minCoeff(), 1.0, 1e-12);
    Command bend = loop.Bending(0.2, 0);
    bend.speed_radps = speed_radps;
    loop.Step(bend);
    int waited = 0;
    while (waited < 1000 && loop.output.reference.velocity_radps.norm() < 1e-12) {
      EXPECT_LE((loop.output.tension_desired_base_N - last).cwiseAbs().maxCoeff(), 2e-3 + 1e-12);
      last = loop.output.tension_desired_base_N;
      loop.Step();
      ++waited;
    }
    EXPECT_GE(waited, 340);
    EXPECT_LE(waited, 355);
    straight.Run(1000);
    bend = straight.Bending(0.2, 0);
    bend.speed_radps = speed_radps;
    straight.Step(bend);
    double fastest_N = 0;
    for (int i = 0; i < 700; ++i) {
      EXPECT_NEAR((loop.output.tension_desired_base_N - straight.output.tension_desired_base_N).norm(), 0,
                  1e-9);
      fastest_N = std::max(fastest_N, (loop.output.tension_desired_base_N - last).cwiseAbs().maxCoeff());
      last = loop.output.tension_desired_base_N;
      loop.Step();
      straight.Step();
    }
    EXPECT_LT(fastest_N, speed_radps < 1 ? 2.5e-3 : 4.5e-3);
    EXPECT_NEAR(loop.output.reference.position_rad[0], 0.2, 1e-9);
    EXPECT_NEAR(loop.output.tension_desired_base_N.minCoeff(), loop.robot.limits.min_tension_N, 1e-9);
  }
}

// Goals beyond the tension limits are projected before the robot moves, and no motion is faster than its
// rotors' share of tension allows; both are reported.
TEST(Controller, GoalsAndRatesAreWithinWhatTensionsGive) {
  for (const ControlLaw law : {ControlLaw::kPaper, ControlLaw::kEquilibrium}) {
    ControllerParameters parameters = kParameters;
    parameters.law = law;
    parameters.guards.max_slack_s = 60;
    IdealLoop loop(config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_60mm.yaml"), parameters);
    loop.RunUntilRunning();
    Command far = loop.Bending(2.5, 0);
    far.speed_radps = 8;
    loop.Step(far);
    int slowed = 0;
    double fastest = 0, before = 0;
    for (int i = 0; i < 8000; ++i) {
      loop.Step();
      slowed += loop.output.status == Status::kSlowedByTension;
      const BendingReference& r = loop.output.reference;
      fastest = std::max(fastest, r.velocity_radps.norm());
      EXPECT_LE(r.position_rad[0], loop.output.target_bending_rad[0] + 1e-9);
      EXPECT_GE(r.position_rad[0], before - 1e-9);
      before = r.position_rad[0];
    }
    EXPECT_EQ(loop.output.mode, Mode::kRunning) << StatusText(loop.output.status);
    EXPECT_EQ(loop.output.status, Status::kLimitedTensionMax);
    EXPECT_GT(slowed, 50);
    EXPECT_LT(loop.output.target_bending_rad[0], 2.2);
    EXPECT_GT(loop.output.target_bending_rad[0], 1.6);
    EXPECT_LT(loop.output.tension_desired_base_N.maxCoeff(), 8);
    if (law == ControlLaw::kPaper) {
      EXPECT_LT(fastest, 2);
    } else {
      EXPECT_GT(fastest, 5);
    }
  }
}

TEST(Controller, CommandedTensionsStopAtTheShareThatShapesHave) {
  IdealLoop loop;
  loop.RunUntilRunning();
  Command c = loop.Make(CommandKind::kTension);
  c.tension_N = TendonVector::Constant(3, 8);
  loop.Step(c);
  loop.Run(5000);
  EXPECT_NEAR(loop.output.tension_desired_base_N.maxCoeff(), kCommandedTensionShare * 8, 1e-9);
  EXPECT_EQ(loop.output.status, Status::kLimitedTensionMax);
}

// With or without feedback of the tip: a tracker that the tendons contradict is reported after half a second.
TEST(Controller, ATrackerThatDisagreesIsToldUnderEveryLaw) {
  for (const ControlLaw law : {ControlLaw::kPaper, ControlLaw::kEquilibrium}) {
    ControllerParameters parameters = kParameters;
    parameters.law = law;
    IdealLoop loop(config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_60mm.yaml"), parameters);
    loop.RunUntilRunning();
    const auto told = [&](double off_m, int cycles) {
      int count = 0;
      for (int i = 0; i < cycles; ++i) {
        loop.input.tracker.valid = i % 10 == 0;
        loop.input.tracker.time_ns = loop.input.time_ns + kNsPerMs;
        loop.input.tracker.tip_W_m = loop.output.tip_estimate_W_m + Eigen::Vector3d(off_m, 0, 0);
        count += loop.Step().status == Status::kTrackerDisagrees;
      }
      return count;
    };
    EXPECT_EQ(told(0.005, 1000), 0) << "a tenth of 60 mm is not reached";
    EXPECT_EQ(told(0.007, 500), 0);
    EXPECT_GT(told(0.007, 500), 450);
    EXPECT_EQ(told(0, 500), 0);
  }
}

TEST(Controller, NotANumberIsRefusedAndNothingMoves) {
  IdealLoop loop;
  loop.RunUntilRunning();
  const auto before = loop.output.reference.position_rad;
  EXPECT_EQ(loop.Step(loop.Tip({std::numeric_limits<double>::quiet_NaN(), 0, 0})).command_status,
            Status::kCommandNotFinite);
  loop.Run(100);
  EXPECT_EQ((loop.output.reference.position_rad - before).norm(), 0);
  EXPECT_EQ(loop.output.mode, Mode::kRunning);
}

// Each fault: what provokes it, and how many cycles the reaction may take.
struct FaultCase {
  const char* name;
  void (*provoke)(IdealLoop&);
  Status status;
  int cycles;
};
class ControllerFault : public testing::TestWithParam<FaultCase> {};

TEST_P(ControllerFault, LatchesRampsDownAndStaysUntilCleared) {
  IdealLoop loop;
  loop.RunUntilRunning();
  loop.Step(loop.Bending(0.5, 0.2));
  loop.Run(1000);
  GetParam().provoke(loop);
  loop.Run(GetParam().cycles);
  ASSERT_EQ(loop.output.mode, Mode::kFault);
  EXPECT_EQ(loop.output.status, GetParam().status) << StatusText(loop.output.status);
  TendonVector last = loop.output.tension_desired_base_N;
  for (int i = 0; i < 5000; ++i) {
    loop.Step();
    EXPECT_LE((loop.output.tension_desired_base_N - last).maxCoeff(), 1e-12) << "tensions only fall";
    last = loop.output.tension_desired_base_N;
  }
  EXPECT_EQ(loop.output.drive_request, DriveRequest::kDisable);
  EXPECT_EQ(loop.output.mode, Mode::kFault) << "latched";
  EXPECT_EQ(loop.Step(loop.ModeCommand(ModeRequest::kArm)).command_status, Status::kCommandWrongMode);
  loop.input.bus_ok = true;
  for (int j = 0; j < 3; ++j) {
    loop.input.drive[j].age_cycles = 0;
    loop.input.drive[j].state = DriveState::kReady;
  }
  EXPECT_TRUE(loop.Step(loop.ModeCommand(ModeRequest::kClear)).clear_drive_faults);
  loop.Run(10);
  EXPECT_EQ(loop.output.mode, Mode::kConfigured) << "cleared, and nothing resumes by itself";
}

INSTANTIATE_TEST_SUITE_P(
    All, ControllerFault,
    testing::Values(FaultCase{"BusOff", [](IdealLoop& l) { l.input.bus_ok = false; }, Status::kBusOff, 1},
                    FaultCase{"DriveLost",
                              [](IdealLoop& l) { l.input.drive[1].state = DriveState::kOffline; },
                              Status::kDriveLost, 1},
                    FaultCase{"DriveFault", [](IdealLoop& l) { l.input.drive[2].state = DriveState::kFault; },
                              Status::kDriveFault, 1},
                    FaultCase{"DriveDisabledItself",
                              [](IdealLoop& l) {
                                l.input.drive[0].state = DriveState::kReady;
                                l.obey = false;
                              },
                              Status::kDriveFault, 1},
                    FaultCase{"FeedbackStale", [](IdealLoop& l) { l.input.drive[0].age_cycles = 6; },
                              Status::kFeedbackStale, 1}),
    [](const auto& fault) { return std::string(fault.param.name); });

TEST(Controller, ToleratesAFewMissingCyclesAndCountsThem) {
  IdealLoop loop;
  loop.RunUntilRunning();
  loop.input.drive[1].age_cycles = 5;
  EXPECT_EQ(loop.Step().status, Status::kFeedbackMissing);
  EXPECT_EQ(loop.output.mode, Mode::kRunning);
  EXPECT_EQ(loop.output.feedback_missing, 1u);
}

TEST(Controller, TensionOverTheLimitIsAFault) {
  IdealLoop loop;
  loop.RunUntilRunning();
  loop.output.tension_desired_motor_N[0] =
      1.2 * loop.robot.limits.max_tension_motor_N;  // what the cell will show
  loop.Step();
  EXPECT_EQ(loop.output.mode, Mode::kFault);
  EXPECT_EQ(loop.output.status, Status::kTensionOverLimit);
}

// Without a cell the torque shows the tension, which rotors and friction change for moments.
TEST(Controller, TensionByTorqueOverTheLimitIsAFaultOnceConfirmed) {
  RobotParameters robot = config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_60mm.yaml");
  for (TendonDriveParameters& t : robot.actuation->tendons) t.load_cell.place = LoadCellPlace::kNone;
  ControllerParameters parameters = kParameters;
  parameters.guards.max_torque_error_N = 100;
  const TendonDriveParameters& t = robot.actuation->tendons[0];
  const double torque_Nm =
      1.3 * robot.limits.max_tension_motor_N * t.SpoolTravelPerMotorRad() / t.gear.efficiency;
  const auto permille = static_cast<std::int16_t>(std::lround(1e3 * torque_Nm / t.drive.rated_torque_Nm));
  for (const int cycles : {parameters.guards.confirm_cycles - 1, parameters.guards.confirm_cycles}) {
    IdealLoop loop(robot, parameters);
    loop.RunUntilRunning();
    for (int i = 0; i < cycles; ++i) {
      ASSERT_EQ(loop.output.mode, Mode::kRunning) << i;
      loop.output.torque_target_permille[0] = permille;  // what the drive will report
      loop.Step();
    }
    loop.Step();
    const bool confirmed = cycles == parameters.guards.confirm_cycles;
    EXPECT_EQ(loop.output.mode, confirmed ? Mode::kFault : Mode::kRunning);
    EXPECT_EQ(loop.output.status == Status::kTensionOverLimit, confirmed) << StatusText(loop.output.status);
  }
}

// Running with `tension_N` in every tendon.
void RunWithTension(IdealLoop& loop, double tension_N) {
  loop.RunUntilRunning();
  Command pull = loop.Make(CommandKind::kTension);
  pull.tension_N = TendonVector::Constant(3, tension_N);
  pull.valid_for_ns = 100 * kNsPerS;
  loop.Step(pull);
  loop.Run(4000);
  ASSERT_NEAR(loop.output.tension_desired_base_N[0], tension_N, 1e-6);
}

TEST(Controller, ClearWaitsUntilTheFaultsTensionsAreDown) {
  IdealLoop loop;
  RunWithTension(loop, 3);
  loop.input.drive[1].state = DriveState::kFault;
  loop.Step();
  ASSERT_EQ(loop.output.mode, Mode::kFault);
  const CycleOutput& early = loop.Step(loop.ModeCommand(ModeRequest::kClear));
  EXPECT_EQ(early.command_status, Status::kClearTooEarly);
  EXPECT_EQ(early.mode, Mode::kFault);
  EXPECT_FALSE(early.clear_drive_faults);
  EXPECT_GT(early.tension_desired_base_N.maxCoeff(), 2.0) << "still on its way down";
  loop.Run(4000);
  EXPECT_TRUE(loop.Step(loop.ModeCommand(ModeRequest::kClear)).clear_drive_faults);
  EXPECT_EQ(loop.output.mode, Mode::kDisconnected);
}

TEST(Controller, BeingEndedTakesASecondAtMost) {
  IdealLoop loop;
  RunWithTension(loop, 6);
  loop.Step(loop.ModeCommand(ModeRequest::kStop));
  EXPECT_EQ(loop.output.mode, Mode::kSafeStop);
  double before_N = loop.output.tension_desired_base_N[0], largest_N = 0;
  int cycles = 0;
  for (; loop.output.mode == Mode::kSafeStop && cycles < 2000; ++cycles) {
    const double now_N = loop.Step().tension_desired_base_N[0];
    if (loop.output.mode == Mode::kSafeStop) largest_N = std::max(largest_N, std::abs(now_N - before_N));
    before_N = now_N;
  }
  EXPECT_EQ(loop.output.mode, Mode::kConfigured);
  EXPECT_LE(cycles, 950);
  EXPECT_LT(largest_N, 0.01) << "led down, not dropped";
}

// On a computer with other things to do two of three cycles are skipped: the daemon has no more time for
// that.
TEST(Controller, BeingEndedTakesASecondHoweverManyCyclesAreSkipped) {
  RobotParameters robot = IdealLoop().robot;
  ControllerParameters parameters = kParameters;
  parameters.guards.max_late_cycles = 100'000;
  IdealLoop loop(robot, parameters);
  RunWithTension(loop, 6);
  loop.Step(loop.ModeCommand(ModeRequest::kStop));
  const TimeNs asked_ns = loop.input.time_ns;
  for (int i = 0; i < 2000 && loop.output.mode == Mode::kSafeStop; ++i) {
    loop.input.cycle += 2;
    loop.input.time_ns += 2 * kNsPerMs;
    loop.Step();
  }
  EXPECT_EQ(loop.output.mode, Mode::kConfigured);
  EXPECT_LE(ToSeconds(loop.input.time_ns - asked_ns), 0.95);
}

// Whenever it is taken, the state holds all that the next steps depend on. The motion passes through every
// source of tensions: ramp, bending, moving tip, tensions, hold, fault and what follows a clear.
void ExpectToGoOnBitForBit(const char* file, ControlLaw law) {
  ControllerParameters parameters = kParameters;
  parameters.law = law;
  IdealLoop loop(IdealLoop(file).robot, parameters);
  const int m = loop.robot.body.tendons();
  std::vector<std::pair<CycleInput, CycleOutput>> cycles;
  std::vector<std::vector<std::byte>> states;
  const auto step = [&](const Command& command, int times) {
    for (int i = 0; i < times; ++i) {
      states.emplace_back(loop.controller.state_bytes());
      loop.controller.SaveState(states.back());
      loop.Step(i == 0 ? command : Command{});
      cycles.emplace_back(loop.input, loop.output);
    }
  };
  step({}, 3);
  for (int j = 0; j < m; ++j) loop.input.drive[j].state = DriveState::kReady;
  step({}, 2);
  step(loop.ModeCommand(ModeRequest::kArm), 600);
  ASSERT_EQ(loop.output.mode, Mode::kRunning);
  step(loop.Bending(0.5, -0.3), 150);
  Command circle = loop.Tip(loop.output.reference_tip_W_m);
  circle.tip_velocity_W_mps = {0.005, -0.01, 0};
  step(circle, 150);
  Command pull = loop.Make(CommandKind::kTension);
  pull.tension_N = TendonVector::LinSpaced(m, 0.8, 0.5);
  step(pull, 100);
  step(loop.Bending(-0.2, 0.3), 100);
  step(loop.ModeCommand(ModeRequest::kHold), 100);
  loop.input.drive[1].state = DriveState::kFault;
  step({}, 50);
  loop.input.drive[1].state = DriveState::kReady;
  step(loop.ModeCommand(ModeRequest::kClear), 20);
  step(loop.ModeCommand(ModeRequest::kArm), 100);

  const auto same = [](const auto& a, const auto& b) {
    return std::memcmp(a.data(), b.data(), static_cast<std::size_t>(a.size()) * sizeof(double)) == 0;
  };
  Controller other(loop.robot, parameters, kNsPerMs);
  for (std::size_t from = 0; from < cycles.size(); from += 37) {
    ASSERT_TRUE(other.LoadState(states[from]));
    for (std::size_t i = from; i < std::min(from + 200, cycles.size()); ++i) {
      CycleOutput again;
      other.Step(cycles[i].first, again);
      const CycleOutput& was = cycles[i].second;
      ASSERT_EQ(again.mode, was.mode) << "from " << from << " cycle " << i;
      ASSERT_EQ(again.status, was.status) << "from " << from << " cycle " << i;
      ASSERT_EQ(again.commands_accepted, was.commands_accepted);
      ASSERT_TRUE(same(again.torque_desired_Nm, was.torque_desired_Nm)) << "from " << from << " cycle " << i;
      ASSERT_TRUE(same(again.bending_estimate_rad, was.bending_estimate_rad)) << from << " cycle " << i;
      ASSERT_TRUE(same(again.reference.acceleration_radps2, was.reference.acceleration_radps2)) << i;
    }
  }
}

TEST(Controller, GoesOnFromASavedStateBitForBit) {
  ExpectToGoOnBitForBit("rig_60mm.yaml", ControlLaw::kPaper);
}
TEST(Controller, OfPairsGoesOnFromASavedStateBitForBit) {
  ExpectToGoOnBitForBit("pairs_90mm.yaml", ControlLaw::kPaper);
  ExpectToGoOnBitForBit("pairs_90mm.yaml", ControlLaw::kEquilibrium);
}

// A log is not to be trusted: no bytes may do more than be refused or make wrong numbers.
TEST(Controller, RefusesAStateThatIsNotItsOwn) {
  IdealLoop loop;
  loop.RunUntilRunning();
  std::vector<std::byte> state(loop.controller.state_bytes());
  loop.controller.SaveState(state);
  const std::span<const std::byte> all(state);
  EXPECT_FALSE(Controller(loop.robot, kParameters, kNsPerMs).LoadState(all.first(all.size() - 1)));
  EXPECT_FALSE(Controller(loop.robot, kParameters, 2 * kNsPerMs).LoadState(all)) << "other windows";
  RobotParameters rougher = loop.robot;
  for (auto& t : rougher.actuation->tendons) t.transmission.presliding_m *= 2;
  EXPECT_FALSE(Controller(rougher, kParameters, kNsPerMs).LoadState(all)) << "other pre-sliding";
  int refused = 0;
  Controller other(loop.robot, kParameters, kNsPerMs);
  for (std::size_t i = 0; i < state.size(); i += 7) {
    std::vector<std::byte> damaged = state;
    damaged[i] ^= std::byte{0xFF};
    if (!other.LoadState(damaged)) {
      ++refused;
      continue;
    }
    CycleOutput output;
    other.Step(loop.input, output);
  }
  EXPECT_GT(refused, 0);
}

TEST(Controller, SameInputSameBits) {
  IdealLoop a, b;
  a.RunUntilRunning();
  b.RunUntilRunning();
  for (int i = 0; i < 3000; ++i) {
    const double angle = i * 2e-3;
    a.Step(a.Bending(0.6 * std::cos(angle), 0.6 * std::sin(angle)));
    b.Step(b.Bending(0.6 * std::cos(angle), 0.6 * std::sin(angle)));
    ASSERT_EQ(0, std::memcmp(a.output.torque_desired_Nm.data(), b.output.torque_desired_Nm.data(),
                             3 * sizeof(double)));
    ASSERT_EQ(0, std::memcmp(a.output.tip_estimate_W_m.data(), b.output.tip_estimate_W_m.data(),
                             3 * sizeof(double)));
  }
}

}  // namespace
}  // namespace tendril::control
