#include "motor_path.h"

#include <algorithm>
#include <cmath>

#include "tendril/model/stop_operator.h"

namespace tendril::gap {
namespace {

/// Mean speed between the readings on both sides of this one.
Eigen::RowVectorXd SpeedAt(const States& run, Eigen::Index row) {
  const Eigen::Index a = std::max<Eigen::Index>(row - 1, 0), b = std::min(row + 1, run.path_s.size() - 1);
  return (run.path_rad.row(b) - run.path_rad.row(a)) / (run.path_s[b] - run.path_s[a]);
}

/// Mean speed over the quarter of a second, or more, at an end of the path.
Eigen::RowVectorXd SpeedAtEnd(const States& run, Eigen::Index end) {
  constexpr double kSpan_s = 0.25;
  const Eigen::Index way = end == 0 ? 1 : -1, last = end == 0 ? run.path_s.size() - 1 : 0;
  Eigen::Index inner = end + way;
  while (inner != last && std::abs(run.path_s[inner] - run.path_s[end]) < kSpan_s) inner += way;
  return (run.path_rad.row(inner) - run.path_rad.row(end)) / (run.path_s[inner] - run.path_s[end]);
}

/// Of all motors, by cubics that meet smoothly; before the first reading and after the last they went on as
/// there.
Eigen::RowVectorXd AngleAt(const States& run, double time_s) {
  const auto after = std::upper_bound(run.path_s.begin(), run.path_s.end(), time_s) - run.path_s.begin();
  if (after == 0 || after == run.path_s.size()) {
    const Eigen::Index end = after == 0 ? 0 : after - 1;
    return run.path_rad.row(end) + (time_s - run.path_s[end]) * SpeedAtEnd(run, end);
  }
  const double h = run.path_s[after] - run.path_s[after - 1], u = (time_s - run.path_s[after - 1]) / h;
  const double w = u * u * (3 - 2 * u);
  return (1 - w) * run.path_rad.row(after - 1) + w * run.path_rad.row(after) +
         h * u * (1 - u) * ((1 - u) * SpeedAt(run, after - 1) - u * SpeedAt(run, after));
}

}  // namespace

Eigen::MatrixXd AnglesBefore(const States& run, double lag_s, double drift) {
  Eigen::MatrixXd angle = run.motor_rad;
  const auto single = std::count_if(run.rows.begin(), run.rows.end(), [](auto its) { return its.count < 2; });
  if (2 * single > std::ssize(run.rows)) return angle;
  for (Eigen::Index state = 0; state < std::ssize(run.rows); ++state) {
    const States::Rows its = run.rows[static_cast<std::size_t>(state)];
    Eigen::RowVectorXd moved = Eigen::RowVectorXd::Zero(angle.cols());
    for (Eigen::Index row = its.first; row < its.first + its.count; ++row) {
      const double time_s = run.path_s[row];
      moved += run.path_rad.row(row) - AngleAt(run, time_s - lag_s - drift * (time_s - run.path_s[0]));
    }
    angle.row(state) -= moved / static_cast<double>(its.count);
  }
  return angle;
}

// The same stop operators as in the plant, whose pulley lies half way along the tendon: held motors move its
// far end about as far as the near one.
Eigen::MatrixXd SlidingOf(const States& run, const Eigen::VectorXd& travel_m,
                          const Eigen::VectorXd& presliding_m) {
  const Eigen::MatrixXd& path = run.rows.empty() ? run.motor_rad : run.path_rad;
  Eigen::MatrixXd sliding(run.time_s.size(), travel_m.size());
  for (Eigen::Index j = 0; j < sliding.cols(); ++j) {
    auto memory = model::PulleyPresliding(presliding_m[j], travel_m[j] * path(0, j));
    Eigen::Index row = 0;
    for (Eigen::Index state = 0; state < sliding.rows(); ++state) {
      const States::Rows its =
          run.rows.empty() ? States::Rows{state, 1} : run.rows[static_cast<std::size_t>(state)];
      for (; row < its.first; ++row) memory.Commit(travel_m[j] * path(row, j));
      double sum = 0;
      for (; row < its.first + its.count; ++row) sum += memory.Commit(travel_m[j] * path(row, j));
      sliding(state, j) = sum / static_cast<double>(its.count);
    }
  }
  return sliding;
}

}  // namespace tendril::gap
