// Grid, gaps, encoder, tracker. An encoder count is an interval that contains the motor angle; where the
// count changes, the motor is at the interval's border, which is known far more accurately than the count.
#include "prepare.h"

#include <fmt/core.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <random>
#include <stdexcept>

#include "health_signal.h"
#include "median.h"

namespace tendril::gap {
namespace {

constexpr double kSlowestGrid_s =
    0.01;  // slower logs are interpolated, since the body's motion is integrated on the grid
constexpr double kDerivativeHalf_s = 0.01;  // half width of the local polynomial for speed and acceleration
constexpr double kSettle_s = 0.02;          // a motor that stays within one count for this long is at rest
constexpr double kSlidingCounts =
    4;                            // 12 mrad at 2048 counts: friction in motor and gear has reversed by then
constexpr double kSlow_s = 0.05;  // a motor with a longer time between counts may be at rest
constexpr double kAtOnce_s =
    0.01;  // and so may one with twice the previous time between counts, if longer than this
constexpr int kWidestSmoothing = 150;  // samples on either side, for a cell's reading at rest
constexpr double kCoarse = 1.5;        // times a cell's own resolution and noise: a table's resolution
constexpr double kCoarseTurn = 2e-3;   // of a quaternion's numbers: more than the noise of trackers
constexpr double kMostlyPause = 10;    // times the duration of its rows
constexpr double kOwnSteps = 2.5;      // and this many steps of a sensor that is slower than the log
// After lost samples: nothing is compared within the first time; a gap longer than the second loses
// friction's memory, unless the motor stood still for the third on both sides.
constexpr double kAfterGap_s = 0.3, kForgets_s = 0.1, kStoodStill_s = 0.1;

/// Local polynomial of degree 4 through 2h+1 equally spaced points: weights for value, first and second
/// derivative (per sample) at the middle.
struct LocalPolynomial {
  explicit LocalPolynomial(int half_width) : half(half_width) {
    const int n = 2 * half + 1;
    const int degree = std::min(4, n - 1);
    Eigen::MatrixXd powers(n, degree + 1);
    for (int i = 0; i < n; ++i) {
      for (int d = 0; d <= degree; ++d)
        powers(i, d) = std::pow((i - half) / static_cast<double>(std::max(half, 1)), d);
    }
    const Eigen::MatrixXd solve = (powers.transpose() * powers).ldlt().solve(powers.transpose());
    const double scale = std::max(half, 1);
    value = solve.row(0);
    first = degree >= 1 ? Eigen::RowVectorXd(solve.row(1) / scale) : Eigen::RowVectorXd::Zero(n);
    second =
        degree >= 2 ? Eigen::RowVectorXd(2 * solve.row(2) / (scale * scale)) : Eigen::RowVectorXd::Zero(n);
  }
  int half;
  Eigen::RowVectorXd value, first, second;
};

/// Linear between knots, constant outside.
class Interpolator {
 public:
  void Add(double t, double y) {
    t_.push_back(t);
    y_.push_back(y);
  }
  double operator()(double t) {
    if (t <= t_.front()) return y_.front();
    if (t >= t_.back()) return y_.back();
    while (t_[at_ + 1] < t) ++at_;
    while (t_[at_] > t) --at_;
    const double s = (t - t_[at_]) / (t_[at_ + 1] - t_[at_]);
    return y_[at_] + s * (y_[at_ + 1] - y_[at_]);
  }
  bool empty() const { return t_.empty(); }

