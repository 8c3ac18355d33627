// Friction of a tendon over guide pulleys: the improved Capstan equation (paper eqs. 26-30), its inverse, and
// a lookup table fast enough for the tick. F maps the low-tension side to the high-tension side under
// sliding; when the motor pulls, the robot is the low-tension side, when it pays out, the motor is (the map
// is inverted, alpha keeps its sign).
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "tendril/core/robot.h"

namespace tendril::model {

/// High-side tension [N] for a low-side tension >= 0 over one pulley, by CVODE (relative tolerance about
/// 1e-12). Throws std::invalid_argument for parameters out of range, std::runtime_error when the solver gives
/// up.
double SolveCapstan(const PulleyParameters& pulley, double low_tension_N);

/// Inverse of SolveCapstan: low-side tension for a high-side one; SolveCapstanInverse(SolveCapstan(T)) = T to
/// 1e-9.
double SolveCapstanInverse(const PulleyParameters& pulley, double high_tension_N);

/// The same for pulleys in series, from the low-tension side to the high-tension side.
double SolveCapstan(std::span<const PulleyParameters> pulleys, double low_tension_N);
double SolveCapstanInverse(std::span<const PulleyParameters> pulleys, double high_tension_N);

/// high/low as the tension goes to zero: finite, and the largest ratio of all tensions (T'' = rho T remains).
double CapstanRatioAtZero(const PulleyParameters& pulley);

/// Motor-side over base tension while the motor pulls, or pays out (`release`), over one pulley. Below
/// `low_tension_N` on the low-tension side the ratio found there is kept (0: nowhere); at zero tension it is
/// the limit.
double CapstanRatio(const PulleyParameters& pulley, double base_tension_N, bool release,
                    double low_tension_N = 0);

/// A steel tendon in a polymer sheath that turns it through this angle [rad].
inline PulleyParameters Sheath(double wrap_rad) {
  return {.law = CapstanLaw::kClassic, .wrap_rad = wrap_rad, .radius_ratio = 10, .alpha = 0.15};
}

/// ln of the motor-side over the base tension while the motor pulls, to first order in the friction:
/// the sum of alpha wrap over the pulleys of the classic law, of alpha rho / (1 + rho) wrap T^(n-1) over the
/// others. Smooth in all their numbers, and without a solver.
double CapstanLogRatio(std::span<const PulleyParameters> pulleys, double base_tension_N);

/// Largest tension the solver and the table accept.
inline constexpr double kMaxCapstanTension_N = 1e6;

/// Throws std::invalid_argument naming the parameter and its accepted range.
void ValidatePulley(const PulleyParameters& pulley);

/// F and its inverse of one tendon's transmission as tables built from CVODE solutions. Below `low_tension_N`
/// F is continued by the constant ratio F(low)/low; above the table's range by the last ratio.
class CapstanTable {
 public:
  /// Builds for low-side tensions up to max_tension_N and checks the table against the solver between its
  /// nodes until the relative error of both directions is below `relative_error`; throws std::runtime_error
  /// if it cannot be met.
  CapstanTable(const TransmissionParameters& transmission, double max_tension_N,
               double relative_error = 1e-6);

  /// F: motor-side tension that pulls a base tension; T >= 0, no allocation.
  double Pull(double base_tension_N) const noexcept;
  /// F^-1: motor-side tension while paying out against a base tension.
  double Release(double base_tension_N) const noexcept;
  /// Derivatives of the two maps.
  double PullSlope(double base_tension_N) const noexcept;
  double ReleaseSlope(double base_tension_N) const noexcept;

  /// Base tension for a motor-side tension at sliding state z in [-1, 1]:
  /// (1+z)/2 F^-1(T_motor) + (1-z)/2 F(T_motor). Pulling at z = 1, paying out at z = -1.
  double MotorToBase(double motor_tension_N, double z) const noexcept {
    return 0.5 * (1 + z) * Release(motor_tension_N) + 0.5 * (1 - z) * Pull(motor_tension_N);
  }
  /// Motor-side tension required for a base tension at sliding state z: (1+z)/2 F(T_b) + (1-z)/2 F^-1(T_b).
  double BaseToMotor(double base_tension_N, double z) const noexcept {
    return 0.5 * (1 + z) * Pull(base_tension_N) + 0.5 * (1 - z) * Release(base_tension_N);
  }

  /// Largest relative error found between the nodes when the table was built.
  double verified_error() const { return verified_error_; }
  int nodes() const { return static_cast<int>(nodes_.size()); }

 private:
  struct Node {
    double log_high;   // ln of the high-side tension here
    double log_ratio;  // ln(high/low)
    double slope;      // of log_ratio by ln(low), from the equation's sensitivities
  };
  struct Ratio {
    double value, slope;  // ln(high/low) and its derivative by ln(low)
  };
  Ratio LogRatio(int interval, double t) const noexcept;  // cubic Hermite, t in [0, 1]
  Ratio LogRatioOfLow(double log_low) const noexcept;
  Ratio LogRatioOfHigh(double log_high) const noexcept;
  bool Monotone() const noexcept;

  double log_low_ = 0, spacing_ = 1;       // nodes are equally spaced in ln(low)
  double low_ratio_ = 1, high_ratio_ = 1;  // beyond both ends
  double verified_error_ = 0;
  std::vector<Node> nodes_;
};

/// One table per tendon, in order; tendons over equal pulleys share one (a table takes some 10 ms).
std::vector<std::shared_ptr<const CapstanTable>> MakeCapstanTables(
    std::span<const TendonDriveParameters> tendons, double max_tension_N, double relative_error = 1e-6);

}  // namespace tendril::model
