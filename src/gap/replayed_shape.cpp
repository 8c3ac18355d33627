#include "tendril/gap/replayed_shape.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "prepare.h"
#include "tendril/sim/replay.h"

namespace tendril::gap {
namespace {

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
  if (prepared.without_cells() && prepared.without_motors()) {
    throw std::runtime_error("run " + run.name +
                             ": neither load cells nor motor positions can drive the model in it");
  }
  const sim::Replay::DrivenBy driven_by = BodyInputs({&prepared, 1});
  SubstituteMissingCells(prepared, driven_by, robot.body.tendons());
  const Eigen::MatrixXd q = sim::Replay(robot).Body(prepared.signals, driven_by).q;
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