 private:
  std::vector<double> t_, y_;
  std::size_t at_ = 0;
};

/// True when the readings change by whole counts.
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

/// Whole counts for interpolated samples as well (`read`: samples with a reading).
void CountThroughDropouts(Eigen::Ref<Eigen::VectorXd> angle, const std::vector<char>& read, double count) {
  for (Eigen::Index i = 1; i < angle.size(); ++i) {
    if (read[static_cast<std::size_t>(i)]) continue;
    angle[i] = angle[i - 1] + count * std::round((angle[i] - angle[i - 1]) / count);
  }
}

/// Angle within the counts: at the border where the count changes by one, at the reading where the motor is
/// faster. Where it rests or reverses within a count the travel is unknown: half way, or with `random`
/// anywhere. Starts at the middle of its count if `in_middle`.
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

/// Removes white noise of rms `noise` from a signal that is smooth most of the time: each sample becomes the
/// mean over the widest window in which a straight line leaves no more than the noise, so rest is smoothed
/// strongly and fast changes are not. Without this, friction memories driven by noise would creep.
Eigen::VectorXd Denoised(const Eigen::VectorXd& signal, double noise) {
  const int n = static_cast<int>(signal.size());
  if (noise <= 0 || !signal.allFinite()) return signal;
  // Sums up to each sample, of the signal less its mean for precision.
  const double mean = signal.mean();
  Eigen::VectorXd y(n + 1), ty(n + 1), yy(n + 1);
  y[0] = ty[0] = yy[0] = 0;
  for (int i = 0; i < n; ++i) {
    const double v = signal[i] - mean;
    y[i + 1] = y[i] + v;
    ty[i + 1] = ty[i] + i * v;
    yy[i + 1] = yy[i] + v * v;
  }
  Eigen::VectorXd smooth = signal;
  for (int i = 0; i < n; ++i) {
    for (int half = 3; half <= kWidestSmoothing; half = half * 3 / 2) {
      const int a = i - half, b = i + half + 1;
      if (a < 0 || b > n) break;
      const double count = 2 * half + 1;
      const double sum = y[b] - y[a];
      const double slope_sum = ty[b] - ty[a] - i * sum;  // of (k - i) v
      const double spread = half * (half + 1.0) * count / 3;
      const double left = yy[b] - yy[a] - sum * sum / count - slope_sum * slope_sum / spread;
      // Three standard deviations of the residual of white noise; shorter windows must have passed as well.
      if (left > noise * noise * (count - 2) * (1 + 3 * std::sqrt(2 / (count - 2)))) break;
      smooth[i] = mean + sum / count;
    }
  }
  return smooth;
}

/// Samples where a motor has moved in one direction by kSlidingCounts since it reversed or rested, and soon
/// reaches the next count. At rest and where samples were lost, its friction is unknown.
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

/// Marks the time after samples [from, to) of a tendon (or of all, tendon -1) were lost: the body's position
/// and the direction of pulley friction are unknown if anything moved.
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

/// Rest position of motors that count from it, as far as cells and counts (S x M) determine it.
void FindRest(const RobotParameters& robot, const Eigen::MatrixXd& reading, PreparedRun& out) {
  constexpr double kRest_s = 0.5;     // initial rest of a run
  constexpr double kStillCounts = 3;  // creep of a tendon while friction settles
  constexpr double kSigmas = 3;
  const auto tendons = reading.cols();
  const auto count_of = [&](Eigen::Index j) {
    const int counts = robot.actuation->tendons[static_cast<std::size_t>(j)].drive.encoder_counts_per_turn;
    return counts > 0 ? 2 * std::numbers::pi / counts : 0;
  };
  const auto still = [&](int i) {
    for (Eigen::Index j = 0; j < tendons; ++j) {
      if (!(std::abs(reading(i, j) - reading(0, j)) <= kStillCounts * count_of(j))) return false;
    }
    return true;
  };
  const int longest =
      out.signals.at_rest ? 1 : std::min(out.samples(), 1 + static_cast<int>(kRest_s / out.signals.step_s));
  out.rest_samples = 1;
  while (out.rest_samples < longest && still(out.rest_samples)) ++out.rest_samples;
  out.rest_N.setConstant(tendons, std::nan(""));
  out.zero_open_rad.setZero(tendons);
  for (Eigen::Index j = 0; j < tendons; ++j) {
    const auto& p = robot.actuation->tendons[static_cast<std::size_t>(j)];
    const double N_per_rad = p.tendon.stiffness_Npm * p.SpoolTravelPerMotorRad();
    double sum_N = 0, count = 0;
    for (int i = 0; i < (j < out.cell_N.cols() ? out.rest_samples : 0); ++i) {
      if (std::isfinite(out.cell_N(i, j))) sum_N += out.cell_N(i, j), count += 1;
    }
    out.zero_open_rad[j] = 0.5 * count_of(j);
    if (count > 0) {
      out.rest_N[j] = sum_N / count;
      const double noise_N =
          std::hypot(p.load_cell.noise_N, out.cell_step_N[static_cast<std::size_t>(j)] / std::sqrt(12.0));
      out.zero_open_rad[j] += kSigmas * noise_N / std::sqrt(count) / N_per_rad;
    } else {
      out.zero_open_rad[j] += robot.limits.min_tension_N / N_per_rad;
    }
  }
}

/// Rows without any data count as missing rows.
std::optional<Run> WithoutEmptyRows(const Run& run) {
  const Eigen::Index rows = run.time_s.size();
  std::vector<int> kept;
  for (Eigen::Index i = 0; i < rows; ++i) {
    bool any = false;
    for (const auto* values : {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad,
                               &run.tension_N, &run.tip_m, &run.tip_quaternion, &run.bending_rad})
      any = any || (values->rows() == rows && values->row(i).array().isFinite().any());
    if (any) kept.push_back(static_cast<int>(i));
  }
  if (kept.empty() || static_cast<Eigen::Index>(kept.size()) == rows) return std::nullopt;
  return OfRows(run, kept);
}

/// Step of the grid of the stamps. A single step has the resolution of a stamp (a date in seconds leaves 1e-7
/// s), which accumulates over a run, so the mean of all steps without gaps is used.
double GridStep(const Run& run, double usual_s) {
  double sum_s = 0, count = 0;
  for (Eigen::Index i = 1; i < run.time_s.size(); ++i) {
    const double step_s = run.time_s[i] - run.time_s[i - 1];
    if (std::abs(step_s - usual_s) > 0.5 * usual_s) continue;
    sum_s += step_s;
    count += 1;
  }
  return count > 0 ? sum_s / count : usual_s;
}

/// Rounding error of a reading within its step: constant while the reading is constant.
class WithinSteps {
 public:
  WithinSteps(double step, std::mt19937_64& random) : part_(-0.5 * step, 0.5 * step), random_(random) {}
  double At(double reading) {
    if (reading != last_) off_ = part_(random_);
    last_ = reading;
    return off_;
  }

