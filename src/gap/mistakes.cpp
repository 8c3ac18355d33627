// One function per measurement error.
#include "mistakes.h"

#include <fmt/core.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "prepare.h"

namespace tendril::gap {
namespace {

constexpr const char* kAxes = "xyz";

void Negate(Eigen::MatrixXd& values, Eigen::Index column) {
  if (column < values.cols()) values.col(column) *= -1;
}

void Exchange(Eigen::MatrixXd& values, Eigen::Index a, Eigen::Index b) {
  if (std::max(a, b) < values.cols()) values.col(a).swap(values.col(b));
}

/// The tracker's frame rotated about the base's axis, positions and orientations.
void Turn(Run& run, const Eigen::AngleAxisd& by) {
  const Eigen::Matrix3d R = by.toRotationMatrix();
  if (run.tip_m.cols() == 3) run.tip_m = (run.tip_m * R.transpose()).eval();
  for (Eigen::Index i = 0; i < run.tip_quaternion.rows() && run.tip_quaternion.cols() == 4; ++i) {
    const Eigen::Vector4d w = run.tip_quaternion.row(i).transpose();
    const Eigen::Quaterniond q = Eigen::Quaterniond(by) * Eigen::Quaterniond(w[0], w[1], w[2], w[3]);
    run.tip_quaternion.row(i) << q.w(), q.x(), q.y(), q.z();
  }
}

/// Errors in the bending of sections, (us, vs) each.
void OfBends(std::size_t sections, std::vector<Mistake>& all) {
  const auto of = [&](const std::string& with, void (*undo)(Eigen::MatrixXd&, Eigen::Index)) {
    for (std::size_t k = 0; k < sections; ++k) {
      const auto column = static_cast<Eigen::Index>(2 * k);
      all.push_back({fmt::format(fmt::runtime(with), k + 1),
                     [undo, column](Run& run) { undo(run.bending_rad, column); }});
    }
  };
  of("the sign of us_{} reversed", Negate);
  of("the sign of vs_{0} reversed", [](Eigen::MatrixXd& bend, Eigen::Index k) { Negate(bend, k + 1); });
  of("us_{0} and vs_{0} exchanged", [](Eigen::MatrixXd& bend, Eigen::Index k) { Exchange(bend, k, k + 1); });
  of("the bend of section {} turned by 180 degrees", [](Eigen::MatrixXd& bend, Eigen::Index k) {
    Negate(bend, k);
    Negate(bend, k + 1);
  });
  all.push_back({"the bends read as degrees", [](Run& run) { run.bending_rad *= std::numbers::pi / 180; }});
}

/// Readings of one cell: rows, times and values where they exist.
struct Readings {
  std::vector<Eigen::Index> row;
  std::vector<double> time_s, value;

  Readings(const Run& run, Eigen::Index tendon) {
    for (Eigen::Index i = 0; i < run.tension_N.rows(); ++i) {
      if (!std::isfinite(run.tension_N(i, tendon))) continue;
      row.push_back(i);
      time_s.push_back(run.time_s[i]);
      value.push_back(run.tension_N(i, tendon));
    }
  }
  std::size_t size() const { return row.size(); }
};

/// Of one tendon, or of all.
struct Cells {
  int one = -1;

