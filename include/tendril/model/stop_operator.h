// Rate-independent pre-sliding: a few stop operators (Maxwell slip) of one coordinate, and Dahl's law as a
// function of displacement. Exact for monotone motion between commits, so a solver may evaluate them between
// its steps while the memory moves only on a commit.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace tendril::model {

/// z(x) = mean_i w_i / y_i in [-1, 1], w_i follows x and is clipped to +-y_i.
/// z = +1: sliding in the positive direction of x; -1: in the negative; between: pre-sliding.
template <int kCount>
class StopOperators {
 public:
  /// Never yields: z = 0 everywhere.
  StopOperators() { yields_.fill(std::numeric_limits<double>::infinity()); }
  /// Yields y_i > 0 in the unit of x; starts relaxed (all w_i = 0) at x = start. Throws
  /// std::invalid_argument.
  explicit StopOperators(const std::array<double, kCount>& yields, double start = 0)
      : yields_(yields), x_(start) {
    for (const double yield : yields_) {
      if (!(yield > 0))
        throw std::invalid_argument("pre-sliding yield = " + std::to_string(yield) + ": accepted > 0");
    }
  }

  /// z if x moved monotonically from the committed point; the memory stays.
  double Peek(double x) const noexcept {
    double z = 0;
    for (int i = 0; i < kCount; ++i) {
      z += std::clamp(w_[i] + (x - x_), -yields_[i], yields_[i]) / yields_[i];
    }
    return z / kCount;
  }
  /// Moves the memory to x and returns z there.
  double Commit(double x) noexcept {
    double z = 0;
    for (int i = 0; i < kCount; ++i) {
      w_[i] = std::clamp(w_[i] + (x - x_), -yields_[i], yields_[i]);
      z += w_[i] / yields_[i];
    }
    x_ = x;
    return z / kCount;
  }
  /// Moves the origin of x without sliding; returns the unchanged z.
  double Hold(double x) noexcept {
    x_ = x;
    return Peek(x);
  }
  /// Relaxed at x.
  void Reset(double x) noexcept {
    w_.fill(0);
    x_ = x;
  }

 private:
  std::array<double, kCount> yields_{};
  std::array<double, kCount> w_{};
  double x_ = 0;
};

/// The pulley's pre-sliding: four stop operators with yields 1/4, 1/2, 3/4, 1 of the configured displacement.
inline StopOperators<4> PulleyPresliding(double displacement_m, double start_m = 0) {
  return StopOperators<4>(
      {0.25 * displacement_m, 0.5 * displacement_m, 0.75 * displacement_m, displacement_m}, start_m);
}

/// Dahl friction state: zeta' = (w - |w| zeta) / angle, as the closed form along monotone motion.
class DahlState {
 public:
  DahlState() = default;
  /// Throws std::invalid_argument unless the angle is positive.
  explicit DahlState(double angle_rad) : angle_rad_(angle_rad) {
    if (!(angle_rad > 0))
      throw std::invalid_argument("Dahl angle = " + std::to_string(angle_rad) + " rad: accepted > 0");
  }

  double Peek(double x) const noexcept {
    const double dx = x - x_;
    const double s = dx >= 0 ? 1 : -1;
    return s + (zeta_ - s) * std::exp(-std::abs(dx) / angle_rad_);
  }
  double Commit(double x) noexcept {
    zeta_ = Peek(x);
    x_ = x;
    return zeta_;
  }
  /// Moves the origin of x without motion; returns the unchanged zeta.
  double Hold(double x) noexcept {
    x_ = x;
    return zeta_;
  }
  void Reset(double x, double zeta = 0) noexcept {
    x_ = x;
    zeta_ = zeta;
  }

 private:
  double angle_rad_ = 1;
  double x_ = 0;
  double zeta_ = 0;
};

}  // namespace tendril::model
