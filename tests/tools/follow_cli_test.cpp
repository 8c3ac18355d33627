// `tendril follow` without a daemon: the plan is printed, and input that is contradictory or out of reach
// gets one line with what, where and what is accepted.
#include "../gap/cli.h"

namespace tendril {
namespace {

using testing::HasSubstr;

class FollowCommandTest : public CommandTest {
 protected:
  int Plan(const std::string& what, const char* daemon = "tendrild.yaml") {
    return Run(fmt::format("follow {} --dry-run --config {}/config/{}", what, TENDRIL_SOURCE_DIR, daemon));
  }
  void ExpectRefused(const std::string& what, int exit_code, const std::vector<std::string>& says) {
    SCOPED_TRACE(what);
    EXPECT_EQ(Plan(what), exit_code);
    EXPECT_TRUE(OneLine());
    for (const std::string& word : says) EXPECT_THAT(error_, HasSubstr(word));
    EXPECT_EQ(out_, "");
  }
  std::string Csv(const std::string& text) {
    WriteText(folder_ / "table.csv", text);
    return "csv table.csv";
  }
};

TEST_F(FollowCommandTest, HelpNamesEveryMotion) {
  ASSERT_EQ(Run("follow --help"), 0);
  const std::string help = out_;
  for (const char* motion :
       {"circle", "planar", "fast_circle", "square", "spiral", "via", "line", "arc", "csv", "stream"}) {
    EXPECT_THAT(help, HasSubstr(motion));
    EXPECT_EQ(Run(fmt::format("follow {} --help", motion)), 0) << motion;
  }
  ASSERT_EQ(Run("follow csv --help"), 0);
  EXPECT_THAT(out_, HasSubstr("t_s and tip_x_m,tip_y_m,tip_z_m or us_1,vs_1"));
}

TEST_F(FollowCommandTest, PlansOfEveryKindAreTold) {
  for (const char* what :
       {"circle", "planar", "fast_circle", "square", "spiral",
        "via --bend 0,0 --bend 0.5,0.2 --bend -0.3,0.4",
        "via --tip 0.0286479,0,0.0496196 --tip 0,0.0286479,0.0496196",
        "arc --tip 0.0286479,0,0.0496196 --tip 0,0.0286479,0.0496196 --tip -0.0286479,0,0.0496196",
        "arc --centre 0,0,0.0496196 --tip 0.0286479,0,0.0496196 --angle -450",
        "line --tip 0.02,0,0.055 --tip 0,0.02,0.055 --tip 0.02,0,0.055 --nearest"}) {
    EXPECT_EQ(Plan(what), 0) << what << ": " << error_;
    EXPECT_THAT(out_, HasSubstr("nothing was sent")) << what;
    // What was taken for the points that were given is worth a word.
    const bool nearest = std::string_view(what).ends_with("--nearest");
    EXPECT_EQ(error_,
              nearest ? "out of the tip's reach by up to 2.57 mm: the nearest points are taken\n" : "")
        << what;
  }
  ASSERT_EQ(Plan(Csv("t_s,us_1,vs_1\n1,0,0\n1.5,0.1,0\n2,0.2,0.1\n3,0.3,0.3\n")), 0) << error_;
  EXPECT_THAT(out_, HasSubstr("4 rows in 2.000 s"));
  ASSERT_EQ(Plan("via --bend 0,0,0.2,0 --bend 0.1,0.3,0,-0.2", "tendrild_two_section.yaml"), 0) << error_;
}

TEST_F(FollowCommandTest, PointsComeFromAFileToo) {
  WriteText(folder_ / "points.csv",
            "tip_z_m,tip_x_m,tip_y_m\n0.0496196,0.0286479,0\n0.0496196,0,0.0286479\n");
  EXPECT_EQ(Plan("via --points points.csv"), 0) << error_;
}

TEST_F(FollowCommandTest, TheSlowestMotionNeedsNoMoreTensionThanRest) {
  EXPECT_EQ(Plan("via --bend 0.5,0 --bend 0,0.5 --speed 0.001"), 0) << error_;
}

TEST_F(FollowCommandTest, WrongUseIsTold) {
  ExpectRefused("via", 2, {"--tip", "--bend", "--points"});
  ExpectRefused("via --bend 0,0", 2, {"one point"});
  ExpectRefused("via --bend 0,0 --tip 0,0,0.06", 2, {"one of the three"});
  ExpectRefused("via --bend nan,0", 2, {"'nan' is not a number"});
  ExpectRefused("via --bend 0.5", 2, {"1 numbers", "accepted: 2"});
  ExpectRefused("via --bend 3,0", 1, {"point 1", "2.6"});
  ExpectRefused("line --tip nan,0,0", 2, {"'nan'"});
  ExpectRefused("arc --centre 0,0,0.05 --tip 0.02,0,0.05 --angle 0", 2, {"--angle 0 is not an arc"});
  ExpectRefused("via --bend 0,x --bend 1,1", 2, {"'x' is not a number"});
  ExpectRefused("via --bend 0,nan --bend 1,1", 2, {"'nan'"});
  ExpectRefused("via --bend 0,0,1 --bend 1,1", 2, {"3 numbers", "accepted: 2"});
  ExpectRefused("via --bend 0,0 --bend 1,1 --speed 9", 2, {"--speed 9", "max_rate_radps = 8"});
  ExpectRefused("via --bend 0,0 --bend 1,1 --acceleration 900", 2, {"max_acceleration_radps2"});
  ExpectRefused("via --bend 0,0 --bend 1,1 --jerk 1e6", 2, {"max_jerk_radps3"});
  const std::pair<const char*, const char*> numbers[] = {
      {"via --bend 0,0 --bend 1,1 --speed nan", "--speed: nan is not a number from 0 to 1000; leave it out"},
      {"via --bend 0,0 --bend 1,1 --speed -1", "--speed: -1 is not a number from 0 to 1000; leave it out"},
      {"via --bend 0,0 --bend 1,1 --acceleration nan",
       "--acceleration: nan is not a number from 0 to 1e+06;"},
      {"via --bend 0,0 --bend 1,1 --jerk nan", "--jerk: nan is not a number from 0 to 1e+09;"},
      {"via --bend 0,0 --bend 1,1 --jerk inf", "--jerk: inf is not a number from 0 to 1e+09;"},
      {"csv table.csv --stretch nan", "--stretch: nan is not a number from 0.01 to 1000;"},
      {"arc --centre 0,0,0.05 --tip 0.02,0,0.05 --angle nan",
       "--angle: nan is not a number from -7200 to 7200;"},
  };
  for (const auto& [what, told] : numbers) {
    EXPECT_EQ(Plan(what), 2) << what;
    EXPECT_THAT(error_, testing::HasSubstr(told));
  }
  ExpectRefused("via --tip 1e308,0,0.05 --tip 0,0.01,0.059", 2, {"--tip 1e308", "1000 m"});
  ExpectRefused("line --tip 0,0,0.06", 2, {"two or more corners"});
  ExpectRefused("arc --tip 0,0,0.06", 2, {"three points"});
  ExpectRefused("arc --tip 0,0,0.06 --centre 0,0,0.05", 2, {"--angle"});
  ExpectRefused("stream --from X", 2, {"--dry-run"});
  EXPECT_EQ(Run("follow circle --dry-run"), 2);
  EXPECT_TRUE(OneLine());
  EXPECT_NE(Run("follow"), 0);
  EXPECT_NE(Run("follow blah"), 0);
  EXPECT_THAT(error_, HasSubstr("'blah' is not known"));
}

TEST_F(FollowCommandTest, WhatTheRobotCannotReachIsTold) {
  ExpectRefused("via --bend 3,0 --bend 0,0", 1, {"point 1", "section 1", "2.6"});
  // Refused before anything moves: a bend that needs more tension than allowed, and a pace that cannot be
  // followed.
  ExpectRefused("via --bend 0,0 --bend 2.5,0", 1, {"t = ", "limits.max_tension_base_N", "bend it less"});
  ExpectRefused("via --tip 0.01,0,0.0589 --tip 0,0.01,0.07", 1, {"point 2", "mm away", "--nearest"});
  ExpectRefused("via --bend 0.1,0 --bend 0.1,0", 1, {"points 1 and 2", "same"});
  ExpectRefused("line --tip 0.02,0,0.055 --tip 0,0.02,0.055", 1, {"line 1", "% of the way", "mm away"});
  ExpectRefused("arc --tip 0.02,0,0.05 --tip 0,0,0.05 --tip -0.02,0,0.05", 1, {"one line"});
  ExpectRefused("arc --centre 0,0,0.05 --tip 0.02,0,0.055 --angle 90", 1, {"off the plane"});
}

TEST_F(FollowCommandTest, ABadTableIsToldByItsLine) {
  ExpectRefused(Csv("t_s,us_1,vs_1\n0,0,0\n0.5,nan,0\n"), 1, {"table.csv: line 3", "not finite"});
  ExpectRefused(Csv("t_s,us_1,vs_1\n0,0,0\n0.5,,0\n"), 1, {"line 3", "not a number"});
  ExpectRefused(Csv("t_s,us_1,vs_1\n0,0,0\n0.5,0,0\n0.5,0.1,0\n"), 1, {"line 4", "0.5 comes after 0.5"});
  ExpectRefused(Csv("t_s,us_1,vs_1\n0,0,0\n0.5,0\n"), 1, {"line 3", "2 values for 3 columns"});
  ExpectRefused(Csv("t_s,tip_x_m,tip_y_m,tip_z_m\n0,0,0,0.06\n1,0.01,0,0.07\n"), 1,
                {"line 3", "10.90 mm away"});
  ExpectRefused(Csv("t_s,us_1,vs_1\n0,0,0\n1,2.7,0\n"), 1, {"line 3", "2.7 rad", "2.6"});
  ExpectRefused(Csv("t_s,us_1,vs_1\n0,0,0\n0.1,2,0\n0.2,0,0\n"), 1,
                {"rad/s", "up to 8, 160 and 8000", "--stretch"});
  ExpectRefused(Csv("t_s,us_1\n0,0\n"), 1, {"line 1", "missing column vs_1"});
  ExpectRefused(Csv("t_s\n0\n"), 1, {"no targets", "us_1,vs_1"});
  ExpectRefused(Csv("t_s,tip_x_m,tip_y_m,tip_z_m,us_1,vs_1\n"), 1, {"two kinds of targets"});
  ExpectRefused(Csv("us_1,vs_1\n0,0\n"), 1, {"missing column t_s"});
  ExpectRefused(Csv("t_s,us_1,vs_1,foo\n0,0,0,1\n"), 1, {"unknown column 'foo'"});
  ExpectRefused(Csv(""), 1, {"empty input", "t_s"});
  ExpectRefused(Csv("t_s,us_1,vs_1\n0,0,0\n"), 1, {"1 row", "two or more"});
  ExpectRefused("csv nowhere.csv", 1, {"nowhere.csv"});
  ExpectRefused(Csv(std::string("t_s,us_1,vs_1\n0,0,0\n1,0\0x,0\n", 28)), 1,
                {"line 3: a NUL byte", "give a CSV"});
  ExpectRefused("csv /", 1, {"/: cannot be read", "not a folder"});
}

}  // namespace
}  // namespace tendril
