// Every guard, provoked on the plant: which fault it becomes, within how many cycles, and the rules of
// safety_rig.h in every cycle of the run.
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <vector>

#include "safety_rig.h"

namespace tendril::daemon {
namespace {

constexpr int kNode = 2;  // whose sensors and drive the table spoils

SafetyOptions Rig() {
  SafetyOptions o;
  const std::string config = std::string(TENDRIL_SOURCE_DIR) + "/config/";
  o.daemon = config::LoadDaemon(config + "tendrild.yaml");
  o.robot = config::LoadRobot(config + "robots/rig_60mm.yaml");
  o.plant = o.robot;
  o.daemon.controller.pretension_ramp_Nps = 5;
  o.daemon.controller.pretension_settle_s = 0.05;
  return o;
}

enum class Activity { kRest, kCircle, kTension };

struct Guard {
  const char* name;
  Activity activity;                // of the robot when it happens
  void (*prepare)(SafetyOptions&);  // a plant or setting that it needs; may be null
  void (*provoke)(SafetyRig&);      // may be null: it comes by itself
  Status status;
  int cycles;  // reaction, from provoking
};

void FixCell(SafetyRig& r, std::int16_t mV) {
  r.tampering = {};
  r.tampering.node = kNode;
  r.tampering.cell_fixed = true;
  r.tampering.cell_mV = mV;
}
void StickEncoder(SafetyRig& r) {
  FaultParameters f;
  f.kind = FaultKind::kStickSensor;
  f.node = kNode;
  f.sensor = DriveSensor::kEncoder;
  r.Order(f);
}
void MoveEncoder(SafetyRig& r, std::int32_t counts, double per_cycle) {
  r.tampering = {};
  r.tampering.node = kNode;
  r.tampering.offset_counts = counts;
  r.tampering.counts_per_cycle = per_cycle;
}
void Order(SafetyRig& r, FaultKind kind) {
  FaultParameters f;
  f.kind = kind;
  f.node = kNode;
  r.Order(f);
}

// counts per metre of tendon are 7.7e5 here: 2048 a turn of a motor that pulls 2.65 mm.
const Guard kGuards[] = {
    {"TensionOverLimit", Activity::kTension,
     [](SafetyOptions& o) { o.plant.actuation->tendons[1].motor.torque_scale = 1.8; }, nullptr,
     Status::kTensionOverLimit, 2500},
    {"TensionOverLimitBySensor", Activity::kCircle, nullptr, [](SafetyRig& r) { FixCell(r, 2300); },
     Status::kTensionOverLimit, 2},
    {"Slack", Activity::kRest, [](SafetyOptions& o) { o.daemon.controller.guards.max_slack_s = 1; },
     [](SafetyRig& r) { FixCell(r, 0); }, Status::kTendonSlack, 1002},
    {"SensorStuck", Activity::kCircle, nullptr,
     [](SafetyRig& r) {
       FixCell(r, static_cast<std::int16_t>(std::lround(r.output().tension_measured_N[kNode - 1] * 200)));
     },
     Status::kSensorStuck, 1500},
    {"SensorDisconnectedAtZero", Activity::kCircle, nullptr, [](SafetyRig& r) { FixCell(r, 0); },
     Status::kSensorDisconnected, 22},
    {"SensorDisconnectedAtRail", Activity::kRest, nullptr, [](SafetyRig& r) { FixCell(r, -10000); },
     Status::kSensorDisconnected, 22},
    {"SensorDisagrees", Activity::kRest, nullptr, [](SafetyRig& r) { FixCell(r, 800); },
     Status::kSensorDisagrees, 22},
    {"DisplacementJump", Activity::kRest, nullptr, [](SafetyRig& r) { MoveEncoder(r, 512, 0); },
     Status::kDisplacementJump, 2},
    {"DisplacementRate", Activity::kTension,
     // So fast an encoder also contradicts the torque; here this guard alone is asked.
     [](SafetyOptions& o) { o.daemon.controller.guards.tension_disagreement_N = 1000; },
     [](SafetyRig& r) { MoveEncoder(r, 0, 375); }, Status::kDisplacementRate, 40},
    {"FollowingError", Activity::kCircle,
     // Once it hangs, a tendon whose encoder stands still fits no shape either; each guard is asked alone.
     [](SafetyOptions& o) { o.daemon.controller.guards.max_estimator_residual_m = 1; }, StickEncoder,
     Status::kFollowingError, 1500},
    {"EncoderOfAHangingTendon", Activity::kCircle,
     [](SafetyOptions& o) { o.daemon.controller.guards.max_following_error_m = 1; }, StickEncoder,
     Status::kEstimatorDiverged, 1500},
    {"EstimatorDiverged", Activity::kTension, nullptr, [](SafetyRig& r) { MoveEncoder(r, 0, 20); },
     Status::kEstimatorDiverged, 400},
    {"BendingOverLimit", Activity::kTension,
     [](SafetyOptions& o) {
       o.robot.limits.max_bending_rad = 0.6;
       o.daemon.controller.guards.max_bending_excess_rad = 0.1;
     },
     nullptr, Status::kBendingOverLimit, 3000},
    {"TpdoMissing", Activity::kCircle, nullptr,
     [](SafetyRig& r) {
       FaultParameters f;
       f.kind = FaultKind::kDrop;
       f.node = kNode;
       f.cob_id = 0x180u + kNode;
       f.direction = FrameDirection::kFromDrives;
       r.Order(f);
     },
     Status::kFeedbackStale, 8},
    {"HeartbeatLost", Activity::kCircle, nullptr, [](SafetyRig& r) { Order(r, FaultKind::kStopHeartbeat); },
     Status::kDriveLost, 255},
    {"DriveDead", Activity::kCircle, nullptr, [](SafetyRig& r) { Order(r, FaultKind::kDie); },
     Status::kFeedbackStale, 8},
    {"DriveFrozen", Activity::kCircle, nullptr, [](SafetyRig& r) { Order(r, FaultKind::kFreeze); },
     Status::kFeedbackStale, 8},
    {"DriveHung", Activity::kCircle, nullptr,
     [](SafetyRig& r) {
       r.tampering = {};
       r.tampering.node = kNode;
       r.tampering.hung = true;
     },
     Status::kDriveFrozen, 700},
    {"TorqueReadingStuck", Activity::kCircle, nullptr,
     [](SafetyRig& r) {
       FaultParameters f;
       f.kind = FaultKind::kStickSensor;
       f.node = kNode;
       f.sensor = DriveSensor::kTorque;
       r.Order(f);
     },
     Status::kDriveFrozen, 700},
    {"DriveRebooted", Activity::kCircle, nullptr, [](SafetyRig& r) { Order(r, FaultKind::kReboot); },
     Status::kDriveLost, 3},
    {"Emcy", Activity::kCircle, nullptr,
     [](SafetyRig& r) {
       FaultParameters f;
       f.kind = FaultKind::kEmcy;
       f.node = kNode;
       f.code = 0x7320;
       r.Order(f);
     },
     Status::kDriveFault, 3},
    {"BusOff", Activity::kCircle, nullptr, [](SafetyRig& r) { r.Order({.kind = FaultKind::kBusOff}); },
     Status::kBusOff, 3},
    {"LateCycles", Activity::kCircle, nullptr, [](SafetyRig& r) { r.Step({}, 150); }, Status::kCyclesLate, 1},
    {"ClockStep", Activity::kCircle, nullptr, [](SafetyRig& r) { r.Step({}, 0, kNsPerMs / 3); },
     Status::kTimeStepped, 1},
};

// What was measured: printed when this program runs as a whole, and written as Markdown to the file that
// TENDRIL_GUARDS_MD names.
struct Measured {
  const Guard* guard;
  int reaction, fall;
  double highest_N;
};
std::vector<Measured>& Measurements() {
  static std::vector<Measured> all;
  return all;
}

class GuardOnThePlant : public testing::TestWithParam<Guard> {
 public:
  static void TearDownTestSuite() {
    if (Measurements().size() < std::size(kGuards)) return;
    std::string t =
        "| provoked | fault | threshold | cycles to the fault: measured (bound) | to drives told to disable "
        "[ms] | highest tension [N] |\n|---|---|---|---|---|---|\n";
    for (const Measured& m : Measurements()) {
      char row[400];
      const std::string measured = m.guard->provoke != nullptr ? std::to_string(m.reaction) : "as it comes";
      std::snprintf(row, sizeof row, "| %s | %d | %s | %s (%d) | %d | %.2f |\n", m.guard->name,
                    static_cast<int>(m.guard->status), KeyOf(m.guard->status), measured.c_str(),
                    m.guard->cycles, m.fall, m.highest_N);
      t += row;
    }
    std::printf("%s", t.c_str());
    if (const char* path = std::getenv("TENDRIL_GUARDS_MD")) std::ofstream(path) << t;
  }

