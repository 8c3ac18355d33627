// A column map as plain numbers: the meaning of each column of a foreign table. Filled from YAML; knows
// nothing of the tables themselves.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <regex>
#include <string>
#include <vector>

#include "csv.h"
#include "tendril/core/robot.h"

namespace tendril::gap {

/// One number of a table: SI value = factor x cell + offset. Empty name: not measured.
struct MappedColumn {
  std::string name;
  double factor = 1, offset = 0;
};

/// A text derived from a column: `as` with $1, $2 ... from the match; the column's text itself where it does
/// not match.
struct MappedText {
  std::string column, constant;  // exactly one of the two
  std::optional<std::regex> match;
  std::string as = "$&";
};

/// Format of a time column.
enum class TimeKind { kNumber, kIso8601, kClock };

enum class OrientationKind { kNone, kQuaternion, kMatrix, kEuler, kRotationVector };

/// A rotation from the axes of what is measured to the table's.
struct MappedOrientation {
  OrientationKind kind = OrientationKind::kNone;
  std::string euler_order;            // "XYZ" about the turned axes, "xyz" about the fixed ones
  std::vector<MappedColumn> columns;  // w, x, y, z; or the matrix row by row; or three angles
};

struct ImportMap {
  TableFormat format;

  std::string time_column, index_column;
  TimeKind time_kind = TimeKind::kNumber;
  double time_factor = 1;  // for numeric times
  double rate_Hz = 0;      // without a time column

  MappedText by, family, repeats;  // empty column and constant: not given
  double longest_gap_s = 0;        // a longer gap begins a new run; 0: never
  std::optional<LoadCellPlace> load_cell;

  std::vector<MappedColumn> torque_target, torque_actual, motor_position, tension;  // by tendon, or empty
  std::vector<MappedColumn> tip;                                                    // x, y, z, or empty
  std::vector<MappedColumn> disks;  // x, y, z of every disk, without names where it has no marker; or empty
  MappedOrientation orientation;    // of the tip
  /// Of every disk, without columns where it has no sensor; or empty.
  std::vector<MappedOrientation> disk_orientations;
  bool bending_is_polar = false;  // columns hold angle and plane of each section instead of us and vs
  std::vector<MappedColumn> bending;

  Eigen::Matrix3d R_base_table = Eigen::Matrix3d::Identity();
  Eigen::Vector3d offset_m = Eigen::Vector3d::Zero();
  bool from_rest = false;  // the first rows show the straight robot
  bool fit_frame = false;  // the above is only an initial estimate
};

/// Throws std::runtime_error, one line: file:line: key: what; accepted; remedy.
ImportMap LoadImportMap(const std::string& path, const RobotParameters& robot);

}  // namespace tendril::gap
