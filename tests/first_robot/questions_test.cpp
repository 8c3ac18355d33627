// The interview with answers of all kinds: whatever they are within what is accepted, the files pass every
// check.
#include "tendril/first_robot/questions.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <random>
#include <stdexcept>

#include "tendril/config/config.h"
#include "tendril/daemon/file_check.h"
#include "tendril/first_robot/files.h"

namespace tendril::first_robot {
namespace {

using testing::HasSubstr;

std::string SameName(const std::string& name) { return name + ".yaml"; }

/// Gives the answers of a map, else the suggestion; no refusal is expected.
Dialogue Given(std::map<std::string, std::string> answers) {
  return {.answer =
              [answers](const Question& q) {
                const auto found = answers.find(std::string(q.item->name));
                return found == answers.end() ? q.suggestion : found->second;
              },
          .refused = [](const Question&, const std::string& line) { throw std::runtime_error(line); }};
}

/// Writes both files, loads them as the programs do, and returns the warnings; throws what they refuse.
std::vector<std::string> Checked(const NewRobot& made) {
  namespace fs = std::filesystem;
  const fs::path folder = fs::path(testing::TempDir()) / "first_robot";
  fs::create_directories(folder);
  const std::string robot = folder / (made.robot.name + ".yaml"), daemon = folder / "daemon.yaml";
  std::ofstream(robot) << RobotFileText(made, "");
  std::ofstream(daemon) << DaemonFileText(made, "");
  const DaemonParameters loaded = config::LoadDaemon(daemon);
  const RobotParameters loaded_robot = config::LoadRobot(robot);
  (void)daemon::CheckedText(loaded, loaded_robot, daemon);
  return daemon::FileWarnings(loaded, loaded_robot, daemon);
}

/// A number anywhere in the range, small and large ones alike.
std::string Drawn(const config::Key& key, std::mt19937& random) {
  const config::Range range = *key.range;
  const double share = std::uniform_real_distribution<>(0, 1)(random);
  double value = range.min + share * (range.max - range.min);
  if (range.min > 0) value = range.min * std::pow(range.max / range.min, share);
  if (key.type == config::Key::Type::kInteger) return fmt::format("{:.0f}", value);
  return fmt::format(
      "{}", std::clamp(value, range.above_min ? std::nextafter(range.min, 1e300) : range.min, range.max));
}

/// Half of the answers as suggested; the others anything that is accepted, the ends of the range among them.
std::string AnyAnswer(const Question& q, std::mt19937& random) {
  const unsigned kind = random() % 10;
  if (kind < 5 || q.item->name == "nodes") return q.suggestion;
  if (!q.key.choices.empty()) return q.key.choices[random() % q.key.choices.size()];
  if (!q.key.range) return q.suggestion;
  if (kind == 5 && !q.key.range->above_min && q.item->name != "tracker_Hz")
    return fmt::format("{}", q.key.range->min);
  if (kind == 6) return fmt::format("{}", q.key.range->max);
  return Drawn(q.key, random);
}

TEST(FirstRobot, WhateverIsAcceptedPassesTheCheck) {
  for (unsigned seed = 1; seed <= 60; ++seed) {
    std::mt19937 random(seed);
    std::string log;
    Dialogue dialogue{.answer =
                          [&](const Question& q) {
                            const std::string answer = AnyAnswer(q, random);
                            log += fmt::format("{} {}\n", q.item->name, answer);
                            return answer;
                          },
                      // A value for all sections may be out of the range of one: the next try is another one.
                      .refused =
                          [&](const Question& q, const std::string& line) {
                            log += "  " + line + "\n";
                            if (!q.item->per_section) throw std::runtime_error(line);
                          }};
    try {
      Checked(Ask(dialogue, SameName));
    } catch (const std::exception& e) {
      FAIL() << "seed " << seed << ": " << e.what() << "\n" << log;
    }
  }
}

TEST(FirstRobot, UsualRobotsGiveNoWarning) {
  const std::map<std::string, std::string> robots[] = {
      {},
      {{"tendons", "4"}},
      {{"sections", "2"}, {"mount", "hanging"}, {"mass_kg", "0.004"}},
      {{"load_cell", "none"}, {"tracker_Hz", "none"}},
      {{"length_m", "0.3"}, {"mass_kg", "0.05"}, {"backbone_diameter_m", "0.002"}, {"material_Pa", "steel"}},
  };
  for (const auto& answers : robots) {
    const NewRobot made = Ask(Given(answers), SameName);
    EXPECT_THAT(Checked(made), testing::IsEmpty()) << RobotFileText(made, "");
  }
}

TEST(FirstRobot, AnswersBecomeTheFilesNumbers) {
  const NewRobot made = Ask(Given({{"name", "arm"},
                                   {"mount", "level"},
                                   {"sections", "2"},
                                   {"tendons", "3, 2"},
                                   {"length_m", "80 mm, 0.06"},
                                   {"disks", "8,3"},
                                   {"hole_radius_m", "4 mm"},
                                   {"disk_diameter_m", "0.01"},
                                   {"mass_kg", "2000 kg/m3, 3 g"},
                                   {"backbone_diameter_m", "1 mm"},
                                   {"material_Pa", "steel, 0.001 Nm2"},
                                   {"nodes", "5,4,3,2,1"},
                                   {"cycle_ns", "4 ms"}}),
                            SameName);
  const BodyParameters& body = made.robot.body;
  EXPECT_EQ(made.robot.name, "arm");
  EXPECT_EQ(body.gravity_W_mps2, Eigen::Vector3d(-9.81, 0, 0));
  ASSERT_EQ(body.sections.size(), 2U);
  EXPECT_EQ(body.tendons(), 5);
  EXPECT_NEAR(body.length_m(), 0.14, 1e-12);
  EXPECT_EQ(body.sections[0].units, 8);
  EXPECT_EQ(body.sections[1].units, 3);
  EXPECT_NEAR(8 * body.sections[0].unit_mass_kg, 2000 * 0.08 * M_PI * 0.01 * 0.01 / 4, 1e-6);
  EXPECT_NEAR(3 * body.sections[1].unit_mass_kg, 0.003, 1e-12);
  EXPECT_EQ(body.sections[0].youngs_modulus_Pa, 2e11);
  // E I as given, of a rod of 1 mm.
  EXPECT_NEAR(body.sections[1].youngs_modulus_Pa * M_PI * std::pow(0.0005, 4) / 4, 0.001, 1e-8);
  EXPECT_EQ(made.robot.actuation->tendons[0].node_id, 5);
  EXPECT_EQ(made.daemon.bus.nodes[4].node_id, 1);
  EXPECT_EQ(made.daemon.bus.cycle_ns, 4000000);
  EXPECT_EQ(made.daemon.robot_file, "arm.yaml");
  Checked(made);
}

TEST(FirstRobot, AnswersMaySayHowWellTheyAreKnown) {
  const NewRobot made = Ask(Given({{"name", "arm"},
                                   {"sections", "2"},
                                   {"tendons", "3"},
                                   {"disks", "4"},
                                   {"length_m", "80 mm within 1 mm, 0.06"},
                                   {"hole_radius_m", "4 mm within 5 %"},
                                   {"disk_diameter_m", "0.01, 10 mm within 2%"},
                                   {"mass_kg", "2000 kg/m3 within 200 kg/m3, 3 g within unknown"},
                                   {"backbone_diameter_m", "1 mm within 0.02 mm"},
                                   {"material_Pa", "steel within 3 %, 0.001 Nm2 within 0.0001 Nm2"},
                                   {"torque_constant_NmpA", "0.02 within 4 %"},
                                   {"wrap_rad", "180 deg within 10 deg"},
                                   {"gear_ratio", "19 within known"}}),
                            SameName);
  Checked(made);
  const RobotParameters robot = config::ParseRobot(RobotFileText(made, ""), "arm.yaml");
  const auto expect = [&](const std::string& key, Uncertainty::Kind kind, double deviation) {
    ASSERT_TRUE(robot.uncertain.contains(key)) << key;
    EXPECT_EQ(robot.uncertain.at(key).kind, kind) << key;
    EXPECT_NEAR(robot.uncertain.at(key).deviation, deviation, 1e-4 * deviation) << key;
  };
  using Kind = Uncertainty::Kind;
  expect("body.sections[1].unit_length_m", Kind::kAbsolute, 0.00025);
  EXPECT_FALSE(robot.uncertain.contains("body.sections[2].unit_length_m"));
  for (const int section : {1, 2}) {
    for (const int tendon : {1, 2, 3})
      expect(fmt::format("body.sections[{}].tendons[{}].radius_m", section, tendon), Kind::kShare, 0.05);
    expect(fmt::format("body.sections[{}].core_radius_m", section), Kind::kAbsolute, 0.00001);
  }
  expect("body.sections[2].disk_inertia_xx_kgm2", Kind::kShare, 0.04);
  EXPECT_FALSE(robot.uncertain.contains("body.sections[1].disk_inertia_xx_kgm2"));
  expect("body.sections[1].unit_mass_kg", Kind::kAbsolute, 0.1 * robot.body.sections[0].unit_mass_kg);
  expect("body.sections[2].unit_mass_kg", Kind::kUnknown, 0);
  expect("body.sections[1].youngs_modulus_Pa", Kind::kShare, 0.03);
  expect("body.sections[2].youngs_modulus_Pa", Kind::kAbsolute,
         0.1 * robot.body.sections[1].youngs_modulus_Pa);
  expect("actuation.motor.torque_constant_NmpA", Kind::kShare, 0.04);
  expect("actuation.transmission.pulleys[1].wrap_rad", Kind::kAbsolute, M_PI / 18);
  expect("actuation.gear.ratio", Kind::kKnown, 0);
  EXPECT_EQ(robot.uncertain.size(), 1 + 6 + 2 + 2 + 2 + 2 + 3U);
  EXPECT_THAT(RobotFileText(made, ""), HasSubstr("disk_diameter_m: {value: 0.01, within: 2 %}\n"));
}

TEST(FirstRobot, WhatIsRefusedNamesTheAcceptedRange) {
  const std::tuple<const char*, const char*, const char*> wrong[] = {
      {"length_m", "60",
       "60 is out of range; accepted: 0.0001 .. 1 m; 60 looks like millimetres: write 0.06"},
      {"length_m", "0.1, 0.2", "2 values; accepted: one, or one for each of 1 sections"},
      {"sections", "5", "accepted: whole number 1 .. 4"},
      {"tendons", "17", "accepted: whole number 1 .. 16"},
      {"name", "a b", "accepted: 1 .. 64 letters"},
      {"mount", "sideways", "accepted: standing, hanging, level"},
      {"hole_radius_m", "nan", "not finite"},
      {"disk_diameter_m", "0.004", "accepted: 0.00804 .. 1 m"},
      {"material_Pa", "wood", "accepted: 1000000 .. 1000000000000 Pa"},
      {"material_Pa", "nitinol within a tenth",
       "within: 'a tenth' is not understood; accepted: one standard deviation"},
      {"length_m", "60 mm within 10 m", "within: 10 is more than the whole range"},
      {"wrap_rad", "0 within 5 %",
       "within: 5 % of 0 is nothing; accepted: one standard deviation as a share (10 %) or a "
       "number in rad, or known, or unknown; give the deviation in rad"},
      {"disks", "4 within 10 %", "'4 within 10 %' is not a whole number"},
      {"sections", "1 within known", "'1 within known' is not a whole number"},
      {"max_bending_rad", "90 deg/s", "accepted: 0.01 .. 6.2 rad"},
      {"nodes", "1,2,2", "accepted: 3 different numbers"},
      {"nodes", "1,2", "accepted: 3 different numbers"},
      {"nodes", "1,2,127", "accepted: whole number 1 .. 126"},
      {"bitrate_bps", "300000", "accepted: 125000, 250000, 500000, 800000, 1000000"},
      {"cycle_ns", "600000", "accepted: whole number"},
  };
  for (const auto& [name, answer, expected] : wrong) {
    try {
      Ask(Given({{name, answer}}), SameName);
      ADD_FAILURE() << name << " accepts " << answer;
    } catch (const std::runtime_error& e) {
      EXPECT_THAT(e.what(), HasSubstr(expected)) << name;
      EXPECT_THAT(e.what(), testing::StartsWith(std::string(name) + ": "));
    }
  }
}

TEST(FirstRobot, EveryKeyThatIsWrittenHasItsMeaning) {
  const std::string text = RobotFileText(Ask(Given({}), SameName), "/somewhere/robot.schema.json");
  EXPECT_THAT(text, testing::StartsWith("# yaml-language-server: $schema=/somewhere/robot.schema.json\n"));
  EXPECT_THAT(text, HasSubstr("# Mass of one unit, lumped at its end. Accepted: 1e-07 .. 10 kg.\n"));
  EXPECT_THAT(text, HasSubstr("disk_diameter_m: 0.01\n"));
  std::istringstream lines(text);
  std::string before;
  std::vector<std::string> seen;
  for (std::string line; std::getline(lines, line); before = line) {
    EXPECT_LE(line.size(), 120U) << line;
    const std::size_t first = line.find_first_not_of(" -");
    if (first == line.npos || line[first] == '#' || line.find(':') == line.npos) continue;
    const std::string key = line.substr(first, line.find(':') - first);
    // Entries of a list are alike: the first has the comments. So has radius_m, of hole and spool.
    if (std::count(seen.begin(), seen.end(), key) == 0) {
      EXPECT_THAT(before, HasSubstr("#")) << line;
    }
    seen.push_back(key);
  }
  EXPECT_GT(seen.size(), 40U);
}

}  // namespace
}  // namespace tendril::first_robot
