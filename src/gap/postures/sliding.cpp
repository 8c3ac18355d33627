// The same stop operators as in the plant, whose pulley lies half way along the tendon: held motors move its
// far end about as far as the near one.
#include "sliding.h"

#include "tendril/model/stop_operator.h"

namespace tendril::gap {

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
