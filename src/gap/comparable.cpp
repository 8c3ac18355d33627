// Compares runs with the robot and with each other: their columns, lengths and clocks.
#include "comparable.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include "health_signal.h"
#include "prepare.h"
#include "squares.h"

namespace tendril::gap {
namespace {

/// Number of tendons of the recorded robot according to the columns of its source, measured or not; 0 where
/// the source names none.
int TendonsOf(const Run& run) {
  Eigen::Index most = 0;
  for (const auto* m :
       {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad, &run.tension_N})
    most = std::max(most, m->cols());
  return static_cast<int>(most);
}

}  // namespace

bool Smooth(const Run& run) {
  constexpr double kSmooth = 0.03;  // rms step of a motor, relative to its rms motion
  double widest = 0, farthest = 0;
  for (Eigen::Index j = 0; j < run.motor_position_rad.cols(); ++j) {
    Squares steps;
    double last = NAN;
    for (const double v : run.motor_position_rad.col(j)) {
      if (!std::isfinite(v)) continue;
      if (std::isfinite(last)) steps.Add(v - last);
      last = v;
    }
    widest = std::max(widest, RangeOf(run.motor_position_rad.col(j)).width());
    farthest = std::max(farthest, steps.rms());
  }
  return widest > 0 && farthest < kSmooth * widest;
}

bool Compared(const DataSet& set) {
  return std::any_of(set.runs.begin(), set.runs.end(), [](const Run& run) { return !run.before.empty(); });
}

void LeaveOut(DataSet& set, std::size_t run) {
  const std::string name = set.runs[run].name;
  const std::string root = set.runs[run].repeat_of;
  set.runs.erase(set.runs.begin() + static_cast<std::ptrdiff_t>(run));
  if (!root.empty()) return;
  std::string heir;
  for (Run& other : set.runs) {
    if (other.repeat_of != name) continue;
    other.repeat_of = heir;
    if (heir.empty()) heir = other.name;
  }
}

void RequireTendons(const DataSet& set) {
  for (const Run& run : set.runs) {
    const int its = TendonsOf(run), tendons = set.robot.body.tendons();
    if (its == 0 || its == tendons) continue;
    throw std::runtime_error(
        fmt::format("these runs have {} tendon{}, robot '{}' has {}; accepted: the robot file that they were "
                    "recorded with",
                    its, its == 1 ? "" : "s", set.robot.name, tendons));
  }
}

std::vector<std::string> LeaveOutShortRuns(DataSet& set) {
  constexpr int kNamed = 5;
  std::vector<std::string> said;
  std::string names;
  int count = 0;
  for (std::size_t i = 0; i < set.runs.size();) {
    const Run& run = set.runs[i];
    if (run.time_s.size() >= LeastRows(run)) {
      ++i;
      continue;
    }
    if (++count <= kNamed)
      names += fmt::format("{}{} ({})", count > 1 ? ", " : "", run.name, run.time_s.size());
    said.push_back(fmt::format("left out: {}: too short ({} rows; accepted: at least {})", run.name,
                               run.time_s.size(), LeastRows(run)));
    LeaveOut(set, i);
  }
  if (set.runs.empty()) {
    throw std::runtime_error(
        fmt::format("no run is long enough: {} rows; accepted: at least {}, or for states at rest (rows more "
                    "than {} s apart) {}; record longer runs",
                    names, kLeastRows, kQuasiStatic_s, kLeastStates));
  }
  return said;
}

std::vector<std::string> LeaveOutOtherTimeUnits(DataSet& set) {
  constexpr double kLike = 0.3;   // steps of one controller differ by less
  constexpr double kLeast_s = 1;  // minimum duration of a run
  std::vector<double> usual_s;
  for (const Run& run : set.runs) {
    if (const double step_s = UsualStep(run); step_s > 0 && step_s <= kQuasiStatic_s)
      usual_s.push_back(step_s);
  }
  std::vector<std::string> said;
  for (std::size_t i = set.runs.size(); i-- > 0;) {
    const Run& run = set.runs[i];
    const double step_s = UsualStep(run);
    if (step_s <= kQuasiStatic_s || !Smooth(run)) continue;
    for (const TimeUnit& unit : kTimeUnits) {
      const auto like = std::find_if(usual_s.begin(), usual_s.end(), [&](double other_s) {
        return std::abs(step_s * unit.seconds / other_s - 1) <= kLike &&
               other_s * static_cast<double>(run.time_s.size()) >= kLeast_s;
      });
      if (like == usual_s.end()) continue;
      said.push_back(
          fmt::format("left out: {}: its rows are {:.4g} s apart, those of other runs {:.4g} s, and its "
                      "motors move smoothly from row to row: its time is in {}; convert it to seconds",
                      run.name, step_s, *like, unit.name));
      LeaveOut(set, i);
      break;
    }
  }
  return said;
}

void FillMissing(DataSet& set) {
  const Eigen::Index tendons = set.robot.body.tendons();
  const auto has = [&](const Run& run, Eigen::MatrixXd Run::*values) {
    const bool none = values == &Run::tension_N && run.load_cell == LoadCellPlace::kNone;
    return !none && (run.*values).cols() == tendons && (run.*values).rows() == run.time_s.size();
  };
  for (Eigen::MatrixXd Run::*values :
       {&Run::torque_target_Nm, &Run::torque_actual_Nm, &Run::motor_position_rad, &Run::tension_N}) {
    const auto first =
        std::find_if(set.runs.begin(), set.runs.end(), [&](const Run& run) { return has(run, values); });
    if (first == set.runs.end()) continue;
    const LoadCellPlace place = first->load_cell;
    for (Run& run : set.runs) {
      if (has(run, values)) continue;
      (run.*values).setConstant(run.time_s.size(), tendons, kNoReading);
      if (values == &Run::tension_N) run.load_cell = place;
    }
  }
}

}  // namespace tendril::gap
