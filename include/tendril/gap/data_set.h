// Measured runs of a robot: a folder of CSV files with robot.yaml and runs.yaml, LCM logs, or anybody's
// tables through a column map. Knows nothing of models.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "tendril/core/robot.h"

namespace tendril::gap {

/// One run as it was measured: S samples; NaN where a slower sensor has no new value; a matrix without
/// columns was not measured. SI units, pulling positive, motor shaft.
struct Run {
  std::string name;       // file name without its ending, or what the log is called
  std::string family;     // kind of excitation: triangle, circle, ... ; "unknown" when not told
  std::string repeat_of;  // name of the run of which it is an identical repetition, or empty
  /// Name of the run of the same commands from before the robot changed, or empty: the diagnosis is then of
  /// what changed, and what the model gets wrong in both cancels.
  std::string before;
  LoadCellPlace load_cell = LoadCellPlace::kMotorSide;
  /// Motor positions count from the pose in which the robot rested when its controller set them to zero, as
  /// friction had left it, and that to whole counts; else from the straight robot at its least tension.
  bool zero_at_rest = false;
  std::string sha256;      // of the file it came from, lower-case hex
  Eigen::VectorXd time_s;  // S, of the log's clock
  // A target is the one sent at its row's time, which acts a cycle later; everything else is the sensors'
  // value then.
  Eigen::MatrixXd torque_target_Nm, torque_actual_Nm, motor_position_rad, tension_N;  // S x M
  Eigen::MatrixXd tip_m;              // S x 3 in the tracker's frame
  Eigen::MatrixXd tip_quaternion;     // S x 4: w, x, y, z
  double tip_quaternion_step = 0;     // of its numbers, in a table of few places; 0: of many
  Eigen::MatrixXd bending_rad;        // S x 2K: (us, vs) a section, where a log has it
  std::vector<std::string> notes;     // what a reader may want to know of the file, one line each
  std::vector<std::string> warnings;  // what was lost or mended on reading, one line each
};

struct DataSet {
  std::string name;
  RobotParameters robot;  // nominal
  /// Nobody knows how the tracker's frame lies against the robot's base: the diagnosis fits it.
  bool fit_frame = false;
  std::vector<Run> runs;
  std::vector<std::string> notes;  // of the set: files that could not be read at all, for example
};

/// What becomes of runs whose folder or log names another robot than the file does: another name, number of
/// sections or tendons, encoder counts per turn, or a length beyond what a correction makes of it.
enum class OtherRobot { kRefused, kNoted };

/// A folder (robot.yaml, runs.yaml, CSV). `robot_path` overrides the folder's robot.yaml when not empty. A
/// run that cannot be read is left out with a note; std::runtime_error when nothing is left, the folder is
/// none, or its runs are refused as another robot's.
DataSet LoadDataSet(const std::filesystem::path& folder, const std::string& robot_path,
                    OtherRobot other_robot = OtherRobot::kRefused);
/// Folders, CSV files and LCM logs in any mixture, as one set; what is named twice is std::runtime_error. A
/// folder without runs stands for its subfolders of the robot at `robot_path`; runs of another are noted.
DataSet LoadLogs(const std::vector<std::string>& paths, const std::string& robot_path,
                 OtherRobot other_robot = OtherRobot::kRefused);

/// Adds `before`'s runs, and pairs each of the set's with that of its name there, else the only one of its
/// kind. std::runtime_error when no run has a partner, or the robot was one of other tendons; single runs
/// that have none are left out with a note, and another robot file is noted: the set's own is taken for both.
void CompareWithBefore(DataSet& set, DataSet before);
/// Another run is compared with this one.
bool IsBefore(const DataSet& set, const Run& run);

/// What one canonical name of a CSV's columns stands for, or one key of runs.yaml.
struct ColumnText {
  std::string_view name;  // "tension_N_j": j counts tendons from 1, k sections
  std::string_view unit;
  std::string_view meaning;
};
std::span<const ColumnText> RunColumns();

struct RunsKey {
  std::string_view name;
  bool of_a_run = true;  // false: of the whole file
  std::string_view accepted;
  std::string_view otherwise;  // what holds where the key is left out; empty: it must be there
  std::string_view meaning;
};
std::span<const RunsKey> RunsFileKeys();

/// Canonical CSV (columns: RunColumns) of one run; as many digits as give the same number back, empty for
/// NaN.
void WriteRun(const Run& run, const std::filesystem::path& file);
/// robot.yaml, runs.yaml and one CSV a run.
void WriteDataSet(const DataSet& set, const std::filesystem::path& folder);

}  // namespace tendril::gap
