// Identification experiments carried out and recorded as measured runs: in process against the plant, in
// simulated time. Knows nothing of what is made of the data.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "excitation.h"
#include "tendril/core/cycle.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"
#include "tendril/gap/data_set.h"

namespace tendril::tools {

/// Cycle records as a measured run; the first row is time 0.
class RunRecorder {
 public:
  /// Motor angles count from where the encoder reads `zero_rad` (one a tendon; empty: from its own zero).
  RunRecorder(const RobotParameters& robot, Eigen::VectorXd zero_rad = {});
  void Add(const CycleRecord& record);
  std::size_t rows() const { return rows_.size(); }
  /// Readings of the tracker stand in the row nearest to their own time.
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
  RobotParameters controller_robot;  // nominal: what the data set is to be compared with
  RobotParameters plant_robot;       // with the effects that it has
  DaemonParameters daemon;
  std::uint64_t seed = 1;  // of the sensors' noise; every run gets its own from it
  bool sensor_noise = true;
  int threads = 1;
};

/// The same daemon with tension targets that may move as fast as quick experiments ask, without guards
/// against a robot that is not as its file says, and without messages that nobody listens to.
DaemonParameters ForExperiments(DaemonParameters daemon);

/// What the daemon of experiments in process is told: this file, or without one what comes with Tendril
/// (built in; nothing is read).
DaemonParameters DaemonOfExperiments(const std::string& file);

struct Experiment {
  gap::Run run;
  std::string trouble;               // empty, or why it ended early
  double largest_tension_N = 0;      // true one at the robot's base
  double largest_command_N = 0;      // wanted at the base
  std::uint64_t limited_cycles = 0;  // in which some limit acted
};

/// Arms, runs the program and records it from the moment until which nothing moves. `stop` ends it early
/// (may be null); `progress` gets the share done now and then.
Experiment RunExperiment(const Program& program, const std::string& name, const ExperimentOptions& options,
                         std::uint64_t noise_seed, const std::atomic<bool>* stop,
                         const std::function<void(double)>& progress);

/// One run of a set: index of its plan entry, its name, and the name of the run it repeats.
struct NamedRun {
  std::size_t planned = 0;
  std::string name, repeat_of;
};
/// The plan's runs in order, each followed later in the list by its repeats.
std::vector<NamedRun> NameRuns(const Plan& plan);

/// Called from worker threads, one at a time: which run, share done of it, and the result when it is over.
using SetProgress = std::function<void(std::size_t run, double share, const Experiment* done)>;

struct ExperimentSet {
  gap::DataSet data;
  std::vector<Experiment> experiments;  // in order; their data moved into `data`
  double simulated_s = 0, wall_s = 0;
  std::string trouble;  // empty, or the first run's that ended early
};

/// The plan's programs, all before the first one runs. Throws std::invalid_argument, with where the plan's
/// file says so, for one that does not fit the robot.
std::vector<Program> MakePrograms(const Plan& plan, const RobotParameters& robot,
                                  const ControllerParameters& controller);

/// Shorter than this a run that ended early says nothing beyond its stillness, and is left out.
inline constexpr double kShortestRun_s = kStillBefore_s + 0.25;

/// std::invalid_argument for a plan that does not fit the robot. After trouble the set holds what was
/// recorded, after `stop` the runs that are whole; `trouble` then says so.
ExperimentSet RunSet(const Plan& plan, const ExperimentOptions& options, const std::atomic<bool>* stop,
                     const SetProgress& progress);

}  // namespace tendril::tools
