// Prepares a measured run for replay: one uniform grid, lost samples bridged and marked, encoder counts
// turned into a smooth angle with its derivatives. Simulates nothing.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "tendril/core/robot.h"
#include "tendril/gap/data_set.h"
#include "tendril/sim/replay.h"

namespace tendril::gap {

/// From this step on a torque loop settles, and a motor may turn back or rest unseen, between two samples.
constexpr double kSlowLog_s = 0.005;
/// Rows farther apart than this are states at rest, not a motion.
constexpr double kQuasiStatic_s = 0.2;
/// A gap that linear interpolation bridges.
constexpr double kBridged_s = 0.02;
/// The body has settled within this time.
constexpr double kBodySettles_s = 0.6;
/// A run of fewer rows is left out.
constexpr int kLeastRows = 20, kLeastStates = 5;

/// Samples [from, to) without data of a tendon's sensor, longer than interpolation bridges.
struct Dropout {
  int tendon = 0, from = 0, to = 0;

  int size() const { return to - from; }
};

/// One run on its grid, S samples, with its sensor data. For states at rest (signals.at_rest) every row is a
/// sample, whatever its time; times other than signals.time_s then count rows, `step_s` apart.
struct PreparedRun {
  std::string name, family, repeat_of, before;
  sim::ReplaySignals signals;
  double start_s = 0;       // time of the first sample in the log
  std::vector<char> valid;  // S: false where samples were lost, and shortly after
  Eigen::MatrixXd cell_N;   // S x M as read, NaN without a reading
  std::vector<Dropout> cell_dropouts;
  std::vector<double> cell_step_N;  // M: its resolution, or that of a table with fewer decimal places
  std::vector<std::vector<int>>
      cell_read;  // M: samples with a reading, for a cell slower than the log; else empty
  /// Gaps of target torque, actual torque and encoder bridged by interpolation (0 where the sensor never had
  /// data); results that need these samples are not available.
  std::vector<Dropout> target_dropouts, torque_dropouts, motor_dropouts;
  std::vector<char> driven;  // S: valid, and the inputs that move tendons and body are known
  /// For a run whose motors count from their rest position (Run::zero_at_rest), else 0 and empty: the first
  /// samples at rest, the cells' mean readings there (M; NaN: none), and the uncertainty of the motor zero
  /// derived from them (M): half a count, plus the effect of the cell's noise or, without a cell, of the
  /// pretension.
  int rest_samples = 0;
  Eigen::VectorXd rest_N, zero_open_rad;
  /// Gaps of a motor, or of all signals (tendon -1), in which it turned; the first moments of a run that
  /// begins in motion.
  std::vector<Dropout> moved_unseen;
  /// S x M: the motor is known to slide in one direction. Around reversals and at rest an encoder cannot show
  /// how far friction in motor and gear has reversed, so torque does not determine tension there.
  Eigen::Matrix<char, Eigen::Dynamic, Eigen::Dynamic> sliding;
  // Tracker: P samples at their own times.
  Eigen::VectorXd tracker_s;           // since start_s
  Eigen::MatrixXd tip_m;               // P x 3, empty without position
  std::vector<Eigen::Matrix3d> tip_R;  // P, empty without orientation
  Eigen::MatrixXd bending_rad;  // P x 2K, (us, vs) per section; empty where position or orientation exists
  double tip_step_m = 0, tip_step_rad = 0,
         bending_step_rad = 0;  // resolution of a table with few decimal places
  // Time stamps.
  double jitter_s = 0;  // rms against the grid
  int lost = 0;         // grid points without a sample

  int samples() const { return static_cast<int>(valid.size()); }
  /// Number of tendon j's samples in these gaps.
  int MissingSamples(const std::vector<Dropout>& dropouts, int j) const {
    int sum = 0;
    for (const Dropout& dropout : dropouts) sum += dropout.tendon == j ? dropout.size() : 0;
    return sum;
  }
  /// Sets tendon j's samples in these gaps to NaN.
  void TakeOut(const std::vector<Dropout>& dropouts, int j, Eigen::VectorXd& samples) const {
    for (const Dropout& dropout : dropouts) {
      if (dropout.tendon == j) samples.segment(dropout.from, dropout.size()).setConstant(NAN);
    }
  }
  /// True when the gaps leave samples of at least one of this many tendons.
  bool LeaveSamples(const std::vector<Dropout>& dropouts, Eigen::Index tendons) const {
    for (int j = 0; j < tendons; ++j) {
      if (MissingSamples(dropouts, j) < samples()) return true;
    }
    return false;
  }
  /// Shifts the tracker's readings to the drives' clock; readings that leave the run are dropped.
  void MoveTracker(double by_s);
  /// No tendon's motor position is known.
  bool without_motors() const { return !LeaveSamples(motor_dropouts, signals.motor_angle_rad.cols()); }
  /// Load cells are recorded, whether or not one of them has a reading.
  bool has_cells() const { return signals.load_cell != LoadCellPlace::kNone && signals.tension_N.cols() > 0; }
  /// No tendon's load cell has a reading.
  bool without_cells() const {
    return !has_cells() || !LeaveSamples(cell_dropouts, signals.tension_N.cols());
  }
  /// Enough readings to compare with.
  bool tracked() const { return tracker_s.size() > (signals.at_rest ? kLeastStates - 1 : 10); }
};

/// A run of these rows only.
Run OfRows(const Run& run, const std::vector<int>& rows);

/// Median time from row to row.
double UsualStep(const Run& run);

/// Number of rows that Prepare needs: kLeastRows, or kLeastStates for a log of states at rest.
int LeastRows(const Run& run);

/// Random draws within the resolution of encoder, cells and tracker. Without a seed Prepare takes the most
/// likely reading; with a seed it draws one that would have been recorded identically. The spread of
/// simulations over such draws is the uncertainty due to sensor resolution.
PreparedRun Prepare(const Run& run, const RobotParameters& robot, std::optional<std::uint64_t> seed = {});

/// What drives the body in runs that are simulated alike: the load cells where all of them have some and at
/// least one has readings, else the motors' positions by the tendons' stretch.
sim::Replay::DrivenBy BodyInputs(std::span<const PreparedRun> runs);

/// Where load cells drive the body and one of them has no reading, the tendon's stretch between motor and
/// body stands in for it (signals.no_cell). Throws std::runtime_error naming a tendon whose tension remains
/// unknown.
void SubstituteMissingCells(PreparedRun& run, sim::Replay::DrivenBy driven_by, int tendons);

}  // namespace tendril::gap