 private:
  std::uniform_real_distribution<double> part_;
  std::mt19937_64& random_;
  double last_ = NAN, off_ = 0;
};

/// Gaps of column j longer than interpolation bridges: everywhere for a sensor that is always slower, or has
/// hardly any readings. `at`: grid sample of each row.
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

/// Shape signals of the rows at samples `at`. Bending adds nothing to a tip pose from the same sensor.
void ReadTracker(const Run& run, const RobotParameters& robot, const std::vector<int>& at,
                 std::optional<std::uint64_t> seed, std::mt19937_64& random, PreparedRun& out) {
  const auto rows = static_cast<int>(run.time_s.size());
  const auto measured = [&](const Eigen::MatrixXd& values, Eigen::Index columns) {
    return values.cols() == columns && values.rows() == rows && values.array().isFinite().any();
  };
  const auto sections = static_cast<Eigen::Index>(robot.body.sections.size());
  const bool placed = measured(run.tip_m, 3), turned = measured(run.tip_quaternion, 4);
  const bool bent = !placed && !turned && measured(run.bending_rad, 2 * sections);
  if (!placed && !turned && !bent) return;
  const double turn_step = run.tip_quaternion_step;
  if (placed) {
    for (const auto axis : run.tip_m.colwise()) out.tip_step_m = std::max(out.tip_step_m, DecimalStep(axis));
  }
  if (bent) {
    for (const auto bend : run.bending_rad.colwise())
      out.bending_step_rad = std::max(out.bending_step_rad, DecimalStep(bend));
  }
  out.tip_step_rad = 2 * turn_step;
  std::vector<WithinSteps> within(4, WithinSteps(turn_step, random));
  std::vector<int> seen;
  for (int i = 0; i < rows; ++i) {
    const bool whole =
        (!placed || run.tip_m.row(i).allFinite()) && (!bent || run.bending_rad.row(i).allFinite()) &&
        (!turned || (run.tip_quaternion.row(i).allFinite() && run.tip_quaternion.row(i).norm() > 0.5));
    if (whole && out.valid[static_cast<std::size_t>(at[static_cast<std::size_t>(i)])]) seen.push_back(i);
  }
  out.tracker_s.resize(static_cast<Eigen::Index>(seen.size()));
  if (placed) out.tip_m = run.tip_m(seen, Eigen::all);
  if (bent) out.bending_rad = run.bending_rad(seen, Eigen::all);
  for (std::size_t k = 0; k < seen.size(); ++k) {
    const int i = seen[k];
    out.tracker_s[static_cast<Eigen::Index>(k)] =
        out.signals.at_rest ? i * out.signals.step_s : run.time_s[i] - out.start_s;
    if (!turned) continue;
    Eigen::Vector4d w = run.tip_quaternion.row(i).transpose();
    for (int n = 0; n < 4 && seed && turn_step > kCoarseTurn; ++n)
      w[n] += within[static_cast<std::size_t>(n)].At(w[n]);
    w.normalize();
    Eigen::Quaterniond orientation(w[0], w[1], w[2], w[3]);
    if (seed && robot.actuation && robot.actuation->tracker) {
      std::normal_distribution<double> normal;
      const double rms = 0.5 * robot.actuation->tracker->orientation_noise_rad;
      const Eigen::Quaterniond turn(1, rms * normal(random), rms * normal(random), rms * normal(random));
      orientation = (orientation * turn).normalized();
    }
    out.tip_R.push_back(orientation.toRotationMatrix());
  }
}

/// The steps of Prepare, in order, and what they share.
class Preparing {
 public:
  Preparing(const Run& run, const RobotParameters& robot, std::optional<std::uint64_t> seed)
      : run_(run),
        robot_(robot),
        seed_(seed),
        rows_(static_cast<int>(run.time_s.size())),
        tendons_(robot.body.tendons()),
        random_(seed.value_or(0)) {}

