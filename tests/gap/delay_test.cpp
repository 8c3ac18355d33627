// Delays of any fraction of a cycle, made by the test's own drive model: targets held from the moment they
// act, a first-order loop integrated in steps of 5 us; and which delay the diagnosis finds.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <tuple>

#include "rig_runs.h"
#include "tendril/gap/diagnose.h"
#include "tendril/sim/plant.h"

namespace tendril {
namespace {

/// Torque of three drives behind their loops. A target acts a cycle and `late_s` after its row.
class Drives {
 public:
  Drives(double cycle_s, double late_s, double lag_s) : cycle_s_(cycle_s), late_s_(late_s), lag_s_(lag_s) {}

  /// Continues from the last call to `to_s`, in steps that are short compared with the lag.
  template <class Targets>
  void Advance(double to_s, const Targets& target_of_row) {
    constexpr double kStep_s = 5e-6;
    for (; time_s_ < to_s - 1e-9; time_s_ += kStep_s) {
      const double row = std::floor((time_s_ + 0.5 * kStep_s - cycle_s_ - late_s_) / cycle_s_);
      const Eigen::Vector3d target = target_of_row(row);
      torque_Nm_ += (1 - std::exp(-kStep_s / lag_s_)) * (target - torque_Nm_);
    }
  }
  void StartAt(const Eigen::Vector3d& torque_Nm) { torque_Nm_ = torque_Nm; }
  const Eigen::Vector3d& torque_Nm() const { return torque_Nm_; }

