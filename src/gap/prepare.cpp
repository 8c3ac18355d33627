// The steps from a log to one uniform grid; what each kind of signal needs is in files of its own.
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

#include "gaps.h"
#include "health_signal.h"
#include "median.h"
#include "motor_angle.h"
#include "rest_position.h"
#include "smoothing.h"
#include "tracker_readings.h"
#include "within_steps.h"

namespace tendril::gap {
namespace {

constexpr double kSlowestGrid_s =
    0.01;  // slower logs are interpolated, since the body's motion is integrated on the grid
constexpr double kDerivativeHalf_s = 0.01;  // half width of the local polynomial for speed and acceleration
constexpr double kCoarse = 1.5;             // times a cell's own resolution and noise: a table's resolution
constexpr double kMostlyPause = 10;         // times the duration of its rows
// After lost samples: nothing is compared within the first time; a gap longer than the second loses
// friction's memory.
constexpr double kAfterGap_s = 0.3, kForgets_s = 0.1;
constexpr double kFastestRows_s = 1e-6;  // faster ones are times in another unit, and a grid without end

/// Rows without any data count as missing rows.
std::optional<Run> WithoutEmptyRows(const Run& run) {
  const Eigen::Index rows = run.time_s.size();
  std::vector<int> kept;
  for (Eigen::Index i = 0; i < rows; ++i) {
    bool any = false;
    for (const auto* values :
         {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad, &run.tension_N, &run.tip_m,
          &run.tip_quaternion, &run.bending_rad, &run.disks_m, &run.disk_quaternion})
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
  /// Step and number of samples. Throws std::runtime_error for too few rows, rows too close in time, and a
  /// pause that is most of the run.
  void MakeGrid() {
    out_.name = run_.name;
    out_.family = run_.family;
    out_.repeat_of = run_.repeat_of;
    out_.before = run_.before;
    if (rows_ < LeastRows(run_))
      throw std::runtime_error(
          fmt::format("{}: {} samples; accepted: at least {}", run_.name, rows_, LeastRows(run_)));

    const double usual_s = UsualStep(run_);
    if (usual_s < kFastestRows_s)
      throw std::runtime_error(fmt::format(
          "{}: its rows are {:.3g} s apart; accepted: {:g} s or more; t_s is in seconds, so convert it",
          run_.name, usual_s, kFastestRows_s));
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
  for (auto* values :
       {&out.torque_target_Nm, &out.torque_actual_Nm, &out.motor_position_rad, &out.tension_N, &out.tip_m,
        &out.tip_quaternion, &out.bending_rad, &out.disks_m, &out.disk_quaternion}) {
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

sim::Replay::DrivenBy BodyInputs(std::span<const PreparedRun> runs) {
  const bool cells =
      std::all_of(runs.begin(), runs.end(), [](const PreparedRun& r) { return r.has_cells(); }) &&
      std::any_of(runs.begin(), runs.end(), [](const PreparedRun& r) { return !r.without_cells(); });
  return cells ? sim::Replay::DrivenBy::kCell : sim::Replay::DrivenBy::kMotor;
}

void SubstituteMissingCells(PreparedRun& run, sim::Replay::DrivenBy driven_by, int tendons) {
  const bool by_cell = driven_by == sim::Replay::DrivenBy::kCell;
  if (by_cell && !run.cell_dropouts.empty()) {
    auto& no_cell = run.signals.no_cell;
    no_cell.setZero(run.samples(), tendons);
    for (const Dropout& dropout : run.cell_dropouts)
      no_cell.col(dropout.tendon).segment(dropout.from, dropout.size()).setOnes();
  }
  for (const Dropout& dropout : run.motor_dropouts) {
    const bool no_other = !by_cell || run.MissingSamples(run.cell_dropouts, dropout.tendon) == run.samples();
    if (!no_other || dropout.size() != run.samples()) continue;
    const bool tension = run.signals.tension_N.cols() > 0 && !by_cell;
    throw std::runtime_error(
        fmt::format("{}: {} of tendon {}{}", run.name,
                    tension ? "no motor position" : "neither tension nor motor position", dropout.tendon + 1,
                    tension ? ", and other runs have no load cells to drive the body" : ""));
  }
}

}  // namespace tendril::gap
