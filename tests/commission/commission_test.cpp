// Commissioning on the plant in process: the rig as its files say passes, and every mistake that is made with
// a new arm is named with its tendon and its remedy.
#include "tendril/commission/commission.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <numbers>
#include <sstream>

#include "tendril/config/config.h"
#include "tendril/experiment/closed_loop.h"

namespace tendril::daemon {
namespace {

using commission::CommissionResult;
using commission::DriveFinding;
using experiment::ClosedLoop;
using rig::Wiring;
using testing::AllOf;
using testing::HasSubstr;

std::string Config(const std::string& name) { return std::string(TENDRIL_SOURCE_DIR) + "/config/" + name; }

class Link final : public commission::CommissionLink {
 public:
  explicit Link(experiment::ClosedLoop& loop) : loop_(loop) {}
  void Pull(const TendonVector& pull_N) override {
    pull_N_ = pull_N;
    Send();
  }
  const CycleRecord& Next() override {
    if (++cycles_ % 50 == 0) Send();
    const CycleRecord& r = loop_.Step();
    if (r.output.mode != Mode::kCommissioning) {
      throw std::runtime_error("left commissioning: " + std::string(StatusText(r.output.status)));
    }
    for (int j = 0; j < pull_N_.size(); ++j) {
      highest_N = std::max(highest_N, loop_.plant().tendon()[static_cast<std::size_t>(j)].tension_motor_N);
    }
    return r;
  }
  double highest_N = 0;

 private:
  void Send() {
    Command c;
    c.kind = CommandKind::kTension;
    c.tension_N = pull_N_;
    loop_.Send(c);
  }
  experiment::ClosedLoop& loop_;
  TendonVector pull_N_;
  int cycles_ = 0;
};

struct Arm {
  explicit Arm(const std::string& robot_file = "robots/rig_60mm.yaml",
               const std::string& daemon_file = "tendrild.yaml")
      : robot(config::LoadRobot(Config(robot_file))),
        plant(robot),
        daemon(config::LoadDaemon(Config(daemon_file))) {
    daemon.lcm.cycle_every_cycles = 0;
    daemon.lcm.state_every_cycles = 1000;
  }

  commission::CommissionResult Commission() {
    loop.emplace(experiment::ClosedLoopOptions{.controller_robot = robot,
                                               .plant_robot = plant,
                                               .daemon = daemon,
                                               .plant = {},
                                               .log_path = {},
                                               .keep_nodes = keep_nodes});
    for (const auto& [drive, wiring] : wirings) loop->rig().Connect(drive, wiring);
    loop->StepUntil([](const CycleRecord& r) { return r.output.mode == Mode::kConfigured; }, 10,
                    "the drives");
    loop->Send(ModeRequest::kCommission);
    loop->StepUntil([](const CycleRecord& r) { return r.output.mode == Mode::kCommissioning; }, 1,
                    "the mode");
    loop->StepUntil([](const CycleRecord& r) { return r.input.drive[0].state == DriveState::kEnabled; }, 3,
                    "power");
    Link link(*loop);
    // What the closed loop makes of the bus is what the daemon would run with.
    DaemonParameters used = loop->daemon();
    const commission::CommissionResult result = commission::Commission(
        link, robot, used, [](int, const std::function<void()>&) { return std::nullopt; },
        [](const std::string&) {});
    highest_N = link.highest_N;
    loop->Send(ModeRequest::kDisarm);
    loop->StepUntil([](const CycleRecord& r) { return r.output.mode == Mode::kConfigured; }, 3, "the end");
    return result;
  }

