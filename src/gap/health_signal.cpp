// Questions to one signal or two; see the header.
#include "health_signal.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "median.h"

namespace tendril::gap {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
// More values than this do not improve estimates of steps and clocks.
constexpr std::size_t kEnough = 4000;
constexpr double kChange_s = 0.1;  // interval for changes

// Number of samples, at least `least`, in the interval for changes.
Eigen::Index Span(double step_s, Eigen::Index least) {
  const double samples = std::round(kChange_s / step_s);
  return samples > static_cast<double>(least) ? static_cast<Eigen::Index>(std::min(samples, 1e9)) : least;
}

// Linear between the rows of increasing times; false outside of them or where a value is missing.
bool At(const Eigen::VectorXd& time_s, const Eigen::MatrixXd& x, double t, Eigen::RowVectorXd& value) {
  const double* const begin = time_s.data();
  const double* const end = begin + time_s.size();
  if (!(t >= *begin && t <= end[-1])) return false;
  const Eigen::Index i =
      std::clamp<Eigen::Index>(std::upper_bound(begin, end, t) - begin - 1, 0, time_s.size() - 2);
  const double part = (t - time_s[i]) / (time_s[i + 1] - time_s[i]);
  value = (1 - part) * x.row(i) + part * x.row(i + 1);
  return value.allFinite();
}

}  // namespace

Range RangeOf(const Signal& x) {
  Range range;
  for (const double v : x) {
    if (!std::isfinite(v)) continue;
    range.least = range.count ? std::min(range.least, v) : v;
    range.most = range.count ? std::max(range.most, v) : v;
    ++range.count;
  }
  return range;
}

Range Range::Of(const Eigen::MatrixXd& columns) {
  Range widest;
  for (Eigen::Index c = 0; c < columns.cols(); ++c) {
    if (const Range range = RangeOf(columns.col(c)); range.width() >= widest.width()) widest = range;
  }
  return widest;
}

double Largest(const Eigen::MatrixXd& x) {
  double most = 0;
  for (Eigen::Index i = 0; i < x.size(); ++i) {
    if (std::isfinite(x.data()[i])) most = std::max(most, std::abs(x.data()[i]));
  }
  return most;
}

double Quantile(std::vector<double> values, double q) {
  if (values.empty()) return 0;
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

double UsualWidth(std::vector<double> values) {
  std::erase_if(values, [](double x) { return !std::isfinite(x); });
  return values.size() < 20 ? 0 : Quantile(values, 0.98) - Quantile(values, 0.02);
}

std::vector<Eigen::Index> FiniteRows(const Signal& x) {
  std::vector<Eigen::Index> rows;
  for (Eigen::Index i = 0; i < x.size(); ++i) {
    if (std::isfinite(x[i])) rows.push_back(i);
  }
  return rows;
}

std::vector<double> RowsApart(const Signal& x) {
  const std::vector<Eigen::Index> rows = FiniteRows(x);
  std::vector<double> apart;
  for (std::size_t i = 1; i < rows.size(); ++i) apart.push_back(static_cast<double>(rows[i] - rows[i - 1]));
  return apart;
}

std::vector<Eigen::Index> LoneValues(const Signal& x, double least) {
  constexpr double kByFar = 10, kNearlyAll = 0.95, kRare = 0.04;
  const std::vector<Eigen::Index> rows = FiniteRows(x);
  if (rows.size() < 20 || !(least > 0)) return {};
  std::vector<double> out, window;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    window.clear();
    for (std::size_t k = i < 2 ? 0 : i - 2; k < std::min(i + 3, rows.size()); ++k)
      window.push_back(x[rows[k]]);
    out.push_back(std::abs(x[rows[i]] - Quantile(window, 0.5)));
  }
  const double most = std::max(least, kByFar * Quantile(out, kNearlyAll));
  std::vector<Eigen::Index> alone;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (out[i] > most) alone.push_back(rows[i]);
  }
  if (static_cast<double>(alone.size()) > kRare * static_cast<double>(rows.size())) alone.clear();
  return alone;
}