  PreparedRun Result() {
    MakeGrid();
    PlaceRows();
    TakeDriveSignals();
    FindCellSteps();
    if (seed_ && robot_.actuation) DrawWithinNoise();
    if (robot_.actuation && !out_.signals.at_rest) SmoothTensions();
    if (run_.motor_position_rad.cols() == tendons_) {
      TakeMotors();
    } else {
      LeaveMotorsUnknown();
    }
    MarkUnrecordedMotion();
    ReadTracker(run_, robot_, at_, seed_, random_, out_);
    return std::move(out_);
  }

 private:
  /// Step and number of samples. Throws std::runtime_error for too few rows and for a pause that is most of
  /// the run.
  void MakeGrid() {
    out_.name = run_.name;
    out_.family = run_.family;
    out_.repeat_of = run_.repeat_of;
    out_.before = run_.before;
    if (rows_ < LeastRows(run_))
      throw std::runtime_error(
          fmt::format("{}: {} samples; accepted: at least {}", run_.name, rows_, LeastRows(run_)));

    const double usual_s = UsualStep(run_);
    const bool at_rest = usual_s > kQuasiStatic_s;
    sampled_s_ = at_rest ? usual_s : GridStep(run_, usual_s);
    out_.signals.at_rest = at_rest;
    if (at_rest) out_.signals.time_s = run_.time_s.array() - run_.time_s[0];
    refine_ = at_rest ? 1 : static_cast<int>(std::max(1.0, std::ceil(sampled_s_ / kSlowestGrid_s - 1e-6)));
    step_s_ = sampled_s_ / refine_;
    out_.start_s = run_.time_s[0];
    out_.signals.step_s = step_s_;
    out_.signals.load_cell = run_.load_cell;
    // In a log of every cycle, a target acts one row after it was sent.
    if (refine_ == 1 && step_s_ > 0.4e-3 && step_s_ < 6e-3) out_.signals.command_delay_s = step_s_;
    const double steps = at_rest ? rows_ - 1 : std::round((run_.time_s[rows_ - 1] - out_.start_s) / step_s_);
    // Interpolation across a pause has no information, however long it is.
    if (!at_rest && steps >= kMostlyPause * rows_ * refine_) RefusePause();
    samples_ = static_cast<int>(steps) + 1;
    memory_ = static_cast<int>(kAfterGap_s / step_s_);
  }

  [[noreturn]] void RefusePause() const {
    const Eigen::VectorXd& t = run_.time_s;
    int at = 1;
    for (int i = 1; i < rows_; ++i) {
      if (t[i] - t[i - 1] > t[at] - t[at - 1]) at = i;
    }
    throw std::runtime_error(fmt::format(
        "{}: its {} rows of {:.3g} s each span {:.4g} s, with a jump of {:.4g} s to {:.10g} s: a pause or a "
        "wrong time stamp; cut the run there",
        run_.name, rows_, sampled_s_, t[rows_ - 1] - out_.start_s, t[at] - t[at - 1], t[at]));
  }

