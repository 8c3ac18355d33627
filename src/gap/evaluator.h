// From a robot (nominal, or with effects) to what is left of the measurements at every cut: the residuals,
// what noise and resolution leave open in them, and their floor. Knows nothing of hypotheses or verdicts.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "prepare.h"
#include "tendril/gap/data_set.h"
#include "tendril/gap/diagnosis.h"
#include "tendril/sim/effects.h"
#include "tendril/sim/replay.h"

namespace tendril::gap {

/// Residuals, measured less simulated, averaged over windows: [run][channel][window]; a channel that was not
/// asked for is empty, a window without a measurement is 0 and has no weight.
using Residuals = std::vector<std::vector<Eigen::VectorXd>>;

/// One measured quantity behind one cut.
struct Channel {
  enum class Quantity { kTorque, kTension, kTipPosition, kTipDirection, kBending };
  sim::Cut cut{};  // kShape stands for C4 and C5, which differ by time scale only
  Quantity quantity{};
  int index = 0;           // tendon, axis, or column of (us, vs) a section
  std::string name, unit;  // "tension 1 from torque", "N"
  double white = 0;        // rms of one sample's white noise
  double floor = 0;        // rms floor of one sample: white noise, resolution, repetition
  double delta = 0;        // materiality
  double distrust = 0;     // rms by which the model may misjudge a change, all alike through a run
};

/// Samples that one window of a channel averages.
int WindowSamples(const PreparedRun& run, const Channel& channel);

/// Which replays an evaluation needs.
enum CutBits : unsigned { kC1 = 1, kC2 = 2, kC3 = 4, kBody = 8, kAllCuts = 15 };

/// One run that the model cannot be driven by; without it the others may be diagnosed.
class RunError : public std::runtime_error {
 public:
  RunError(std::size_t at, const std::string& what) : std::runtime_error(what), run(at) {}
  std::size_t run;
};

/// How a tracker's frame lies against the robot's base: it reports p = turn p_base + offset_m.
struct TrackerFrame {
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  Eigen::Vector3d offset_m = Eigen::Vector3d::Zero();

  /// Standard deviations of its error where it is fitted to the nominal robot: a shift is a part of the
  /// length.
  static constexpr double kTurn_rad = 0.1;
  static double Shift_m(const RobotParameters& robot) { return 2.0 / 9 * robot.body.length_m(); }

  /// The tracker's readings of a run into the base's frame.
  void ToBase(PreparedRun& run) const;
};

class Evaluator {
 public:
  struct Options {
    int threads = 1;
    double delta_N = 0, delta_m = 0;  // 0: derived from the floor
    std::uint64_t seed = 1;
    int readings = 4;  // alternative ones of the same log, see Prepare; without, their spread is no noise
    // How runs repeat is told by what the nominal robot leaves of them; or they are taken to repeat as well
    // as the sensors' noise lets them; or as they do with a cause in the robot, whose variances count where
    // they are larger.
    bool repeats = false;
    const Evaluator* with_cause = nullptr;
  };
  /// Prepares the runs and finds the floors. Runs from before a change (Run::before) are taken off those that
  /// name them, and are none of runs(). Throws RunError for a run that has to be left out, another
  /// std::runtime_error when nothing can be compared.
  Evaluator(const DataSet& set, const Options& options);

  const RobotParameters& nominal() const { return nominal_; }
  const std::vector<PreparedRun>& runs() const { return runs_; }
  const std::vector<Channel>& channels() const { return channels_; }
  double window_s(int run, int channel) const;
  bool has(unsigned cut) const { return (available_ & cut) != 0; }
  bool has_tracker() const { return has(kBody); }
  /// Load cells drive the body, whether or not their readings can be compared.
  bool has_cells() const { return driven_by_ == sim::Replay::DrivenBy::kCell; }
  bool repeated() const { return repeated_; }
  /// Some run has the tip's position.
  bool has_position() const;
  /// Repetitions differ by so many times what the sensors' noise leaves (rms, of the worst channel), where
  /// that is more than robots do; else 0. The floor follows them, so what differs between them is no gap.
  double repetitions_differ() const { return repetitions_differ_; }
  /// The same of each channel, however little it is; 1 where it repeats as well as the sensors' noise lets
  /// it.
  const Eigen::VectorXd& repetitions_by() const { return repetitions_by_; }
  /// What they differ by, where that is no scatter of a usual robot; with a cause, what it leaves of that.
  const std::optional<Repeatability>& repeatability() const { return repeatability_; }
  /// Fitted to the nominal robot, where nobody knows it; what the runs hold is in the base's frame then.
  const std::optional<TrackerFrame>& frame() const { return frame_; }
  /// The zero of every motor is found from its run: what moves it cannot be seen.
  bool zeros_from_rest() const { return zeros_from_rest_; }
  /// Share of what was measured before a change that the model got wrong then, at the worst cut; 0 without
  /// runs from before.
  double wrong_before() const { return wrong_before_; }
  /// It was so wrong before that nothing it says about the change is believed.
  bool useless() const { return wrong_before_ > kUseless; }
  /// Windows over which what a model leaves unexplained stays alike.
  double Correlated(int run, int channel) const;
  const std::vector<std::string>& degradations() const { return degradations_; }

