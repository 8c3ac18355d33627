// Measured runs of a robot, read from a folder (CSV files with robot.yaml and runs.yaml), from LCM logs, or
// from other tables through a column map. Knows nothing of models.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "tendril/core/robot.h"

namespace tendril::gap {

/// A value that was not read.
inline constexpr double kNoReading = std::numeric_limits<double>::quiet_NaN();

/// One measured run with S samples. NaN marks rows where a slower sensor has no new value; a matrix without
/// columns marks a channel that was not measured. SI units, pulling positive, motor shaft.
struct Run {
  std::string name;       // file name without its extension, or a name made from the log's
  std::string family;     // kind of motion: triangle, circle, ...; "unknown" where not given
  std::string repeat_of;  // name of the run that this one repeats unchanged, or empty
  /// Name of the run of the same commands from before the robot changed, or empty. The diagnosis then
  /// concerns the change, and model errors common to both runs cancel.
  std::string before;
  LoadCellPlace load_cell = LoadCellPlace::kMotorSide;
  /// Motor positions count from the pose in which friction had left the robot when its controller zeroed
  /// them, rounded to whole counts. Otherwise they count from the straight robot at pretension.
  bool zero_at_rest = false;
  std::string sha256;      // of the source file, lower-case hex
  Eigen::VectorXd time_s;  // S, by the log's clock
  // A row's target is the one sent at that time, which acts a cycle later; all other columns are sensor
  // values at that time.
  Eigen::MatrixXd torque_target_Nm, torque_actual_Nm, motor_position_rad, tension_N;  // S x M
  Eigen::MatrixXd tip_m;           // S x 3 in the tracker's frame
  Eigen::MatrixXd tip_quaternion;  // S x 4: w, x, y, z
  double tip_quaternion_step =
      0;  // resolution of the quaternion's numbers in a table of few decimal places; 0: full precision
  Eigen::MatrixXd bending_rad;  // S x 2K: (us, vs) per section, where the log has it
  /// S x 3D: the centre of every disk in the tracker's frame; NaN where it has no marker. Where the last
  /// disk has none, tip_m stands for it.
  Eigen::MatrixXd disks_m;
  /// S x 4D: orientation of every disk in the tracker's frame, w, x, y, z; NaN where it has no sensor. Where
  /// the last disk has none, tip_quaternion stands for it.
  Eigen::MatrixXd disk_quaternion;
  std::vector<std::string> notes;     // remarks on the file, one line each
  std::vector<std::string> warnings;  // what was dropped or repaired on reading, one line each
};

struct DataSet {
  std::string name;
  RobotParameters robot;  // nominal
  /// The pose of the tracker's frame relative to the robot's base is unknown: the diagnosis fits it.
  bool fit_frame = false;
  std::vector<Run> runs;
  std::vector<std::string> notes;  // of the set, such as files that could not be read
};

/// What happens to runs whose folder or log names another robot than the robot file: another name, number of
/// sections or tendons, encoder counts per turn, or a length that no plausible correction reaches.
enum class OtherRobot { kRefused, kNoted };

/// The motor of a pair shows the difference of two tensions, which the chain of cuts has no place for: throws
/// std::runtime_error with the remedy.
void RequireAMotorForEachTendon(const RobotParameters& robot);

/// Reads a folder (robot.yaml, runs.yaml, CSV). `robot_path` overrides the folder's robot.yaml unless empty.
/// A run that cannot be read is left out with a note. Throws std::runtime_error when the folder does not
/// exist, no run is left, or its runs are refused because they are another robot's.
DataSet LoadDataSet(const std::filesystem::path& folder, const std::string& robot_path,
                    OtherRobot other_robot = OtherRobot::kRefused);
/// Reads any mixture of folders, CSV files and LCM logs as one set; throws std::runtime_error when one is
/// named twice. A folder without runs stands for those of its subfolders whose runs are of the robot at
/// `robot_path`; runs of another robot are left out with a note.
DataSet LoadLogs(const std::vector<std::string>& paths, const std::string& robot_path,
                 OtherRobot other_robot = OtherRobot::kRefused);

/// Adds the runs of `before` and pairs each run of the set with the one of the same name there, or else with
/// the only one of the same family. Where the runs before show enough of a robot whose motors hold positions
/// to learn it from, a run without a partner is compared with all of them; other runs without a partner are
/// left out with a note. A different robot file is noted, and the set's own is used for both. Throws
/// std::runtime_error when no run has a partner or the number of tendons differs.
void CompareWithBefore(DataSet& set, DataSet before);
/// True where another run is compared with this one.
bool IsBefore(const DataSet& set, const Run& run);

/// A canonical CSV column, or a key of runs.yaml.
struct ColumnText {
  std::string_view name;  // "tension_N_j": j counts tendons from 1, k sections, d disks
  std::string_view unit;
  std::string_view meaning;
};
std::span<const ColumnText> RunColumns();

struct RunsKey {
  std::string_view name;
  bool of_a_run = true;  // false: a key of the whole file
  std::string_view accepted;
  std::string_view otherwise;  // the default where the key is missing; empty: the key is required
  std::string_view meaning;
};
std::span<const RunsKey> RunsFileKeys();

/// Writes one run as canonical CSV (columns: RunColumns), with enough digits to read back the same numbers;
/// cells are empty for NaN.
void WriteRun(const Run& run, const std::filesystem::path& file);
/// Writes robot.yaml, runs.yaml and one CSV per run.
void WriteDataSet(const DataSet& set, const std::filesystem::path& folder);

}  // namespace tendril::gap
