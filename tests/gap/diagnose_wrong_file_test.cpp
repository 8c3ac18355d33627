// Runs of a robot that is not what its file says.
#include <fmt/core.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>

#include "rig_runs.h"
#include "tendril/config/config.h"
#include "tendril/gap/diagnose.h"
#include "tendril/sim/effects.h"

namespace tendril {
namespace {

using gap::DataSet;
using gap::Diagnosis;
using gap::Verdict;

// An effect that the robot file contains may have become larger since, or have been removed.
TEST(Diagnose, ALawOfTheRobotFileIsFoundWithMoreAndWithLess) {
  for (const double rad : {0.0, 0.2}) {
    DataSet set = RecordedAt500Hz(rad > 0 ? fmt::format("backlash where=tendon:2 rad={}", rad) : "", 4);
    set.robot.effects.push_back(sim::ParseEffect("backlash where=tendon:2 rad=0.1", set.robot));
    set.robot.effects.push_back(sim::ParseEffect("unit_mass scale=1.0001", set.robot));
    const Diagnosis d = Diagnose(set, Only({"backlash", "encoder_offset", "tendon_stiffness", "unit_mass"}));
    ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
    EXPECT_EQ(d.accepted[0].effect, "backlash");
    EXPECT_EQ(d.accepted[0].where, "tendon:2");
    EXPECT_FALSE(d.accepted[0].bound_hit);
    EXPECT_NEAR(d.accepted[0].parameters.at("rad").value, rad, 0.005) << d.sentence;
    EXPECT_THAT(d.sentence, testing::HasSubstr("where the robot file has 5.7"));
    EXPECT_THAT(d.robot_yaml, testing::HasSubstr("unit_mass"));  // as it was given
  }
}

// A wrong direction of gravity in the robot file, and a wrong scale of the tracker.
TEST(Diagnose, GravityAndScaleAreNamed) {
  DataSet set = RecordedAt500Hz("", 2);
  set.robot.body.gravity_W_mps2 *= -1;
  EXPECT_THAT(Diagnose(set, Only({"unit_mass", "tip_force"})).sentence,
              testing::StartsWith("Check the measurement first: with gravity along -z of the base"));
  set = RecordedAt500Hz("", 2);
  for (gap::Run& run : set.runs) run.tip_m *= 1.03;
  EXPECT_THAT(Diagnose(set, Only({"unit_mass", "tracker_offset"})).sentence,
              testing::ContainsRegex(
                  "^Check the measurement first: with the tip's distances (2.[789]|3|3.1) % smaller"));
}

// Readings that the robot cannot give are left out; what is left may well agree with the model.
TEST(Diagnose, ReadingsBeyondTheRobotsRangeAreNoProof) {
  DataSet set = RecordedAt500Hz("", 3);
  for (gap::Run& run : set.runs) run.tension_N *= 1000;
  const Diagnosis d = Diagnose(set, Only({"unit_mass", "tendon_stiffness"}));
  EXPECT_EQ(d.verdict, Verdict::kInsufficientData);
  EXPECT_THAT(d.sentence, testing::StartsWith("Check units and robot file first: the tension reaches "));
}

/// A number of the robot file, `factor` times what it is.
struct WrongNumber {
  const char* key;
  double factor;
  void (*change)(RobotParameters& robot, double factor);
  std::vector<std::string> effects;  // of the library that come near to it
  double within = 0.01;              // of the value found
};

class DiagnoseWrongFile : public testing::TestWithParam<WrongNumber> {};

// A number that is wrong by more than its effect's range, or that no effect represents, is named first with
// the value that fits the runs; no cause is likelier than not.
TEST_P(DiagnoseWrongFile, TheNumberIsReportedFirst) {
  DataSet set = TwoFamilies("", 2.5);
  GetParam().change(set.robot, GetParam().factor);
  const Diagnosis d = Diagnose(set, Only(GetParam().effects));
  EXPECT_EQ(d.verdict, Verdict::kUnexplained) << d.sentence;
  EXPECT_THAT(d.sentence, testing::StartsWith("Check the robot file first: with "));
  for (const auto& cause : d.causes) {
    if (cause.effect != "unknown") {
      EXPECT_LE(cause.p, 0.5) << cause.effect;
    }
  }
  const auto named = std::find_if(d.suspected.begin(), d.suspected.end(),
                                  [](const auto& number) { return number.key == GetParam().key; });
  ASSERT_NE(named, d.suspected.end()) << d.sentence;
  EXPECT_NEAR(named->value / (named->in_file / GetParam().factor), 1, GetParam().within) << d.sentence;
  ASSERT_TRUE(named->closed);
  EXPECT_GT(named->closed->value, 0.99);
}

INSTANTIATE_TEST_SUITE_P(
    Numbers, DiagnoseWrongFile,
    testing::Values(
        WrongNumber{"body.sections.tendons.radius_m",
                    1.5,
                    [](RobotParameters& robot, double factor) {
                      for (auto& tendon : robot.body.sections[0].tendons) tendon.radius_m *= factor;
                    },
                    {"hole_radius", "tendon_stiffness", "bending_stiffness", "unit_stiffness"}},
        WrongNumber{"actuation.gear.ratio",
                    16.0 / 19,
                    [](RobotParameters& robot, double factor) {
                      for (auto& tendon : robot.actuation->tendons) tendon.gear.ratio *= factor;
                    },
                    {"torque_constant", "tendon_stiffness", "gear_efficiency"}},
        // A diameter taken for the radius.
        WrongNumber{"actuation.spool.radius_m",
                    2,
                    [](RobotParameters& robot, double factor) {
                      for (auto& tendon : robot.actuation->tendons) tendon.spool.radius_m *= factor;
                    },
                    {"torque_constant", "spool_growth", "tendon_stiffness"}},
        WrongNumber{
            "body.sections.core_radius_m",
            0.5,
            [](RobotParameters& robot, double factor) { robot.body.sections[0].core_radius_m *= factor; },
            {"bending_stiffness", "tip_force", "tracker_offset"}},
        // A backbone sixteen times too stiff hardly bends, and does not ring.
        WrongNumber{
            "body.sections.core_radius_m",
            2,
            [](RobotParameters& robot, double factor) { robot.body.sections[0].core_radius_m *= factor; },
            {"bending_stiffness", "tip_force", "tendon_stiffness"}},
        // Newtons per millimetre taken for newtons per metre. Slack, which stiff tendons turn
        // into a gap, closes as much as softer ones at the bound of the library's range.
        WrongNumber{"actuation.tendon.stiffness_Npm",
                    1000,
                    [](RobotParameters& robot, double factor) {
                      for (auto& tendon : robot.actuation->tendons) tendon.tendon.stiffness_Npm *= factor;
                    },
                    {"slack", "tendon_stiffness", "encoder_offset"},
                    0.2},
        // A missing kilo: the file's backbone bends as far as it can.
        WrongNumber{
            "body.sections.youngs_modulus_Pa",
            1e-3,
            [](RobotParameters& robot, double factor) { robot.body.sections[0].youngs_modulus_Pa *= factor; },
            {"bending_stiffness", "tracker_offset", "hole_angle"}},
        // With half the stiffness so many effects are screened before its own that it is not fitted.
        WrongNumber{
            "body.sections.youngs_modulus_Pa",
            0.5,
            [](RobotParameters& robot, double factor) { robot.body.sections[0].youngs_modulus_Pa *= factor; },
            {"bending_stiffness", "tendon_stiffness", "axial_stiffness", "slack", "encoder_offset",
             "tendon_creep", "contact", "hole_radius", "cell_gain", "spool_growth"}},
        WrongNumber{"actuation.gear.ratio",
                    1e-3,
                    [](RobotParameters& robot, double factor) {
                      for (auto& tendon : robot.actuation->tendons) tendon.gear.ratio *= factor;
                    },
                    {"torque_constant", "tendon_stiffness", "cell_gain"}},
        WrongNumber{"body.gravity_W_mps2",
                    1.5,
                    [](RobotParameters& robot, double factor) { robot.body.gravity_W_mps2 *= factor; },
                    {"tip_force", "unit_stiffness", "base_tilt"}}),
    [](const auto& about) {
      std::string name = fmt::format("{}_{:.2g}", about.param.key, about.param.factor);
      for (char& c : name) c = std::isalnum(static_cast<unsigned char>(c)) ? c : '_';
      return name;
    });

// Cells with twice the gain of the file, beyond what their effect is searched to.
TEST(Diagnose, AWrongGainOfTheCellsIsReportedFirst) {
  DataSet set = TwoFamilies("", 3);
  for (gap::Run& run : set.runs) run.tension_N *= 2;
  const Diagnosis d = Diagnose(set, Only({"cell_gain", "bending_stiffness"}));
  EXPECT_EQ(d.verdict, Verdict::kUnexplained) << d.sentence;
  EXPECT_THAT(d.sentence,
              testing::ContainsRegex("^Check the robot file first: with "
                                     "actuation.load_cell.gain_VpN 0.(4|40.*|39.*) where the file has 0.2"));
}

// Angles computed with a wrong number of counts per turn.
TEST(Diagnose, WrongCountsPerTurnAreReportedFirst) {
  DataSet set = RecordedAt500Hz("", 3);
  for (gap::Run& run : set.runs)
    run.motor_position_rad *= 0.5;  // 1024 of the encoder where the file has 2048
  const Diagnosis d = Diagnose(set, Only({"torque_constant", "tendon_stiffness", "hole_radius"}));
  EXPECT_THAT(d.sentence, testing::ContainsRegex(
                              "^Check the robot file first: with "
                              "actuation.drive.encoder_counts_per_turn 102[3-5] where the file has 2048"));
}

TEST(Diagnose, RunsOfFewerTendonsAreAnotherRobots) {
  DataSet set = RecordedAt500Hz("", 1);
  set.robot = config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/four_tendon_90mm.yaml");
  EXPECT_THAT([&] { Diagnose(set, {}); }, testing::ThrowsMessage<std::runtime_error>(testing::HasSubstr(
                                              "these runs have 3 tendons, robot 'four_tendon_90mm' has 4")));
}

RobotParameters ShortRig() { return config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_60mm.yaml"); }

// A frame that is turned and moved, or not known, changes nothing; nor does a run that hardly moves.
TEST(Diagnose, ATipPathBeyondTheRobotsReachIsTheVerdict) {
  for (const bool moved : {false, true}) {
    DataSet set = RecordedAt500Hz("", 4);
    set.robot = ShortRig();
    set.runs.push_back(Record(Rig(), "gentle", 4, 5, 500));
    const Eigen::Matrix3d turn =
        Eigen::AngleAxisd(2.1, Eigen::Vector3d(1, -2, 0.5).normalized()).toRotationMatrix();
    for (gap::Run& run : set.runs) {
      if (moved) run.tip_m = (run.tip_m * turn.transpose()).rowwise() + Eigen::RowVector3d(0.1, 0, -0.2);
    }
    set.fit_frame = moved;
    const Diagnosis d = Diagnose(set, {});
    EXPECT_EQ(d.verdict, Verdict::kUnexplained);
    EXPECT_THAT(d.sentence, testing::StartsWith("No pose of robot 'rig_60mm' explains"));
    EXPECT_TRUE(d.accepted.empty());
    for (const gap::Cause& cause : d.causes) {
      if (cause.effect == "unknown") continue;
      EXPECT_LE(cause.p, 0.5) << cause.effect;
    }
  }
}

// Numbers that are wrong within their bounds leave poses that explain the path.
TEST(Diagnose, WrongNumbersAreWithinTheRobotsReach) {
  for (const char* effect : {"unit_length scale=1.15", "tracker_offset x_m=0.02 y_m=0 z_m=0.03",
                             "tracker_rotation x_rad=0.4 y_rad=0 z_rad=0", "base_tilt x_rad=0.6 y_rad=0",
                             "precurvature u_rad=0.1 v_rad=0", "tip_payload mass_kg=0.003"}) {
    const std::string name = std::string(effect).substr(0, std::string(effect).find(' '));
    const Diagnosis d = Diagnose(RecordedAt500Hz(effect, 3), Only({name}));
    EXPECT_THAT(d.sentence, testing::Not(testing::HasSubstr("No pose"))) << effect;
    ASSERT_EQ(d.accepted.size(), 1u) << effect << ": " << d.sentence;
    EXPECT_EQ(d.accepted[0].effect, name);
  }
}

// One run that another scale makes impossible is odd; the others move as far and are possible.
TEST(Diagnose, OneImpossibleTipPathIsNotTheRobots) {
  DataSet set = RecordedAt500Hz("bending_stiffness scale=0.9", 2.5);
  set.runs[1].tip_m *= 1.6;
  const Diagnosis d = Diagnose(set, Only({"bending_stiffness", "unit_length"}));
  EXPECT_THAT(d.sentence, testing::Not(testing::HasSubstr("No pose")));
}

}  // namespace
}  // namespace tendril
