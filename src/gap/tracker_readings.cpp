// Whole readings of a pose or of the bends; see the header.
#include "tracker_readings.h"

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cstddef>

#include "health_signal.h"
#include "within_steps.h"

namespace tendril::gap {
namespace {

constexpr double kCoarseTurn = 2e-3;  // of a quaternion's numbers: more than the noise of trackers

}  // namespace

void ReadTracker(const Run& run, const RobotParameters& robot, const std::vector<int>& at,
                 std::optional<std::uint64_t> seed, std::mt19937_64& random, PreparedRun& out) {
  const auto rows = static_cast<int>(run.time_s.size());
  const auto measured = [&](const Eigen::MatrixXd& values, Eigen::Index columns) {
    return values.cols() == columns && values.rows() == rows && values.array().isFinite().any();
  };
  const auto sections = static_cast<Eigen::Index>(robot.body.sections.size());
  const bool placed = measured(run.tip_m, 3), turned = measured(run.tip_quaternion, 4);
  const bool bent = !placed && !turned && measured(run.bending_rad, 2 * sections);
  if (!placed && !turned && !bent) return;
  const double turn_step = run.tip_quaternion_step;
  if (placed) {
    for (const auto axis : run.tip_m.colwise()) out.tip_step_m = std::max(out.tip_step_m, DecimalStep(axis));
  }
  if (bent) {
    for (const auto bend : run.bending_rad.colwise())
      out.bending_step_rad = std::max(out.bending_step_rad, DecimalStep(bend));
  }
  out.tip_step_rad = 2 * turn_step;
  std::vector<WithinSteps> within(4, WithinSteps(turn_step, random));
  std::vector<int> seen;
  for (int i = 0; i < rows; ++i) {
    const bool whole =
        (!placed || run.tip_m.row(i).allFinite()) && (!bent || run.bending_rad.row(i).allFinite()) &&
        (!turned || (run.tip_quaternion.row(i).allFinite() && run.tip_quaternion.row(i).norm() > 0.5));
    if (whole && out.valid[static_cast<std::size_t>(at[static_cast<std::size_t>(i)])]) seen.push_back(i);
  }
  out.tracker_s.resize(static_cast<Eigen::Index>(seen.size()));
  if (placed) out.tip_m = run.tip_m(seen, Eigen::all);
  if (bent) out.bending_rad = run.bending_rad(seen, Eigen::all);
  for (std::size_t k = 0; k < seen.size(); ++k) {
    const int i = seen[k];
    out.tracker_s[static_cast<Eigen::Index>(k)] =
        out.signals.at_rest ? i * out.signals.step_s : run.time_s[i] - out.start_s;
    if (!turned) continue;
    Eigen::Vector4d w = run.tip_quaternion.row(i).transpose();
    for (int n = 0; n < 4 && seed && turn_step > kCoarseTurn; ++n)
      w[n] += within[static_cast<std::size_t>(n)].At(w[n]);
    w.normalize();
    Eigen::Quaterniond orientation(w[0], w[1], w[2], w[3]);
    if (seed && robot.actuation && robot.actuation->tracker) {
      std::normal_distribution<double> normal;
      const double rms = 0.5 * robot.actuation->tracker->orientation_noise_rad;
      const Eigen::Quaterniond turn(1, rms * normal(random), rms * normal(random), rms * normal(random));
      orientation = (orientation * turn).normalized();
    }
    out.tip_R.push_back(orientation.toRotationMatrix());
  }
}

}  // namespace tendril::gap
