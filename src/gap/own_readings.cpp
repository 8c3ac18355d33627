// Finds a sensor's own rows by the regularity of new values.
#include "own_readings.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <limits>
#include <map>
#include <utility>

#include "health_signal.h"
#include "median.h"
#include "prepare.h"

namespace tendril::gap {
namespace {

using Rows = std::vector<Eigen::Index>;

constexpr std::size_t kLeastReadings = 30;
constexpr double kMostApart_s = 0.1;  // between own readings; a longer constant value may be a rest
constexpr double kRegular = 0.7;      // share of readings at the usual distance, to within a row
constexpr double kAtOnce = 0.15;      // share of them that may be followed by another in the next row

/// Rows between own readings, and the rows of these readings.
struct Own {
  int every = 1;
  Rows rows;
  double late_s = 0;  // mean delay from a reading to its row
};

/// The usual distance in rows; 1 where distances are not regular.
int Usual(const std::vector<double>& distances) {
  if (distances.size() < kLeastReadings) return 1;
  const double usual = Median(distances);
  const auto share = [&](auto&& which) {
    return static_cast<double>(std::count_if(distances.begin(), distances.end(), which)) /
           static_cast<double>(distances.size());
  };
  const bool regular = share([&](double d) { return std::abs(d - usual) <= 1; }) >= kRegular;
  return usual >= 2 && regular && share([](double d) { return d == 1; }) <= kAtOnce
             ? static_cast<int>(std::lround(usual))
             : 1;
}

/// Repeated readings. `there`: rows with a value, in order.
Own Held(const Run& run, const Eigen::MatrixXd& values, const Rows& there) {
  std::vector<std::size_t> begins;  // starts of equal values, as indices into `there`
  for (std::size_t i = 0; i < there.size(); ++i) {
    if (i == 0 || values.row(there[i]) != values.row(there[i - 1])) begins.push_back(i);
  }
  std::vector<double> distances, news;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t k = 1; k < begins.size(); ++k) {
    const double step =
        (values.row(there[begins[k]]) - values.row(there[begins[k - 1]])).cwiseAbs().maxCoeff();
    news.push_back(step);
    least = std::min(least, step);
    if (run.time_s[there[begins[k]]] - run.time_s[there[begins[k - 1]]] <= kMostApart_s)
      distances.push_back(static_cast<double>(begins[k] - begins[k - 1]));
  }
  Own own{Usual(distances), {}};
  // A slow change of a coarsely rounded signal comes in steps of one size.
  if (own.every == 1 || Median(std::move(news)) < 2 * least) return {};
  // With its own rate, a reading waits half a row on average for the next row.
  if (Slips(distances)) own.late_s = 0.5 * UsualStep(run);
  begins.push_back(there.size());
  for (std::size_t k = 0; k + 1 < begins.size(); ++k) {
    for (std::size_t i = begins[k]; i < begins[k + 1]; i += static_cast<std::size_t>(own.every)) {
      const bool as_usual = i == begins[k] || i + static_cast<std::size_t>(own.every) <= begins[k + 1];
      if (as_usual) own.rows.push_back(there[i]);
    }
  }
  return own;
}

/// Deviation of a value from the straight line between its neighbours, for each column; NaN beside a pause
/// and where the value is constant.
Eigen::MatrixXd Bends(const Run& run, const Eigen::MatrixXd& values, const Rows& there) {
  const double usual_s = UsualStep(run);
  const auto rows = static_cast<Eigen::Index>(there.size());
  Eigen::MatrixXd bends = Eigen::MatrixXd::Constant(rows, values.cols(), std::nan(""));
  for (Eigen::Index i = 1; i + 1 < rows; ++i) {
    const Eigen::Index a = there[static_cast<std::size_t>(i - 1)], b = there[static_cast<std::size_t>(i)],
                       c = there[static_cast<std::size_t>(i + 1)];
    const double span_s = run.time_s[c] - run.time_s[a];
    if (span_s > 3 * usual_s || values.row(b) == values.row(a)) continue;
    const double share = (run.time_s[b] - run.time_s[a]) / span_s;
    bends.row(i) = (values.row(b) - values.row(a) - share * (values.row(c) - values.row(a))).cwiseAbs();
  }
  return bends;
}

/// Interpolated readings: the rows at which the lines bend.
Own Interpolated(const Run& run, const Eigen::MatrixXd& values, const Rows& there) {
  constexpr double kRounded = 4;    // medians: the largest bend by rounding alone
  constexpr double kExact = 1e-13;  // of the largest value: zero
  constexpr double kSingle = 1e-6;  // of the largest value: resolution of single-precision numbers
  constexpr double kPlain = 2;      // times the rounding error
  constexpr double kRowsAKnot =
      2.2;  // rows that bend, two for a reading between rows; a smooth curve bends in many
  const Eigen::MatrixXd bends = Bends(run, values, there);
  std::vector<double> bend(there.size(), 0.0);  // of the most bent column, relative to rounding
  for (Eigen::Index c = 0; c < values.cols(); ++c) {
    std::vector<double> all;
    for (const double x : bends.col(c)) {
      if (std::isfinite(x)) all.push_back(x);
    }
    const double usual = Median(std::move(all)), largest = Largest(values.col(c));
    // A signal that scatters about a line is not interpolated.
    if (usual > std::max(DecimalStep(values.col(c)), kSingle * largest)) return {};
    const double rounding = std::max({kRounded * usual, kExact * largest, 1e-300});
    for (std::size_t i = 0; i < bend.size(); ++i) {
      const double x = bends(static_cast<Eigen::Index>(i), c);
      if (std::isfinite(x)) bend[i] = std::max(bend[i], x / rounding);
    }
  }
  const auto bent = std::count_if(bend.begin(), bend.end(), [](double x) { return x > 1; });
  Own own;
  std::vector<std::size_t> knots;
  std::vector<double> distances, of_knots;
  for (std::size_t i = 1; i + 1 < there.size(); ++i) {
    if (bend[i] <= 1 || bend[i] < bend[i - 1] || bend[i] <= bend[i + 1]) continue;
    if (!knots.empty() && run.time_s[there[i]] - run.time_s[there[knots.back()]] <= kMostApart_s)
      distances.push_back(static_cast<double>(i - knots.back()));
    knots.push_back(i);
    of_knots.push_back(bend[i]);
  }
  own.every = Usual(distances);
  if (own.every == 1 || Median(std::move(of_knots)) < kPlain ||
      static_cast<double>(bent) > kRowsAKnot * static_cast<double>(knots.size()))
    return {};
  // Collinear readings do not bend the line; omitting them would bias the sample towards others.
  const auto between = [&](std::size_t from, std::size_t to) {
    const auto readings = static_cast<std::size_t>(
        std::max(1L, std::lround(static_cast<double>(to - from) / static_cast<double>(own.every))));
    for (std::size_t k = 0; k < readings; ++k) own.rows.push_back(there[from + k * (to - from) / readings]);
  };
  std::size_t last = 0;
  for (const std::size_t knot : knots) between(std::exchange(last, knot), knot);
  between(last, there.size());
  return own;
}

/// Values of the lines through the readings, with each reading shifted earlier by its delay.
void Advance(const Eigen::VectorXd& time_s, const Own& own, Eigen::Ref<Eigen::MatrixXd> values) {
  if (own.late_s == 0) return;
  for (std::size_t k = 0; k + 1 < own.rows.size(); ++k) {
    const Eigen::Index a = own.rows[k], b = own.rows[k + 1];
    const double apart_s = time_s[b] - time_s[a];
    if (apart_s <= kMostApart_s) values.row(a) += own.late_s / apart_s * (values.row(b) - values.row(a));
  }
}

/// Keeps only the own rows of these matrices. Returns the distance of rows; 1 where all are own.
template <class Find>
int Keep(Run& run, const Eigen::MatrixXd& by, std::initializer_list<Eigen::Ref<Eigen::MatrixXd>> of,
         Find&& find) {
  Rows there;
  for (Eigen::Index i = 0; i < by.rows(); ++i) {
    if (by.row(i).allFinite()) there.push_back(i);
  }
  const Own own = find(run, by, there);
  if (own.every == 1) return 1;
  std::vector<char> keep(static_cast<std::size_t>(by.rows()), 0);
  for (const Eigen::Index i : own.rows) keep[static_cast<std::size_t>(i)] = 1;
  for (Eigen::Ref<Eigen::MatrixXd> values : of) {
    for (Eigen::Index i = 0; i < values.rows(); ++i) {
      if (!keep[static_cast<std::size_t>(i)]) values.row(i).setConstant(kNoReading);
    }
    Advance(run.time_s, own, values);
  }
  return own.every;
}

}  // namespace