  /// The sample of each row, and the samples without a row.
  void PlaceRows() {
    at_.resize(static_cast<std::size_t>(rows_));
    double square = 0;
    for (int i = 0; i < rows_; ++i) {
      const double exact = out_.signals.at_rest ? i : (run_.time_s[i] - out_.start_s) / step_s_;
      at_[i] = std::clamp(static_cast<int>(std::llround(exact)), 0, samples_ - 1);
      square += std::pow((exact - at_[i]) * step_s_, 2);
    }
    out_.jitter_s = std::sqrt(square / rows_);
    out_.valid.assign(samples_, 1);
    for (int i = 1; i < rows_; ++i) {
      const int between = at_[i] - at_[i - 1];
      if (between > refine_) out_.lost += between / refine_ - 1;
      // A few lost samples are bridged; after a longer gap the friction memories are unknown.
      if (between > 5 * refine_ && between * step_s_ > kBridged_s) {
        if (between * step_s_ > kForgets_s) lost_.emplace_back(at_[i - 1] + 1, at_[i]);
        for (int k = at_[i - 1] + 1; k < std::min(samples_, at_[i] + memory_); ++k) out_.valid[k] = 0;
      }
    }
    out_.driven = out_.valid;
  }

  /// Columns of rows on the grid, interpolated; NaN for a column without readings.
  Eigen::MatrixXd OnGrid(const Eigen::MatrixXd& values) const {
    Eigen::MatrixXd grid(samples_, values.cols());
    for (int j = 0; j < values.cols(); ++j) {
      Interpolator line;
      for (int i = 0; i < rows_; ++i) {
        if (std::isfinite(values(i, j))) line.Add(step_s_ * at_[i], values(i, j));
      }
      if (line.empty()) {
        grid.col(j).setConstant(NAN);
        continue;
      }
      for (int i = 0; i < samples_; ++i) grid(i, j) = line(step_s_ * i);
    }
    return grid;
  }

  /// The dropouts of each tendon's sensor; a column of `grid` without readings becomes 0.
  void TakeDropouts(const Eigen::MatrixXd& values, Eigen::MatrixXd& grid, std::vector<Dropout>& dropouts) {
    if (values.cols() != tendons_) return;
    for (int j = 0; j < tendons_; ++j) {
      FindDropouts(values, at_, samples_, step_s_, out_.signals.at_rest, j, dropouts);
      if (!grid.col(j).allFinite()) grid.col(j).setZero();
    }
  }

  /// Torques and tensions.
  void TakeDriveSignals() {
    auto& s = out_.signals;
    if (run_.torque_target_Nm.cols() == tendons_) s.torque_target_Nm = OnGrid(run_.torque_target_Nm);
    if (run_.torque_actual_Nm.cols() == tendons_) s.torque_actual_Nm = OnGrid(run_.torque_actual_Nm);
    if (run_.tension_N.cols() == tendons_) {
      s.tension_N = OnGrid(run_.tension_N);
      out_.cell_N = s.tension_N;
      for (int j = 0; j < tendons_; ++j) {
        for (int i = 0; i < samples_; ++i) {
          if (!out_.valid[i]) out_.cell_N(i, j) = NAN;
        }
        FindDropouts(run_.tension_N, at_, samples_, step_s_, s.at_rest, j, out_.cell_dropouts);
      }
      for (const Dropout& dropout : out_.cell_dropouts) {
        out_.cell_N.col(dropout.tendon).segment(dropout.from, dropout.size()).setConstant(NAN);
        if (dropout.size() == samples_) s.tension_N.col(dropout.tendon).setZero();
      }
    }
    TakeDropouts(run_.torque_target_Nm, s.torque_target_Nm, out_.target_dropouts);
    TakeDropouts(run_.torque_actual_Nm, s.torque_actual_Nm, out_.torque_dropouts);
  }

  static double OwnStep_N(const LoadCellParameters& cell) {
    return cell.gain_VpN > 0 ? cell.resolution_V / cell.gain_VpN : 0;
  }

