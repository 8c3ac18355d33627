// The numbers of a robot file inferred from runs of a robot that is not what its file says.
#include "tendril/gap/calibrate.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "gap/free_numbers.h"
#include "rig_runs.h"
#include "tendril/config/config.h"
#include "tendril/gap/calibration_text.h"
#include "tendril/gap/diagnose.h"
#include "tendril/robot_file/robot_patch.h"
#include "tendril/sim/effects.h"

namespace tendril {
namespace {

using gap::CalibratedNumber;
using gap::Calibration;

gap::DataSet RunsOfOther(std::uint64_t seed) { return Recorded(kNumbersOff, 3, seed, 500); }

/// The runs with this file, whose load cells have a gain of their own.
gap::DataSet With(const RobotParameters& file, gap::DataSet set) {
  for (gap::Run& run : set.runs) {
    for (int j = 0; j < run.tension_N.cols(); ++j) {
      const auto at = static_cast<std::size_t>(j);
      run.tension_N.col(j) *= set.robot.actuation->tendons[at].load_cell.gain_VpN /
                              file.actuation->tendons[at].load_cell.gain_VpN;
    }
  }
  set.robot = file;
  return set;
}

const CalibratedNumber& Number(const Calibration& c, const std::string& key) {
  const auto found = std::find_if(c.numbers.begin(), c.numbers.end(),
                                  [&](const CalibratedNumber& n) { return n.key == key; });
  EXPECT_NE(found, c.numbers.end()) << key;
  return *found;
}

class Calibrated : public testing::Test {
 protected:
  static void SetUpTestSuite() { found_ = new Calibration(gap::Calibrate(RunsOfOther(11), {})); }
  static void TearDownTestSuite() { delete found_; }
  static const Calibration& found() { return *found_; }

