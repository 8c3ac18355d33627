// Dropouts of sensors and unrecorded motion; see the header.
#include "gaps.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "median.h"

namespace tendril::gap {
namespace {

constexpr double kOwnSteps = 2.5;  // a dropout's least length, in steps of a sensor slower than the log
constexpr double kStoodStill_s =
    0.1;  // a motor at rest for this long on both sides of a gap did not move in it

}  // namespace

void FindDropouts(const Eigen::MatrixXd& values, const std::vector<int>& at, int samples, double step_s,
                  bool at_rest, int j, std::vector<Dropout>& dropouts) {
  constexpr std::size_t kHardlyEver = 5;  // readings
  std::vector<double> steps_s;
  std::vector<int> there;
  for (int i = 0; i < values.rows(); ++i) {
    if (!std::isfinite(values(i, j))) continue;
    if (!there.empty() && i - there.back() > 1) steps_s.push_back((at[i] - at[there.back()]) * step_s);
    if (!there.empty() && i - there.back() == 1) steps_s.push_back(0);  // as fast as the log
    there.push_back(i);
  }
  if (there.size() < kHardlyEver) {
    dropouts.push_back({j, 0, samples});
    return;
  }
  const double own_s = at_rest ? 0 : Median(std::move(steps_s));
  if (own_s > kBridged_s + 1e-9) {
    dropouts.push_back({j, 0, samples});
    return;
  }
  const double bridged_s = std::max(kBridged_s, kOwnSteps * own_s);
  int last = -1;  // last row with a reading
  for (const int i : there) {
    const int from = last < 0 ? 0 : at[last] + 1;
    // Dropped rows do not count as sensor dropouts.
    if (i - last > 1 && (at[i] - from) * step_s > bridged_s) dropouts.push_back({j, from, at[i]});
    last = i;
  }
  if ((samples - at[last] - 1) * step_s > bridged_s) dropouts.push_back({j, at[last] + 1, samples});
}

void MarkMoved(int tendon, int from, int to, PreparedRun& out) {
  constexpr double kStill_rad = 0.008;  // 2.5 counts of a coarse encoder
  constexpr double kStillFor_s = 2;     // in a longer gap a motor may have moved and returned
  const int samples = out.samples();
  const auto after = [&](double time_s) {
    return static_cast<int>(std::lround(time_s / out.signals.step_s));
  };
  const int tendons = static_cast<int>(out.signals.motor_angle_rad.cols());
  const int first = std::max(0, tendon), last = tendon < 0 ? tendons : tendon + 1;
  const int a = std::max(0, from - after(kStoodStill_s)), b = std::min(samples, to + after(kStoodStill_s));
  bool moved = to - from >= after(kStillFor_s);
  for (int j = first; j < last; ++j) {
    // An unknown signal may have moved.
    moved =
        moved || (out.signals.no_motor.size() > 0 && out.signals.no_motor[static_cast<std::size_t>(j)] != 0);
    const auto about = out.signals.motor_angle_rad.col(j).segment(a, b - a);
    moved = moved || about.maxCoeff() - about.minCoeff() >= kStill_rad;
  }
  if (!moved) return;
  out.moved_unseen.push_back({tendon, from, to});
  std::fill(out.driven.begin() + from, out.driven.begin() + std::min(samples, to + after(kBodySettles_s)),
            char{0});
}

}  // namespace tendril::gap
