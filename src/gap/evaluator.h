// From a robot (nominal, or with effects) to the residuals at every cut, their variance from noise and
// resolution, and their noise floor. Knows nothing of hypotheses or verdicts.
#pragma once

#include <Eigen/Core>
#include <algorithm>
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
#include "tracker_frame.h"

namespace tendril::gap {

/// Residuals, measured less simulated, averaged over windows: [run][channel][window]. A channel that was not
/// requested is empty; a window without a measurement is 0 and has no weight.
using Residuals = std::vector<std::vector<Eigen::VectorXd>>;

/// One measured quantity at one cut.
struct Channel {
  enum class Quantity { kTorque, kTension, kTipPosition, kTipDirection, kBending };
  sim::Cut cut{};  // kShape stands for C4 and C5, which differ only in time scale
  Quantity quantity{};
  int index = 0;           // tendon, axis, or column of (us, vs) of a section
  std::string name, unit;  // "tension 1 from torque", "N"
  double white = 0;        // rms of one sample's white noise
  double floor = 0;        // rms floor of one sample: white noise, resolution, repeatability
  double delta = 0;        // materiality
  double distrust = 0;     // rms error of the model about a change, fully correlated within a run
};

/// Samples averaged in one window of a channel.
int WindowSamples(const PreparedRun& run, const Channel& channel);

/// The replays that an evaluation needs.
enum CutBits : unsigned { kC1 = 1, kC2 = 2, kC3 = 4, kBody = 8, kAllCuts = 15 };

/// A run that cannot drive the model; the others may be diagnosed without it.
class RunError : public std::runtime_error {
 public:
  RunError(std::size_t at, const std::string& what) : std::runtime_error(what), run(at) {}
  std::size_t run;
};

class Evaluator {
 public:
  struct Options {
    int threads = 1;
    double delta_N = 0, delta_m = 0;  // 0: derived from the floor
    std::uint64_t seed = 1;
    int readings =
        4;  // alternative readings of the same log, see Prepare; 0: their spread is not counted as noise
    // How repeatability is determined: from the residuals of the nominal robot; assumed to be limited by
    // sensor noise only; or from the residuals with a cause, whose variances count where they are larger.
    bool repeats = false;
    const Evaluator* with_cause = nullptr;
  };
  /// Prepares the runs and finds the floors. Runs from before a change (Run::before) are subtracted from
  /// those that name them and are not part of runs(). Throws RunError for a run that has to be left out,
  /// another std::runtime_error when nothing can be compared.
  Evaluator(const DataSet& set, const Options& options);

  const RobotParameters& nominal() const { return nominal_; }
  const std::vector<PreparedRun>& runs() const { return runs_; }
  const std::vector<Channel>& channels() const { return channels_; }
  double window_s(int run, int channel) const;
  /// Windows in a second: residuals further apart count as independent.
  int WindowsPerBlock(int run, int channel) const {
    return std::max(1, static_cast<int>(1.0 / window_s(run, channel)));
  }
  bool has(unsigned cut) const { return (available_ & cut) != 0; }
  bool has_tracker() const { return has(kBody); }
  /// Load cells drive the body, even where their readings cannot be compared.
  bool has_cells() const { return driven_by_ == sim::Replay::DrivenBy::kCell; }
  bool repeated() const { return repeated_; }
  /// At least one run has tip positions.
  bool has_position() const;
  /// Ratio of the differences between repetitions to what sensor noise explains (rms, of the worst channel),
  /// where it exceeds that of usual robots; else 0. The floor includes these differences, so they are not a
  /// gap.
  double repetitions_differ() const { return repetitions_differ_; }
  /// The same ratio of each channel, however small; 1 where a channel repeats to within sensor noise.
  const Eigen::VectorXd& repetitions_by() const { return repetitions_by_; }
  /// The differences between repetitions beyond the usual scatter of a robot; with a cause, the part that it
  /// does not explain.
  const std::optional<Repeatability>& repeatability() const { return repeatability_; }
  /// Fitted to the nominal robot where the frame is unknown; tracker data in the runs are then in the base's
  /// frame.
  const std::optional<TrackerFrame>& frame() const { return frame_; }
  /// The zero of every motor is taken from its run, so effects that shift it cannot be identified.
  bool zeros_from_rest() const { return zeros_from_rest_; }
  /// Share of the measurement before a change that the model got wrong, at the worst cut; 0 without runs from
  /// before.
  double wrong_before() const { return wrong_before_; }
  /// How far a delay of the drives may be off [s], since the logs do not show how many targets a row holds.
  double delay_unknown_s() const { return delay_unknown_s_; }
  /// The model was so wrong before the change that its statements on the change are not used.
  bool useless() const { return wrong_before_ > kUseless; }
  /// Windows over which model errors stay correlated.
  double Correlated(int run, int channel) const;
  const std::vector<std::string>& degradations() const { return degradations_; }

  /// Residuals of a robot at the requested cuts; for the runs in `only`, or all when empty. Throws
  /// std::runtime_error when the simulation fails.
  Residuals At(const RobotParameters& robot, unsigned cuts, const std::vector<int>& only = {},
               sim::Replay::Steps steps = sim::Replay::Steps::kFine) const;
  /// With the nominal robot.
  const Residuals& AtNominal() const { return nominal_residuals_; }
  /// Variance due to noise, resolution and repeatability in each window [run][channel][window]; infinite
  /// without a measurement.
  const Residuals& Variance() const { return variance_; }
  /// The part of it that comes from noise in the signals that drive the nominal robot, estimated from
  /// alternative readings of the same logs.
  const Residuals& Carried() const { return carried_; }