  /// When each cell was read, and in which steps.
  void FindCellSteps() {
    const Eigen::Index cells = out_.signals.tension_N.cols();
    for (int j = 0; j < cells; ++j) {
      std::vector<int>& read = out_.cell_read.emplace_back();
      if (Median(RowsApart(run_.tension_N.col(j))) <= 1) continue;
      for (int i = 0; i < rows_; ++i) {
        if (std::isfinite(run_.tension_N(i, j))) read.push_back(at_[static_cast<std::size_t>(i)]);
      }
    }
    out_.cell_step_N.assign(static_cast<std::size_t>(cells), 0);
    for (int j = 0; j < cells && robot_.actuation; ++j) {
      out_.cell_step_N[static_cast<std::size_t>(j)] =
          std::max(OwnStep_N(robot_.actuation->tendons[j].load_cell), DecimalStep(run_.tension_N.col(j)));
    }
  }

  /// Adds another draw of noise and rounding to torques and tensions.
  void DrawWithinNoise() {
    auto& s = out_.signals;
    std::normal_distribution<double> normal;
    for (int j = 0; j < tendons_; ++j) {
      const auto& p = robot_.actuation->tendons[j];
      const double permille = 1e-3 * p.drive.rated_torque_Nm;
      const double torque = permille * std::hypot(p.drive.actual_torque_noise_permille, std::sqrt(1.0 / 12));
      for (int i = 0; i < s.torque_actual_Nm.rows(); ++i)
        s.torque_actual_Nm(i, j) += torque * normal(random_);
      if (j >= s.tension_N.cols()) continue;
      const double cell_step_N = out_.cell_step_N[static_cast<std::size_t>(j)];
      if (cell_step_N > kCoarse * std::max(OwnStep_N(p.load_cell), p.load_cell.noise_N)) {
        // In a coarse table the rounding error is constant until the reading changes.
        WithinSteps within(cell_step_N, random_);
        for (int i = 0; i < s.tension_N.rows(); ++i) {
          const double off_N = within.At(s.tension_N(i, j));
          s.tension_N(i, j) += off_N + p.load_cell.noise_N * normal(random_);
        }
        continue;
      }
      const double cell = std::hypot(p.load_cell.noise_N, cell_step_N / std::sqrt(12.0));
      for (int i = 0; i < s.tension_N.rows(); ++i) s.tension_N(i, j) += cell * normal(random_);
    }
  }

  void SmoothTensions() {
    auto& s = out_.signals;
    for (int j = 0; j < s.tension_N.cols(); ++j) {
      const auto& p = robot_.actuation->tendons[j].load_cell;
      const double noise =
          std::hypot(p.noise_N, out_.cell_step_N[static_cast<std::size_t>(j)] / std::sqrt(12.0));
      s.tension_N.col(j) = Denoised(s.tension_N.col(j), seed_ ? std::sqrt(2.0) * noise : noise);
      if (seed_) DrawBetweenReadings(j);
    }
  }

  /// The tension between two samples is uncertain by its change of slope: when a slack tendon catches, most
  /// of the impact may fall between samples.
  void DrawBetweenReadings(int j) {
    auto& s = out_.signals;
    std::uniform_real_distribution<double> part(-0.5, 0.5);
    const Eigen::VectorXd read = s.tension_N.col(j);
    const std::vector<int>& at_read = out_.cell_read[static_cast<std::size_t>(j)];
    const auto count = at_read.empty() ? samples_ : static_cast<int>(at_read.size());
    const auto sample = [&](int k) { return at_read.empty() ? k : at_read[static_cast<std::size_t>(k)]; };
    // The time of a reading within its row is uncertain too, where they slip.
    const bool slips = Slips(RowsApart(run_.tension_N.col(j)));
    Interpolator by;  // change of the readings
    by.Add(-1, 0);
    for (int k = 1; k + 1 < count; ++k) {
      const int a = sample(k - 1), b = sample(k), c = sample(k + 1);
      double moved = part(random_) * (read[a] - 2 * read[b] + read[c]);
      if (slips) moved += part(random_) * refine_ * (read[c] - read[a]) / (c - a);
      by.Add(b, moved);
    }
    by.Add(samples_, 0);
    for (int i = 1; i + 1 < samples_; ++i) s.tension_N(i, j) += by(i);
  }

  void LeaveMotorsUnknown() {
    auto& s = out_.signals;
    for (int j = 0; j < tendons_; ++j) out_.motor_dropouts.push_back({j, 0, samples_});
    s.no_motor.assign(static_cast<std::size_t>(tendons_), 1);
    out_.sliding.setZero(samples_, tendons_);
    for (auto* motion : {&s.motor_angle_rad, &s.motor_velocity_radps, &s.motor_acceleration_radps2})
      motion->setZero(samples_, tendons_);
  }