TimeSteps StepsOf(const Eigen::VectorXd& time_s) {
  TimeSteps s;
  std::vector<double> steps;
  for (Eigen::Index i = 1; i < time_s.size(); ++i) steps.push_back(time_s[i] - time_s[i - 1]);
  s.usual = Median(steps);
  double sum = 0;
  int inside = 0;
  for (const double step : steps) {
    if (step > 1.5 * s.usual) {
      ++s.gaps;
      s.lost += std::round(step / s.usual) - 1;
    } else {
      sum += (step - s.usual) * (step - s.usual);
      ++inside;
    }
  }
  if (inside > 0) s.jitter = std::sqrt(sum / inside);
  return s;
}

double LostOfOwnGrid(const std::vector<Eigen::Index>& rows) {
  if (rows.size() < 2) return 0;
  std::vector<double> steps;
  for (std::size_t i = 1; i < rows.size(); ++i) steps.push_back(static_cast<double>(rows[i] - rows[i - 1]));
  const double usual = Median(steps);
  double lost = 0;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    lost += std::max(std::round(static_cast<double>(rows[i] - rows[i - 1]) / usual) - 1, 0.0);
  }
  return lost / (lost + static_cast<double>(rows.size()));
}

double Scatter(const Signal& x) {
  std::vector<double> second;
  // Over existing values only: a slower sensor never has neighbouring rows.
  double one = kNone, two = kNone;
  for (const double v : x) {
    if (!std::isfinite(v)) continue;
    if (const double d = v - 2 * one + two; std::isfinite(d)) second.push_back(std::abs(d));
    two = one;
    one = v;
  }
  // White noise of rms 1 has second differences of rms sqrt(6), and their median magnitude is 0.6745 of that.
  return Median(second) / (0.6745 * std::sqrt(6.0));
}

Plateau FlatExtreme(const Signal& x, bool top) {
  const Range range = RangeOf(x);
  if (range.count < 100 || range.width() <= 0) return {};
  const double value = top ? range.most : range.least;
  std::vector<Eigen::Index> stretches;  // uninterrupted intervals at the extreme
  Eigen::Index moving = 0, still = 0, beside = 0;
  double before = kNone, next = kNone;  // value nearest to the extreme, and its number of occurrences
  double first = kNone;
  for (const double v : x) {
    if (!std::isfinite(v)) continue;
    if (!std::isfinite(first)) first = v;
    if (v != value) {
      if (std::isfinite(before)) ++(v == before ? still : moving);
      if (!(top ? v <= next : v >= next)) next = v, beside = 0;
      beside += v == next;
    } else if (before == value) {
      ++stretches.back();
    } else {
      stretches.push_back(1);
    }
    before = v;
  }
  // A signal that also stands still elsewhere has no noise, so a flat extreme means nothing.
  const double same = static_cast<double>(still) / static_cast<double>(still + moving);
  if (moving < 50 || same > 0.9) return {};
  // Longer than a signal with this scatter stands still by chance.
  const double chance = std::ceil(std::log(1e-6) / std::log(std::max(same, 0.25)));
  Eigen::Index flat = 0;
  for (const Eigen::Index stretch : stretches) {
    if (static_cast<double>(stretch) >= chance) flat += stretch;
  }
  // A coarse signal that turns smoothly stays at its last two values for similar times, and one that returns
  // to rest stays where it began.
  if (flat < 5 * beside || std::abs(first - value) <= 2 * std::abs(next - value)) return {};
  return {value, static_cast<double>(flat) / static_cast<double>(range.count)};
}