 private:
  static const char* KeyOf(Status s) {
    switch (s) {
      case Status::kTensionOverLimit:
        return "limits.max_tension_motor_N, guards.tension_margin";
      case Status::kTendonSlack:
        return "slack_tension_N, max_slack_s";
      case Status::kSensorStuck:
        return "stuck_torque_change_N";
      case Status::kSensorDisconnected:
      case Status::kSensorDisagrees:
        return "tension_disagreement_N, confirm_cycles";
      case Status::kDisplacementJump:
        return "max_displacement_jump_m";
      case Status::kDisplacementRate:
        return "max_displacement_rate_mps, confirm_cycles";
      case Status::kFollowingError:
        return "max_following_error_m, confirm_cycles";
      case Status::kEstimatorDiverged:
        return "max_estimator_residual_m, confirm_cycles";
      case Status::kBendingOverLimit:
        return "max_bending_excess_rad, confirm_cycles";
      case Status::kFeedbackStale:
        return "max_missing_cycles";
      case Status::kDriveFrozen:
        return "max_torque_error_N, confirm_cycles";
      case Status::kCyclesLate:
        return "max_late_cycles";
      case Status::kDriveLost:
        return "bus.heartbeat_timeout_ms";
      default:
        return "none: at once";
    }
  }
};

// A cycle of what the robot is about.
void Go(SafetyRig& r, Activity activity, int i) {
  const double t_s = i * 1e-3;
  if (activity == Activity::kCircle && i % 10 == 0) {
    r.Step(r.Circle(std::min(1., t_s), 2, t_s));
  } else if (activity == Activity::kTension && i % 10 == 0) {
    r.Step(r.Tensions(Eigen::Vector3d(0.4, 7.9, 0.4)));
  } else {
    r.Step();
  }
}

TEST_P(GuardOnThePlant, BecomesItsFaultInTimeAndNoRuleIsBroken) {
  const Guard& g = GetParam();
  SafetyOptions o = Rig();
  if (g.prepare != nullptr) g.prepare(o);
  SafetyRig r(o);
  ASSERT_TRUE(r.Arm()) << StatusText(r.output().status) << "; " << r.last_event();
  int i = 0;
  if (g.provoke != nullptr) {
    for (; i < 800; ++i) Go(r, g.activity, i);
    ASSERT_EQ(r.output().mode, Mode::kRunning)
        << StatusText(r.output().status) << ": before anything happened";
    g.provoke(r);
  }
  int reaction = 0;
  while (r.output().mode != Mode::kFault && reaction <= g.cycles) {
    Go(r, g.activity, i++);
    ++reaction;
  }
  ASSERT_EQ(r.output().mode, Mode::kFault);
  EXPECT_EQ(r.output().status, g.status) << StatusText(r.output().status);
  EXPECT_LE(reaction, g.cycles);
  r.Run(2);
  Measurements().push_back(
      {&g, reaction, static_cast<int>(std::lround(1e3 * r.fall_s())), r.max_tension_N()});
  EXPECT_EQ(r.output().mode, Mode::kFault) << "latched";
  EXPECT_EQ(r.output().drive_request, DriveRequest::kDisable);
  if (std::string(g.name) !=
      "DriveFrozen") {  // deaf to everything: nothing but its supply takes its torque away
    for (int d = 0; d < 3; ++d) EXPECT_EQ(r.rig().drives().torque_Nm(d), 0) << "drive " << d + 1;
  }
  EXPECT_EQ(r.Step(r.Request(ModeRequest::kArm)).output.command_status, Status::kCommandWrongMode);
  for (const std::string& v : r.violations()) ADD_FAILURE() << v;
}

INSTANTIATE_TEST_SUITE_P(All, GuardOnThePlant, testing::ValuesIn(kGuards),
                         [](const auto& g) { return std::string(g.param.name); });

// On the way down of a safe stop a robot is under tension as well: what can be found there is.
class GuardInASafeStop : public testing::TestWithParam<Guard> {};

TEST_P(GuardInASafeStop, BecomesItsFaultInTimeAndNoRuleIsBroken) {
  const Guard& g = GetParam();
  SafetyOptions o = Rig();
  if (g.prepare != nullptr) g.prepare(o);
  o.daemon.controller.pretension_ramp_Nps = 4;
  SafetyRig r(o);
  ASSERT_TRUE(r.Arm());
  for (int i = 0; i < 2000; ++i) Go(r, Activity::kTension, i);
  r.Step(r.Request(ModeRequest::kDisarm));
  r.Run(0.1);
  ASSERT_EQ(r.output().mode, Mode::kSafeStop) << StatusText(r.output().status);
  g.provoke(r);
  int reaction = 0;
  while (r.output().mode == Mode::kSafeStop && reaction <= g.cycles) {
    r.Step();
    ++reaction;
  }
  ASSERT_EQ(r.output().mode, Mode::kFault) << "after " << reaction << " cycles";
  EXPECT_EQ(r.output().status, g.status) << StatusText(r.output().status);
  EXPECT_LE(reaction, g.cycles);
  r.Run(2);
  EXPECT_EQ(r.output().mode, Mode::kFault) << "latched";
  EXPECT_EQ(r.output().drive_request, DriveRequest::kDisable);
  for (const std::string& v : r.violations()) ADD_FAILURE() << v;
}

std::vector<Guard> GuardsOfASafeStop() {
  std::vector<Guard> found;
  for (const Guard& g : kGuards) {
    // Nothing is followed any more by which an encoder that stands still would show; no slack lasts so long.
    const bool elsewhere = g.provoke == StickEncoder || g.status == Status::kTendonSlack;
    if (g.provoke == nullptr || elsewhere) continue;
    found.push_back(g);
    // Less than there is, not more.
    if (g.status == Status::kSensorDisagrees) found.back().provoke = [](SafetyRig& r) { FixCell(r, 200); };
  }
  return found;
}
INSTANTIATE_TEST_SUITE_P(All, GuardInASafeStop, testing::ValuesIn(GuardsOfASafeStop()),
                         [](const auto& g) { return std::string(g.param.name); });

struct BadCommand {
  const char* name;
  Command (*make)(SafetyRig&);
  Status status;
};
const BadCommand kBadCommands[] = {
    {"NotFinite", [](SafetyRig& r) { return r.Bend(std::nan(""), 0); }, Status::kCommandNotFinite},
    {"OutOfRange", [](SafetyRig& r) { return r.Bend(3, 0); }, Status::kCommandOutOfRange},
    {"TensionOutOfRange", [](SafetyRig& r) { return r.Tensions(Eigen::Vector3d(9, 1, 1)); },
     Status::kCommandOutOfRange},
    {"WrongSize", [](SafetyRig& r) { return r.Tensions(TendonVector::Constant(5, 1.)); },
     Status::kCommandWrongSize},
    {"Stale",
     [](SafetyRig& r) {
       Command c = r.Bend(0.2, 0);
       c.received_ns -= kNsPerS;
       return c;
     },
     Status::kCommandStale},
    {"WrongMode", [](SafetyRig& r) { return r.Request(ModeRequest::kClear); }, Status::kCommandWrongMode},
    {"AnotherSender",
     [](SafetyRig& r) {
       Command c = r.Bend(0.2, 0);
       c.sender = 9;
       return c;
     },
     Status::kAnotherSender},
    {"OutOfOrder",
     [](SafetyRig& r) {
       Command c = r.Bend(0.2, 0);
       c.sequence -= 2;
       return c;
     },
     Status::kCommandOutOfOrder},
};

class CommandOnThePlant : public testing::TestWithParam<BadCommand> {};

TEST_P(CommandOnThePlant, IsRefusedInItsCycleAndTheMotionGoesOn) {
  SafetyRig good(Rig()), bad(Rig());
  ASSERT_TRUE(good.Arm() && bad.Arm());
  for (int i = 0; i < 400; ++i) {
    const bool now = i == 205;
    Go(good, Activity::kCircle, i);
    if (now) {
      const std::uint32_t refused = bad.output().commands_refused;
      bad.Step(GetParam().make(bad));
      EXPECT_EQ(bad.output().command_status, GetParam().status) << StatusText(bad.output().command_status);
      EXPECT_EQ(bad.output().commands_refused, refused + 1);
    } else {
      Go(bad, Activity::kCircle, i);
    }
    ASSERT_EQ(bad.output().mode, Mode::kRunning);
    ASSERT_EQ(bad.output().torque_target_permille, good.output().torque_target_permille) << "in cycle " << i;
  }
  for (const std::string& v : bad.violations()) ADD_FAILURE() << v;
}

INSTANTIATE_TEST_SUITE_P(All, CommandOnThePlant, testing::ValuesIn(kBadCommands),
                         [](const auto& c) { return std::string(c.param.name); });

// Enabled, its heart beats, and its feedback does not come: it may not stay armed for ever.
TEST(Arming, ADriveThatSwitchesOnWithoutFeedbackIsAFaultThatNamesIt) {
  SafetyRig r(Rig());
  ASSERT_TRUE(r.RunUntil(Mode::kConfigured, 10));
  r.Order({.kind = FaultKind::kDrop, .for_s = 3.5, .node = 2, .cob_id = 0x182});
  r.Step(r.Request(ModeRequest::kArm));
  r.Run(2.9);
  EXPECT_EQ(r.output().mode, Mode::kArmed);
  ASSERT_TRUE(r.RunUntil(Mode::kFault, 0.3));
  EXPECT_EQ(r.output().status, Status::kEnableTimedOut) << StatusText(r.output().status);
  EXPECT_EQ(r.output().blamed_tendon, 2);
  EXPECT_EQ(r.output().drive_request, DriveRequest::kDisable);
  r.Run(1);
  r.Step(r.Request(ModeRequest::kClear));
  EXPECT_TRUE(r.Arm());
  for (const std::string& v : r.violations()) ADD_FAILURE() << v;
}

// A drive whose application hangs hears no controlword: the master gives it up, and says how it stands.
TEST(Arming, ADriveThatNeverSwitchesOnIsAFaultThatNamesItAndNothingPulls) {
  SafetyRig r(Rig());
  ASSERT_TRUE(r.RunUntil(Mode::kConfigured, 10));
  r.tampering.node = 2;
  r.tampering.hung = true;
  r.Step(r.Request(ModeRequest::kArm));
  ASSERT_TRUE(r.RunUntil(Mode::kFault, 2.5));
  EXPECT_EQ(r.output().status, Status::kDriveFault) << StatusText(r.output().status);
  EXPECT_EQ(r.output().blamed_tendon, 2);
  EXPECT_NE(r.events().find("node 2: enabling: stuck in"), std::string::npos) << r.events();
  EXPECT_EQ(r.output().drive_request, DriveRequest::kDisable);
  for (const std::string& v : r.violations()) ADD_FAILURE() << v;
}

TEST(SilentCommands, HoldTheRobotWhereItStopsUntilItIsArmedAgain) {
  SafetyRig r(Rig());
  ASSERT_TRUE(r.Arm());
  for (int i = 0; i < 500; ++i) Go(r, Activity::kCircle, i);
  int silent = 0;
  while (r.output().mode == Mode::kRunning && silent < 2000) {
    r.Step();
    ++silent;
  }
  EXPECT_EQ(r.output().mode, Mode::kHold);
  EXPECT_EQ(r.output().status, Status::kCommandsSilent);
  // Sent every 10 ms and valid for 100 ms; then the silence allowed.
  EXPECT_NEAR(silent, 1100, 12);
  EXPECT_EQ(r.Step(r.Bend(0, 0)).output.command_status, Status::kCommandWrongMode);
  r.Run(0.5);
  EXPECT_EQ(r.output().reference.velocity_radps.norm(), 0);
  r.Step(r.Request(ModeRequest::kArm));
  EXPECT_EQ(r.output().mode, Mode::kRunning);
  for (const std::string& v : r.violations()) ADD_FAILURE() << v;
}

// A slack tendon's cell shows tension for a cycle now and then, by noise.
TEST(Slack, ANoisyReadingDoesNotStartTheCountAnew) {
  SafetyOptions o = Rig();
  o.daemon.controller.guards.max_slack_s = 1;
  SafetyRig r(o);
  ASSERT_TRUE(r.Arm());
  for (int i = 0; i < 1200 && r.output().mode == Mode::kRunning; ++i) {
    FixCell(r, i % 100 == 99 ? 20 : 0);  // 0.1 N, above slack_tension_N
    r.Step();
  }
  EXPECT_EQ(r.output().status, Status::kTendonSlack) << StatusText(r.output().status);
}

// The cell sits before the pulleys, whose friction takes a good fifth: what is left is still too much.
TEST(TensionLimit, HoldsAtTheBaseAsWell) {
  SafetyOptions o = Rig();
  o.daemon.controller.guards.tension_margin = 0.02;
  for (RobotParameters* robot : {&o.robot, &o.plant}) robot->limits.max_tension_base_N = 5;
  SafetyRig r(o);
  ASSERT_TRUE(r.Arm());
  FixCell(r, 1600);  // 8 N of 10: more than 6 N at the base
  r.Step();
  r.Step();
  EXPECT_EQ(r.output().mode, Mode::kFault);
  EXPECT_EQ(r.output().status, Status::kTensionOverLimit) << StatusText(r.output().status);
}

// Tendons of which nothing is known yet may not be pulled beyond the limit either.
TEST(TensionLimit, EndsHomingWhenACellShowsMore) {
  SafetyRig r(Rig());
  ASSERT_TRUE(r.RunUntil(Mode::kConfigured, 10));
  r.Step(r.Request(ModeRequest::kHome));
  r.Run(0.2);
  ASSERT_EQ(r.output().mode, Mode::kHoming) << StatusText(r.output().status);
  FixCell(r, 2300);  // 11.5 N
  r.Step();
  r.Step();
  EXPECT_EQ(r.output().mode, Mode::kFault);
  EXPECT_EQ(r.output().status, Status::kTensionOverLimit);
  r.Run(2);
  EXPECT_EQ(r.output().drive_request, DriveRequest::kDisable);
  for (const std::string& v : r.violations()) ADD_FAILURE() << v;
}

// Motors eight times as strong as their file says: the pull of 2 N that was asked for would be 16 N. All pull
// at once, so that the robot does not give way.
TEST(TensionLimit, EndsCommissioningBeforeATensionIsTooHigh) {
  SafetyOptions o = Rig();
  for (TendonDriveParameters& t : o.plant.actuation->tendons) t.motor.torque_scale = 8;
  SafetyRig r(o);
  ASSERT_TRUE(r.RunUntil(Mode::kConfigured, 10));
  r.Step(r.Request(ModeRequest::kCommission));
  ASSERT_EQ(r.output().mode, Mode::kCommissioning);
  for (int i = 0; i < 3000 && r.output().mode == Mode::kCommissioning; ++i) {
    r.Step(i % 50 == 0 ? r.Tensions(Eigen::Vector3d(2, 2, 2)) : Command{});
  }
  EXPECT_EQ(r.output().mode, Mode::kFault);
  EXPECT_EQ(r.output().status, Status::kTensionOverLimit) << StatusText(r.output().status);
  EXPECT_GT(r.max_tension_N(), o.robot.limits.max_tension_motor_N) << "the pull was too strong";
  r.Run(2);
  EXPECT_EQ(r.output().drive_request, DriveRequest::kDisable);
  for (const std::string& v : r.violations()) ADD_FAILURE() << v;
}

TEST(ConfigurationMismatch, AnotherMotorIsNeverArmed) {
  SafetyOptions o = Rig();
  o.robot.actuation->tendons[1].drive.rated_torque_Nm *= 1.5;
  SafetyRig r(o);
  EXPECT_FALSE(r.RunUntil(Mode::kConfigured, 6));
  EXPECT_EQ(r.output().mode, Mode::kDisconnected);
  EXPECT_EQ(r.Step(r.Request(ModeRequest::kArm)).output.command_status, Status::kCommandWrongMode);
  EXPECT_NE(r.events().find("6076"), std::string::npos) << r.events();
  EXPECT_EQ(r.output().status, Status::kDriveMisconfigured) << "and no fault of the drive";
  for (const std::string& v : r.violations()) ADD_FAILURE() << v;
}

TEST(ConfigurationMismatch, AnotherDeviceIsNamedAsOne) {
  SafetyOptions o = Rig();
  o.daemon.bus.identity.product_codes = {0x65510000};
  SafetyRig r(o);
  EXPECT_FALSE(r.RunUntil(Mode::kConfigured, 6));
  EXPECT_EQ(r.output().status, Status::kOtherDevice);
}

bool Reports(const CycleOutput& output, Status status) {
  return std::find(output.reported.begin(), output.reported.end(), status) != output.reported.end();
}

TEST(NodeIdTwice, PluggedInWhileRunningIsAFaultThatNamesIt) {
  SafetyRig r(Rig());
  ASSERT_TRUE(r.Arm());
  r.Run(0.2);
  r.PlugIn({.node_id = 2, .serial = 99});
  ASSERT_TRUE(r.RunUntil(Mode::kFault, 0.1));
  r.Run(0.05);
  EXPECT_EQ(r.output().status, Status::kDriveLost);
  EXPECT_TRUE(Reports(r.output(), Status::kNodeIdTwice)) << r.events();
  EXPECT_EQ(r.rig().drives().torque_Nm(1), 0) << "the first one is taken off as well";
  r.Run(3);
  ASSERT_EQ(r.Step(r.Request(ModeRequest::kClear)).output.mode, Mode::kDisconnected);
  r.Run(3);
  EXPECT_EQ(r.output().mode, Mode::kDisconnected);
  EXPECT_EQ(r.output().status, Status::kNodeIdTwice);
  EXPECT_NE(r.events().find("two drives have this node id: serial numbers"), std::string::npos) << r.events();
  EXPECT_EQ(r.Step(r.Request(ModeRequest::kArm)).output.command_status, Status::kCommandWrongMode);
  for (const std::string& v : r.violations()) ADD_FAILURE() << v;
}

TEST(NodeIdTwice, ThereFromTheBeginningIsNeverArmed) {
  SafetyRig r(Rig());
  r.PlugIn({.node_id = 2, .serial = 99});
  EXPECT_FALSE(r.RunUntil(Mode::kConfigured, 6));
  EXPECT_EQ(r.output().status, Status::kNodeIdTwice) << r.events();
}

// A loop that runs every second cycle only, and a drive that seems not to be there.
TEST(CyclesMissed, AreNamedBeforeADriveThatDoesNotAnswer) {
  for (const std::uint64_t skipped : {0, 1}) {
    SafetyRig r(Rig());
    r.Order({.kind = FaultKind::kDie, .node = 2});
    for (int i = 0; i < 8000; ++i) r.Step({}, skipped);
    EXPECT_EQ(r.output().mode, Mode::kDisconnected);
    EXPECT_EQ(r.output().status, skipped ? Status::kCyclesMissed : Status::kDriveAbsent);
    EXPECT_TRUE(Reports(r.output(), Status::kDriveAbsent));
    EXPECT_NE(StatusRemedy(Status::kCyclesMissed).find("tendril rt-check"), std::string_view::npos);
  }
}

TEST(CyclesMissed, AreToldWithADriveLostMeanwhile) {
  for (const std::uint64_t skipped : {0, 1}) {
    SafetyRig r(Rig());
    ASSERT_TRUE(r.RunUntil(Mode::kConfigured, 10));
    for (int i = 0; i < 500; ++i) r.Step({}, skipped);
    ASSERT_EQ(r.output().mode, Mode::kConfigured) << "no fault without torque";
    r.Order({.kind = FaultKind::kDie, .node = 2});
    for (int i = 0; i < 3000 && r.output().mode != Mode::kFault; ++i) r.Step({}, skipped);
    ASSERT_EQ(r.output().mode, Mode::kFault);
    EXPECT_EQ(r.output().status, Status::kDriveLost);
    EXPECT_EQ(Reports(r.output(), Status::kCyclesMissed), skipped > 0);
  }
}

TEST(SafeStop, RampsDownAndDisablesFromEveryMotion) {
  for (const Activity a : {Activity::kRest, Activity::kCircle, Activity::kTension}) {
    SafetyRig r(Rig());
    ASSERT_TRUE(r.Arm());
    for (int i = 0; i < 1200; ++i) Go(r, a, i);
    const double pretension_N = r.options().robot.limits.min_tension_N;
    r.Step(r.Request(ModeRequest::kDisarm));
    double last_N = r.output().tension_desired_base_N.maxCoeff(), step_N = 0;
    int cycles = 0;
    while (r.output().mode == Mode::kSafeStop && cycles < 3000) {
      const double now_N = r.output().tension_desired_base_N.maxCoeff();
      step_N = std::max(step_N, last_N - now_N);
      last_N = now_N;
      r.Step();
      ++cycles;
    }
    EXPECT_EQ(r.output().mode, Mode::kConfigured);
    EXPECT_EQ(cycles == 1, a == Activity::kRest) << "at rest the robot is at pretension already";
    EXPECT_NEAR(last_N, pretension_N, 1e-9) << "what the drives are disabled at";
    EXPECT_LE(step_N, r.options().daemon.controller.pretension_ramp_Nps * 1e-3 + 1e-9);
    r.Run(0.1);
    for (int d = 0; d < 3; ++d) EXPECT_FALSE(r.rig().drives().enabled(d));
    for (const std::string& v : r.violations()) ADD_FAILURE() << v;
  }
}

// Steady motions, and no guard has a word to say.
// Bare motors are held to the speed of taking up until they are off.
TEST(SafeStop, OfCommissioningLetsNoSpoolRun) {
  SafetyRig r(Rig());
  ASSERT_TRUE(r.RunUntil(Mode::kConfigured, 10));
  r.Step(r.Request(ModeRequest::kCommission));
  for (int i = 0; i < 3000; ++i) r.Step(i % 50 == 0 ? r.Tensions(Eigen::Vector3d(0, 2, 0)) : Command{});
  ASSERT_EQ(r.output().mode, Mode::kCommissioning);
  r.Step(r.Request(ModeRequest::kDisarm));
  r.rig().Connect(1, {.tendon_off = true});
  const double begin_m = r.rig().plant().tendon()[1].spool_pull_m;
  double last_m = begin_m, fastest_mps = 0;
  while (r.output().mode == Mode::kSafeStop) {
    r.Step();
    const double now_m = r.rig().plant().tendon()[1].spool_pull_m;
    fastest_mps = std::max(fastest_mps, std::abs(now_m - last_m) / 1e-3);
    last_m = now_m;
  }
  EXPECT_LT(fastest_mps, 1.5 * r.options().daemon.controller.take_up.max_speed_mps);
  EXPECT_EQ(r.output().mode, Mode::kConfigured);
  for (const std::string& v : r.violations()) ADD_FAILURE() << v;
}

TEST(Guards, AreSilentOnGoodRuns) {
  for (const double omega : {0.5, 2.}) {
    SafetyRig r(Rig());
    ASSERT_TRUE(r.Arm());
    for (int i = 0; i < 3000; ++i) {
      r.Step(i % 10 == 0 ? r.Circle(std::min(1., i * 1e-3), omega, i * 1e-3) : Command{});
      ASSERT_EQ(r.output().mode, Mode::kRunning)
          << omega << " rad/s at " << i << ": " << StatusText(r.output().status);
    }
    for (int i = 0; i < 3000; ++i) {  // to and fro
      Command c = r.Bend(0, i / 1500 % 2 == 0 ? 1.2 : -1.2);
      c.speed_radps = 1;
      r.Step(i % 1500 == 0 ? c : Command{});
      ASSERT_EQ(r.output().mode, Mode::kRunning) << "step at " << i << ": " << StatusText(r.output().status);
    }
    for (const std::string& v : r.violations()) ADD_FAILURE() << v;
  }
}

// The law steers without looking. Motions too fast for that whip the robot until slack tendons snap taut at
// twice the limit; the guards end them before.
TEST(Guards, EndMotionsThatThrowTheRobotAboutBeforeATensionIsTooHigh) {
  for (const bool guarded : {true, false}) {
    SafetyOptions o = Rig();
    // By a file that knows little of the rotors; with its own the motion is not so fast.
    for (auto& t : o.robot.actuation->tendons) t.motor.rotor_inertia_kgm2 /= 10;
    GuardParameters& g = o.daemon.controller.guards;
    if (!guarded) {
      g.max_following_error_m = g.max_displacement_jump_m = g.max_displacement_rate_mps = 1;
      g.tension_disagreement_N = g.stuck_torque_change_N = g.max_slack_s = g.max_bending_excess_rad = 100;
      g.max_estimator_residual_m = 1;
    }
    SafetyRig r(o);
    ASSERT_TRUE(r.Arm());
    for (int i = 0; i < 2000; ++i) {
      Command c = r.Bend(i / 500 % 2 == 0 ? 1.5 : -1.5, 0);
      c.speed_radps = 8;
      r.Step(i % 500 == 0 ? c : Command{});
    }
    EXPECT_EQ(r.output().mode, Mode::kFault);
    EXPECT_EQ(r.output().status, guarded ? Status::kFollowingError : Status::kTensionOverLimit);
    EXPECT_EQ(r.violations().empty(), guarded) << r.max_tension_N() << " N";
  }
}

// What is done after a fault follows no single sensor, for it may be what the fault is about.
TEST(AfterAFault, AWrongEncoderBesideASlackTendonMovesNothing) {
  for (const double counts_per_cycle : {-375.0, -50.0, 375.0}) {
    SafetyOptions o = Rig();
    o.plant.effects.push_back({.name = "slack", .where = "tendon:2", .values = {{"m", 0.004}}});
    SafetyRig r(o);
    ASSERT_TRUE(r.Arm());
    for (int i = 0; i < 2000; ++i)
      r.Step(i % 10 == 0 ? r.Tensions(Eigen::Vector3d(1.3, 0.3, 1.3)) : Command{});
    ASSERT_EQ(r.output().mode, Mode::kRunning);
    MoveEncoder(r, 0, counts_per_cycle);
    const double pulled_m = r.rig().plant().tendon()[1].spool_pull_m;
    bool faulted = false;
    for (int i = 0; i < 3000; ++i) {
      r.Step();
      faulted = faulted || r.output().mode == Mode::kFault;
      if (faulted) {
        ASSERT_LT(r.rig().plant().tendon()[1].tension_motor_N, 1.5) << counts_per_cycle;
      }
    }
    EXPECT_TRUE(faulted);
    EXPECT_NEAR(r.rig().plant().tendon()[1].spool_pull_m, pulled_m, 5e-3) << counts_per_cycle;
    EXPECT_TRUE(r.violations().empty());
  }
}

// Load cells hold a motor that is half as strong again as its file says to the desired tension; the end of
// that, by a fault or by the operator, is no jerk.
TEST(AfterAFault, WhatTensionFeedbackTookOffDoesNotComeBackAtOnce) {
  for (const bool fault : {true, false}) {
    SCOPED_TRACE(fault);
    SafetyOptions o = Rig();
    o.daemon.controller.law = ControlLaw::kEquilibrium;
    o.daemon.controller.tension_feedback = true;
    o.plant.actuation->tendons[1].motor.torque_scale = 1.5;
    o.daemon.controller.guards.tension_disagreement_N = 10;
    SafetyRig r(o);
    ASSERT_TRUE(r.Arm());
    for (int i = 0; i < 6000; ++i) r.Step(i % 10 == 0 ? r.Tensions(Eigen::Vector3d(0.4, 6, 0.4)) : Command{});
    ASSERT_EQ(r.output().mode, Mode::kRunning) << StatusText(r.output().status);
    const double before_N = r.rig().plant().tendon()[1].tension_motor_N;
    double highest_N = 0, last_N = before_N, drop_N = 0;
    if (fault) {
      FaultParameters f;
      f.kind = FaultKind::kEmcy;
      f.node = 1;
      f.code = 0x7320;
      r.Order(f);
    } else {
      r.Step(r.Request(ModeRequest::kDisarm));
    }
    while (r.now_s() < 20 && r.output().mode != Mode::kConfigured && r.rig().drives().enabled(1)) {
      r.Step();
      const double now_N = r.rig().plant().tendon()[1].tension_motor_N;
      highest_N = std::max(highest_N, now_N);
      if (r.output().drive_request == DriveRequest::kEnable) drop_N = std::max(drop_N, last_N - now_N);
      last_N = now_N;
    }
    EXPECT_LT(highest_N, before_N + 0.3);
    EXPECT_LT(drop_N, 0.1) << "in a cycle";
    for (const std::string& v : r.violations()) ADD_FAILURE() << v;
  }
}

TEST(AfterAFault, ADeadCellLetsNoTautTendonGo) {
  SafetyRig r(Rig());
  ASSERT_TRUE(r.Arm());
  for (int i = 0; i < 4000; ++i) r.Step(i % 10 == 0 ? r.Tensions(Eigen::Vector3d(0.3, 5, 0.3)) : Command{});
  ASSERT_EQ(r.output().mode, Mode::kRunning);
  FixCell(r, 0);
  while (r.output().mode == Mode::kRunning) r.Step();
  ASSERT_EQ(r.output().mode, Mode::kFault);
  const double before_N = r.rig().plant().tendon()[1].tension_motor_N;
  const int told = r.output().torque_target_permille[1];
  for (int i = 0; i < 100; ++i) r.Step();
  // A tenth of a second of the ramp.
  const double ramp_N = 0.1 * r.options().daemon.controller.pretension_ramp_Nps;
  EXPECT_GT(r.rig().plant().tendon()[1].tension_motor_N, before_N - 2 * ramp_N);
  EXPECT_GT(r.output().torque_target_permille[1], told / 2);
}

}  // namespace
}  // namespace tendril::daemon