 private:
  double cycle_s_, late_s_, lag_s_, time_s_ = 0;
  Eigen::Vector3d torque_Nm_ = Eigen::Vector3d::Zero();
};

/// Torques that approximately hold the tensions of a family's motion, quantised to per mille as on the bus.
Eigen::Vector3d TargetAt(const RobotParameters& robot, const std::string& family, double time_s) {
  const auto& drive = robot.actuation->tendons[0];
  const double s = std::max(0.0, time_s - 0.5), begin = std::min(1.0, s);
  Eigen::Vector3d torque_Nm;
  for (int j = 0; j < 3; ++j) {
    const double phase = 2 * std::numbers::pi * j / 3;
    double tension_N = 0.4;  // more than the file's pretension
    if (family == "multisine")
      tension_N += begin * (3.2 + 1.8 * std::sin(3 * s + phase) + 0.9 * std::sin(13 * s + 2 * phase));
    if (family == "sway") tension_N += begin * 2.2 * (1 + std::sin(20 * s - phase));
    if (family == "steps") tension_N += begin * (std::fmod(s / 1.2 + j / 3.0, 1.0) < 0.4 ? 5 : 0.5);
    const double permille_Nm = 1e-3 * drive.drive.rated_torque_Nm;
    torque_Nm[j] = permille_Nm * std::round(tension_N * drive.SpoolTravelPerMotorRad() / permille_Nm);
  }
  return torque_Nm;
}

/// A run logged every cycle, the drives `late_s` late.
gap::Run RecordLate(const std::string& family, double cycle_s, double late_s, std::uint64_t seed) {
  const RobotParameters robot = Rig();
  RobotParameters plant_robot = robot;
  for (auto& tendon : plant_robot.actuation->tendons) tendon.motor.torque_lag_s = 0;
  sim::Plant plant(plant_robot, {.seed = seed});
  const auto& p = robot.actuation->tendons[0];
  const double permille_Nm = 1e-3 * p.drive.rated_torque_Nm;
  std::mt19937_64 random(seed);
  std::normal_distribution<double> noise(0, p.drive.actual_torque_noise_permille);
  const auto target_of_row = [&](double row) {
    return TargetAt(robot, family, std::max(0.0, row) * cycle_s);
  };
  Drives drives(cycle_s, late_s, p.motor.torque_lag_s);
  drives.StartAt(target_of_row(0));
  constexpr double kPiece_s = 2e-4;  // the plant's torque is held so long
  const int samples = static_cast<int>(3.5 / cycle_s),
            pieces = static_cast<int>(std::lround(cycle_s / kPiece_s));
  gap::Run run = EmptyRun(family, samples, cycle_s * (samples - 1));
  for (int i = 0; i < samples; ++i) {
    ReadRow(plant, robot, i % static_cast<int>(std::lround(0.01 / cycle_s)) == 0, i, run);
    run.torque_target_Nm.row(i) = target_of_row(i).transpose();
    for (int j = 0; j < 3; ++j) {
      run.torque_actual_Nm(i, j) =
          permille_Nm * std::round(drives.torque_Nm()[j] / permille_Nm + noise(random));
    }
    for (int piece = 1; piece <= pieces; ++piece) {
      drives.Advance(cycle_s * i + kPiece_s * (piece - 0.5), target_of_row);
      plant.SetTorque(drives.torque_Nm());
      plant.Advance(kNsPerMs / 5);
      drives.Advance(cycle_s * i + kPiece_s * piece, target_of_row);
    }
  }
  return run;
}

/// Logs of every `n`-th cycle.
gap::Diagnosis DiagnoseLate(double cycle_s, double late_s, int n = 1) {
  gap::DataSet set;
  set.robot = Rig();
  std::uint64_t seed = 5;
  for (const char* family : {"multisine", "sway", "steps", "sway"}) {
    set.runs.push_back(RecordLate(family, cycle_s, late_s, seed++));
    KeepEveryNth(set.runs.back(), n);
  }
  set.runs.back().name = "sway again";
  set.runs.back().repeat_of = "sway";
  return gap::Diagnose(
      set, Only({"command_delay", "torque_loop_lag", "torque_constant", "torque_saturation", "tip_payload"}));
}

class DelayTest : public testing::TestWithParam<std::tuple<double, double>> {};

TEST_P(DelayTest, IsNamedWithItsSize) {
  const auto [cycle_ms, late_ms] = GetParam();
  const gap::Diagnosis d = DiagnoseLate(1e-3 * cycle_ms, 1e-3 * late_ms);
  ASSERT_EQ(d.accepted.size(), 1u) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "command_delay") << d.sentence;
  EXPECT_EQ(d.accepted[0].where, "all");
  EXPECT_NEAR(d.causes[0].parameters.at("s").value, 1e-3 * late_ms, 3e-5) << d.sentence;
}

INSTANTIATE_TEST_SUITE_P(Fractions, DelayTest,
                         testing::Combine(testing::Values(1.0, 2.0), testing::Values(0.4, 1.6, 2.5)),
                         [](const auto& of) {
                           return "Cycle" + std::to_string(std::lround(std::get<0>(of.param))) + "msLate" +
                                  std::to_string(std::lround(1000 * std::get<1>(of.param))) + "us";
                         });

// Slow targets between two rows are not in the log and leave no trace in the torque: how long a row's target
// had been on its way is unknown, and the interval of a delay says so.
class ThinnedDelayTest : public testing::TestWithParam<std::tuple<int, double>> {};

TEST_P(ThinnedDelayTest, IsWithinItsInterval) {
  const auto [n, late_ms] = GetParam();
  const gap::Diagnosis d = DiagnoseLate(1e-3, 1e-3 * late_ms, n);
  for (const gap::Cause& cause : d.accepted) {
    const gap::Estimate late = cause.parameters.at("s");
    EXPECT_LE(late.low, 1e-3 * late_ms) << d.sentence;
    EXPECT_GE(late.high, 1e-3 * late_ms) << d.sentence;
  }
  EXPECT_THAT(
      d.degradations,
      testing::Contains(testing::ContainsRegex("a row \\(every . ms\\) holds (every target or )?one of . ?")))
      << d.sentence;
}

INSTANTIATE_TEST_SUITE_P(Rows, ThinnedDelayTest,
                         testing::Combine(testing::Values(2, 3), testing::Values(2.5, 7.3)),
                         [](const auto& of) {
                           return "Of" + std::to_string(std::get<0>(of.param)) + "Late" +
                                  std::to_string(std::lround(1000 * std::get<1>(of.param))) + "us";
                         });

TEST(Delay, NoneIsNoGap) {
  for (const double cycle_s : {1e-3, 2e-3}) {
    const gap::Diagnosis d = DiagnoseLate(cycle_s, 0);
    EXPECT_EQ(d.verdict, gap::Verdict::kNoGap) << d.sentence;
  }
}

}  // namespace
}  // namespace tendril