bool Slips(const std::vector<double>& distances) {
  constexpr double kLeast = 2, kShare = 1e-3;  // rows in total, and share of the values
  const double usual = Median(distances);
  double slipped = 0;  // except for lost rows
  for (const double d : distances) {
    if (std::abs(d - usual) <= 1) slipped += d - usual;
  }
  return std::abs(slipped) >= std::max(kLeast, kShare * static_cast<double>(distances.size()));
}

double DecimalStep(const Signal& x) {
  constexpr std::size_t kDifferent = 12;
  for (int places = 0; places <= 6; ++places) {
    const double step = std::pow(10, -places);
    std::set<double> different;
    bool multiples = true;
    for (Eigen::Index i = 0; i < x.size() && multiples; ++i) {
      if (!std::isfinite(x[i])) continue;
      const double whole = std::round(x[i] / step);
      multiples = std::abs(x[i] / step - whole) < 1e-6;
      if (different.size() < kDifferent) different.insert(whole);
    }
    if (multiples) return different.size() < kDifferent ? 0 : step;
  }
  return 0;
}

double Quantum(const Signal& x) {
  std::vector<double> values;
  const std::vector<Eigen::Index> rows = FiniteRows(x);
  const std::size_t stride = rows.size() / kEnough + 1;
  for (std::size_t i = 0; i < rows.size(); i += stride) values.push_back(x[rows[i]]);
  std::sort(values.begin(), values.end());
  if (values.empty() || values.back() - values.front() <= 0) return 0;
  const double same = 1e-9 * std::max(std::abs(values.front()), std::abs(values.back()));
  values.erase(std::unique(values.begin(), values.end(), [&](double a, double b) { return b - a <= same; }),
               values.end());
  if (values.size() < 12) return 0;
  double step = std::numeric_limits<double>::infinity();
  for (std::size_t i = 1; i < values.size(); ++i) step = std::min(step, values[i] - values[i - 1]);
  // The nearest values give an approximate step, values farther apart refine it.
  const double first = values.front();
  std::size_t off = 0;
  for (const double v : values) {
    const double multiple = (v - first) / step;
    const double whole = std::round(multiple);
    if (std::abs(multiple - whole) > 0.1) {
      if (++off > values.size() / 50) return 0;
    } else if (whole > 0) {
      step = (v - first) / whole;
    }
  }
  // Decimal places come from the writer, not from the sensor.
  const double power = std::log10(step);
  return std::abs(power - std::round(power)) < 1e-6 ? 0 : step;
}

int Reversals(const Signal& x) {
  const Range range = RangeOf(x);
  if (range.width() <= 0 || range.width() < 20 * Scatter(x)) return 0;
  const double least = 0.05 * range.width();
  int count = 0, direction = 0;
  double low = kNone, high = kNone;  // since the last turning point
  for (const double v : x) {
    if (!std::isfinite(v)) continue;
    low = std::isnan(low) ? v : std::min(low, v);
    high = std::isnan(high) ? v : std::max(high, v);
    if (direction >= 0 && v < high - least) {
      count += direction > 0;
      direction = -1;
      low = v;
    } else if (direction <= 0 && v > low + least) {
      count += direction < 0;
      direction = 1;
      high = v;
    }
  }
  return count;
}

std::pair<double, double> Speeds(const Eigen::VectorXd& time_s, const Signal& x) {
  const double step = StepsOf(time_s).usual;
  const Eigen::Index w = Span(step, 1);
  std::vector<double> speed;
  double most = 0;
  for (Eigen::Index i = 0; i + w < x.size(); i += std::max<Eigen::Index>(w / 2, 1)) {
    const double v = std::abs(x[i + w] - x[i]) / (time_s[i + w] - time_s[i]);
    if (!std::isfinite(v)) continue;
    speed.push_back(v);
    most = std::max(most, v);
  }
  std::erase_if(speed, [&](double v) { return v < 0.02 * most || v == 0; });
  return {Quantile(speed, 0.1), Quantile(speed, 0.9)};
}

