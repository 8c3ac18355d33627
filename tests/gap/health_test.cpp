// Data health: a good set has no findings, and each kind of damage has its own, on the channel concerned. The
// signals are made up here, from sines and noise.
#include "tendril/gap/health.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <random>

#include "tendril/config/config.h"

namespace tendril::gap {
namespace {

using Severity = HealthFinding::Severity;
using testing::HasSubstr;
using testing::Not;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr int kRows = 8000;

double Rounded(double value, double step) { return step * std::round(value / step); }

/// Bending that begins at rest and then oscillates with two frequencies and several reversals.
Eigen::Vector2d Bend(double t, double scale) {
  if (t < 0.6) return {0, 0};
  const double s = std::min(1.0, (t - 0.6) / 0.5);
  return scale * s *
         Eigen::Vector2d(0.5 * std::sin(2.1 * (t - 0.6)) + 0.1 * std::sin(17 * (t - 0.6)),
                         0.4 * std::sin(1.3 * (t - 0.6)) + 0.1 * std::sin(13 * (t - 0.6)));
}

gap::Run GoodRun(const std::string& name, const std::string& family, unsigned seed, double scale,
                 double tracker_delay_s = 0) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  const double count_rad = 2 * std::numbers::pi / 2048, permille_Nm = 0.007056e-3;
  gap::Run run;
  run.name = name;
  run.family = family;
  run.time_s.resize(kRows);
  for (Eigen::MatrixXd* m :
       {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad, &run.tension_N}) {
    m->resize(kRows, 3);
  }
  run.tip_m.setConstant(kRows, 3, kNone);
  run.tip_quaternion.setConstant(kRows, 4, kNone);
  for (int i = 0; i < kRows; ++i) {
    const double t = i * 1e-3;
    run.time_s[i] = t;
    const Eigen::Vector2d bend = Bend(t, scale);
    for (int j = 0; j < 3; ++j) {
      const double angle = 2 * std::numbers::pi * j / 3;
      const double pull = bend.dot(Eigen::Vector2d(std::cos(angle), std::sin(angle)));
      const double tension = 1.5 + 1.6 * pull;
      const double torque = tension * 0.008 / 19 / 0.84;
      run.motor_position_rad(i, j) = Rounded(9.5 * pull, count_rad);
      run.tension_N(i, j) = Rounded(tension + 0.005 * normal(random), 0.005);
      run.torque_target_Nm(i, j) = Rounded(torque, permille_Nm);
      run.torque_actual_Nm(i, j) = Rounded(torque + 0.3 * permille_Nm * normal(random), permille_Nm);
    }
    if (i % 10 != 0) continue;
    const Eigen::Vector2d seen = Bend(t - tracker_delay_s, scale);
    const double theta = seen.norm(), l = 0.06;
    const Eigen::Vector2d direction = theta > 0 ? Eigen::Vector2d(seen / theta) : Eigen::Vector2d(1, 0);
    const Eigen::Vector2d side = direction * (theta > 1e-6 ? l * (1 - std::cos(theta)) / theta : 0.0);
    run.tip_m.row(i) << side.x(), side.y(), theta > 1e-6 ? l * std::sin(theta) / theta : l;
    for (int c = 0; c < 3; ++c) run.tip_m(i, c) += 5e-5 * normal(random);
    run.tip_quaternion.row(i) << std::cos(theta / 2), -direction.y() * std::sin(theta / 2),
        direction.x() * std::sin(theta / 2), 0;
  }
  return run;
}

DataSet GoodSet() {
  DataSet set;
  set.robot = config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_60mm.yaml");
  set.runs.push_back(GoodRun("sway", "multisine", 1, 1));
  set.runs.push_back(GoodRun("sway_again", "multisine", 2, 1));
  set.runs.back().repeat_of = "sway";
  set.runs.push_back(GoodRun("gentle", "triangle", 3, 0.8));
  return set;
}

std::string Shown(const std::vector<HealthFinding>& findings) {
  std::string text;
  for (const HealthFinding& f : findings) {
    text += (f.severity == Severity::kInfo      ? "info "
             : f.severity == Severity::kWarning ? "warning "
                                                : "error ") +
            f.run + " | " + f.channel + " | " + std::to_string(f.value) + " | " + f.text + "\n";
  }
  return text;
}

/// The findings after the damage, about the damaged run or the set only.
std::vector<HealthFinding> Complaints(const std::function<void(DataSet&)>& damage) {
  DataSet set = GoodSet();
  damage(set);
  std::vector<HealthFinding> found = CheckHealth(set);
  std::erase_if(found, [](const HealthFinding& f) { return f.severity == Severity::kInfo; });
  return found;
}

/// Exactly one finding, on this channel of run "gentle", with this in its text.
HealthFinding Only(const std::function<void(gap::Run&)>& damage, const std::string& channel,
                   const std::string& text) {
  const auto found = Complaints([&](DataSet& set) { damage(set.runs[2]); });
  EXPECT_EQ(found.size(), 1u) << Shown(found);
  if (found.empty()) return {};
  EXPECT_EQ(found[0].run, "gentle");
  EXPECT_EQ(found[0].channel, channel) << Shown(found);
  EXPECT_THAT(found[0].text, HasSubstr(text));
  EXPECT_THAT(found[0].text, HasSubstr("; ")) << "neither meaning nor remedy";
  return found[0];
}

/// Findings of several channels, all with this in their text.
void All(std::size_t count, const std::function<void(gap::Run&)>& damage, const std::string& text) {
  const auto found = Complaints([&](DataSet& set) { damage(set.runs[2]); });
  EXPECT_EQ(found.size(), count) << Shown(found);
  for (const HealthFinding& f : found) EXPECT_THAT(f.text, HasSubstr(text));
}

TEST(Health, AGoodSetRaisesNoComplaintAndItsFiguresAreRight) {
  const DataSet set = GoodSet();
  const auto found = CheckHealth(set);
  int sampling = 0, repeats = 0;
  for (const HealthFinding& f : found) {
    EXPECT_EQ(f.severity, Severity::kInfo) << Shown({f});
    if (f.channel == "time") {
      ++sampling;
      EXPECT_NEAR(f.value, 1000, 1e-6);
    }
    if (f.run == "sway_again" && f.channel == "tension") {
      ++repeats;
      // Two readings of the same tension, each with 5 mN of noise and a resolution of 5 mN.
      EXPECT_NEAR(f.value, std::sqrt(2 * (0.005 * 0.005 + 0.005 * 0.005 / 12)), 2e-4);
    }
  }
  EXPECT_EQ(sampling, 3);
  EXPECT_EQ(repeats, 1);
}

TEST(Health, LostRowsAndScatteredTimes) {
  const HealthFinding lost = Only(
      [](gap::Run& run) {
        std::vector<int> rows;
        for (int i = 0; i < kRows; ++i) {
          if (i < 3000 || i >= 3100) rows.push_back(i);
        }
        run.time_s = run.time_s(rows).eval();
        for (Eigen::MatrixXd* m : {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad,
                                   &run.tension_N, &run.tip_m, &run.tip_quaternion}) {
          *m = (*m)(rows, Eigen::all).eval();
        }
      },
      "time", "100 of 8000 rows are missing in 1 gaps");
  EXPECT_EQ(lost.value, 100);
  Only(
      [](gap::Run& run) {
        for (int i = 1; i < kRows; i += 2) run.time_s[i] += 4e-4;
      },
      "time", "steps scatter");
}

TEST(Health, MissingValuesDeadSensorsAndDeadTrackers) {
  const HealthFinding missing =
      Only([](gap::Run& run) { run.tension_N.col(1).segment(1000, 800).setConstant(kNone); }, "tension 2",
           "10.0 %");
  EXPECT_NEAR(missing.value, 0.1, 1e-3);
  Only([](gap::Run& run) { run.torque_actual_Nm.col(2).setConstant(kNone); }, "actual torque 3",
       "no value at all");
  Only([](gap::Run& run) { run.tension_N.col(0).setConstant(0.75); }, "tension 1", "is 0.75 N throughout");
  Only([](gap::Run& run) { run.motor_position_rad.col(1).setConstant(0.5); }, "motor position 2",
       "is 0.5 rad throughout");
  Only(
      [](gap::Run& run) {
        for (int i = 4000; i < 6000; ++i) run.tip_m.row(i).setConstant(kNone);
      },
      "tip position", "25.0 %");
}

TEST(Health, ClippedSignals) {
  const HealthFinding cut =
      Only([](gap::Run& run) { run.tension_N.col(1) = run.tension_N.col(1).cwiseMin(2.0).eval(); },
           "tension 2", "is clipped at 2 N");
  EXPECT_GT(cut.value, 0.01);
  Only([](gap::Run& run) { run.torque_actual_Nm.col(0) = run.torque_actual_Nm.col(0).cwiseMax(5e-4).eval(); },
       "actual torque 1", "is clipped");
  // A coarse torque of a slow log that returns to its value at rest is not at the end of its range.
  DataSet rested = GoodSet();
  for (gap::Run& run : rested.runs) {
    for (Eigen::Index i = 0; i < run.torque_actual_Nm.rows(); ++i) {
      // At rest, then up and back, with noise where it moves.
      const double up = std::max(0.0, std::sin(2e-3 * static_cast<double>(i) - 1));
      const double counts =
          std::round(200 * up + (up > 0 ? 10 + 3 * std::sin(7.0 * static_cast<double>(i)) : 0));
      run.torque_actual_Nm(i, 0) = 2e-5 * counts;
    }
  }
  for (const HealthFinding& f : CheckHealth(rested))
    EXPECT_EQ(f.text.find("is clipped"), std::string::npos) << f.channel << " " << f.text;
  // The target of a drive at its limit: 0.0196 N m/A times 0.36 A.
  All(
      1, [](gap::Run& run) { run.torque_target_Nm.col(0).segment(2000, 100).setConstant(0.007056); },
      "is at the drive's limit");
}

TEST(Health, WrongUnitsAreTakenForWhatTheyAre) {
  Only([](gap::Run& run) { run.tip_m *= 1000; }, "tip position", "these are millimetres");
  Only([](gap::Run& run) { run.tip_m.col(2).array() -= 0.06; }, "tip position", "displacement");
  Only([](gap::Run& run) { run.tip_m.col(0).array() += 0.04; }, "tip position", "is up to");
  // The lengths of a robot two thirds as long.
  Only([](gap::Run& run) { run.tip_m /= 1.5; }, "tip position",
       "the file of a longer robot looks like a gap");
  Only([](gap::Run& run) { run.tension_N *= 1000; }, "tension", "millinewtons");
  Only([](gap::Run& run) { run.tension_N *= 102; }, "tension", "grams");
  Only(
      [](gap::Run& run) {
        run.torque_actual_Nm *= 1000;
        run.torque_target_Nm.resize(0, 0);
      },
      "actual torque", "millinewton metres");
  // Degrees and counts change the step of the encoder too.
  const auto degrees =
      Complaints([](DataSet& set) { set.runs[2].motor_position_rad *= 180 / std::numbers::pi; });
  EXPECT_THAT(Shown(degrees), HasSubstr("are these degrees"));
  const auto counts =
      Complaints([](DataSet& set) { set.runs[2].motor_position_rad *= 2048 / (2 * std::numbers::pi); });
  EXPECT_THAT(Shown(counts), HasSubstr("are these encoder counts"));
  // One bad count does not indicate another unit.
  const auto once = Complaints([](DataSet& set) { set.runs[2].motor_position_rad(1000, 0) = 1e5; });
  EXPECT_THAT(Shown(once), Not(HasSubstr("are these")));
}

TEST(Health, TendonsInAnotherOrderOrWithAnotherSign) {
  const auto swapped =
      Complaints([](DataSet& set) { set.runs[2].tension_N.col(0).swap(set.runs[2].tension_N.col(2)); });
  EXPECT_THAT(Shown(swapped), HasSubstr("tension 1"));
  EXPECT_THAT(Shown(swapped), HasSubstr("follows the actual torque of tendon 3"));
  EXPECT_THAT(Shown(swapped), HasSubstr("follows the motor position of tendon 1"));
  for (const HealthFinding& f : swapped) EXPECT_THAT(f.channel, testing::Ne("tension 2")) << Shown({f});
  All(
      3, [](gap::Run& run) { run.motor_position_rad *= -1; }, "wrong sign");
  const auto negative = Complaints([](DataSet& set) { set.runs[2].tension_N *= -1; });
  EXPECT_THAT(Shown(negative), HasSubstr("is negative throughout"));
  All(
      1, [](gap::Run& run) { run.tension_N.col(1).array() -= 1.2; }, "a tendon cannot push");
}

// A motion may correlate two tendons, which is no exchange where each also correlates with its own signals;
// the same column twice is one.
TEST(Health, ATendonThatGoesWithAnotherIsNotExchanged) {
  const auto tied = Complaints([](DataSet& set) {
    gap::Run& run = set.runs[2];
    run.tension_N.col(0) = 3 + (run.tension_N.col(1) - 0.8 * run.tension_N.col(0)).array();
  });
  EXPECT_THAT(Shown(tied), Not(HasSubstr("exchange them")));
  const auto twice =
      Complaints([](DataSet& set) { set.runs[2].tension_N.col(0) = set.runs[2].tension_N.col(1); });
  EXPECT_THAT(Shown(twice), HasSubstr("follows the motor position of tendon 2"));
}

TEST(Health, TheEncodersStepTellsAnotherRobot) {
  All(
      3,
      [](gap::Run& run) {
        run.motor_position_rad = run.motor_position_rad.unaryExpr(
            [](double x) { return Rounded(x + 2e-3 * std::sin(1e3 * x), 2 * std::numbers::pi / 8192); });
      },
      "encoder_counts_per_turn");
}

TEST(Health, ARunThatBeginsInMotion) {
  Only(
      [](gap::Run& run) {
        const auto later = [](auto& m) { m = m.bottomRows(m.rows() - 1500).eval(); };
        later(run.time_s);
        for (Eigen::MatrixXd* m : {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad,
                                   &run.tension_N, &run.tip_m, &run.tip_quaternion}) {
          later(*m);
        }
      },
      "motor position 1", "in the first 0.5 s");
}

TEST(Health, ATrackerWhoseClockIsBehindIsSeenToTheMillisecond) {
  const HealthFinding late = Only([](gap::Run& run) { run = GoodRun("gentle", "triangle", 3, 0.8, 0.04); },
                                  "tracker clock", "later");
  EXPECT_NEAR(late.value, 0.04, 0.001);
  const HealthFinding early = Only([](gap::Run& run) { run = GoodRun("gentle", "triangle", 3, 0.8, -0.025); },
                                   "tracker clock", "too early");
  EXPECT_NEAR(early.value, -0.025, 0.001);
}

TEST(Health, ACellThatWasFilteredIsSmootherThanItsSensor) {
  const HealthFinding smooth = Only(
      [](gap::Run& run) {
        for (int pass = 0; pass < 3; ++pass) {
          const Eigen::VectorXd raw = run.tension_N.col(1);
          for (Eigen::Index i = 10; i + 10 < raw.size(); ++i)
            run.tension_N(i, 1) = raw.segment(i - 10, 21).mean();
        }
      },
      "tension 2", "but 0.0052 by the robot file: filtered");
  EXPECT_LT(smooth.value, 5e-4);
}

TEST(Health, ARepetitionThatDoesNotRepeat) {
  const auto found = Complaints([](DataSet& set) {
    set.runs[2] = GoodRun("gentle", "triangle", 3, -0.8);
    set.runs[2].repeat_of = "sway";
  });
  EXPECT_THAT(Shown(found), HasSubstr("this is not a repetition"));
}

TEST(Health, MissingChannelsOfASetAreReported) {
  const auto found = Complaints([](DataSet& set) {
    set.runs.erase(set.runs.begin(), set.runs.begin() + 2);
    set.runs[0].tip_m.resize(0, 0);
    set.runs[0].tip_quaternion.resize(0, 0);
    set.runs[0].tension_N.resize(0, 0);
  });
  const std::string text = Shown(found);
  EXPECT_THAT(text, HasSubstr("no run repeats another"));
  EXPECT_THAT(text, HasSubstr("all runs are of one family"));
  EXPECT_THAT(text, HasSubstr("no run has a tip"));
  EXPECT_THAT(text, HasSubstr("no run has tensions"));
}

// Any loaded set can be checked: only missing values, two rows, other numbers of columns.
TEST(Health, UnusualRunsDoNotCrash) {
  DataSet set = GoodSet();
  set.runs[0].tension_N.setConstant(kNone);
  set.runs[0].motor_position_rad.setConstant(kNone);
  set.runs[0].tip_m.setConstant(kNone);
  gap::Run two;
  two.name = "two";
  two.time_s = Eigen::Vector2d(0, 1);
  two.tension_N = Eigen::MatrixXd::Zero(2, 3);
  two.motor_position_rad = Eigen::MatrixXd::Constant(2, 9, 1e300);
  two.torque_target_Nm = Eigen::MatrixXd::Constant(2, 9, -1e300);
  two.tip_m = Eigen::MatrixXd::Zero(2, 3);
  two.repeat_of = "gentle";
  set.runs.push_back(two);
  gap::Run empty;
  empty.name = "empty";
  set.runs.push_back(empty);
  gap::Run nine = set.runs[2];
  nine.tension_N = Eigen::MatrixXd::Random(kRows, 9);
  nine.motor_position_rad.conservativeResize(kRows - 5, 3);
  set.runs.push_back(nine);
  set.robot.actuation.reset();
  EXPECT_FALSE(CheckHealth(set).empty());
  set.robot = GoodSet().robot;
  EXPECT_FALSE(CheckHealth(set).empty());
  EXPECT_FALSE(CheckHealth(DataSet{}).empty());
}

}  // namespace
}  // namespace tendril::gap