  bool has(Eigen::Index tendon) const { return one < 0 || one == tendon; }
  std::string name() const {
    return one < 0 ? "the load cells' readings" : fmt::format("the readings of load cell {}", one + 1);
  }
};

/// The cells' readings, shifted in time by their delay.
void Advance(Run& run, Cells cells, double late_s) {
  for (Eigen::Index j = 0; j < run.tension_N.cols(); ++j) {
    if (!cells.has(j)) continue;
    const Readings read(run, j);
    std::size_t next = 0;
    for (std::size_t i = 0; i < read.size(); ++i) {
      const double at_s = read.time_s[i] + late_s;
      while (next < read.size() && read.time_s[next] < at_s) ++next;
      double& value = run.tension_N(read.row[i], j);
      if (next == 0 || next == read.size()) {
        value = kNoReading;
        continue;
      }
      const double share = (at_s - read.time_s[next - 1]) / (read.time_s[next] - read.time_s[next - 1]);
      value = read.value[next - 1] + share * (read.value[next] - read.value[next - 1]);
    }
  }
}

/// The cells' readings before a first-order low-pass filter; slopes are those of straight lines.
void Unfilter(Run& run, Cells cells, double time_constant_s) {
  constexpr double kLine_s = 0.01;
  for (Eigen::Index j = 0; j < run.tension_N.cols(); ++j) {
    if (!cells.has(j)) continue;
    const Readings read(run, j);
    const std::size_t n = read.size();
    if (n < 3) continue;
    const double step_s = (read.time_s[n - 1] - read.time_s[0]) / static_cast<double>(n - 1);
    const auto points =
        static_cast<std::size_t>(std::clamp(std::round(kLine_s / step_s) + 1, 3.0, static_cast<double>(n)));
    for (std::size_t i = 0; i < n; ++i) {
      const std::size_t from = std::min(i - std::min(i, points / 2), n - points);
      const auto count = static_cast<Eigen::Index>(points);
      const Eigen::Map<const Eigen::ArrayXd> t(&read.time_s[from], count), y(&read.value[from], count);
      const Eigen::ArrayXd off_s = t - t.mean();
      run.tension_N(read.row[i], j) += time_constant_s * (off_s * y).sum() / off_s.square().sum();
    }
  }
}

/// Signs of motors, and tendons exchanged.
void OfTendons(const DataSet& set, Measured measured, std::vector<Mistake>& all) {
  const int tendons = set.robot.body.tendons();
  for (int j = 0; j < tendons; ++j) {
    all.push_back({fmt::format("the sign of motor position {} reversed", j + 1),
                   [j](Run& run) { Negate(run.motor_position_rad, j); }});
    for (int k = j + 1; k < tendons; ++k) {
      const auto exchanged = [&](const char* what, std::vector<Eigen::MatrixXd Run::*> columns) {
        all.push_back({fmt::format("{} {} and {} exchanged", what, j + 1, k + 1), [=](Run& run) {
                         for (const auto values : columns) Exchange(run.*values, j, k);
                       }});
      };
      exchanged("all columns of tendons",
                {&Run::torque_target_Nm, &Run::torque_actual_Nm, &Run::motor_position_rad, &Run::tension_N});
      exchanged("the motor positions", {&Run::motor_position_rad});
      if (measured.cells) exchanged("the load cells", {&Run::tension_N});
    }
  }
}

/// Units and zeros of the motors, units of the cells.
void OfUnits(const DataSet& set, Measured measured, std::vector<Mistake>& all) {
  const auto motors_in = [&](const char* unit, double rad) {
    all.push_back({fmt::format("the motor positions read as {}", unit),
                   [rad](Run& run) { run.motor_position_rad *= rad; }});
  };
  all.push_back({"the motor positions counted from the beginning of each run", [](Run& run) {
                   for (auto motor : run.motor_position_rad.colwise()) {
                     const auto first =
                         std::find_if(motor.begin(), motor.end(), [](double x) { return std::isfinite(x); });
                     if (first != motor.end()) motor.array() -= double{*first};
                   }
                 }});
  motors_in("degrees", std::numbers::pi / 180);
  motors_in("turns", 2 * std::numbers::pi);
  if (const int counts = set.robot.actuation->tendons.front().drive.encoder_counts_per_turn; counts > 0)
    motors_in("encoder counts", 2 * std::numbers::pi / counts);
  const auto tensions_in = [&](const char* unit, double newtons) {
    if (!measured.cells) return;
    all.push_back(
        {fmt::format("the tensions read as {}", unit), [newtons](Run& run) { run.tension_N *= newtons; }});
  };
  tensions_in("pounds-force", 4.4482216);
  tensions_in("kilograms-force", 9.80665);
}

/// Half-corrected, an error of a size looks like one that is half as large; sizes are tried at this spacing,
/// and about those that help in steps of a twelfth.
template <class OfSize>
void AddAllSizes(std::vector<Mistake>& all, double least, double most, OfSize&& of_size) {
  for (double size = least; size < most; size *= 2.25) {
    Mistake mistake = of_size(size);
    for (double finer = size / 1.5; finer < 1.51 * size; finer *= 1.084)
      mistake.finer.push_back(of_size(finer));
    all.push_back(std::move(mistake));
  }
}

/// The scale of the tracker, delays of the cells.
void OfSizes(const DataSet& set, Measured measured, std::vector<Mistake>& all) {
  for (const int sign : {-1, 1}) {
    if (!measured.tracker || set.fit_frame) break;
    AddAllSizes(all, 1, 12, [sign](double percent) {
      return Mistake{fmt::format("the tip's distances {:.2g} % {}", percent, sign < 0 ? "smaller" : "larger"),
                     [=](Run& run) { run.tip_m *= 1 + 0.01 * sign * percent; }};
    });
  }
  // Slower logs do not resolve such a delay.
  const bool fast = std::any_of(set.runs.begin(), set.runs.end(),
                                [](const Run& run) { return UsualStep(run) <= kBridged_s; });
  const auto late = [&](Cells cells) {
    AddAllSizes(all, 1, 150, [cells](double ms) {
      return Mistake{fmt::format("{} shifted {:.0f} ms earlier", cells.name(), ms),
                     [=](Run& run) { Advance(run, cells, 1e-3 * ms); }};
    });
    AddAllSizes(all, 1, 150, [cells](double ms) {
      return Mistake{fmt::format("a low-pass filter of {:.0f} ms removed from {}", ms, cells.name()),
                     [=](Run& run) { Unfilter(run, cells, 1e-3 * ms); }};
    });
  };
  if (measured.cells && fast) late({});
  if (measured.disagreeing_cell >= 0 && fast) late({measured.disagreeing_cell});
}

/// Order and frame of the tracker's readings.
void OfTracker(const DataSet& set, Measured measured, std::vector<Mistake>& all) {
  if (!measured.tracker) return;
  const bool bent = std::any_of(set.runs.begin(), set.runs.end(), [](const Run& run) {
    return run.tip_m.cols() == 0 && run.tip_quaternion.cols() == 0 && run.bending_rad.cols() > 0;
  });
  if (bent) {
    OfBends(set.robot.body.sections.size(), all);
    return;
  }
  all.push_back({"the tip's quaternions read as x, y, z, w", [](Run& run) {
                   if (run.tip_quaternion.cols() == 4)
                     run.tip_quaternion = run.tip_quaternion(Eigen::all, {3, 0, 1, 2}).eval();
                 }});
  all.push_back({"the tip's orientations read as the base's in the tip's frame", [](Run& run) {
                   if (run.tip_quaternion.cols() == 4) run.tip_quaternion.rightCols(3) *= -1;
                 }});
  if (set.fit_frame) return;
  for (int a = 0; a < 3; ++a) {
    all.push_back(
        {fmt::format("the sign of tip {} reversed", kAxes[a]), [a](Run& run) { Negate(run.tip_m, a); }});
    for (int b = a + 1; b < 3; ++b) {
      all.push_back({fmt::format("tip {} and {} exchanged", kAxes[a], kAxes[b]),
                     [a, b](Run& run) { Exchange(run.tip_m, a, b); }});
    }
    for (const int quarters : {1, 2, 3}) {
      const Eigen::AngleAxisd by(quarters * std::numbers::pi / 2, Eigen::Vector3d::Unit(a));
      all.push_back(
          {fmt::format("the tracker's frame turned by {} degrees about {}", 90 * quarters, kAxes[a]),
           [by](Run& run) { Turn(run, by); }});
    }
  }
}

}  // namespace

Mistake MovedZero(int tendon, double zero_N) {
  return {fmt::format("the zero of load cell {} moved by {:.2g} N", tendon + 1, -zero_N),
          [tendon, zero_N](Run& run) {
            if (tendon < run.tension_N.cols()) run.tension_N.col(tendon).array() -= zero_N;
          }};
}

std::vector<Mistake> MistakesOfReading(const DataSet& set, Measured measured) {
  std::vector<Mistake> all;
  OfTendons(set, measured, all);
  OfUnits(set, measured, all);
  OfSizes(set, measured, all);
  OfTracker(set, measured, all);
  return all;
}

std::vector<Mistake> AllMistakes(const DataSet& set, Measured measured) {
  std::vector<Mistake> all = MistakesOfReading(set, measured);
  const Eigen::Vector3d in_file_mps2 = set.robot.body.gravity_W_mps2;
  for (int a = 0; a < 3; ++a) {
    for (const int sign : {1, -1}) {
      const Eigen::Vector3d gravity = sign * in_file_mps2.norm() * Eigen::Vector3d::Unit(a);
      if ((gravity - in_file_mps2).norm() <= 0.01 * in_file_mps2.norm()) continue;
      all.push_back({.with = fmt::format("gravity along {}{} of the base (gravity_W_mps2 in the robot file)",
                                         sign < 0 ? "-" : "+", kAxes[a]),
                     .in_file = [gravity](RobotParameters& robot) { robot.body.gravity_W_mps2 = gravity; }});
    }
  }
  if (measured.cells) {
    const bool motors = set.runs.front().load_cell == LoadCellPlace::kMotorSide;
    all.push_back({fmt::format("the load cells on the {} side (load_cell in runs.yaml)",
                               motors ? "robot's" : "motors'"),
                   [](Run& run) {
                     run.load_cell = run.load_cell == LoadCellPlace::kMotorSide ? LoadCellPlace::kRobotSide
                                                                                : LoadCellPlace::kMotorSide;
                   }});
  }
  return all;
}

}  // namespace tendril::gap