Eigen::MatrixXd ChangeCorrelation(const Eigen::VectorXd& time_s, const Eigen::MatrixXd& a,
                                  const Eigen::MatrixXd& b) {
  const double step = StepsOf(time_s).usual;
  const Eigen::Index w = Span(step, 3);
  const Eigen::Index hop = std::max<Eigen::Index>(w / 2, 1);
  const auto changes = [&](const Eigen::MatrixXd& x) {
    const Eigen::Index count = std::max<Eigen::Index>((x.rows() - w + hop - 1) / hop, 0);
    Eigen::MatrixXd d(count, x.cols());
    for (Eigen::Index i = 0; i < count; ++i) d.row(i) = x.row(i * hop + w) - x.row(i * hop);
    return d;
  };
  const Eigen::MatrixXd da = changes(a), db = changes(b);
  const auto noise = [](const Eigen::MatrixXd& x) {
    Eigen::VectorXd n(x.cols());
    for (Eigen::Index c = 0; c < x.cols(); ++c) n[c] = Scatter(x.col(c));
    return n;
  };
  const Eigen::VectorXd noise_a = noise(a), noise_b = noise(b);
  Eigen::MatrixXd c(a.cols(), b.cols());
  for (Eigen::Index i = 0; i < a.cols(); ++i) {
    for (Eigen::Index j = 0; j < b.cols(); ++j) {
      double aa = 0, bb = 0, ab = 0;
      int n = 0;
      for (Eigen::Index k = 0; k < da.rows(); ++k) {
        const double x = da(k, i), y = db(k, j);
        if (!std::isfinite(x) || !std::isfinite(y)) continue;
        aa += x * x, bb += y * y, ab += x * y;
        ++n;
      }
      const bool both_move =
          n >= 10 && aa > 50 * n * noise_a[i] * noise_a[i] && bb > 50 * n * noise_b[j] * noise_b[j];
      c(i, j) = both_move && aa > 0 && bb > 0 ? ab / std::sqrt(aa * bb) : kNone;
    }
  }
  return c;
}

