// Rest at the beginning of a run; see the header.
#include "rest_position.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace tendril::gap {

void FindRest(const RobotParameters& robot, const Eigen::MatrixXd& reading, PreparedRun& out) {
  constexpr double kRest_s = 0.5;     // initial rest of a run
  constexpr double kStillCounts = 3;  // creep of a tendon while friction settles
  constexpr double kSigmas = 3;
  const auto tendons = reading.cols();
  const auto count_of = [&](Eigen::Index j) {
    const int counts = robot.actuation->tendons[static_cast<std::size_t>(j)].drive.encoder_counts_per_turn;
    return counts > 0 ? 2 * std::numbers::pi / counts : 0;
  };
  const auto still = [&](int i) {
    for (Eigen::Index j = 0; j < tendons; ++j) {
      if (!(std::abs(reading(i, j) - reading(0, j)) <= kStillCounts * count_of(j))) return false;
    }
    return true;
  };
  const int longest =
      out.signals.at_rest ? 1 : std::min(out.samples(), 1 + static_cast<int>(kRest_s / out.signals.step_s));
  out.rest_samples = 1;
  while (out.rest_samples < longest && still(out.rest_samples)) ++out.rest_samples;
  out.rest_N.setConstant(tendons, std::nan(""));
  out.zero_open_rad.setZero(tendons);
  for (Eigen::Index j = 0; j < tendons; ++j) {
    const auto& p = robot.actuation->tendons[static_cast<std::size_t>(j)];
    const double N_per_rad = p.tendon.stiffness_Npm * p.SpoolTravelPerMotorRad();
    double sum_N = 0, count = 0;
    for (int i = 0; i < (j < out.cell_N.cols() ? out.rest_samples : 0); ++i) {
      if (std::isfinite(out.cell_N(i, j))) sum_N += out.cell_N(i, j), count += 1;
    }
    out.zero_open_rad[j] = 0.5 * count_of(j);
    if (count > 0) {
      out.rest_N[j] = sum_N / count;
      const double noise_N =
          std::hypot(p.load_cell.noise_N, out.cell_step_N[static_cast<std::size_t>(j)] / std::sqrt(12.0));
      out.zero_open_rad[j] += kSigmas * noise_N / std::sqrt(count) / N_per_rad;
    } else {
      out.zero_open_rad[j] += robot.limits.min_tension_N / N_per_rad;
    }
  }
}

}  // namespace tendril::gap
