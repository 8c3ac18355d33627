// One list of mistakes, one measure of how much of the gap each leaves.
#include "mistakes.h"

#include <fmt/core.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <numbers>
#include <set>
#include <utility>
#include <vector>

#include "median.h"
#include "parallel.h"

namespace tendril::gap {
namespace {

constexpr double kLarge = 8;      // floors: effects that robots have are rarely larger
constexpr double kTakenAway = 4;  // times smaller is a gap whose reason was this mistake
constexpr std::size_t kRuns = 3;  // that each is tried on
constexpr const char* kAxes = "xyz";

struct Mistake {
  std::string with;  // what would make it right
  std::function<void(Run&)> undo;
};

void Negate(Eigen::MatrixXd& values, Eigen::Index column) {
  if (column < values.cols()) values.col(column) *= -1;
}

void Exchange(Eigen::MatrixXd& values, Eigen::Index a, Eigen::Index b) {
  if (std::max(a, b) < values.cols()) values.col(a).swap(values.col(b));
}

/// The tracker's frame turned about the base's axis, positions and orientations.
void Turn(Run& run, const Eigen::AngleAxisd& by) {
  if (run.tip_m.cols() != 3) return;
  const Eigen::Matrix3d R = by.toRotationMatrix();
  run.tip_m = (run.tip_m * R.transpose()).eval();
  for (Eigen::Index i = 0; i < run.tip_quaternion.rows() && run.tip_quaternion.cols() == 4; ++i) {
    const Eigen::Vector4d w = run.tip_quaternion.row(i).transpose();
    const Eigen::Quaterniond q = Eigen::Quaterniond(by) * Eigen::Quaterniond(w[0], w[1], w[2], w[3]);
    run.tip_quaternion.row(i) << q.w(), q.x(), q.y(), q.z();
  }
}

std::vector<Mistake> AllMistakes(const DataSet& set, bool cells, bool tracked) {
  std::vector<Mistake> all;
  const int tendons = set.robot.body.tendons();
  for (int j = 0; j < tendons; ++j) {
    all.push_back({fmt::format("the sign of motor position {} turned round", j + 1),
                   [j](Run& run) { Negate(run.motor_position_rad, j); }});
    for (int k = j + 1; k < tendons; ++k) {
      all.push_back(
          {fmt::format("tendons {} and {} exchanged in all columns", j + 1, k + 1), [j, k](Run& run) {
             for (auto* values :
                  {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad, &run.tension_N})
               Exchange(*values, j, k);
           }});
    }
  }
  if (cells) {
    const bool motors = set.runs.front().load_cell == LoadCellPlace::kMotorSide;
    all.push_back({fmt::format("the load cells on the {} side (load_cell in runs.yaml)",
                               motors ? "robot's" : "motors'"),
                   [](Run& run) {
                     run.load_cell = run.load_cell == LoadCellPlace::kMotorSide ? LoadCellPlace::kRobotSide
                                                                                : LoadCellPlace::kMotorSide;
                   }});
  }
  if (!tracked || set.fit_frame) return all;
  for (int a = 0; a < 3; ++a) {
    all.push_back(
        {fmt::format("the sign of tip {} turned round", kAxes[a]), [a](Run& run) { Negate(run.tip_m, a); }});
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
  return all;
}

using Kind = std::pair<sim::Cut, Channel::Quantity>;

/// Mean of the kinds of channels of what the nominal robot leaves, in floors.
double Misfit(const Evaluator& evaluator, const std::map<Kind, double>& floors) {
  std::map<Kind, std::pair<double, double>> squares;  // sum, count
  for (std::size_t c = 0; c < evaluator.channels().size(); ++c) {
    auto& [sum, count] = squares[{evaluator.channels()[c].cut, evaluator.channels()[c].quantity}];
    for (std::size_t i = 0; i < evaluator.runs().size(); ++i) {
      const auto& variance = evaluator.Variance()[i][c];
      for (Eigen::Index w = 0; w < variance.size(); ++w) {
        if (!std::isfinite(variance[w])) continue;
        sum += std::pow(evaluator.AtNominal()[i][c][w], 2);
        count += 1;
      }
    }
  }
  double total = 0;
  int kinds = 0;
  for (const auto& [kind, floor] : floors) {
    const auto found = squares.find(kind);
    if (found == squares.end() || !(found->second.second > 0) || !(floor > 0)) continue;
    // What noise leaves anyway is not to be told from nothing.
    total += std::hypot(1.0, std::sqrt(found->second.first / found->second.second) / floor);
    ++kinds;
  }
  return kinds > 0 ? total / kinds : std::numeric_limits<double>::infinity();
}

/// Some runs of different kinds, the shortest first.
DataSet SomeRuns(const DataSet& set) {
  std::vector<const Run*> runs;
  for (const Run& run : set.runs) runs.push_back(&run);
  std::stable_sort(runs.begin(), runs.end(),
                   [](const Run* a, const Run* b) { return a->time_s.size() < b->time_s.size(); });
  std::set<std::string> families;
  std::stable_partition(runs.begin(), runs.end(),
                        [&](const Run* run) { return families.insert(run->family).second; });
  DataSet some;
  some.name = set.name;
  some.robot = set.robot;
  some.fit_frame = set.fit_frame;
  for (std::size_t i = 0; i < std::min(kRuns, runs.size()); ++i) {
    some.runs.push_back(*runs[i]);
    some.runs.back().repeat_of.clear();
  }
  return some;
}

}  // namespace

std::string FindMistake(const DataSet& set, const Evaluator& evaluator, int threads) {
  if (std::any_of(set.runs.begin(), set.runs.end(), [](const Run& run) { return !run.before.empty(); }))
    return "";
  std::map<Kind, std::vector<double>> of_kind;
  for (const Channel& channel : evaluator.channels())
    of_kind[{channel.cut, channel.quantity}].push_back(channel.floor);
  std::map<Kind, double> floors;
  for (auto& [kind, all] : of_kind) floors[kind] = Median(std::move(all));
  if (Misfit(evaluator, floors) < kLarge) return "";

  const DataSet some = SomeRuns(set);
  const auto misfit = [&](const std::function<void(Run&)>& undo) {
    DataSet tried = some;
    for (Run& run : tried.runs) undo(run);
    try {
      return Misfit(Evaluator(tried, {.threads = 1, .readings = 0}), floors);
    } catch (const std::exception&) {
      return std::numeric_limits<double>::infinity();
    }
  };
  const std::vector<Mistake> mistakes = AllMistakes(set, evaluator.has(kC3), evaluator.has_tracker());
  std::vector<double> left(mistakes.size() + 1);
  ParallelFor(static_cast<int>(left.size()), threads, [&](int i) {
    left[static_cast<std::size_t>(i)] =
        i == 0 ? misfit([](Run&) {}) : misfit(mistakes[static_cast<std::size_t>(i) - 1].undo);
  });
  const auto best = std::min_element(left.begin() + 1, left.end());
  if (best == left.end() || !std::isfinite(left.front()) || !(*best * kTakenAway < left.front())) return "";
  return mistakes[static_cast<std::size_t>(best - left.begin()) - 1].with;
}

}  // namespace tendril::gap
