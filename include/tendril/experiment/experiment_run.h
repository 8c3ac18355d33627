// Identification experiments carried out and recorded as measured runs: in process against the plant, in
// simulated time. Knows nothing of the use of the data.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "tendril/core/cycle.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"
#include "tendril/experiment/excitation.h"
#include "tendril/gap/data_set.h"

namespace tendril::experiment {

/// Cycle records as a measured run; the first row is time 0.
class RunRecorder {
 public:
  /// Motor angles count from encoder angle `zero_rad` (one per tendon; empty: the encoder's own zero).
  RunRecorder(const RobotParameters& robot, Eigen::VectorXd zero_rad = {});
  void Add(const CycleRecord& record);
  std::size_t rows() const { return rows_.size(); }
  /// Tracker readings are in the row nearest to their own time.
  gap::Run Finish(const std::string& name, const std::string& family) const;

 private:
  struct Row {
    TimeNs time_ns;
    TendonVector target_Nm, actual_Nm, position_rad, tension_N;
  };
  const RobotParameters& robot_;
  Eigen::VectorXd zero_rad_;
  std::vector<Row> rows_;
  std::vector<TrackerSample> tracker_;
};

struct ExperimentOptions {
  RobotParameters controller_robot;  // nominal: the robot with which the data set is compared
  RobotParameters plant_robot;       // including its effects
  DaemonParameters daemon;
  std::uint64_t seed = 1;  // of the sensors' noise; each run derives its own
  bool sensor_noise = true;
  int threads = 1;
};

/// The daemon with tension targets as fast as quick experiments require, without guards against a robot that
/// differs from its file, and without unused messages.
DaemonParameters ForExperiments(DaemonParameters daemon);

/// A daemon's file, or without one the file that is built in (nothing is read).
DaemonParameters DaemonFile(const std::string& file);
/// The same for experiments in process, where no guard ends a run.
DaemonParameters DaemonOfExperiments(const std::string& file);

struct Experiment {
  gap::Run run;
  std::string trouble;               // empty, or why it ended early
  double largest_tension_N = 0;      // true tension at the robot's base
  double largest_command_N = 0;      // commanded at the base
  std::uint64_t limited_cycles = 0;  // with an active limit
};

/// Arms, runs the program and records it from the initial rest on. `stop` ends it early (may be null);
/// `progress` receives the completed share from time to time.
Experiment RunExperiment(const Program& program, const std::string& name, const ExperimentOptions& options,
                         std::uint64_t noise_seed, const std::atomic<bool>* stop,
                         const std::function<void(double)>& progress);

/// One run of a set: index of its plan entry, its name, and the name of the run it repeats.
struct NamedRun {
  std::size_t planned = 0;
  std::string name, repeat_of;
};
/// The plan's runs in order, with each run's repeats later in the list.
std::vector<NamedRun> NameRuns(const Plan& plan);

/// Called from worker threads, one at a time: which run, its completed share, and the result when it has
/// ended.
using SetProgress = std::function<void(std::size_t run, double share, const Experiment* done)>;

struct ExperimentSet {
  gap::DataSet data;
  std::vector<Experiment> experiments;  // in order; their data are moved into `data`
  double simulated_s = 0, wall_s = 0;
  std::string trouble;  // empty, or that of the first run that ended early
};

/// The plan's programs, all made before the first one runs. Throws std::invalid_argument, with the place in
/// the plan's file, for one that does not fit the robot.
std::vector<Program> MakePrograms(const Plan& plan, const RobotParameters& robot,
                                  const ControllerParameters& controller);

/// A run that ended earlier than this holds little more than the initial rest, and is left out.
inline constexpr double kShortestRun_s = kStillBefore_s + 0.25;

/// std::invalid_argument for a plan that does not fit the robot. After an error the set holds the data
/// recorded, after `stop` the complete runs; `trouble` states the reason.
ExperimentSet RunSet(const Plan& plan, const ExperimentOptions& options, const std::atomic<bool>* stop,
                     const SetProgress& progress);

}  // namespace tendril::experiment