std::vector<std::string> KeepOwnReadings(DataSet& set) {
  std::vector<std::string> said;
  const auto look = [&](const char* between, auto&& find) {
    std::map<std::string, int> every;  // the largest distance, by sensor
    for (Run& run : set.runs) {
      if (run.time_s.size() < kLeastRows || UsualStep(run) > kQuasiStatic_s) continue;
      const auto note = [&](const std::string& sensor, int rows) {
        if (rows > 1) every[sensor] = std::max(every[sensor], rows);
      };
      const Eigen::Index rows = run.time_s.size();
      if (run.tip_m.cols() == 3 && run.tip_m.rows() == rows) {
        if (run.tip_quaternion.rows() == rows)
          note("the tip", Keep(run, run.tip_m, {run.tip_m, run.tip_quaternion}, find));
        else
          note("the tip", Keep(run, run.tip_m, {run.tip_m}, find));
      }
      for (Eigen::Index j = 0; j < run.tension_N.cols() && run.tension_N.rows() == rows; ++j) {
        note(fmt::format("tension {}", j + 1), Keep(run, run.tension_N.col(j), {run.tension_N.col(j)}, find));
      }
    }
    std::string names;
    for (const auto& [sensor, rows] : every)
      names += fmt::format("{}{} (every {} rows)", names.empty() ? "" : ", ", sensor, rows);
    if (!names.empty()) {
      said.push_back(fmt::format(
          "slower than the log, which {} between their readings: {}; only their own readings are used",
          between, names));
    }
  };
  look("repeats the last one", Held);
  look("interpolates", Interpolated);
  return said;
}

}  // namespace tendril::gap
