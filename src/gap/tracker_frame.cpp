// Kabsch's rigid fit, reweighted.
#include "tracker_frame.h"

#include <fmt/core.h>

#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "median.h"
#include "rotation.h"

namespace tendril::gap {
namespace {

/// The same moments of the tips: where the robot's are, and where the tracker has them.
struct Tips {
  std::vector<Eigen::Vector3d> simulated, measured;
};

Tips TipsOf(const std::vector<PreparedRun>& runs, const std::vector<sim::BodyMotion>& motions) {
  Tips tips;
  for (std::size_t i = 0; i < runs.size(); ++i) {
    const PreparedRun& run = runs[i];
    if (!run.tracked() || run.tip_m.rows() == 0) continue;
    const int last = static_cast<int>(motions[i].tip_m.rows()) - 1;
    for (int k = 0; k < run.tracker_s.size(); ++k) {
      const int at =
          std::clamp(static_cast<int>(std::lround(run.tracker_s[k] / run.signals.step_s)), 0, last);
      if (run.driven[static_cast<std::size_t>(at)] == 0) continue;
      tips.simulated.emplace_back(motions[i].tip_m.row(at).transpose());
      tips.measured.emplace_back(run.tip_m.row(k).transpose());
    }
  }
  return tips;
}

/// The rigid motion with the least weighted squares between the tips.
TrackerFrame RigidFit(const Tips& tips, const std::vector<double>& weight) {
  constexpr double kLeastSpread =
      0.02;  // lateral spread of the tips relative to the main one: below, the rotation is undetermined
  double total = 0;
  Eigen::Vector3d from(0, 0, 0), to(0, 0, 0);
  for (std::size_t k = 0; k < weight.size(); ++k) {
    total += weight[k];
    from += weight[k] * tips.simulated[k];
    to += weight[k] * tips.measured[k];
  }
  from /= total;
  to /= total;
  Eigen::Matrix3d cross = Eigen::Matrix3d::Zero();
  for (std::size_t k = 0; k < weight.size(); ++k)
    cross += weight[k] * (tips.measured[k] - to) * (tips.simulated[k] - from).transpose();
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(cross, Eigen::ComputeFullU | Eigen::ComputeFullV);
  if (!(svd.singularValues()[1] > kLeastSpread * svd.singularValues()[0])) {
    throw std::runtime_error(
        "tracker_frame: fit: the tips of these runs lie on a line, so the tracker's frame cannot be "
        "fitted; accepted: bends in several directions; add runs or give the frame");
  }
  TrackerFrame frame;
  Eigen::Vector3d proper(1, 1, (svd.matrixU() * svd.matrixV().transpose()).determinant() > 0 ? 1 : -1);
  frame.turn = svd.matrixU() * proper.asDiagonal() * svd.matrixV().transpose();
  frame.offset_m = to - frame.turn * from;
  return frame;
}

}  // namespace

void TrackerFrame::ToBase(PreparedRun& run) const {
  for (Eigen::Index k = 0; k < run.tip_m.rows(); ++k)
    run.tip_m.row(k) = (turn.transpose() * (run.tip_m.row(k).transpose() - offset_m)).transpose();
  for (auto& R : run.tip_R) R = turn.transpose() * R;
}

std::string TrackerFrame::Text(const RobotParameters& robot) const {
  const Eigen::Vector3d vector = RotationVector(turn);
  return fmt::format(
      "the tracker's frame is unknown: fitted to the nominal robot (rotation vector {:.4f}, {:.4f}, {:.4f} "
      "rad, offset {:.2f}, {:.2f}, {:.2f} mm), and refitted within {:.2g} rad and {:.3g} mm with every "
      "cause; effects that look like a wrong frame (a tilt without gravity, an offset) cannot be identified",
      vector.x(), vector.y(), vector.z(), 1e3 * offset_m.x(), 1e3 * offset_m.y(), 1e3 * offset_m.z(),
      3 * kTurn_rad, 3e3 * Shift_m(robot));
}

TrackerFrame FitTrackerFrame(const std::vector<PreparedRun>& runs,
                             const std::vector<sim::BodyMotion>& motions) {
  constexpr int kPasses = 20;
  const Tips tips = TipsOf(runs, motions);
  TrackerFrame frame;
  std::vector<double> weight(tips.simulated.size(), 1.0);
  for (int pass = 0; pass < kPasses; ++pass) {
    frame = RigidFit(tips, weight);
    std::vector<double> distance;
    for (std::size_t k = 0; k < weight.size(); ++k)
      distance.push_back((tips.measured[k] - frame.turn * tips.simulated[k] - frame.offset_m).norm());
    const double usual = std::max(Median(distance), 1e-9);
    for (std::size_t k = 0; k < weight.size(); ++k) weight[k] = 1 / std::max(1.0, distance[k] / usual);
  }
  return frame;
}

}  // namespace tendril::gap
