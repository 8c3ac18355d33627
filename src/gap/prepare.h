// A measured run made fit for replay: one uniform grid, lost samples bridged and marked, encoder counts
// turned into a smooth angle with its derivatives. Simulates nothing.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "tendril/core/robot.h"
#include "tendril/gap/data_set.h"
#include "tendril/sim/replay.h"

namespace tendril::gap {

/// From this step on a torque loop settles, and a motor may turn or rest, unseen between two samples.
constexpr double kSlowLog_s = 0.005;
/// Rows further apart than this are states at rest, not a motion.
constexpr double kQuasiStatic_s = 0.2;
/// A hole that a straight line bridges.
constexpr double kBridged_s = 0.02;
/// The body has about come to where its tendons pull it.
constexpr double kBodySettles_s = 0.6;
/// A run of fewer rows is left out.
constexpr int kLeastRows = 20, kLeastStates = 5;

/// Samples [from, to) in which a tendon's sensor says nothing, longer than what a line bridges.
struct Hole {
  int tendon = 0, from = 0, to = 0;

  int size() const { return to - from; }
};

/// One run on its grid, S samples, with what the sensors said. Of states at rest (signals.at_rest) every row
/// is a sample, whenever it was; times other than signals.time_s then count rows, `step_s` apart.
struct PreparedRun {
  std::string name, family, repeat_of, before;
  sim::ReplaySignals signals;
  double start_s = 0;       // time of the first sample in the log
  std::vector<char> valid;  // S: false where samples were lost, and shortly after
  Eigen::MatrixXd cell_N;   // S x M as read, NaN where nothing was
  std::vector<Hole> cell_holes;
  std::vector<double> cell_step_N;  // M: its resolution, or that of a table with fewer places
  std::vector<std::vector<int>>
      cell_read;  // M: at which samples, where it is slower than the log; else empty
  /// Where a straight line stands for target torque, actual torque or encoder (0 where nothing ever was),
  /// and what needs them cannot be told.
  std::vector<Hole> target_holes, torque_holes, motor_holes;
  std::vector<char> driven;  // S: valid, and what moves tendons and body is known
  /// Of a run whose motors count from where they rested (Run::zero_at_rest), else 0 and empty: the first
  /// samples at rest, what the cells read there in the mean (M; NaN: nothing), and how far from the zero that
  /// follows the true one may be (M): half a count, and what the cell's noise or, without it, the least
  /// tension makes.
  int rest_samples = 0;
  Eigen::VectorXd rest_N, zero_open_rad;
  /// Holes of a motor, or of all that was recorded (tendon -1), in which it turned; the first moments of a
  /// run that begins on the way.
  std::vector<Hole> moved_unseen;
  /// S x M: the motor is known to slide in one direction. Around reversals and at rest an encoder cannot tell
  /// how far friction in motor and gear has turned round, so what torque says of tension is worth nothing
  /// there.
  Eigen::Matrix<char, Eigen::Dynamic, Eigen::Dynamic> sliding;
  // Tracker: P samples at their own times, of what it shows.
  Eigen::VectorXd tracker_s;           // since start_s
  Eigen::MatrixXd tip_m;               // P x 3, empty without position
  std::vector<Eigen::Matrix3d> tip_R;  // P, empty without orientation
  Eigen::MatrixXd bending_rad;         // P x 2K, (us, vs) a section; empty beside a position or orientation
  double tip_step_m = 0, tip_step_rad = 0, bending_step_rad = 0;  // of a table with few places
  // Of the time stamps.
  double jitter_s = 0;  // rms against the grid
  int lost = 0;         // grid points without a sample

  int samples() const { return static_cast<int>(valid.size()); }
  /// Samples of tendon j that lie in these holes.
  int Without(const std::vector<Hole>& holes, int j) const {
    int sum = 0;
    for (const Hole& hole : holes) sum += hole.tendon == j ? hole.size() : 0;
    return sum;
  }
  /// Makes NaN of tendon j's samples in these holes.
  void TakeOut(const std::vector<Hole>& holes, int j, Eigen::VectorXd& samples) const {
    for (const Hole& hole : holes) {
      if (hole.tendon == j) samples.segment(hole.from, hole.size()).setConstant(NAN);
    }
  }
  /// True when the holes leave something of at least one of so many tendons.
  bool Leave(const std::vector<Hole>& holes, Eigen::Index tendons) const {
    for (int j = 0; j < tendons; ++j) {
      if (Without(holes, j) < samples()) return true;
    }
    return false;
  }
  /// Moves the tracker's readings on the drives' clock; what would leave the run is dropped.
  void MoveTracker(double by_s);
  /// Where the motor of no tendon is known.
  bool without_motors() const { return !Leave(motor_holes, signals.motor_angle_rad.cols()); }
  /// Readings enough to compare with.
  bool tracked() const { return tracker_s.size() > (signals.at_rest ? kLeastStates - 1 : 10); }
};

/// A run of these rows alone.
Run OfRows(const Run& run, const std::vector<int>& rows);

/// Median time from row to row.
double UsualStep(const Run& run);

/// Rows that Prepare needs: kLeastRows, of a log of states at rest kLeastStates.
int LeastRows(const Run& run);

/// What encoder, cells and tracker cannot resolve, drawn anew: prepared without a seed the most likely
/// reading is taken, with one a reading that would have been recorded the same. The spread of a simulation
/// over such readings is how much the sensors' resolution leaves open.
PreparedRun Prepare(const Run& run, const RobotParameters& robot, std::optional<std::uint64_t> seed = {});

}  // namespace tendril::gap