  /// S x M: torque and motor position are known.
  Eigen::Matrix<char, -1, -1> TorqueAndMotorKnown() const {
    Eigen::Matrix<char, -1, -1> both(samples_, tendons_);
    for (int i = 0; i < samples_; ++i) both.row(i).setConstant(out_.valid[static_cast<std::size_t>(i)]);
    for (const auto* dropouts : {&out_.torque_dropouts, &out_.motor_dropouts}) {
      for (const Dropout& dropout : *dropouts)
        both.col(dropout.tendon).segment(dropout.from, dropout.size()).setZero();
    }
    return both;
  }

  void TakeMotors() {
    auto& s = out_.signals;
    Eigen::MatrixXd reading = OnGrid(run_.motor_position_rad);
    TakeDropouts(run_.motor_position_rad, reading, out_.motor_dropouts);
    if (run_.zero_at_rest && robot_.actuation) FindRest(robot_, reading, out_);
    for (const Dropout& dropout : out_.motor_dropouts) {
      s.no_motor.resize(static_cast<std::size_t>(tendons_), 0);
      if (dropout.size() == samples_) s.no_motor[static_cast<std::size_t>(dropout.tendon)] = 1;
    }
    const Eigen::Matrix<char, -1, -1> both = TorqueAndMotorKnown();
    out_.sliding.setZero(samples_, tendons_);
    s.motor_angle_rad.resize(samples_, tendons_);
    s.motor_velocity_radps.resize(samples_, tendons_);
    s.motor_acceleration_radps2.resize(samples_, tendons_);
    // The dependence of speed and acceleration on the window is part of the encoder's uncertainty.
    constexpr std::array<double, 4> kOtherWidths{0.6, 0.8, 1.25, 1.6};
    const double half_s = kDerivativeHalf_s * (seed_ ? kOtherWidths[*seed_ % kOtherWidths.size()] : 1);
    const LocalPolynomial local(std::max(2, static_cast<int>(std::lround(half_s / step_s_))));
    for (int j = 0; j < tendons_; ++j) {
      const int counts = robot_.actuation ? robot_.actuation->tendons[j].drive.encoder_counts_per_turn : 0;
      const double count =
          counts > 0 ? std::max(2 * std::numbers::pi / counts, DecimalStep(run_.motor_position_rad.col(j)))
                     : 0;
      const Eigen::VectorXd angle = AngleWithinCounts(j, reading.col(j), count);
      if (s.at_rest) {
        s.motor_angle_rad.col(j) = angle;
        s.motor_velocity_radps.col(j).setZero();
        s.motor_acceleration_radps2.col(j).setZero();
        continue;
      }
      MarkSliding(reading.col(j), both.col(j), count > 0 ? count : 3e-3, step_s_, sampled_s_,
                  out_.sliding.col(j));
      Differentiate(j, angle, local);
    }
  }

  /// Of motor j, from its reading on the grid; `count` in rad, 0: unknown.
  Eigen::VectorXd AngleWithinCounts(int j, Eigen::VectorXd angle, double count) {
    std::uniform_real_distribution<double> anywhere(0, 1);
    if (count > 0 && out_.signals.at_rest) {
      for (int i = 0; i < samples_ && seed_; ++i) angle[i] += (anywhere(random_) - 0.5) * count;
    } else if (count > 0 && Quantised(refine_ == 1 ? run_.motor_position_rad.col(j).eval() : angle, count)) {
      if (refine_ == 1) {
        std::vector<char> read(static_cast<std::size_t>(samples_), 0);
        for (int i = 0; i < rows_; ++i)
          read[static_cast<std::size_t>(at_[i])] = std::isfinite(run_.motor_position_rad(i, j));
        CountThroughDropouts(angle, read, count);
      }
      angle = InsideCounts(angle, count, step_s_, !run_.zero_at_rest, seed_ ? &random_ : nullptr);
    }
    return angle;
  }

