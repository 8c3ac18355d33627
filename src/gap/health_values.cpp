// Checks of magnitudes: limits, steps and noise of the numbers, units, signs.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "health_checks.h"
#include "health_signal.h"
#include "implausible.h"
#include "prepare.h"

namespace tendril::gap {
namespace {

// Minimum reach, as a share of its length, of a robot that is straight at times.
constexpr double kNearest = 0.8;
constexpr double kPi = std::numbers::pi;

/// Largest magnitude except for the rarest values, which do not indicate a unit.
double Usual(const Eigen::MatrixXd& m) {
  std::vector<double> sizes;
  for (const double x : m.reshaped()) {
    if (std::isfinite(x)) sizes.push_back(std::abs(x));
  }
  return sizes.empty() ? 0 : Quantile(std::move(sizes), 0.98);
}

}  // namespace

void Checkup::Clipped(const SignalKind& kind) {
  const Matrix& m = Of(kind);
  for (Eigen::Index c = 0; c < m.cols(); ++c) {
    for (const bool top : {true, false}) {
      const Plateau p = FlatExtreme(m.col(c), top);
      if (p.share < 0.003) continue;
      Add(p.share > 0.1 ? Severity::kError : Severity::kWarning, ChannelOf(kind, c), p.share,
          fmt::format("is clipped at {:.6g} {} for {:.1f} % of the run{}; use a sensor with a larger range "
                      "or a smaller motion",
                      p.value, kind.unit, 100 * p.share,
                      kind.matrix == &Run::torque_actual_Nm
                          ? ": the end of the reading's range, or of the drive's"
                          : "; clipped values say nothing about the robot"));
    }
  }
}

void Checkup::Saturated() {
  if (!robot_.actuation || !Fits(kTarget)) return;
  const Matrix& m = Of(kTarget);
  for (Eigen::Index j = 0; j < std::min<Eigen::Index>(m.cols(), Tendons()); ++j) {
    const auto& t = robot_.actuation->tendons[static_cast<std::size_t>(j)];
    const double most = t.motor.torque_constant_NmpA * t.drive.current_limit_A;
    if (!(most > 0)) continue;
    const double share =
        static_cast<double>((m.col(j).array().abs() >= 0.995 * most).count()) / static_cast<double>(m.rows());
    // Values far beyond the limit indicate a wrong unit.
    if (share < 0.002 || m.col(j).array().isNaN().select(0, m.col(j)).cwiseAbs().maxCoeff() > 5 * most)
      continue;
    Add(Severity::kWarning, ChannelOf(kTarget, j), share,
        fmt::format(
            "is at the drive's limit of {:.4g} N m for {:.1f} % of the run; the drive cannot follow there; "
            "plan a smaller motion",
            most, 100 * share));
  }
}

void Checkup::Steps() {
  if (!robot_.actuation) return;
  const auto check = [&](const SignalKind& kind, auto expected, const char* key) {
    if (!Fits(kind)) return;
    const Matrix& m = Of(kind);
    for (Eigen::Index j = 0; j < std::min<Eigen::Index>(m.cols(), Tendons()); ++j) {
      const auto& tendon = robot_.actuation->tendons[static_cast<std::size_t>(j)];
      const double step = Quantum(m.col(j));
      const double by_file = expected(tendon);
      if (!(step > 0) || !(by_file > 0)) continue;
      const double ratio = step / by_file;
      if (std::abs(ratio - 1) < 0.02) continue;
      // Values that differ only by several steps are coarser than the file says, not in another unit.
      Add(ratio < 0.98 && kind.matrix == &Run::motor_position_rad ? Severity::kWarning : Severity::kInfo,
          ChannelOf(kind, j), step,
          fmt::format("comes in steps of {:.6g} {}, but {:.6g} by the robot file ({:.4g} times); {} may be "
                      "another robot's; check it",
                      step, kind.unit, by_file, ratio, key));
    }
  };
  check(
      kMotor, [](const auto& t) { return 2 * kPi / t.drive.encoder_counts_per_turn; },
      "actuation.drive.encoder_counts_per_turn");
  check(
      kActual, [](const auto& t) { return 1e-3 * t.drive.rated_torque_Nm; },
      "actuation.drive.rated_torque_Nm");
  check(
      kTension,
      [](const auto& t) {
        return t.load_cell.gain_VpN > 0 ? t.load_cell.resolution_V / t.load_cell.gain_VpN : 0;
      },
      "actuation.load_cell.gain_VpN or resolution_V");
}

void Checkup::Smoothed() {
  constexpr double kLess = 0.1, kSteps = 0.3;
  if (!robot_.actuation || StepsOf(run_->time_s).usual > kQuasiStatic_s) return;
  const auto check = [&](const SignalKind& kind, Eigen::Index column, double noise) {
    const auto x = Of(kind).col(column);
    if (!(noise > 0) || RangeOf(x).count < 100 || RangeOf(x).width() <= 0 || Quantum(x) > kSteps * noise)
      return;
    const double scatter = Scatter(x);
    if (scatter > kLess * noise) return;
    Add(Severity::kWarning, ChannelOf(kind, column), scatter,
        fmt::format("scatters by {:.2g} {} from value to value, but {:.2g} by the robot file: filtered, "
                    "averaged, interpolated or repeated before logging; fast changes may be missing, which "
                    "looks like a gap; log the sensor's raw readings",
                    scatter, kind.unit, noise));
  };
  if (Fits(kTension)) {
    for (Eigen::Index j = 0; j < std::min(Of(kTension).cols(), Tendons()); ++j) {
      const auto& cell = robot_.actuation->tendons[static_cast<std::size_t>(j)].load_cell;
      const double step_N = cell.gain_VpN > 0 ? cell.resolution_V / cell.gain_VpN : 0;
      check(kTension, j, std::hypot(cell.noise_N, step_N / std::sqrt(12.0)));
    }
  }
  if (Fits(kTip) && robot_.actuation->tracker) check(kTip, 0, robot_.actuation->tracker->position_noise_m);
}

void Checkup::Units() {
  if (Fits(kTip)) TipUnits();
  if (Fits(kBending)) {
    const double most = Largest(Of(kBending));
    if (most > 2 * kPi) {
      Add(Severity::kError, kBending.name, most,
          fmt::format("reaches {:.4g} rad; a section cannot bend that far; are these degrees?", most));
    }
  }
  if (!robot_.actuation) return;
  const auto& t = robot_.actuation->tendons.front();
  const LimitParameters& limits = robot_.limits;
  UnitsBy(kTension, Usual(Of(kTension)), limits.max_tension_motor_N, limits.min_tension_N / 30,
          {{"millinewtons", 1e-3},
           {"grams", 9.81e-3},
           {"kilonewtons", 1e3},
           {"volts of the cell", t.load_cell.gain_VpN > 0 ? 1 / t.load_cell.gain_VpN : 0}});
  const double rated_Nm = t.drive.rated_torque_Nm;
  for (const SignalKind& kind : {kTarget, kActual}) {
    UnitsBy(kind, Usual(Of(kind)), rated_Nm, 1e-4 * rated_Nm,
            {{"millinewton metres", 1e-3},
             {"amperes", t.motor.torque_constant_NmpA},
             {"milliamperes", 1e-3 * t.motor.torque_constant_NmpA},
             {"per mille of rated torque", 1e-3 * rated_Nm}});
  }
  const double most_rad = MostMotorWay_rad(robot_);
  if (!(most_rad > 0) || t.drive.encoder_counts_per_turn <= 0) return;
  Matrix position_rad = Of(kMotor);
  for (auto motor : position_rad.colwise()) {
    for (const Eigen::Index i : LonePositions(motor, robot_)) motor[i] = std::nan("");
  }
  UnitsBy(kMotor, Range::Of(position_rad).width(), most_rad, 1e-4 * most_rad,
          {{"degrees", kPi / 180}, {"encoder counts", 2 * kPi / t.drive.encoder_counts_per_turn}});
}

void Checkup::UnitsBy(const SignalKind& kind, double reached, double most, double least,
                      const std::vector<std::pair<const char*, double>>& units) {
  if (!Fits(kind) || !(most > 0) || !(reached > 0)) return;
  if (reached < 6 * most && reached > least) return;
  const auto off = [&](double factor) { return std::abs(std::log(reached * factor / (0.3 * most))); };
  const auto best = std::min_element(units.begin(), units.end(), [&](const auto& a, const auto& b) {
    return b.second <= 0 || (a.second > 0 && off(a.second) < off(b.second));
  });
  const std::string hint =
      best->second > 0 && off(best->second) < off(1)
          ? fmt::format("are these {}? convert them (tendril gap import has a column map for it)",
                        best->first)
          : "check the column and the robot file";
  const bool motor = kind.matrix == &Run::motor_position_rad;
  const char* so = reached > most && !motor ? "values that this robot cannot reach are masked"
                                            : "wrong units make every number of the diagnosis wrong";
  Add(Severity::kError, kind.name, reached,
      fmt::format("reaches {:.4g} {}, but this robot reaches {:.4g} at most; {}; {}", reached, kind.unit,
                  most, so, hint));
}

void Checkup::TipUnits() {
  const double length_m = robot_.body.length_m();
  std::vector<double> distance;
  const Matrix& tip = Of(kTip);
  for (Eigen::Index i = 0; i < tip.rows(); ++i) {
    if (const double d = tip.row(i).norm(); std::isfinite(d)) distance.push_back(d);
  }
  if (distance.empty()) return;
  const double usual = Quantile(distance, 0.5), far = Quantile(distance, 0.99);
  if (usual > 30 * length_m) {
    const bool mm = usual / 1000 > 0.2 * length_m && usual / 1000 < 3 * length_m;
    Add(Severity::kError, kTip.name, usual,
        fmt::format("is {:.4g} m from the base, the robot is {:.4g} m long; {}", usual, length_m,
                    mm ? "these are millimetres; divide by 1000"
                       : "wrong unit or the tracker's own origin; give it in metres in the base's frame"));
  } else if (const double rest = distance.front(); rest < 0.3 * length_m) {
    Add(Severity::kError, kTip.name, rest,
        fmt::format("begins {:.4g} m from the base, the robot is {:.4g} m long; is the tip given as a "
                    "displacement or in "
                    "another unit? give its position in metres in the base's frame",
                    rest, length_m));
  } else if (far > 1.05 * length_m + 0.002) {
    Add(Severity::kWarning, kTip.name, far,
        fmt::format(
            "is up to {:.4g} m from the base, the robot is {:.4g} m long; a frame with another origin, or "
            "the file of another robot, looks like a gap; transform the tracker's frame to the base",
            far, length_m));
  } else if (far < kNearest * length_m) {
    Add(Severity::kWarning, kTip.name, far,
        fmt::format("is never more than {:.4g} m from the base, the robot is {:.4g} m long; the file of a "
                    "longer robot looks like a gap; give the file of the robot that was measured, unless it "
                    "was strongly bent all the time",
                    far, length_m));
  }
}

void Checkup::Signs() {
  if (!Fits(kTension)) return;
  const Matrix& m = Of(kTension);
  for (Eigen::Index j = 0; j < m.cols(); ++j) {
    const auto rows = FiniteRows(m.col(j));
    if (rows.empty()) continue;
    const double noise = std::max(Scatter(m.col(j)), 1e-3);
    const auto below = static_cast<double>(
        std::count_if(rows.begin(), rows.end(), [&](Eigen::Index i) { return m(i, j) < -5 * noise - 0.02; }));
    const double share = below / static_cast<double>(rows.size());
    if (share > 0.9) {
      Add(Severity::kError, ChannelOf(kTension, j), share,
          "is negative throughout; a tendon can only pull; reverse its sign (pulling is positive)");
    } else if (share > 0.001) {
      Add(Severity::kWarning, ChannelOf(kTension, j), RangeOf(m.col(j)).least,
          fmt::format("falls to {:.3g} N; a tendon cannot push, so the cell has an offset; zero the cells "
                      "with slack tendons before the run",
                      RangeOf(m.col(j)).least));
    }
  }
}

}  // namespace tendril::gap