std::optional<Shift> ClockShift(const Eigen::VectorXd& time_s, const Eigen::MatrixXd& drive,
                                const Eigen::MatrixXd& response) {
  constexpr double kMost_s = 0.2, kCoarse_s = 0.005, kFine_s = 0.0005;
  if (time_s.size() < 10) return std::nullopt;
  std::vector<Eigen::Index> rows;
  for (Eigen::Index i = 0; i < response.rows(); ++i) {
    if (response.row(i).allFinite()) rows.push_back(i);
  }
  if (rows.size() < 50) return std::nullopt;
  std::vector<double> steps;
  for (std::size_t i = 1; i < rows.size(); ++i) steps.push_back(time_s[rows[i]] - time_s[rows[i - 1]]);
  const double own = Median(steps);
  // Slower readings cannot resolve a shift of milliseconds.
  if (own > kChange_s) return std::nullopt;
  const auto n = static_cast<std::size_t>(Span(own, 1));
  std::vector<std::pair<double, double>> spans;
  std::vector<Eigen::Index> from, to;
  const std::size_t hop = std::max<std::size_t>(1, rows.size() / (kEnough / 2));
  for (std::size_t i = 0; i + n < rows.size(); i += hop) {
    const double t0 = time_s[rows[i]], t1 = time_s[rows[i + n]];
    if (t1 - t0 > 1.3 * own * static_cast<double>(n)) continue;
    if (t0 < time_s[0] + kMost_s || t1 > time_s[time_s.size() - 1] - kMost_s) continue;
    spans.emplace_back(t0, t1);
    from.push_back(rows[i]);
    to.push_back(rows[i + n]);
  }
  const auto count = static_cast<Eigen::Index>(spans.size());
  const Eigen::Index inputs = drive.cols();
  if (count < 20 * inputs) return std::nullopt;
  Eigen::MatrixXd y(count, response.cols());
  for (Eigen::Index k = 0; k < count; ++k) {
    y.row(k) =
        response.row(to[static_cast<std::size_t>(k)]) - response.row(from[static_cast<std::size_t>(k)]);
  }
  Eigen::RowVectorXd a(inputs), b(inputs);
  // Share of the response's changes that a linear map of the drive's changes, `shift` earlier, does not
  // explain.
  const auto left = [&](double shift) {
    Eigen::MatrixXd d = Eigen::MatrixXd::Zero(count, inputs);
    Eigen::MatrixXd seen = Eigen::MatrixXd::Zero(count, y.cols());
    for (Eigen::Index k = 0; k < count; ++k) {
      const auto& [t0, t1] = spans[static_cast<std::size_t>(k)];
      if (!At(time_s, drive, t0 - shift, a) || !At(time_s, drive, t1 - shift, b)) continue;
      d.row(k) = b - a;
      seen.row(k) = y.row(k);
    }
    const double all = seen.squaredNorm();
    Eigen::MatrixXd normal = d.transpose() * d;
    const double trace = normal.trace();
    if (!(all > 0) || !(trace > 0)) return 1.0;
    normal.diagonal().array() += 1e-9 * trace;
    const Eigen::MatrixXd cross = d.transpose() * seen;
    return 1 - (cross.transpose() * normal.ldlt().solve(cross)).trace() / all;
  };
  double best = 0, least = 2;
  const auto search = [&](double middle, double reach, double step) {
    const auto each_side = static_cast<int>(std::lround(reach / step));
    for (int i = -each_side; i <= each_side; ++i) {
      const double l = left(middle + i * step);
      if (l < least) least = l, best = middle + i * step;
    }
  };
  search(0, kMost_s, 4 * kCoarse_s);
  search(best, 3 * kCoarse_s, kCoarse_s);
  search(best, kCoarse_s, kFine_s);
  // A motion that looks the same a little later (a slow circle) is not conclusive.
  const double before = left(-kMost_s), after = left(kMost_s);
  if (least > 0.3 || std::min(before, after) < 2 * least + 0.02 || std::abs(best) > kMost_s - kCoarse_s) {
    return std::nullopt;
  }
  // Interpolates between steps by a parabola through the three points about the minimum.
  const double sooner = left(best - kFine_s), later = left(best + kFine_s);
  const double bend = sooner - 2 * least + later;
  if (bend > 0) best += std::clamp(0.5 * kFine_s * (sooner - later) / bend, -kFine_s, kFine_s);
  return Shift{best, std::sqrt(std::max(1 - least, 0.0))};
}

double RmsDifference(const Eigen::VectorXd& x_time_s, const Eigen::MatrixXd& x,
                     const Eigen::VectorXd& y_time_s, const Eigen::MatrixXd& y) {
  double sum = 0;
  Eigen::Index count = 0;
  for (Eigen::Index c = 0; c < std::min(x.cols(), y.cols()); ++c) {
    const std::vector<Eigen::Index> rows = FiniteRows(y.col(c));
    if (rows.size() < 2) continue;
    Eigen::VectorXd time(static_cast<Eigen::Index>(rows.size()));
    Eigen::MatrixXd value(time.size(), 1);
    for (Eigen::Index i = 0; i < time.size(); ++i) {
      time[i] = y_time_s[rows[static_cast<std::size_t>(i)]] - y_time_s[0];
      value(i, 0) = y(rows[static_cast<std::size_t>(i)], c);
    }
    Eigen::RowVectorXd at(1);
    for (Eigen::Index i = 0; i < x.rows(); ++i) {
      if (!std::isfinite(x(i, c)) || !At(time, value, x_time_s[i] - x_time_s[0], at)) continue;
      sum += (x(i, c) - at[0]) * (x(i, c) - at[0]);
      ++count;
    }
  }
  return count > 0 ? std::sqrt(sum / static_cast<double>(count)) : kNone;
}

}  // namespace tendril::gap
