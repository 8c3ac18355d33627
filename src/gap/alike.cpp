// Runs beside each other: their clocks and their columns.
#include "alike.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "prepare.h"

namespace tendril::gap {
namespace {

/// Motors go smoothly from row to row: a motion, as states that were waited for are not.
bool Smooth(const Run& run) {
  constexpr double kSmooth = 0.03;  // rms step of a motor, of what it does in all
  const Eigen::MatrixXd& x = run.motor_position_rad;
  double widest = 0, largest = 0;
  for (Eigen::Index j = 0; j < x.cols(); ++j) {
    double least = INFINITY, most = -INFINITY, square = 0, count = 0, last = NAN;
    for (const double v : x.col(j)) {
      if (!std::isfinite(v)) continue;
      least = std::min(least, v), most = std::max(most, v);
      if (std::isfinite(last)) square += (v - last) * (v - last), count += 1;
      last = v;
    }
    if (count == 0) continue;
    widest = std::max(widest, most - least);
    largest = std::max(largest, std::sqrt(square / count));
  }
  return widest > 0 && largest < kSmooth * widest;
}

}  // namespace

std::vector<std::string> TakeOutOtherTime(DataSet& set) {
  struct Unit {
    double seconds;
    const char* name;
  };
  constexpr Unit kUnits[] = {{1e-3, "milliseconds"}, {1e-6, "microseconds"}, {1e-9, "nanoseconds"}};
  constexpr double kLike = 0.3;  // steps of one controller differ by less
  std::vector<std::string> said;
  double fastest_s = std::numeric_limits<double>::infinity();
  for (const Run& run : set.runs) fastest_s = std::min(fastest_s, UsualStep(run));
  std::erase_if(set.runs, [&](const Run& run) {
    const double step_s = UsualStep(run);
    if (!(step_s > kQuasiStatic_s) || !(fastest_s > 0)) return false;
    for (const Unit& unit : kUnits) {
      if (std::abs(step_s * unit.seconds / fastest_s - 1) > kLike || !Smooth(run)) continue;
      said.push_back(
          fmt::format("{}: left out: a row every {:.4g} s, in other runs every {:.4g} s, and motors that go "
                      "smoothly from row to row: its time is in {}; write it in seconds",
                      run.name, step_s, fastest_s, unit.name));
      return true;
    }
    return false;
  });
  return said;
}

void FillMissing(DataSet& set) {
  const auto no_cell = [](const Run& run) { return run.load_cell == LoadCellPlace::kNone; };
  const auto with_cell = std::find_if(set.runs.begin(), set.runs.end(), [&](const Run& run) {
    return !no_cell(run) && run.tension_N.cols() > 0;
  });
  const bool any_cell = with_cell != set.runs.end();
  const LoadCellPlace place = any_cell ? with_cell->load_cell : LoadCellPlace::kNone;
  for (Eigen::MatrixXd Run::*values :
       {&Run::torque_target_Nm, &Run::torque_actual_Nm, &Run::motor_position_rad, &Run::tension_N}) {
    const bool tensions = values == &Run::tension_N;
    if (tensions && !any_cell) continue;
    Eigen::Index columns = 0;
    for (const Run& run : set.runs) {
      if (!tensions || !no_cell(run)) columns = std::max(columns, (run.*values).cols());
    }
    for (Run& run : set.runs) {
      if ((run.*values).cols() > 0 && !(tensions && no_cell(run))) continue;
      (run.*values).setConstant(run.time_s.size(), columns, std::numeric_limits<double>::quiet_NaN());
    }
  }
  for (Run& run : set.runs) {
    if (any_cell && no_cell(run)) run.load_cell = place;
  }
}

}  // namespace tendril::gap