 private:
  static inline Calibration* found_ = nullptr;
};

TEST_F(Calibrated, NumbersThatTheRunsTellAreFound) {
  EXPECT_TRUE(found().converged);
  const RobotParameters file = Rig();
  const auto& its = file.actuation->tendons[0];
  const struct {
    const char* key;
    double truth;
  } told[] = {
      {"body.sections.unit_length_m", file.body.sections[0].unit_length_m},
      {"body.sections.unit_mass_kg", 0.86 * file.body.sections[0].unit_mass_kg},
      {"actuation.motor.coulomb_friction_Nm", 1.2 * its.motor.coulomb_friction_Nm},
      {"actuation.motor.torque_constant_NmpA", 0.96 * its.motor.torque_constant_NmpA},
      {"actuation.tendon.stiffness_Npm", 1.1 * its.tendon.stiffness_Npm},
      {"actuation.gear.efficiency", its.gear.efficiency},
      {"actuation.spool.radius_m", its.spool.radius_m},
  };
  for (const auto& [key, truth] : told) {
    const CalibratedNumber& n = Number(found(), key);
    EXPECT_NEAR(std::log(n.value / truth), 0, 3 * n.deviation) << key;
    EXPECT_LT(n.deviation, 0.5 * n.prior) << key;
    EXPECT_LE(n.low, n.value);
    EXPECT_GE(n.high, n.value);
  }
  // Modulus and core radius show only in the bending stiffness.
  const CalibratedNumber &E = Number(found(), "body.sections.youngs_modulus_Pa"),
                         &r = Number(found(), "body.sections.core_radius_m");
  const double stiffness = std::log(E.value / E.in_file) + 4 * std::log(r.value / r.in_file);
  EXPECT_NEAR(stiffness, std::log(0.85), 0.05);
  EXPECT_GT(E.deviation, 0.02);
}

// Wrap and friction coefficient act as one product: neither is told, and their product is.
TEST_F(Calibrated, WhatOnlyTogetherShowsStaysUncertain) {
  const CalibratedNumber &wrap = Number(found(), "actuation.transmission.pulleys.wrap_rad"),
                         &alpha = Number(found(), "actuation.transmission.pulleys.alpha");
  EXPECT_LT(wrap.Learned(), 0.5);
  EXPECT_LT(std::abs(wrap.Moved()), 2);
  const double exponent = Rig().actuation->tendons[0].transmission.pulleys[0].exponent;
  EXPECT_NEAR(std::log(alpha.value / alpha.in_file) + exponent * std::log(wrap.value / wrap.in_file),
              std::log(1.25), 0.02);
}

// A kind of motion is predicted by the numbers of two others, of three seconds each.
TEST_F(Calibrated, LittleIsLeft) {
  for (const gap::CalibratedChannel& c : found().channels) {
    EXPECT_LT(c.held_out, std::max(2 * c.floor, 0.5 * c.in_file)) << c.name;
    EXPECT_LT(c.discrepancy, 0.5 * c.floor) << c.name;
  }
}

TEST_F(Calibrated, WithItTheSameRobotHasNoGapAndAChangedOneIsNamed) {
  const RobotParameters file = sim::FoldEffects(found().robot);
  EXPECT_EQ(
      Diagnose(With(file, RunsOfOther(31)), Only({"tip_payload", "unit_mass", "tendon_stiffness"})).verdict,
      gap::Verdict::kNoGap);

  std::vector<std::string> with_load = kNumbersOff;
  with_load.push_back("tip_payload mass_kg=0.002");
  const gap::Diagnosis d = Diagnose(With(file, Recorded(with_load, 3, 51, 500)),
                                    Only({"tip_payload", "tendon_stiffness", "motor_coulomb"}));
  ASSERT_EQ(d.verdict, gap::Verdict::kAttributed) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "tip_payload");
  EXPECT_NEAR(d.accepted[0].parameters.at("mass_kg").value, 0.002, 0.0002);
}

TEST_F(Calibrated, TheFileIsWrittenWithItsComments) {
  const std::string text = config::ToYaml(Rig());
  const robot_file::RobotPatch patch =
      robot_file::PatchNumbers(text, "rig.yaml", found().robot, gap::CalibrationHeading(found()));
  EXPECT_THAT(patch.text, testing::StartsWith("# Calibrated by `tendril gap calibrate`"));
  EXPECT_THAT(patch.text, testing::HasSubstr("# was "));
  EXPECT_LT(robot_file::RobotDifference(patch.robot, found().robot), 1e-9);
}

TEST_F(Calibrated, TextAndJsonSayTheSame) {
  const std::string text = gap::CalibrationText(found());
  EXPECT_THAT(text, testing::HasSubstr("Numbers learned"));
  EXPECT_THAT(text, testing::HasSubstr("Known only together"));
  const auto json = nlohmann::json::parse(gap::CalibrationJson(found()));
  ASSERT_EQ(json["numbers"].size(), found().numbers.size());
  EXPECT_EQ(json["correlation"].size(), found().numbers.size());
  EXPECT_EQ(json["numbers"][0]["value"].get<double>(), found().numbers[0].value);
  EXPECT_EQ(json["channels"].size(), found().channels.size());
}

// Its key in the file may stand in a list, below per_tendon, or be that of one tendon's hole.
TEST(FreeNumbers, WhatTheFileSaysGoesBeforeWhatIsUsual) {
  RobotParameters file = Rig();
  using enum Uncertainty::Kind;
  file.uncertain = {{"body.sections[1].youngs_modulus_Pa", {kKnown, 0}},
                    {"body.sections[1].unit_mass_kg", {kShare, 0.01}},
                    {"body.sections[1].tendons[2].radius_m", {kAbsolute, 4e-5}},
                    {"body.sections[1].tendons[3].angle_rad", {kUnknown, 0}},
                    {"body.gravity_W_mps2[3]", {kShare, 0.02}},
                    {"actuation.gear.ratio", {kUnknown, 0}},
                    {"actuation.per_tendon.2.spool.radius_m", {kShare, 0.3}},
                    {"actuation.spool.radius_m", {kShare, 0.03}},
                    {"actuation.transmission.pulleys[1].alpha", {kShare, 0.2}}};
  const gap::FreeNumbers free = gap::FreeNumbersOf(file);
  const auto prior = [&](const std::string& key) {
    for (int k = 0; k < free.size(); ++k) {
      if (free.numbers[static_cast<std::size_t>(k)].key == key) return free.deviation[k];
    }
    return 0.0;
  };
  EXPECT_EQ(prior("body.sections.youngs_modulus_Pa"), 0);
  EXPECT_THAT(free.known, testing::Contains("body.sections.youngs_modulus_Pa"));
  EXPECT_EQ(prior("body.sections.unit_mass_kg"), 0.01);
  EXPECT_EQ(prior("body.sections.core_radius_m"), 0.05);  // usual
  EXPECT_EQ(prior("body.sections.tendons (tendon 1) radius_m"), 0.05);
  EXPECT_NEAR(prior("body.sections.tendons (tendon 2) radius_m"), 0.01, 1e-12);
  EXPECT_GT(prior("body.sections.tendons (tendon 3) angle_rad"), 1);
  EXPECT_EQ(prior("body.sections.tendons.radius_m"), 0);  // the holes have their own
  EXPECT_EQ(prior("body.gravity_W_mps2"), 0.02);
  EXPECT_GT(prior("actuation.gear.ratio"), 1);
  EXPECT_EQ(prior("actuation.spool.radius_m"), 0.03);
  EXPECT_EQ(prior("actuation.transmission.pulleys.alpha"), 0.2);
}

TEST(Calibrate, TheSameForAnyNumberOfThreads) {
  gap::DataSet set = Recorded(kNumbersOff, 2, 11, 500);
  set.runs.resize(2);
  gap::CalibrateOptions alone;
  alone.threads = 1;
  const Calibration one = gap::Calibrate(set, alone), two = gap::Calibrate(set, {});
  ASSERT_EQ(one.numbers.size(), two.numbers.size());
  for (std::size_t k = 0; k < one.numbers.size(); ++k)
    EXPECT_EQ(one.numbers[k].value, two.numbers[k].value) << one.numbers[k].key;
}

TEST(Calibrate, RunsFromBeforeAChangeAreRefused) {
  gap::DataSet set = RunsOfOther(11);
  set.runs[0].before = "circle again";
  EXPECT_THROW(gap::Calibrate(set, {}), std::runtime_error);
}

}  // namespace
}  // namespace tendril
