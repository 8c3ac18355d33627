// Checks of the time stamps, and of values that are missing or do not change.
#include <fmt/core.h>

#include <algorithm>
#include <iterator>

#include "health_checks.h"
#include "health_signal.h"
#include "prepare.h"

namespace tendril::gap {
namespace {

constexpr SignalKind kLoads[] = {kActual, kTension};

}  // namespace

void Checkup::Sampling() {
  const Eigen::VectorXd& t = run_->time_s;
  TimeSteps s = StepsOf(t);
  // Time stamps that scatter by more than a step define no grid in which rows could be missing.
  if (s.gaps > t.size() / 5) s.gaps = 0, s.lost = 0;
  Add(Severity::kInfo, "time", 1 / s.usual,
      fmt::format(
          "{} samples over {:.6g} s, {:.6g} Hz, jitter {:.3g} % of a step, {} gaps ({:.0f} rows missing)",
          t.size(), t[t.size() - 1] - t[0], 1 / s.usual, 100 * s.jitter / s.usual, s.gaps, s.lost));
  if (s.jitter > 0.2 * s.usual) {
    Add(Severity::kWarning, "time", s.jitter,
        fmt::format("steps scatter by {:.2g} s around {:.4g} s; fast effects (delay, damping) are blurred; "
                    "stamp the "
                    "samples where they are taken",
                    s.jitter, s.usual));
  }
  // Missing rows do not matter where nothing moves between rows.
  if (s.usual < kQuasiStatic_s && s.lost > 0.001 * static_cast<double>(t.size())) {
    Add(s.lost > 0.1 * static_cast<double>(t.size()) ? Severity::kError : Severity::kWarning, "time", s.lost,
        fmt::format("{:.0f} of {:.0f} rows are missing in {} gaps; the gaps and the time just after are "
                    "masked; record with less load on the logger",
                    s.lost, s.lost + static_cast<double>(t.size()), s.gaps));
  }
  if (s.usual > 0.9) {
    Add(Severity::kWarning, "time", s.usual,
        fmt::format("a step is {:.3g} s; if the column is in milliseconds divide it by 1000, else the run "
                    "is quasi-static and motion (C5) cannot be compared",
                    s.usual));
  } else if (s.usual > 0.02) {
    Add(Severity::kWarning, "time", 1 / s.usual,
        fmt::format("{:.3g} Hz; drives (C1) and motion (C5) need 100 Hz or more, the other cuts do not",
                    1 / s.usual));
  } else if (s.usual < 2e-5) {
    Add(Severity::kWarning, "time", s.usual,
        fmt::format("a step is {:.3g} s; is the column in another unit than seconds?", s.usual));
  }
  if (t[t.size() - 1] - t[0] < 2) {
    Add(Severity::kWarning, "time", t[t.size() - 1] - t[0],
        fmt::format(
            "{:.3g} s is short; slow effects and averages over noise cannot be determined; record longer",
            t[t.size() - 1] - t[0]));
  }
}

void Checkup::Missing(const SignalKind& kind) {
  const Matrix& m = Of(kind);
  for (Eigen::Index c = 0; c < m.cols(); ++c) {
    const std::vector<Eigen::Index> rows = FiniteRows(m.col(c));
    const double missing = 1 - static_cast<double>(rows.size()) / static_cast<double>(m.rows());
    if (rows.empty()) {
      Add(Severity::kWarning, ChannelOf(kind, c), 1,
          "has no value at all; cuts that need it cannot be compared for this tendon or axis; check sensor "
          "and column");
    } else if (missing > 0.01) {
      // A slower sensor has its own regular grid: only values missing from that grid count.
      const double lost = LostOfOwnGrid(rows);
      if (lost > 0.02) {
        Add(lost > 0.3 ? Severity::kError : Severity::kWarning, ChannelOf(kind, c), lost,
            fmt::format(
                "{:.1f} % of its values are missing; these stretches are not used; check cable and marker "
                "visibility",
                100 * lost));
      }
    }
    if (!kind.a_tendon) break;  // the axes of a pose are present or missing together
  }
}

void Checkup::Constant(const SignalKind& kind) {
  const Matrix& m = Of(kind);
  for (Eigen::Index c = 0; c < m.cols(); ++c) {
    const Range range = RangeOf(m.col(c));
    if (range.count < 20 || range.width() > 0) continue;
    // A target may stay constant, and so may a simulated tip; a motor is suspicious only if its load
    // changes.
    const bool cell = kind.matrix == &Run::tension_N || kind.matrix == &Run::torque_actual_Nm;
    const bool motor = kind.matrix == &Run::motor_position_rad && LoadChanges(c);
    if (!cell && !motor) continue;
    Add(Severity::kWarning, ChannelOf(kind, c), range.least,
        fmt::format("is {:.6g} {} throughout; a dead sensor carries no information and looks like a "
                    "perfect one; check its cable and its column",
                    range.least, kind.unit));
  }
}

bool Checkup::LoadChanges(Eigen::Index tendon) const {
  return std::any_of(std::begin(kLoads), std::end(kLoads), [&](const SignalKind& load) {
    if (!Fits(load) || Of(load).cols() <= tendon) return false;
    const auto column = Of(load).col(tendon);
    return RangeOf(column).width() > 50 * Scatter(column) && RangeOf(column).width() > 0;
  });
}

}  // namespace tendril::gap