  /// Takes over the variance of channels from an evaluation of the same runs with another robot, where it is
  /// clearly larger: a body with less damping or mass amplifies sensor noise. Floors and materialities of
  /// channels stay, so that sigmas keep their meaning. True when any channel changed.
  bool Widen(const Evaluator& other);

  /// Share of a window's variance that is white noise; the rest is assumed to change slowly.
  double WhiteVariance(int run, int channel) const { return white_[run][channel]; }

  /// The cuts that an effect can change, given these logs.
  unsigned CutsOf(const sim::Effect& effect) const;
  /// The cuts that a change in this part of the chain can affect in these runs.
  unsigned CutsBehind(sim::Stage stage, sim::Element element) const;

  /// Simulated (nominal) and measured signal of a run, by window of the channel, for plots.
  struct Curve {
    Eigen::VectorXd time_s, measured, simulated;
  };
  Curve NominalCurve(int run, int channel) const;

 private:
  static constexpr double kUseless = 0.5;  // share of the motion before the change

  // In residuals.cpp.
  struct Replayed {
    Eigen::MatrixXd torque_Nm, from_torque_N, from_stretch_N;
    sim::BodyMotion motion;
  };
  Replayed ReplayRun(const RobotParameters& robot, const PreparedRun& run, unsigned cuts,
                     const sim::BodyMotion* known_motion,
                     sim::Replay::Steps steps = sim::Replay::Steps::kFine) const;
  std::vector<Eigen::VectorXd> ResidualsOf(const Replayed& replayed, const PreparedRun& run, unsigned cuts,
                                           std::vector<Eigen::VectorXd>* scatter = nullptr) const;
  /// The cells' readings from the tendons' stretch (S x M). Motors that count from their rest position use
  /// the zero that this robot and `reading_N` (S x M; NaN: no reading) imply.
  Eigen::MatrixXd FromStretch(const sim::Replay& replay, const RobotParameters& robot, const PreparedRun& run,
                              const Eigen::MatrixXd& shortening, const Eigen::MatrixXd& reading_N) const;
  double TrackerLate(const sim::BodyMotion& motion, const PreparedRun& run) const;

  // In evaluator.cpp.
  void FindCuts(const DataSet& set);
  void ReportMissingMotors();
  void ReportSensorGaps();
  void ListChannels();
  void FindFrame();

  // In targets_per_row.cpp.
  /// For logs slower than the controller: whether a row holds every target sent or every n-th.
  void FindTargetsPerRow();
  double TorqueLeft(const std::vector<PreparedRun*>& runs) const;
  double TorqueNoise() const;

  // In unrecorded_motion.cpp.
  /// Masks windows that depend on unrecorded parts of a run.
  void MaskAfterUnrecordedMotion(int threads);

  // In variances.cpp.
  void FindWhiteNoise();
  void FindVariances(const DataSet& set, const Options& options);
  void SumVariances(const std::vector<Residuals>& readings, const Residuals& within);

  // In earlier_runs.cpp.
  void SubtractBefore();
  void DistrustChange(const std::vector<char>& is_before);

  // In floors.cpp.
  void FindFloors(const DataSet& set, const Options& options);
  void ScaleByRepetition(const Options& options);
  /// Scales the variance of a channel, to at least `least` and that of an evaluation `with_cause` (nullptr:
  /// none).
  void ScaleVariance(int channel, double scale, double least, const Evaluator* with_cause);
  void SetFloor(int channel, const Options& options);
  /// `most_returns`: pairs of equal rows that the floor comes from; 0: none.
  void ReportRepetitions(int most_returns);
  bool AlikeIn(const Evaluator& other) const;  // same runs, channels and windows
  /// Standard deviation of the measured signal of a channel over all runs; 0 for torque.
  double Spread(const Channel& channel) const;
  /// Mean ratio of the residual differences at recurring inputs to the variance of `channel`; 0 when inputs
  /// never recur. `returns` counts the recurrences.
  double Unrepeated(int channel, int& returns) const;

  RobotParameters nominal_;
  std::vector<PreparedRun> runs_;
  std::vector<sim::BodyMotion> nominal_motion_;
  std::vector<Channel> channels_;
  unsigned available_ = 0;
  bool repeated_ = false;
  bool zeros_from_rest_ = false;
  bool clocks_free_ = false;  // the tracker's time shift is refitted for every robot
  double wrong_before_ = 0, repetitions_differ_ = 0, delay_unknown_s_ = 0;
  Eigen::VectorXd repetitions_by_;
  std::optional<Repeatability> repeatability_;
  std::optional<TrackerFrame> frame_;
  std::vector<double>
      tracker_late_s_;  // [run] delay of the stamps, already subtracted; empty without a tracker
  sim::Replay::DrivenBy driven_by_ = sim::Replay::DrivenBy::kCell;
  Residuals nominal_residuals_, variance_, carried_;
  Residuals before_;  // nominal residuals of the runs from before the change; empty without such
  std::vector<std::vector<double>> white_;
  std::vector<std::string> degradations_;
};

}  // namespace tendril::gap
