#include "tendril/gap/replayed_shape.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "prepare.h"
#include "tendril/sim/replay.h"

namespace tendril::gap {
namespace {

using DrivenBy = sim::Replay::DrivenBy;

/// By the cells where there are any; where one has no reading, the tendon's stretch stands in for it.
DrivenBy ChooseInputs(PreparedRun& run, int tendons) {
  sim::ReplaySignals& signals = run.signals;
  const bool cells = signals.load_cell != LoadCellPlace::kNone && signals.tension_N.cols() > 0 &&
                     run.LeaveSamples(run.cell_dropouts, signals.tension_N.cols());
  if (!cells && run.without_motors()) {
    throw std::runtime_error("run " + run.name +
                             ": neither load cells nor motor positions can drive the model in it");
  }
  if (cells && !run.cell_dropouts.empty()) {
    signals.no_cell.setZero(run.samples(), tendons);
    for (const Dropout& dropout : run.cell_dropouts)
      signals.no_cell.col(dropout.tendon).segment(dropout.from, dropout.size()).setOnes();
  }
  for (int j = 0; j < tendons && cells; ++j) {
    if (signals.motor_angle_rad.cols() > 0 && run.MissingSamples(run.motor_dropouts, j) < run.samples())
      continue;
    signals.no_motor.resize(static_cast<std::size_t>(tendons), 0);
    signals.no_motor[static_cast<std::size_t>(j)] = 1;
  }
  return cells ? DrivenBy::kCell : DrivenBy::kMotor;
}

/// Times of the prepared run's samples, as Run::time_s.
Eigen::VectorXd SampleTimes(const PreparedRun& run) {
  const Eigen::Index samples = run.samples();
  if (run.signals.at_rest) return run.signals.time_s.array() + run.start_s;
  return Eigen::VectorXd::LinSpaced(samples, run.start_s,
                                    run.start_s + static_cast<double>(samples - 1) * run.signals.step_s);
}

}  // namespace

Eigen::MatrixXd ReplayedShape(const RobotParameters& robot, const Run& run, const Eigen::VectorXd& times_s) {
  if (run.time_s.size() < 2 || run.time_s.size() < LeastRows(run))
    throw std::runtime_error("run " + run.name + ": too few rows to simulate");
  PreparedRun prepared = Prepare(run, robot);
  const DrivenBy driven_by = ChooseInputs(prepared, robot.body.tendons());
  const Eigen::MatrixXd q = sim::Replay(robot).Body(prepared.signals, driven_by, 1).q;
  const Eigen::VectorXd at_s = SampleTimes(prepared);

  Eigen::MatrixXd shape = Eigen::MatrixXd::Constant(times_s.size(), q.cols(), kNoReading);
  const double* const begin = at_s.data();
  const double* const end = begin + q.rows();
  for (Eigen::Index i = 0; i < times_s.size(); ++i) {
    const double t = times_s[i];
    if (!(t >= *begin) || t > *(end - 1)) continue;
    const Eigen::Index after = std::min<Eigen::Index>(std::upper_bound(begin, end, t) - begin, q.rows() - 1);
    const double span = at_s[after] - at_s[after - 1], part = span > 0 ? (t - at_s[after - 1]) / span : 0;
    shape.row(i) = (1 - part) * q.row(after - 1) + part * q.row(after);
  }
  return shape;
}

}  // namespace tendril::gap
