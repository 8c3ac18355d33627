// Plants under the commands of a run.
#include "free_run.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "tendril/sim/batch.h"
#include "tendril/sim/effects.h"

namespace tendril::gap {
namespace {

// Longest part of a run: errors of friction add up, and what is off later says no more.
constexpr double kLongest_s = 10;
// From the plant's rest to the tensions at which the run begins.
constexpr double kSettles_s = 1;
// Between rows that are farther apart, or nearer, the targets are not known.
constexpr double kLeastStep_s = 1e-5, kMostStep_s = 0.01;
// Some ten times what the solver takes for usual robots; one that is far from its file may have no motion.
constexpr double kMostSteps_per_s = 2e4;

bool CanRunFree(const PreparedRun& run, const RobotParameters& robot) {
  const sim::ReplaySignals& signals = run.signals;
  return robot.actuation && !signals.at_rest && run.tracked() && signals.step_s >= kLeastStep_s &&
         signals.step_s <= kMostStep_s && run.tip_m.rows() > 0 && run.target_dropouts.empty() &&
         signals.torque_target_Nm.rows() == run.samples() && signals.torque_target_Nm.allFinite();
}

Eigen::Index SettlingRows(double step_s) { return static_cast<Eigen::Index>(std::ceil(kSettles_s / step_s)); }

/// The targets of a run, the first of them held until the robot rests.
sim::TorqueProgram ProgramOf(const PreparedRun& run) {
  const Eigen::MatrixXd& target_Nm = run.signals.torque_target_Nm;
  const double step_s = run.signals.step_s;
  const auto rows = std::min<Eigen::Index>(target_Nm.rows(), std::lround(kLongest_s / step_s));
  const Eigen::Index settling = SettlingRows(step_s);
  sim::TorqueProgram program{step_s, Eigen::MatrixXd(settling + rows, target_Nm.cols())};
  program.torque_Nm.topRows(settling).rowwise() = target_Nm.row(0);
  program.torque_Nm.bottomRows(rows) = target_Nm.topRows(rows);
  return program;
}

/// rms over the tracker's readings of what `at` gives for the reading's index and the row of the motion that
/// shows the same moment, with the share of the next row.
template <class Function>
double Rms(const PreparedRun& run, const sim::TorqueProgram& program, const Function& at) {
  const double step_s = program.step_s;
  const auto settling = static_cast<double>(SettlingRows(step_s));
  double squares = 0;
  int count = 0;
  for (Eigen::Index i = 0; i < run.tracker_s.size(); ++i) {
    // Row k is at the end of its step; a target acts one bus cycle after its stamp.
    const double row = settling + (run.tracker_s[i] - run.signals.command_delay_s) / step_s - 1;
    const auto k = static_cast<Eigen::Index>(std::floor(row));
    if (row < settling || k + 1 >= program.torque_Nm.rows() || !run.tip_m.row(i).allFinite()) continue;
    squares += at(i, k, row - static_cast<double>(k));
    ++count;
  }
  return count > 0 ? std::sqrt(squares / count) : std::numeric_limits<double>::quiet_NaN();
}

double Error_m(const PreparedRun& run, const sim::TorqueProgram& program, const RobotParameters& robot,
               const sim::PlantMotion& motion) {
  const sim::TrackerPlacement tracker = sim::PlacementOfTracker(robot);
  return Rms(run, program, [&](Eigen::Index i, Eigen::Index k, double share) {
    const Eigen::Vector3d tip_m = (1 - share) * motion.tip_m.row(k) + share * motion.tip_m.row(k + 1);
    return (run.tip_m.row(i).transpose() - tracker.R * tip_m - tracker.offset_m).squaredNorm();
  });
}

double Moves_m(const PreparedRun& run, const sim::TorqueProgram& program) {
  Eigen::Vector3d sum_m = Eigen::Vector3d::Zero();
  int count = 0;
  Rms(run, program, [&](Eigen::Index i, Eigen::Index, double) {
    sum_m += run.tip_m.row(i).transpose();
    return ++count;
  });
  const Eigen::Vector3d mean_m = sum_m / std::max(count, 1);
  return Rms(run, program, [&](Eigen::Index i, Eigen::Index, double) {
    return (run.tip_m.row(i).transpose() - mean_m).squaredNorm();
  });
}

}  // namespace

std::vector<FreeRun> FreeRuns(const Evaluator& evaluator, const RobotParameters* with_cause, int threads) {
  std::vector<RobotParameters> robots{evaluator.nominal()};
  if (with_cause != nullptr) robots.push_back(*with_cause);
  std::vector<FreeRun> free_runs;
  std::set<std::string> families;
  for (const PreparedRun& run : evaluator.runs()) {
    if (!CanRunFree(run, evaluator.nominal()) || !families.insert(run.family).second) continue;
    const sim::TorqueProgram program = ProgramOf(run);
    const auto motions =
        sim::SimulateEach(robots, program, {}, threads, nullptr, {}, kMostSteps_per_s * program.step_s);
    if (!motions[0].failed.empty()) break;
    FreeRun of{run.name,
               run.family,
               program.step_s * static_cast<double>(program.torque_Nm.rows() - SettlingRows(program.step_s)),
               Moves_m(run, program),
               Error_m(run, program, robots[0], motions[0]),
               {}};
    if (robots.size() > 1) {
      if (motions[1].failed.empty()) {
        of.after_m = Error_m(run, program, robots[1], motions[1]);
      } else {
        robots.pop_back();
      }
    }
    if (std::isfinite(of.moves_m)) free_runs.push_back(std::move(of));
  }
  return free_runs;
}

}  // namespace tendril::gap
