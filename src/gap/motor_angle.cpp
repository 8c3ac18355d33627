// An encoder count is an interval that contains the motor angle; where the count changes, the motor is at the
// interval's border, which is known far more accurately than the count.
#include "motor_angle.h"

#include <algorithm>
#include <cmath>

#include "prepare.h"
#include "smoothing.h"

namespace tendril::gap {
namespace {

constexpr double kSettle_s = 0.02;  // a motor that stays within one count for this long is at rest
constexpr double kSlidingCounts =
    4;                            // 12 mrad at 2048 counts: friction in motor and gear has reversed by then
constexpr double kSlow_s = 0.05;  // a motor with a longer time between counts may be at rest
constexpr double kAtOnce_s =
    0.01;  // and so may one with twice the previous time between counts, if longer than this

}  // namespace

bool Quantised(const Eigen::VectorXd& angle, double count) {
  int moved = 0, whole = 0;
  for (int i = 1; i < angle.size(); ++i) {
    const double steps = (angle[i] - angle[i - 1]) / count;
    if (!std::isfinite(steps) || std::abs(steps) < 1e-6) continue;
    ++moved;
    whole += std::abs(steps - std::round(steps)) < 0.02;
  }
  return moved > 0 && whole > 0.98 * moved;
}

void CountThroughDropouts(Eigen::Ref<Eigen::VectorXd> angle, const std::vector<char>& read, double count) {
  for (Eigen::Index i = 1; i < angle.size(); ++i) {
    if (read[static_cast<std::size_t>(i)]) continue;
    angle[i] = angle[i - 1] + count * std::round((angle[i] - angle[i - 1]) / count);
  }
}

Eigen::VectorXd InsideCounts(const Eigen::VectorXd& reading, double count, double step_s, bool in_middle,
                             std::mt19937_64* random) {
  const int n = static_cast<int>(reading.size());
  Interpolator path;
  std::uniform_real_distribution<double> anywhere(0, 1);
  const double begin = in_middle || random == nullptr ? 0 : (anywhere(*random) - 0.5) * count;
  path.Add(0, reading[0] + begin);
  int dwell = 0;         // first sample at the present count
  double entered = NAN;  // border by which this count was entered; NaN: by a jump, or from the beginning
  for (int i = 1; i <= n; ++i) {
    const bool end = i == n;
    const double steps = end ? 0 : std::round((reading[i] - reading[i - 1]) / count);
    if (!end && steps == 0) continue;
    const double middle = reading[i - 1];
    const double left = !end && std::abs(steps) == 1 ? middle + 0.5 * count * steps : std::nan("");
    const double from_s = step_s * (dwell - 0.5), to_s = step_s * (end ? i - 1 : i - 0.5);
    const bool rests = to_s - from_s > 2.5 * kSettle_s;
    const bool turns = !std::isnan(entered) && (end || std::abs(left - entered) < 0.5 * count);
    // Before it rests a motor may swing back unseen within the count, reversing its friction.
    double deepest = middle;
    double rest = middle + (dwell == 0 ? begin : random != nullptr ? (anywhere(*random) - 0.5) * count : 0);
    if (!std::isnan(entered)) {
      const double inwards = entered < middle ? count : -count;
      deepest = entered + inwards * (random != nullptr ? anywhere(*random) : 0.5);
      rest = entered + inwards * (random != nullptr ? anywhere(*random) : 0.5);
    }
    if (rests) {
      if (dwell > 0) path.Add(from_s + 0.5 * kSettle_s, deepest);
      if (dwell > 0) path.Add(from_s + kSettle_s, rest);
      path.Add(end ? to_s : to_s - kSettle_s, rest);
    } else if (turns || std::isnan(entered) || std::isnan(left)) {
      if (dwell > 0) path.Add(0.5 * (from_s + to_s), rest);
    }
    if (end) break;
    if (!std::isnan(left)) path.Add(to_s, left);
    entered = std::abs(steps) == 1 ? left : std::nan("");
    dwell = i;
  }
  Eigen::VectorXd angle(n);
  for (int i = 0; i < n; ++i) angle[i] = path(step_s * i);
  return angle;
}

void MarkSliding(const Eigen::VectorXd& reading, const Eigen::Matrix<char, -1, 1>& valid, double count,
                 double step_s, double sampled_s, Eigen::Ref<Eigen::Matrix<char, -1, 1>> out) {
  const int samples = static_cast<int>(reading.size());
  const int soon = std::max(2, static_cast<int>(std::lround(kSlow_s / step_s)));
  const int at_once = std::max(1, static_cast<int>(std::lround(kAtOnce_s / step_s)));
  double turn = reading[0], last = reading[0];
  int direction = 0, changed = 0, before = 0, lost = -1;
  out.setZero();
  for (int i = 1; i < samples; ++i) {
    if (!valid[i]) lost = i;
    const double step = reading[i] - last;
    if (std::abs(step) <= 0.5 * count) continue;
    const int now = step > 0 ? 1 : -1;
    const int lasted = i - changed;
    const bool on =
        now == direction && lost < changed && lasted <= soon && lasted <= std::max(at_once, 2 * before);
    if (!on) turn = last;
    if (on && std::abs(last - turn) >= kSlidingCounts * count) out.segment(changed, i - changed).setOnes();
    direction = now;
    last = reading[i];
    changed = i;
    before = lasted;
  }
  // Between the samples of a slow log a motor may have reversed or rested unseen.
  const int unseen =
      step_s < kSlowLog_s ? 0 : 2 * std::max(1, static_cast<int>(std::lround(sampled_s / step_s)));
  const Eigen::Matrix<char, -1, 1> whole = out;
  for (int i = 0; i < samples && unseen > 0; ++i) {
    const int a = std::max(0, i - unseen), b = std::min(samples, i + unseen + 1);
    out[i] = whole.segment(a, b - a).minCoeff();
  }
}

}  // namespace tendril::gap
