// The commands around a daemon without one: wrong use of any program is one line that says what, where, what
// would be accepted and where to read on; what cannot be replayed whole is not called whole.
#include <fstream>
#include <utility>
#include <vector>

#include "../gap/cli.h"

namespace tendril {
namespace {

using testing::HasSubstr;
using testing::Not;

class ServiceCommandTest : public CommandTest {
 protected:
  void ExpectWrongUse(const std::string& arguments, const std::string& says,
                      const std::string& program = TENDRIL_BINARY) {
    SCOPED_TRACE(program + " " + arguments);
    EXPECT_EQ(Run(arguments, program), 2);
    EXPECT_TRUE(OneLine());
    EXPECT_THAT(error_, HasSubstr(says));
    EXPECT_EQ(out_, "");
  }
};

TEST_F(ServiceCommandTest, ANumberIsANumberWhereverItIsAskedFor) {
  const std::pair<const char*, const char*> options[] = {
      {"home --timeout", "1 to 3600"},
      {"send arm --timeout", "0 to 3600"},
      {"send arm --valid-for", "0.001 to 3600"},
      {"send arm --speed", "0 to 1000"},
      {"fault reboot node=1 --timeout", "0 to 3600"},
      {"rt-check --seconds", "0.1 to 86400"},
      {"commission --config x.yaml --seen 0 120", "-360 to 360"},
      {"model simulate --robot x.yaml --step", "1e-09 to 1e+09"},
      {"model simulate --robot x.yaml --rtol", "1e-14 to 0.1"}};
  for (const auto& [option, range] : options) {
    for (const char* wrong : {"nan", "inf", "-1e3", "1e300", "soon"})
      ExpectWrongUse(fmt::format("{} {}", option, wrong),
                     fmt::format("{} is not a number from {}; ", wrong, range));
  }
  ExpectWrongUse("send --timeout nan arm", "; see tendril send arm --help");
  ExpectWrongUse("send tip 0.01 nan 0.05", "nan is not a number from -1e+06 to 1e+06; ");
}

// A variable that is not set must not pass for an option that was left out.
TEST_F(ServiceCommandTest, AnEmptyValueIsRefusedByEveryProgram) {
  const std::string empty = " is empty; accepted: a value; give one, or leave the option out; see ";
  for (const char* option : {"--can", "--lcm", "--log", "--black-box", "--config"})
    ExpectWrongUse(fmt::format("--config x.yaml {} ''", option),
                   fmt::format("tendrild: {}:{}tendrild --help", option, empty), TENDRILD_BINARY);
  for (const char* option : {"--can", "--lcm", "--robot", "--fault", "--scenario", "--extra-nodes"})
    ExpectWrongUse(fmt::format("--robot x.yaml {} ''", option),
                   fmt::format("tendril-plant: {}:{}tendril-plant --help", option, empty),
                   TENDRIL_PLANT_BINARY);
  for (const char* arguments :
       {"send arm --lcm ''", "replay x.lcmlog --robot ''", "replay ''", "commission --config x.yaml --lcm ''",
        "rt-check --config ''", "demo --out ''", "config check ''"})
    ExpectWrongUse(arguments, empty + "tendril ");
  for (const char* arguments : {"send tip '' 0 0.05", "send bending 0.1 ''", "send tension 1 '' 1"})
    ExpectWrongUse(arguments, "'' is not a number from -1e+06 to 1e+06; give metres, radians or newtons; ");
  ExpectWrongUse("send bending ' ' 0.1", "' ' is not a number from");
  ExpectWrongUse("status --prefix ''", "'' is not a prefix");
}

TEST_F(ServiceCommandTest, WrongUseIsOneLineThatTellsWhereToReadOn) {
  ExpectWrongUse("sned arm", "tendril: 'sned' is not known here (did you mean send?); commands: capstan, ");
  ExpectWrongUse(
      "send amr",
      "tendril: 'amr' is not known here (did you mean arm?); commands: tip, bending, tension, arm, hold, "
      "disarm, clear; see tendril send --help");
  ExpectWrongUse("send tip 1 2", "see tendril send tip --help");
  ExpectWrongUse("send tip", "0 value(s) given");
  ExpectWrongUse("help demoo", "'demoo' is not known here (did you mean demo?)");
  ExpectWrongUse("gap help diagnos", "'diagnos' is not known here (did you mean diagnose?)");
  ExpectWrongUse("send arm --tiemout 3",
                 "'--tiemout' is not known here (did you mean --timeout?); see tendril send arm --help");
  ExpectWrongUse("", "--config is required; see tendrild --help", TENDRILD_BINARY);
  ExpectWrongUse("--config x.yaml --simluated", "'--simluated' is not known here (did you mean --simulated?)",
                 TENDRILD_BINARY);
  ExpectWrongUse("--seed x --robot y", "see tendril-plant --help", TENDRIL_PLANT_BINARY);
}

TEST_F(ServiceCommandTest, CommandsAreListedAndSuggestedAtEveryLevel) {
  ExpectWrongUse("", "tendril: a command is needed; commands: capstan, commission, ");
  ExpectWrongUse("gap", "tendril: a command is needed; commands: accept, apply, calibrate, diagnose, ");
  ExpectWrongUse("demoo", "(did you mean demo?)");
  ExpectWrongUse("gap diagnoze", "(did you mean diagnose?); commands: accept, apply, calibrate, diagnose, ");
  ExpectWrongUse("config chek", "(did you mean check?)");
  ExpectWrongUse("model simul", "(did you mean simulate?)");
  ExpectWrongUse("xyzzy", "'xyzzy' is not known here; commands: capstan, ");
  for (const char* help : {"help", "help gap", "gap help", "help gap diagnose"}) {
    SCOPED_TRACE(help);
    EXPECT_EQ(Run(help), 0) << error_;
    const bool diagnose = std::string_view(help).ends_with("diagnose");
    EXPECT_THAT(out_, HasSubstr(diagnose ? "--robot" : "Subcommands:"));
  }
}

TEST_F(ServiceCommandTest, SendSaysWhichValuesItTakesAndAsksAfterMillimetres) {
  for (const char* values : {"", "0 0", "0 0 0.05 1"})
    ExpectWrongUse(fmt::format("send tip {}", values), "accepted: 3, X Y Z in metres");
  ExpectWrongUse("send bending 1", "U V of each section in radians");
  ExpectWrongUse("send tip 0 0 60",
                 "60 m is out of any robot's reach; millimetres? That would be 0 0 0.06 m");
  EXPECT_EQ(Run("send tip 0 0 9 --timeout 0"), 0) << error_ << ": nine metres may be a robot's";
}

TEST_F(ServiceCommandTest, CapstanNamesTheWrongValueBeforeAMissingOne) {
  ExpectWrongUse("capstan --alpha -1", "--alpha: -1 is not a number from 0 to 100; ");
  ExpectWrongUse("capstan --alpha 0.2", "--wrap is required");
}

TEST_F(ServiceCommandTest, WhatAShortMeasurementCannotJudgeIsSaid) {
  Run("rt-check --seconds 0.3");
  EXPECT_THAT(out_, HasSubstr("cycles are too few to judge one in a thousand; measure for "
                              "--seconds 4 or more"));
  EXPECT_THAT(out_ + error_, Not(HasSubstr("one wake-up in a thousand is late")));
}

TEST_F(ServiceCommandTest, OneRuleForPrefixesHoldsInFilesAndOnCommandLines) {
  const std::string shipped = ReadText(TENDRIL_SOURCE_DIR "/config/tendrild.yaml");
  const std::string key = "channel_prefix: TENDRIL";
  const auto at = shipped.find(key);
  ASSERT_NE(at, shipped.npos);
  const auto robot = shipped.find("robot: ");
  fs::create_directories(folder_ / "robots");
  fs::copy(TENDRIL_SOURCE_DIR "/config/robots/rig_60mm.yaml", folder_ / "robots");
  ASSERT_NE(robot, shipped.npos);
  for (const char* prefix : {"A-B", "a.b", "R2_D2"}) {
    SCOPED_TRACE(prefix);
    std::string text = shipped;
    WriteText(folder_ / "t.yaml", text.replace(at, key.size(), std::string("channel_prefix: ") + prefix));
    const bool good = std::string_view(prefix) == "R2_D2";
    EXPECT_EQ(Run("config check t.yaml"), good ? 0 : 1) << error_;
    if (!good) {
      EXPECT_THAT(error_, HasSubstr("accepted: 1 to 40 letters, digits and '_'"));
      ExpectWrongUse(fmt::format("send arm --prefix {}", prefix),
                     "accepted: 1 to 40 letters, digits and '_'");
    }
  }
}

TEST_F(ServiceCommandTest, AReplayClaimsNoMoreThanItRead) {
  WriteText(folder_ / "notes.txt", std::string(500, 'x'));
  EXPECT_EQ(Run("replay notes.txt"), 1);
  EXPECT_TRUE(OneLine());
  EXPECT_THAT(
      error_,
      HasSubstr(
          "notes.txt: not a log that can be replayed (damaged: the event at byte 0 does not begin like"));
  EXPECT_THAT(error_, HasSubstr("give one of tendrild --log or tendril demo, or a black box"));
  WriteText(folder_ / "empty.lcmlog", "");
  EXPECT_EQ(Run("replay empty.lcmlog"), 1);
  EXPECT_THAT(error_, HasSubstr("not a log that can be replayed (damaged: the file is empty)"));

  ASSERT_EQ(Run("demo --no-plots --trajectory planar --out ."), 0) << error_;
  ASSERT_EQ(Run("replay planar/run.lcmlog"), 0) << error_;
  EXPECT_THAT(out_, HasSubstr("\nno bit differs\n"));
  const fs::path log = folder_ / "planar/run.lcmlog";
  fs::resize_file(log, fs::file_size(log) / 10);
  EXPECT_EQ(Run("replay planar/run.lcmlog"), 1);
  EXPECT_TRUE(OneLine());
  EXPECT_THAT(out_, testing::Not(HasSubstr("no bit differs")));
  EXPECT_THAT(error_, testing::ContainsRegex(
                          "incomplete: no bit differs in [0-9]+ cycles; damaged: the event at byte "
                          "[0-9]+ ends .*, to the end; [0-9]+ events over [0-9.]+ s are read"));
}

// Damage is named by its place and not taken for another controller.
TEST_F(ServiceCommandTest, ReplayNamesDamage) {
  ASSERT_EQ(Run("demo --no-plots --trajectory planar --out ."), 0) << error_;
  const fs::path log = folder_ / "planar/run.lcmlog";
  const std::string whole = ReadText(log);
  const auto replay = [&](const std::string& bytes) {
    WriteText(log, bytes);
    EXPECT_EQ(Run("replay planar/run.lcmlog"), 1);
    EXPECT_TRUE(OneLine());
    EXPECT_THAT(error_, testing::Not(HasSubstr("does not reproduce the log")));
  };
  const std::size_t middle = whole.size() / 2;
  std::string bytes = whole;
  replay(bytes.replace(middle, 5000, 5000, '\0'));
  EXPECT_THAT(error_, testing::ContainsRegex(
                          "no bit differs in [0-9]+ cycles; cycle [0-9]+ is missing before the event at "
                          "byte [0-9]+; the [0-9]+ cycles from there could not be checked; "
                          "damaged: the event at byte [0-9]+ is not "
                          "followed by another; [0-9]+ bytes are left out, zeros from byte"));
  bytes = whole;
  replay(bytes.erase(middle, 5000));
  EXPECT_THAT(error_, HasSubstr("is not followed by another"));
  bytes = whole;
  replay(bytes.replace(0, 100, 100, '\0'));
  EXPECT_THAT(error_, HasSubstr("the robot is not known (damaged: the event at byte 0 does not begin"));
  EXPECT_THAT(error_, HasSubstr("give --robot and --config"));
  replay(whole + whole);
  EXPECT_THAT(error_,
              testing::ContainsRegex("cycles begin again after cycle [0-9]+ before the event at byte"));
  EXPECT_THAT(error_, HasSubstr(fmt::format("the event at byte {} has number 0", whole.size())));
  // The number of an event alone.
  bytes = whole;
  const std::size_t cycle = bytes.find("TENDRIL_CYCLE", middle);
  replay(bytes.replace(cycle - 24, 8, 8, '\0'));
  EXPECT_THAT(error_, testing::ContainsRegex("the event at byte [0-9]+ has number 0 where [0-9]+ follows; "));
  // What the drives reported in one cycle: its event is whole, and all that follows from it differs.
  bytes = whole;
  replay(bytes.replace(cycle + 100, 64, 64, '\0'));
  EXPECT_THAT(error_,
              testing::ContainsRegex("one cycle's readings are not what the log says of it and those of "
                                     "the [0-9]+ after it are, as when its event, at byte [0-9]+, is"));
  // Outputs of one cycle alone.
  bytes = whole;
  replay(bytes.replace(cycle + 600, 16, 16, '\x55'));
  EXPECT_THAT(error_,
              testing::ContainsRegex("one cycle differs and the [0-9]+ after it are identical to the last "
                                     "bit, as when its event, at byte [0-9]+, is damaged"));
}

}  // namespace
}  // namespace tendril
