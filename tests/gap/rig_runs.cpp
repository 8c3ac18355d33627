#include "rig_runs.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "gap/file_numbers.h"
#include "tendril/config/config.h"
#include "tendril/sim/effects.h"

namespace tendril {

using gap::DataSet;
using gap::Diagnosis;
using gap::Run;

RobotParameters Rig() { return config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_90mm.yaml"); }

Eigen::Vector3d CommandedTension(const std::string& family, double t) {
  constexpr double kRest_s = 0.5;
  const Eigen::Vector3d rest(0.3, 0.3, 0.3);
  if (t < kRest_s) return rest;
  const double s = t - kRest_s;
  const double begin = std::min(1.0, s);
  Eigen::Vector3d tension_N = rest;
  for (int j = 0; j < 3; ++j) {
    const double phase = 2 * std::numbers::pi * j / 3;
    if (family == "circle") tension_N[j] += begin * 3.5 * (1 + std::sin(1.6 * s - phase));
    if (family == "sway") tension_N[j] += begin * 2.2 * (1 + std::sin(20 * s - phase));
    if (family == "gentle") tension_N[j] += begin * 0.15 * (1 + std::sin(1.6 * s - phase));
    if (family == "triangle") {
      const double part = std::fmod(s / 3 + j / 3.0, 1.0);
      tension_N[j] += begin * 7 * (1 - std::abs(2 * part - 1));
    }
    if (family == "slow") {
      const double part = std::fmod(s / 6 + j / 3.0, 1.0);
      tension_N[j] += begin * 9 * (1 - std::abs(2 * part - 1));
    }
    if (family == "multisine") {
      tension_N[j] += begin * (3.2 + 1.8 * std::sin(3 * s + phase) + 0.9 * std::sin(13 * s + 2 * phase));
    }
  }
  return tension_N;
}

Run EmptyRun(const std::string& family, int rows, double last_s) {
  Run run;
  run.name = family;
  run.family = family;
  run.time_s = Eigen::VectorXd::LinSpaced(rows, 0, last_s);
  for (auto* matrix :
       {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad, &run.tension_N}) {
    matrix->setZero(rows, 3);
  }
  run.tip_m.setConstant(rows, 3, std::nan(""));
  run.tip_quaternion.setConstant(rows, 4, std::nan(""));
  return run;
}

void ReadRow(sim::Plant& plant, const RobotParameters& nominal, bool tracked, int row, Run& run) {
  const auto& p = nominal.actuation->tendons[0];
  const auto sensors = plant.ReadSensors();
  for (int j = 0; j < 3; ++j) {
    run.torque_actual_Nm(row, j) = sensors[j].torque_Nm;
    run.motor_position_rad(row, j) =
        2 * std::numbers::pi / p.drive.encoder_counts_per_turn * sensors[j].encoder_counts;
    run.tension_N(row, j) = sensors[j].load_cell_V / p.load_cell.gain_VpN;
  }
  if (!tracked) return;
  const auto seen = plant.ReadTracker();
  run.tip_m.row(row) = seen.tip_W_m;
  const auto& o = seen.orientation_WT;
  run.tip_quaternion.row(row) << o.w(), o.x(), o.y(), o.z();
}

Run Record(sim::Plant& plant, const std::string& family, double duration_s, const Rub& rub, int rows_Hz) {
  const RobotParameters nominal = Rig();
  const int samples = static_cast<int>(duration_s * rows_Hz);
  Run run = EmptyRun(family, samples, (samples - 1.0) / rows_Hz);
  Eigen::Vector3d sent = CommandedTension(family, 0) * kTorquePerN, rubbed = Eigen::Vector3d::Zero();
  for (int i = 0; i < samples; ++i) {
    ReadRow(plant, nominal, i % (rows_Hz / 100) == 0, i, run);
    const Eigen::Vector3d target = CommandedTension(family, static_cast<double>(i) / rows_Hz) * kTorquePerN;
    run.torque_target_Nm.row(i) = target.transpose();
    run.torque_actual_Nm.row(i) += rubbed.transpose();
    // A target acts at the SYNC after the cycle in which it was sent.
    for (int j = 0; rub && j < 3; ++j)
      rubbed[j] = rub(j, plant.tendon()[j], static_cast<double>(i) / rows_Hz);
    plant.SetTorque(sent - rubbed);
    sent = target;
    plant.Advance(1000 / rows_Hz * kNsPerMs);
  }
  return run;
}

Run Record(const RobotParameters& plant_robot, const std::string& family, double duration_s,
           std::uint64_t seed, int rows_Hz) {
  sim::Plant plant(plant_robot, {.seed = seed});
  return Record(plant, family, duration_s, nullptr, rows_Hz);
}

DataSet Recorded(const std::vector<std::string>& effects, double duration_s, std::uint64_t seed,
                 int rows_Hz) {
  DataSet set;
  set.name = "test";
  set.robot = Rig();
  RobotParameters plant = Rig();
  for (const auto& effect : effects) plant.effects.push_back(sim::ParseEffect(effect, plant));
  for (const char* family : {"circle", "triangle", "multisine"}) {
    set.runs.push_back(Record(plant, family, duration_s, seed++, rows_Hz));
  }
  set.runs.push_back(Record(plant, "circle", duration_s, seed++, rows_Hz));
  set.runs.back().name = "circle again";
  set.runs.back().repeat_of = "circle";
  return set;
}

DataSet Recorded(const std::string& effect, double duration_s) {
  return Recorded(effect.empty() ? std::vector<std::string>{} : std::vector{effect}, duration_s);
}

DataSet RecordedAt500Hz(const std::string& effect, double duration_s) {
  return Recorded(effect.empty() ? std::vector<std::string>{} : std::vector{effect}, duration_s, 11, 500);
}

DataSet TwoFamilies(const std::string& effect, double duration_s) {
  DataSet set = RecordedAt500Hz(effect, duration_s);
  set.runs.erase(set.runs.begin() + 2);
  return set;
}

DataSet RecordedAtRobotSide(const std::string& effect, const std::vector<std::string>& families,
                            double duration_s, std::uint64_t seed, int rows_Hz) {
  DataSet set;
  set.robot = Rig();
  for (auto& tendon : set.robot.actuation->tendons) tendon.load_cell.place = LoadCellPlace::kRobotSide;
  RobotParameters plant = set.robot;
  if (!effect.empty()) plant.effects.push_back(sim::ParseEffect(effect, plant));
  for (const auto& family : families) set.runs.push_back(Record(plant, family, duration_s, seed++, rows_Hz));
  for (auto& run : set.runs) run.load_cell = LoadCellPlace::kRobotSide;
  set.runs.back().name = families.front() + " again";
  set.runs.back().repeat_of = families.front();
  return set;
}

const gap::Cause* Named(const Diagnosis& d, const std::string& effect) {
  for (const auto& cause : d.causes) {
    if (cause.effect == effect) return &cause;
  }
  return nullptr;
}

sim::Cut First(const Diagnosis& d) {
  for (const auto& finding : d.location) {
    if (finding.first) return finding.cut;
  }
  return sim::Cut::kClock;
}

const std::vector<std::string> kNumbersOff{"bending_stiffness scale=0.85", "unit_mass scale=0.86",
                                           "capstan_alpha scale=1.25",     "motor_coulomb scale=1.2",
                                           "tendon_stiffness scale=1.1",   "torque_constant scale=0.96"};

void KnowEveryNumber(RobotParameters& robot) {
  constexpr Uncertainty kKnown{Uncertainty::Kind::kKnown, 0};
  for (const gap::FileNumber& number : gap::FileNumbers(robot)) robot.uncertain[number.key] = kKnown;
  for (std::size_t k = 0; k < robot.body.sections.size(); ++k) {
    for (std::size_t j = 0; j < robot.body.sections[k].tendons.size(); ++j) {
      for (const char* word : {"radius_m", "angle_rad"})
        robot.uncertain[fmt::format("body.sections[{}].tendons[{}].{}", k + 1, j + 1, word)] = kKnown;
    }
  }
}

gap::DiagnoseOptions Only(const std::vector<std::string>& effects) {
  gap::DiagnoseOptions options;
  options.menu.families.clear();
  for (const std::string& name : effects) EXPECT_NE(sim::FindEffect(name), nullptr) << name;
  for (const sim::Effect& effect : sim::Effects()) {
    if (std::find(effects.begin(), effects.end(), effect.name) == effects.end())
      options.without.emplace_back(effect.name);
  }
  return options;
}

void KeepEveryNth(Run& run, int n, Eigen::Index first) {
  std::vector<Eigen::Index> rows;
  for (Eigen::Index row = first; row < run.time_s.size(); row += n) rows.push_back(row);
  KeepRows(run, rows);
}

void KeepRows(Run& run, const std::vector<Eigen::Index>& rows) {
  const Eigen::Index all = run.time_s.size();
  run.time_s = run.time_s(rows).eval();
  for (auto* values : {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad, &run.tension_N,
                       &run.tip_m, &run.tip_quaternion}) {
    if (values->rows() == all) *values = (*values)(rows, Eigen::all).eval();
  }
}

void Lose(Run& run, Eigen::Index lost, Eigen::Index from) {
  const Eigen::Index rows = run.time_s.size(), kept = rows - lost;
  const auto without = [&](auto& values) {
    if (values.rows() != rows) return;
    values.middleRows(from, kept - from) = values.bottomRows(kept - from).eval();
    values.conservativeResize(kept, values.cols());
  };
  for (auto* values : {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad, &run.tension_N,
                       &run.tip_m, &run.tip_quaternion})
    without(*values);
  run.time_s.segment(from, kept - from) = run.time_s.tail(kept - from).eval();
  run.time_s.conservativeResize(kept);
}

void LoseRows(Run& run) { Lose(run, RowAt(run, 0.7), run.time_s.size() / 3); }

Eigen::Index RowAt(const Run& run, double time_s) {
  return static_cast<Eigen::Index>(std::lround(time_s / (run.time_s[1] - run.time_s[0])));
}

}  // namespace tendril