  void Differentiate(int j, const Eigen::VectorXd& angle, const LocalPolynomial& local) {
    auto& s = out_.signals;
    const int h = local.half;
    Eigen::VectorXd padded(samples_ + 2 * h);
    padded << Eigen::VectorXd::Constant(h, angle[0]), angle,
        Eigen::VectorXd::Constant(h, angle[samples_ - 1]);
    for (int i = 0; i < samples_; ++i) {
      const auto window = padded.segment(i, 2 * h + 1);
      s.motor_angle_rad(i, j) = angle[i];  // not smoothed: its turning points matter for friction
      s.motor_velocity_radps(i, j) = (local.first * window).value() / step_s_;
      s.motor_acceleration_radps2(i, j) = (local.second * window).value() / (step_s_ * step_s_);
    }
  }

  void MarkUnrecordedMotion() {
    const auto& s = out_.signals;
    if (s.at_rest) return;
    // A log that begins in motion has the same unknown history.
    constexpr double kTurned_rad = 0.02;
    if (s.motor_angle_rad.cols() > 0 && s.motor_angle_rad.row(0).cwiseAbs().maxCoeff() > kTurned_rad)
      MarkMoved(-1, 0, std::min(samples_, memory_), out_);
    for (const auto& [from, to] : lost_) MarkMoved(-1, from, to, out_);
    // Pulleys slide with a motor whose position is unknown for a while.
    for (const Dropout& dropout : out_.motor_dropouts) {
      if (dropout.size() == samples_) continue;
      std::fill(out_.driven.begin() + dropout.from, out_.driven.begin() + dropout.to, char{0});
      MarkMoved(dropout.tendon, dropout.from, dropout.to, out_);
    }
  }

  const Run& run_;
  const RobotParameters& robot_;
  const std::optional<std::uint64_t> seed_;
  const int rows_, tendons_;
  std::mt19937_64 random_;
  double sampled_s_ = 0, step_s_ = 0;      // of the log, and of the grid
  int refine_ = 1;                         // grid steps from row to row
  int samples_ = 0, memory_ = 0;           // of the run, and after a gap until friction is known again
  std::vector<int> at_;                    // sample of each row
  std::vector<std::pair<int, int>> lost_;  // ranges of samples without rows that friction does not survive
  PreparedRun out_;
};

}  // namespace

void PreparedRun::MoveTracker(double by_s) {
  if (by_s == 0) return;
  const double end_s = (samples() - 1) * signals.step_s;
  int kept = 0;
  for (int k = 0; k < tracker_s.size(); ++k) {
    const double moved_s = tracker_s[k] + by_s;
    if (moved_s < 0 || moved_s > end_s) continue;
    tracker_s[kept] = moved_s;
    for (Eigen::MatrixXd* readings : {&tip_m, &bending_rad}) {
      if (readings->rows() > 0) readings->row(kept) = readings->row(k).eval();
    }
    if (!tip_R.empty()) tip_R[static_cast<std::size_t>(kept)] = tip_R[static_cast<std::size_t>(k)];
    ++kept;
  }
  tracker_s.conservativeResize(kept);
  for (Eigen::MatrixXd* readings : {&tip_m, &bending_rad}) {
    if (readings->rows() > 0) readings->conservativeResize(kept, readings->cols());
  }
  if (!tip_R.empty()) tip_R.resize(static_cast<std::size_t>(kept));
}

Run OfRows(const Run& run, const std::vector<int>& rows) {
  Run out = run;
  out.time_s = run.time_s(rows);
  for (auto* values : {&out.torque_target_Nm, &out.torque_actual_Nm, &out.motor_position_rad, &out.tension_N,
                       &out.tip_m, &out.tip_quaternion, &out.bending_rad}) {
    if (values->rows() == run.time_s.size()) *values = (*values)(rows, Eigen::all).eval();
  }
  return out;
}

double UsualStep(const Run& run) {
  std::vector<double> steps;
  for (Eigen::Index i = 1; i < run.time_s.size(); ++i) steps.push_back(run.time_s[i] - run.time_s[i - 1]);
  return Median(std::move(steps));
}

int LeastRows(const Run& run) { return UsualStep(run) > kQuasiStatic_s ? kLeastStates : kLeastRows; }

PreparedRun Prepare(const Run& run, const RobotParameters& robot, std::optional<std::uint64_t> seed) {
  if (const auto less = WithoutEmptyRows(run)) return Prepare(*less, robot, seed);
  return Preparing(run, robot, seed).Result();
}

}  // namespace tendril::gap