  /// Residuals of one robot in the cuts asked for; runs in `only`, or all when empty. Throws
  /// std::runtime_error when the simulation cannot be carried out.
  Residuals At(const RobotParameters& robot, unsigned cuts, const std::vector<int>& only = {}) const;
  /// With the nominal robot.
  const Residuals& AtNominal() const { return nominal_residuals_; }
  /// Variance that noise, resolution and repetition leave in each window [run][channel][window]; infinite
  /// without a measurement.
  const Residuals& Variance() const { return variance_; }
  /// Part of it that the nominal robot makes of the noise of what drives it, as other readings of the same
  /// logs show.
  const Residuals& Carried() const { return carried_; }

  /// Takes the variance of channels from another evaluation of the same runs, with another robot, where that
  /// is plainly larger: a body with less damping or mass carries the sensors' noise further. Floors and
  /// materialities of channels stay, so that sigmas mean the same. True when any channel changed.
  bool Widen(const Evaluator& other);

  /// Part of a window's variance that is white noise; the rest is taken to change slowly.
  double WhiteVariance(int run, int channel) const { return white_[run][channel]; }

  /// What an effect can change, given these logs.
  unsigned CutsOf(const sim::Effect& effect) const;

  /// What the nominal robot makes of a run and what was measured, by window of the channel, for pictures.
  struct Curve {
    Eigen::VectorXd time_s, measured, simulated;
  };
  Curve NominalCurve(int run, int channel) const;

 private:
  static constexpr double kUseless = 0.5;  // share of the motion before

  struct Replayed {
    Eigen::MatrixXd torque_Nm, from_torque_N, from_stretch_N;
    sim::BodyMotion motion;
  };
  Replayed ReplayRun(const RobotParameters& robot, const PreparedRun& run, unsigned cuts,
                     const sim::BodyMotion* known_motion) const;
  std::vector<Eigen::VectorXd> ResidualsOf(const Replayed& replayed, const PreparedRun& run, unsigned cuts,
                                           std::vector<Eigen::VectorXd>* scatter = nullptr) const;
  Eigen::MatrixXd MeasuredShortening(const PreparedRun& run, const RobotParameters& robot,
                                     const sim::BodyMotion& motion) const;
  /// The cells' readings from the tendons' stretch (S x M). Motors that count from where they rested do so
  /// from the zero that this robot and `reading_N` (S x M; NaN: nothing) give them.
  Eigen::MatrixXd FromStretch(const sim::Replay& replay, const RobotParameters& robot, const PreparedRun& run,
                              const Eigen::MatrixXd& shortening, const Eigen::MatrixXd& reading_N) const;
  double TrackerLate(const sim::BodyMotion& motion, const PreparedRun& run) const;
  void FindCuts(const DataSet& set);
  void TellWithoutMotors();
  /// Of logs that are slower than controllers: whether a row is every target that was sent, or every n-th.
  void FindCommandsARow();
  void StandInForCells();
  void TellHoles();
  void ListChannels();
  void FindFrame();
  /// Takes out what depends on how the runs went where nothing was recorded. In unseen.cpp.
  void Forget(int threads);

  // In floors.cpp.
  void FindFloors(const DataSet& set, const Options& options);
  void FindWhiteNoise();
  void FindVariances(const DataSet& set, const Options& options);
  void TakeDifferences();
  void ScaleByRepetition(const Options& options);
  bool AlikeIn(const Evaluator& other) const;  // in runs, channels and windows
  /// Standard deviation of what is measured on a channel, over all runs; 0 for torque.
  double Spread(const Channel& channel) const;
  /// Mean ratio of what the same inputs at other times leave to what `channel`'s variances say; 0 when they
  /// never come back. `returns` counts them.
  double Unrepeated(int channel, int& returns) const;

  RobotParameters nominal_;
  std::vector<PreparedRun> runs_;
  std::vector<sim::BodyMotion> nominal_motion_;
  std::vector<Channel> channels_;
  unsigned available_ = 0;
  bool repeated_ = false;
  bool zeros_from_rest_ = false;
  bool clocks_free_ = false;  // the tracker's stamps are free to move with every robot that is tried
  double wrong_before_ = 0, repetitions_differ_ = 0;
  Eigen::VectorXd repetitions_by_;
  std::optional<Repeatability> repeatability_;
  std::optional<TrackerFrame> frame_;
  std::vector<double> tracker_late_s_;  // [run] of the stamps, taken off; empty without a tracker
  sim::Replay::DrivenBy driven_by_ = sim::Replay::DrivenBy::kCell;
  Residuals nominal_residuals_, variance_, carried_;
  Residuals before_;  // what the nominal robot leaves of the runs from before; empty without such
  std::vector<std::vector<double>> white_;
  std::vector<std::string> degradations_;
};

}  // namespace tendril::gap