  RobotParameters robot, plant;
  DaemonParameters daemon;
  std::vector<std::pair<int, rig::Wiring>> wirings;
  std::optional<experiment::ClosedLoop> loop;
  bool keep_nodes = false;  // of the daemon's file; else the robot file's
  double highest_N = 0;
};

TEST(Commission, TheRigAsItsFilesSayPassesWithFiguresAndCanBeArmedAfterwards) {
  for (const auto& [robot, daemon] : {std::pair{"robots/rig_60mm.yaml", "tendrild.yaml"},
                                      {"robots/rig_90mm.yaml", "tendrild.yaml"},
                                      {"robots/four_tendon_90mm.yaml", "tendrild_four_tendon.yaml"}}) {
    SCOPED_TRACE(robot);
    Arm arm(robot, daemon);
    const commission::CommissionResult r = arm.Commission();
    std::printf("%s\nhighest tension %.2f N, %.0f s\n", commission::CommissionTable(r).c_str(), arm.highest_N,
                arm.loop->now_s());
    EXPECT_TRUE(r.passed());
    for (const commission::DriveFinding& f : r.drives) {
      EXPECT_EQ(f.seen_tendon, f.tendon);
      EXPECT_EQ(f.cell_tendon, f.tendon);
      EXPECT_NEAR(f.cell_zero_N, 0, 0.02);
      EXPECT_NEAR(f.cell_gain, 1, 0.1);
      EXPECT_GE(f.pulled_N, f.least_N - 0.1);
      EXPECT_LE(f.pulled_N, f.most_N);
    }
    EXPECT_LT(arm.highest_N, arm.daemon.controller.take_up.pull_N) << "at low torque throughout";
    arm.loop->ArmAndPretension();
    EXPECT_EQ(arm.loop->record().output.mode, Mode::kRunning);
  }
}

TEST(Commission, APairIsVerifiedByTheBendOfItsMotor) {
  Arm arm("robots/pairs_90mm.yaml", "tendrild_pairs.yaml");
  arm.daemon.controller.take_up.pull_N = 4;
  const commission::CommissionResult r = arm.Commission();
  std::printf("%s\n", commission::CommissionTable(r).c_str());
  EXPECT_TRUE(r.passed());
  ASSERT_EQ(r.drives.size(), 2u);
  for (const commission::DriveFinding& f : r.drives) EXPECT_EQ(f.seen_tendon, f.tendon);
  arm.loop->ArmAndPretension();
  EXPECT_EQ(arm.loop->record().output.mode, Mode::kRunning);
}

// A pair stands either way, so that only the bend tells which of its tendons a positive torque pulls.
TEST(Commission, APairsMistakesAreNamed) {
  const struct {
    rig::Wiring wiring;
    const char* verdict;
  } kCases[] = {{{.motor_reversed = true}, "motor reversed"},
                {{.encoder_reversed = true}, "encoder reversed"},
                {{.motor_reversed = true, .encoder_reversed = true}, "spool reversed"}};
  for (const auto& c : kCases) {
    SCOPED_TRACE(c.verdict);
    Arm arm("robots/pairs_90mm.yaml", "tendrild_pairs.yaml");
    arm.daemon.controller.take_up.pull_N = 4;
    arm.wirings.emplace_back(1, c.wiring);
    const commission::CommissionResult r = arm.Commission();
    EXPECT_FALSE(r.passed());
    EXPECT_EQ(r.drives[0].verdict, "ok");
    EXPECT_EQ(r.drives[1].verdict, c.verdict);
    const std::vector<NodeParameters> found = commission::FoundNodes(r);
    ASSERT_EQ(found.size(), 2u);
    EXPECT_EQ(found[1].tendon, 2);
    EXPECT_EQ(found[1].motor_reversed, c.wiring.motor_reversed);
    EXPECT_EQ(found[1].encoder_reversed, c.wiring.encoder_reversed);
  }
}

struct Mistake {
  const char* name;
  void (*make)(Arm&);
  const char* verdict;
  const char* what;
  const char* remedy;
};

void Connect(Arm& arm, rig::Wiring wiring) { arm.wirings.emplace_back(1, wiring); }

const Mistake kMistakes[] = {
    {"MotorLeadsSwapped", [](Arm& a) { Connect(a, {.motor_reversed = true}); }, "motor reversed",
     "positive torque pays out", "give node 2 motor: reversed"},
    {"EncoderReversed", [](Arm& a) { Connect(a, {.encoder_reversed = true}); }, "encoder reversed",
     "counts down while the motor pulls", "give node 2 encoder: reversed"},
    {"SpoolReversed", [](Arm& a) { Connect(a, {.motor_reversed = true, .encoder_reversed = true}); },
     "spool reversed", "wound in the opposite direction", "motor: reversed, encoder: reversed"},
    {"EncoderDead", [](Arm& a) { Connect(a, {.encoder_dead = true}); }, "encoder dead", "does not count",
     "encoder's cable"},
    {"CellDead", [](Arm& a) { Connect(a, {.cell_gain = 0}); }, "cell dead", "no load cell shows it",
     "load cell's cable"},
    {"TendonOff", [](Arm& a) { Connect(a, {.tendon_off = true}); }, "tendon off", "nothing holds it",
     "attach the tendon"},
    {"Jammed", [](Arm& a) { Connect(a, {.jammed = true}); }, "no answer", "jammed", "free gear and spool"},
    {"CellGainHalf", [](Arm& a) { Connect(a, {.cell_gain = 0.5}); }, "cell gain", "of the tension expected",
     "load_cell.gain_VpN (0.09"},
    {"CellZeroOff", [](Arm& a) { Connect(a, {.cell_zero_mV = 60}); }, "cell zero",
     "while the tendon is slack", "actuation.load_cell.offset_N of tendon 2 to 0."},
    {"CellsCrossed",
     [](Arm& a) {
       a.wirings = {{1, {.cell_of = 2}}, {2, {.cell_of = 1}}};
     },
     "cells crossed", "shows on the load cell of tendon 3 (node 3)", "plug each load cell"},
    {"VeryLoose",
     [](Arm& a) {
       a.plant.effects = {{.name = "slack", .where = "tendon:2", .values = {{"m", 0.005}}}};
     },
     "ok", "", ""},
};

class CommissionMistake : public testing::TestWithParam<Mistake> {};

TEST_P(CommissionMistake, IsNamedAtItsTendonOnly) {
  const Mistake& m = GetParam();
  Arm arm;
  m.make(arm);
  const commission::CommissionResult r = arm.Commission();
  SCOPED_TRACE(commission::CommissionTable(r));
  EXPECT_EQ(r.drives[1].verdict, m.verdict);
  if (*m.what != '\0') {
    ASSERT_FALSE(r.drives[1].disagreements.empty());
    EXPECT_THAT(r.drives[1].disagreements[0].what, AllOf(HasSubstr("tendon 2 (node 2)"), HasSubstr(m.what)));
    EXPECT_THAT(r.drives[1].disagreements[0].remedy, HasSubstr(m.remedy));
    EXPECT_EQ(r.drives[1].disagreements.size(), 1U) << "one mistake, one word about it";
  }
  if (std::string(m.name) == "VeryLoose") {
    EXPECT_NEAR(r.drives[1].slack_m, 0.0055, 0.001);
    EXPECT_LT(r.drives[0].slack_m, 0.0015);
  }
  EXPECT_EQ(r.passed(), *m.what == '\0');
  EXPECT_EQ(r.drives[0].verdict, "ok");
  EXPECT_EQ(r.drives[2].verdict, std::string(m.name) == "CellsCrossed" ? "cells crossed" : "ok");
  EXPECT_LT(arm.highest_N, 1.5 * arm.daemon.controller.take_up.pull_N);
}

INSTANTIATE_TEST_SUITE_P(All, CommissionMistake, testing::ValuesIn(kMistakes),
                         [](const auto& c) { return std::string(c.param.name); });

TEST(Commission, WritingTheNodesKeepsWhichDriveTheyAre) {
  const std::string servo = "profile: cia402, eds: \"drives/servo.eds\", analog_input: 0x6401:01";
  const std::string text = "  nodes:\n    - {" + servo + ", node_id: 2, motor: reversed, tendon: 1}  # new\n";
  NodeParameters found;
  found.node_id = 2;
  found.tendon = 3;
  found.encoder_reversed = true;
  EXPECT_EQ(commission::PatchNodes(text, "tendrild.yaml", {found}),
            "  nodes:\n    - {node_id: 2, tendon: 3, encoder: reversed, " + servo + "}  # new\n");
}

// Two drives exchanged, one of them with its motor's leads swapped as well: the node list that is found makes
// the same rig pass, and the robot then bends as commanded.
TEST(Commission, WhatItFindsPutIntoTheFileMakesTheRigRight) {
  Arm arm;
  arm.plant.actuation->tendons[0].node_id = 2;
  arm.plant.actuation->tendons[1].node_id = 1;
  arm.wirings = {{1, {.motor_reversed = true}}};  // of tendon 2, on node 1
  const commission::CommissionResult r = arm.Commission();
  SCOPED_TRACE(commission::CommissionTable(r));
  EXPECT_FALSE(r.passed());
  EXPECT_EQ(r.drives[0].verdict, "motor reversed");
  EXPECT_EQ(r.drives[0].seen_tendon, 2);
  EXPECT_EQ(r.drives[1].verdict, "pulls 1");
  EXPECT_EQ(r.drives[2].verdict, "ok");

  const std::vector<NodeParameters> nodes = commission::FoundNodes(r);
  ASSERT_EQ(nodes.size(), 3U);
  std::ifstream in(Config("tendrild.yaml"));
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  const DaemonParameters patched =
      config::ParseDaemon(commission::PatchNodes(text, "tendrild.yaml", nodes), "patched");
  ASSERT_EQ(patched.bus.nodes.size(), 3U);
  EXPECT_EQ(patched.bus.nodes[0].node_id, 2);
  EXPECT_FALSE(patched.bus.nodes[0].motor_reversed);
  EXPECT_EQ(patched.bus.nodes[1].node_id, 1);
  EXPECT_TRUE(patched.bus.nodes[1].motor_reversed);
  EXPECT_FALSE(patched.bus.nodes[1].encoder_reversed);

  arm.daemon.bus.nodes = patched.bus.nodes;
  arm.keep_nodes = true;
  const commission::CommissionResult again = arm.Commission();
  EXPECT_TRUE(again.passed()) << commission::CommissionTable(again);
  arm.loop->ArmAndPretension();
  Command bend;
  bend.kind = CommandKind::kBending;
  bend.bending_rad = Eigen::Vector2d(0.5, 0);
  arm.loop->Send(bend);
  for (int i = 0; i < 3000; ++i) arm.loop->Step();
  const Eigen::Vector3d tip = arm.loop->plant().TipPose().p_WA;
  EXPECT_GT(tip.x(), 0.01);
  EXPECT_LT(std::abs(tip.y()), 0.003);
}

// Nobody is to ride on a motor whose operator went away.
TEST(Commission, EndsByItselfWhenNothingIsAskedForAnyMore) {
  Arm arm;
  arm.loop.emplace(experiment::ClosedLoopOptions{.controller_robot = arm.robot,
                                                 .plant_robot = arm.plant,
                                                 .daemon = arm.daemon,
                                                 .plant = {},
                                                 .log_path = {},
                                                 .keep_nodes = false});
  experiment::ClosedLoop& loop = *arm.loop;
  loop.StepUntil([](const CycleRecord& r) { return r.output.mode == Mode::kConfigured; }, 10, "the drives");
  loop.Send(ModeRequest::kCommission);
  for (int i = 0; i < 500; ++i) loop.Step();
  Command pull;
  pull.kind = CommandKind::kTension;
  pull.tension_N = Eigen::Vector3d(2.1, 0, 0);
  loop.Send(pull);
  loop.Step();
  EXPECT_EQ(loop.record().output.command_status, Status::kCommandOutOfRange) << "more than take_up.pull_N";
  pull.tension_N = Eigen::Vector3d(2.0, 0, 0);
  loop.Send(pull);
  int cycles = 0;
  do {
    loop.Step();
    ++cycles;
  } while (loop.record().output.mode == Mode::kCommissioning && cycles < 1000);
  EXPECT_NEAR(cycles, 102, 2) << "valid for 100 ms";
  EXPECT_EQ(loop.record().output.status, Status::kCommissioningEnded);
  loop.StepUntil([](const CycleRecord& r) { return r.output.mode == Mode::kConfigured; }, 2, "the end");
}

// ---- the record ----

struct RecordTest : testing::Test {
  RecordTest() {
    folder = std::filesystem::temp_directory_path() / ("tendril_commission_" + std::to_string(getpid()));
    std::filesystem::create_directories(folder);
    arm.daemon.robot_file = folder / "robot.yaml";
    arm.daemon.commissioning_required = true;
  }
  ~RecordTest() override { std::filesystem::remove_all(folder); }
  std::string Problem() const { return CommissioningProblem(arm.robot, arm.daemon); }
  void Write() {
    WriteRecord(RecordPath(arm.daemon), {.wiring = WiringHash(arm.robot, arm.daemon.bus),
                                         .at = "now",
                                         .by = "me",
                                         .software = "this",
                                         .pull_N = 2,
                                         .tendons = {{.node_id = 1, .tendon = 1, .serial = 4'100'200'300},
                                                     {.node_id = 2, .tendon = 2, .serial = 2},
                                                     {.node_id = 3, .tendon = 3, .serial = 3}}});
  }
  Arm arm;
  std::filesystem::path folder;
};

TEST_F(RecordTest, OnlyOfExactlyThisWiringCounts) {
  EXPECT_THAT(Problem(), AllOf(HasSubstr("never commissioned"), HasSubstr("robot.yaml.commissioned"),
                               HasSubstr("tendril commission")));
  Write();
  EXPECT_EQ(Problem(), "");
  arm.robot.limits.max_tension_base_N = 5;
  arm.robot.body.sections[0].youngs_modulus_Pa *= 2;
  EXPECT_EQ(Problem(), "") << "a limit or a stiffness is no wire";
  const RobotParameters robot = arm.robot;
  const DaemonParameters daemon = arm.daemon;
  const auto expect_other = [&](const char* what) {
    EXPECT_THAT(Problem(), HasSubstr("commissioned with other")) << what;
    arm.robot = robot;
    arm.daemon = daemon;
  };
  std::swap(arm.daemon.bus.nodes[0].node_id, arm.daemon.bus.nodes[1].node_id);
  expect_other("nodes");
  arm.daemon.bus.nodes[2].motor_reversed = true;
  expect_other("direction");
  arm.robot.actuation->tendons[1].load_cell.gain_VpN = 0.19;
  expect_other("gain");
  arm.robot.actuation->tendons[1].load_cell.offset_N = 0.1;
  expect_other("zero");
  arm.robot.actuation->tendons[0].gear.ratio = 20;
  expect_other("gear");
  arm.robot.body.sections[0].tendons[0].angle_rad = 0.1;
  expect_other("hole");
  arm.robot.body.sections[0].tendons[0].radius_m *= 1.5;
  expect_other("radius");
  arm.robot.body.sections[0].unit_length_m *= 1.5;
  expect_other("length");
  arm.robot.name = "another";
  expect_other("robot");
  EXPECT_EQ(Problem(), "");
  arm.daemon.commissioning_required = false;
  std::filesystem::remove(RecordPath(arm.daemon));
  EXPECT_EQ(Problem(), "") << "a simulation";
}

// Nothing would guard what is missing in a record.
TEST_F(RecordTest, ADamagedOneArmsNothing) {
  Write();
  const std::string path = RecordPath(arm.daemon);
  std::stringstream read;
  read << std::ifstream(path).rdbuf();
  const std::string whole = read.str();
  const auto expect_damaged = [&](const std::string& text, const char* how) {
    std::ofstream(path) << text;
    EXPECT_THAT(Problem(), AllOf(HasSubstr("robot.yaml.commissioned is damaged: "), HasSubstr(how),
                                 HasSubstr("tendril commission")));
  };
  expect_damaged("", "it names no wiring");
  expect_damaged(whole.substr(0, whole.find("  - {tendon: 2")), "tendon 2 is not there");
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string text = whole;
    return text.replace(text.find(from), from.size(), to);
  };
  expect_damaged(with("tendon: 3", "tendon: 2"), "tendon 2 is there more than once");
  expect_damaged(with("node_id: 3", "node_id: 1"), "tendon 3 has node 1, not 3");
  expect_damaged(with("serial: 3,", "serial: -1,"), "tendon 3 is not there");
  std::ofstream(path) << whole;
  EXPECT_EQ(Problem(), "");
}

TEST_F(RecordTest, NamesTheDrivesThatWereExchanged) {
  commission::CommissionResult result;
  for (int j = 1; j <= 3; ++j) {
    commission::DriveFinding f;
    f.tendon = j;
    f.node.node_id = 10 + j;
    result.drives.push_back(f);
  }
  // That of node 13 was not told.
  WriteRecord(RecordPath(arm.daemon),
              commission::RecordOf(result, arm.robot, arm.daemon, {{11, 4'100'200'300}, {12, 5}}));
  const auto exchanged = [&](std::vector<std::uint32_t> serials) {
    return ExchangedDrives(arm.daemon, serials);
  };
  EXPECT_EQ(exchanged({4'100'200'300, 5, 6}), "");
  EXPECT_EQ(exchanged({4'100'200'300, 5, 7}), "") << "nothing is known of the third";
  EXPECT_THAT(exchanged({5, 4'100'200'300, 6}),
              AllOf(HasSubstr("node 11 (tendon 1) has serial 5, commissioned was 4100200300"),
                    HasSubstr("node 12 (tendon 2) has serial 4100200300, commissioned was 5"),
                    HasSubstr("robot.yaml.commissioned"), HasSubstr("exchanged_drives: warn")));
  EXPECT_THAT(UnnumberedDrives(arm.daemon),
              AllOf(HasSubstr("node 13 (tendon 3) has no serial number"), testing::Not(HasSubstr("node 12")),
                    HasSubstr("tendril commission")));
  arm.daemon.commissioning_required = false;
  EXPECT_EQ(exchanged({1, 2, 3}), "") << "a simulation";
  EXPECT_EQ(UnnumberedDrives(arm.daemon), "");
}

}  // namespace
}  // namespace tendril::daemon
