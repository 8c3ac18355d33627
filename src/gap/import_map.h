// A column map as plain numbers: what each column of a foreign table means. Filled from YAML; knows nothing
// of the tables themselves.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <regex>
#include <string>
#include <vector>

#include "csv.h"
#include "tendril/core/robot.h"

namespace tendril::gap {

/// One number of a table: SI value = factor x cell + offset. An empty name: not measured.
struct MappedColumn {
  std::string name;
  double factor = 1, offset = 0;
};

/// A text made of a column's text: `as` with $1, $2 ... from the match; the text itself where it does not
/// match.
struct MappedText {
  std::string column, constant;  // one of the two
  std::optional<std::regex> match;
  std::string as = "$&";
};

/// How a time column writes its times.
enum class TimeKind { kNumber, kIso8601, kClock };

enum class OrientationKind { kNone, kQuaternion, kMatrix, kEuler, kRotationVector };

struct ImportMap {
  TableFormat format;

  std::string time_column, index_column;
  TimeKind time_kind = TimeKind::kNumber;
  double time_factor = 1;  // of numbers
  double rate_Hz = 0;      // where there is no time column

  MappedText by, family, repeats;  // empty column and constant: not told
  double longest_gap_s = 0;        // a hole beyond begins a new run; 0: none does
  std::optional<LoadCellPlace> load_cell;

  std::vector<MappedColumn> torque_target, torque_actual, motor_position, tension;  // by tendon, or empty
  std::vector<MappedColumn> tip;                                                    // x, y, z, or empty
  OrientationKind orientation_kind = OrientationKind::kNone;
  std::vector<MappedColumn> orientation;  // w, x, y, z; or the matrix row by row; or three angles
  std::string euler_order;                // "XYZ" about the turned axes, "xyz" about the fixed ones
  bool bending_is_polar = false;          // columns are angle and plane of each section, not us and vs
  std::vector<MappedColumn> bending;

  Eigen::Matrix3d R_base_table = Eigen::Matrix3d::Identity();
  Eigen::Vector3d offset_m = Eigen::Vector3d::Zero();
  bool from_rest = false;  // the first rows show the straight robot
  bool fit_frame = false;  // the above is a beginning only
};

/// Throws std::runtime_error, one line: file:line: key: what; accepted; remedy.
ImportMap LoadImportMap(const std::string& path, const RobotParameters& robot);

}  // namespace tendril::gap
