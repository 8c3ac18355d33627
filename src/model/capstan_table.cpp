// The lookup table of the Capstan equation: cubic Hermite pieces between solutions, in ln T. Knows the
// equation only by its solutions.
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

#include "capstan_equation.h"
#include "tendril/model/capstan.h"

namespace tendril::model {
namespace {

constexpr int kFirstIntervals = 8;
constexpr int kMostIntervals = 4096;
constexpr int kProbes = 4;  // each interval is checked at its inner quarter points
// Hermite errors peak near the middle of an interval but not exactly there: the probes must stay this far
// below.
constexpr double kProbeMargin = 0.8;

}  // namespace

CapstanTable::CapstanTable(const TransmissionParameters& transmission, double max_tension_N,
                           double relative_error) {
  for (const PulleyParameters& pulley : transmission.pulleys) ValidatePulley(pulley);
  const double low_N = transmission.low_tension_N;
  if (!(low_N >= 1e-9 && low_N <= kMaxCapstanTension_N)) {
    throw std::invalid_argument("transmission low tension = " + NumberText(low_N) +
                                " N: accepted 1e-9 .. 1e6 N");
  }
  if (!(max_tension_N > low_N && max_tension_N <= kMaxCapstanTension_N)) {
    throw std::invalid_argument("Capstan table up to " + NumberText(max_tension_N) + " N: accepted above " +
                                NumberText(low_N) + " N (the low tension), up to 1e6 N");
  }
  if (!(relative_error >= 1e-9 && relative_error <= 0.1)) {
    throw std::invalid_argument("Capstan table relative error = " + NumberText(relative_error) +
                                ": accepted 1e-9 .. 0.1");
  }
  log_low_ = std::log(low_N);
  const double span = std::log(max_tension_N) - log_low_;
  const double tolerance = std::max(kSolverTolerance, 1e-4 * relative_error);
  // The probes of one round are the nodes and probes of the next: only the points between them are new.
  std::vector<double> log_low, through, slope;
  for (int intervals = kFirstIntervals; intervals <= kMostIntervals; intervals *= 2) {
    const int samples = intervals * kProbes + 1;
    const int stride = log_low.empty() ? 1 : 2;
    std::vector<double> fine_low(samples), fine_through(samples), fine_slope(samples, 1.0);
    std::vector<double> fresh;
    for (int i = 0; i < samples; ++i) {
      fine_low[i] = log_low_ + span * i / (samples - 1);
      if (stride == 1 || i % 2 == 1) fresh.push_back(fine_low[i]);
    }
    std::vector<double> fresh_slope(fresh.size(), 1.0);
    std::vector<LogPoint> points(fresh.size());
    for (const PulleyParameters& pulley : transmission.pulleys) {
      SolveLog(pulley, fresh, points, tolerance);
      for (std::size_t i = 0; i < fresh.size(); ++i) {
        fresh[i] = points[i].log_high;
        fresh_slope[i] *= points[i].slope;
      }
    }
    for (int i = 0; i < samples; ++i) {
      const bool known = stride == 2 && i % 2 == 0;
      fine_through[i] = known ? through[i / 2] : fresh[i / stride];
      fine_slope[i] = known ? slope[i / 2] : fresh_slope[i / stride];
    }
    log_low = std::move(fine_low);
    through = std::move(fine_through);
    slope = std::move(fine_slope);
    spacing_ = span / intervals;
    nodes_.clear();
    for (int i = 0; i < samples; i += kProbes) {
      nodes_.push_back({through[i], through[i] - log_low[i], slope[i] - 1});
    }
    verified_error_ = 0;
    for (int i = 0; i < samples; ++i) {
      if (i % kProbes == 0) continue;
      const int interval = i / kProbes;
      const double forward = LogRatio(interval, static_cast<double>(i % kProbes) / kProbes).value;
      const double back = through[i] - LogRatioOfHigh(through[i]).value;
      verified_error_ = std::max({verified_error_, std::abs(std::expm1(forward - (through[i] - log_low[i]))),
                                  std::abs(std::expm1(back - log_low[i]))});
    }
    if (Monotone() && verified_error_ <= kProbeMargin * relative_error) {
      low_ratio_ = std::exp(nodes_.front().log_ratio);
      high_ratio_ = std::exp(nodes_.back().log_ratio);
      return;
    }
  }
  throw std::runtime_error("Capstan table: relative error " + NumberText(relative_error) +
                           " not reached with 4096 intervals; raise the low tension or the accepted error");
}

bool CapstanTable::Monotone() const noexcept {
  // Fritsch and Carlson: a cubic Hermite piece rises throughout when both end slopes lie within the circle of
  // radius three mean slopes.
  for (std::size_t i = 0; i + 1 < nodes_.size(); ++i) {
    const double mean = (nodes_[i + 1].log_high - nodes_[i].log_high) / spacing_;
    const double a = (1 + nodes_[i].slope) / mean, b = (1 + nodes_[i + 1].slope) / mean;
    if (!(mean > 0 && a >= 0 && b >= 0 && a * a + b * b <= 9)) return false;
  }
  return true;
}

CapstanTable::Ratio CapstanTable::LogRatio(int interval, double t) const noexcept {
  const Node &a = nodes_[interval], &b = nodes_[interval + 1];
  const double rise = b.log_ratio - a.log_ratio, da = spacing_ * a.slope, db = spacing_ * b.slope;
  const double c2 = 3 * rise - 2 * da - db, c3 = da + db - 2 * rise;
  return {a.log_ratio + t * (da + t * (c2 + t * c3)), (da + t * (2 * c2 + t * 3 * c3)) / spacing_};
}

CapstanTable::Ratio CapstanTable::LogRatioOfLow(double log_low) const noexcept {
  const double at = (log_low - log_low_) / spacing_;
  const int interval = std::clamp(static_cast<int>(at), 0, nodes() - 2);
  return LogRatio(interval, at - interval);
}

CapstanTable::Ratio CapstanTable::LogRatioOfHigh(double log_high) const noexcept {
  const auto above = std::upper_bound(nodes_.begin() + 1, nodes_.end() - 1, log_high,
                                      [](double value, const Node& node) { return value < node.log_high; });
  const int interval = static_cast<int>(above - nodes_.begin()) - 1;
  const Node &a = nodes_[interval], &b = nodes_[interval + 1];
  const double low = log_low_ + spacing_ * interval;
  // Start from the cubic of the inverse, whose error is the table's; two Newton steps bring it to round-off.
  const double height = b.log_high - a.log_high, s = (log_high - a.log_high) / height;
  const double da = height / (spacing_ * (1 + a.slope)), db = height / (spacing_ * (1 + b.slope));
  double t = s * (da + s * (3 - 2 * da - db + s * (da + db - 2)));
  for (int i = 0; i < 2; ++i) {
    const Ratio f = LogRatio(interval, t);
    t -= (low + spacing_ * t + f.value - log_high) / (spacing_ * (1 + f.slope));
  }
  return LogRatio(interval, t);
}

double CapstanTable::Pull(double base_tension_N) const noexcept {
  const double log_low = std::log(base_tension_N);
  if (!(log_low > log_low_)) return base_tension_N * low_ratio_;
  if (!(log_low < log_low_ + spacing_ * (nodes() - 1))) return base_tension_N * high_ratio_;
  return base_tension_N * std::exp(LogRatioOfLow(log_low).value);
}

double CapstanTable::Release(double base_tension_N) const noexcept {
  const double log_high = std::log(base_tension_N);
  if (!(log_high > nodes_.front().log_high)) return base_tension_N / low_ratio_;
  if (!(log_high < nodes_.back().log_high)) return base_tension_N / high_ratio_;
  return base_tension_N * std::exp(-LogRatioOfHigh(log_high).value);
}

double CapstanTable::PullSlope(double base_tension_N) const noexcept {
  const double log_low = std::log(base_tension_N);
  if (!(log_low > log_low_)) return low_ratio_;
  if (!(log_low < log_low_ + spacing_ * (nodes() - 1))) return high_ratio_;
  const Ratio f = LogRatioOfLow(log_low);
  return std::exp(f.value) * (1 + f.slope);
}

double CapstanTable::ReleaseSlope(double base_tension_N) const noexcept {
  const double log_high = std::log(base_tension_N);
  if (!(log_high > nodes_.front().log_high)) return 1 / low_ratio_;
  if (!(log_high < nodes_.back().log_high)) return 1 / high_ratio_;
  const Ratio f = LogRatioOfHigh(log_high);
  return std::exp(-f.value) / (1 + f.slope);
}

namespace {

bool SameTable(const TransmissionParameters& a, const TransmissionParameters& b) {
  const auto same = [](const PulleyParameters& p, const PulleyParameters& q) {
    return p.law == q.law && p.wrap_rad == q.wrap_rad && p.radius_ratio == q.radius_ratio &&
           p.alpha == q.alpha && p.exponent == q.exponent && p.entry_angle_rad == q.entry_angle_rad;
  };
  return a.low_tension_N == b.low_tension_N && std::ranges::equal(a.pulleys, b.pulleys, same);
}

}  // namespace

std::vector<std::shared_ptr<const CapstanTable>> MakeCapstanTables(
    std::span<const TendonDriveParameters> tendons, double max_tension_N, double relative_error) {
  std::vector<std::shared_ptr<const CapstanTable>> tables;
  for (const TendonDriveParameters& t : tendons) {
    const auto equal = std::find_if(tendons.begin(), tendons.begin() + tables.size(), [&](const auto& other) {
      return SameTable(other.transmission, t.transmission);
    });
    const auto first = static_cast<std::size_t>(equal - tendons.begin());
    tables.push_back(first < tables.size() ? tables[first]
                                           : std::make_shared<const CapstanTable>(
                                                 t.transmission, max_tension_N, relative_error));
  }
  return tables;
}

}  // namespace tendril::model
