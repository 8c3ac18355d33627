// `tendril gap calibrate` as a user runs it: a folder of runs and a file in, a better file out.
#include <nlohmann/json.hpp>

#include "cli.h"
#include "tendril/config/config.h"

namespace tendril {
namespace {

using nlohmann::json;
using testing::HasSubstr;

class CalibrateCommand : public CommandTest {};

TEST_F(CalibrateCommand, WritesTheNumbersOfTheRunsIntoACopyOfTheFile) {
  WriteText(folder_ / "plan.yaml",
            "runs:\n"
            "  - {family: triangle, duration_s: 4, amplitude_rad: 1.0, repeats: 1}\n"
            "  - {family: circle, duration_s: 4, amplitude_rad: 0.8}\n");
  ASSERT_EQ(Run(fmt::format("gap simulate --robot {} --plan plan.yaml --out runs "
                            "--effect 'bending_stiffness scale=0.8' --effect 'unit_mass scale=0.85'",
                            kRig)),
            0)
      << error_;
  std::string file = ReadText(kRig);
  const std::string number = "unit_length_m: 0.0225 ",
                    known = "unit_length_m: {value: 0.0225, within: known} ";
  ASSERT_NE(file.find(number), file.npos);
  WriteText(folder_ / "mine.yaml", file.replace(file.find(number), number.size(), known));
  ASSERT_EQ(Run("gap calibrate --robot mine.yaml runs --out better.yaml --json found.json"), 0) << error_;
  EXPECT_THAT(out_, HasSubstr("Numbers learned"));
  const RobotParameters was = config::LoadRobot(kRig),
                        is = config::LoadRobot((folder_ / "better.yaml").string());
  EXPECT_NEAR(is.body.sections[0].UnitStiffness() / was.body.sections[0].UnitStiffness(), 0.8, 0.05);
  EXPECT_THAT(ReadText(folder_ / "better.yaml"), HasSubstr("(the paper, table 1)"));  // the file's comments
  const json found = json::parse(ReadText(folder_ / "found.json"));
  EXPECT_EQ(found["robot"], "rig_90mm");
  EXPECT_TRUE(found["converged"].get<bool>());
  // What the file says of a number holds, and stays in it.
  EXPECT_THAT(found["known"], testing::Contains("body.sections.unit_length_m"));
  EXPECT_EQ(is.body.sections[0].unit_length_m, was.body.sections[0].unit_length_m);
  EXPECT_THAT(ReadText(folder_ / "better.yaml"), HasSubstr(known));

  // What is there already is not replaced.
  ASSERT_EQ(Run(fmt::format("gap calibrate --robot {} runs --out better.yaml", kRig)), 2);
  EXPECT_TRUE(OneLine());
  EXPECT_THAT(error_, HasSubstr("--overwrite"));
}

TEST_F(CalibrateCommand, TheRobotFileItselfIsNeverTheResult) {
  fs::copy_file(kRig, folder_ / "robot.yaml");
  ASSERT_EQ(Run("gap calibrate --robot robot.yaml nowhere --out ./robot.yaml --overwrite"), 2);
  EXPECT_TRUE(OneLine());
  EXPECT_EQ(ReadText(folder_ / "robot.yaml"), ReadText(kRig));
}

TEST_F(CalibrateCommand, NoRunsAreOneLine) {
  ASSERT_EQ(Run(fmt::format("gap calibrate --robot {} nowhere --out better.yaml", kRig)), 1);
  EXPECT_TRUE(OneLine());
  EXPECT_FALSE(fs::exists(folder_ / "better.yaml"));
}

}  // namespace
}  // namespace tendril
