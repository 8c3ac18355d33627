// Column maps out of YAML; every refusal names file, line, key, what is accepted and the remedy.
#include "import_map.h"

#include <fmt/core.h>
#include <yaml-cpp/yaml.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "file_bytes.h"
#include "rotation.h"
#include "tendril/core/load_cell_place.h"
#include "yaml_block.h"

namespace tendril::gap {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
// A map that is larger is not one.
constexpr std::size_t kLargestMap_B = std::size_t{1} << 20;

using Units = std::map<std::string, double>;

const Units kTimes{{"s", 1}, {"unix_s", 1}, {"ms", 1e-3}, {"us", 1e-6}, {"ns", 1e-9}, {"min", 60}};
const Units kLengths{{"m", 1}, {"cm", 1e-2}, {"mm", 1e-3}, {"um", 1e-6}, {"inch", 0.0254}};
const Units kAngles{{"rad", 1}, {"deg", kDegree}, {"turns", 2 * std::numbers::pi}};

class Reader {
 public:
  Reader(const std::string& path, const RobotParameters& robot) : path_(path), robot_(robot) {}

  ImportMap Read() {
    const std::string text = ReadBytes(path_);
    if (text.size() > kLargestMap_B) throw std::runtime_error(path_ + ": too large for a column map");
    YAML::Node root;
    try {
      root = YAML::Load(text);
    } catch (const YAML::Exception& e) {
      throw std::runtime_error(fmt::format("{}:{}: not YAML ({})", path_, e.mark.line + 1, e.msg));
    }
    if (!root.IsMap()) {
      throw std::runtime_error(path_ +
                               ":1: no column map; accepted: a YAML file with the keys table, time, runs, "
                               "columns, frame; config/import holds examples");
    }
    RefuseKeysTwice(root, path_);
    YamlBlock top(root, path_, "");
    Format(top.Sub("table"));
    if (!top.Has("time"))
      top.Fail("time", "is missing", "{column: NAME, unit: s}, or {rate_Hz: 100} without a time column");
    Time(top.Sub("time"));
    Runs(top.Sub("runs"));
    if (!top.Has("columns"))
      top.Fail("columns", "is missing", "a block that says what the table's columns are");
    Columns(top.Sub("columns"));
    Frame(top.Sub("frame"));
    top.Close();
    RefuseTwice(top);
    if (!map_.tension.empty() && map_.load_cell == LoadCellPlace::kNone) {
      top.Fail("runs", "load_cell is none, and columns.tension names load cells",
               "motor_side or robot_side, or no columns.tension");
    }
    return std::move(map_);
  }

 private:
  /// One column is one sensor's; of a motor that winds one tendon in and another one out it may be both's.
  void RefuseTwice(YamlBlock& top) const {
    std::map<std::string, std::string> used;  // channel by column
    const auto use = [&](const std::string& channel, const std::string& column, bool shared) {
      if (column.empty()) return;
      const auto [at, first] = used.emplace(column, channel);
      if (!first && !(shared && at->second == channel)) {
        top.Fail("columns",
                 fmt::format("'{}' stands for {}", Printable(column),
                             at->second == channel ? "two numbers of " + channel
                                                   : fmt::format("{} and {}", at->second, channel)),
                 "a column of its own for each");
      }
    };
    use("time", map_.time_column, false);
    use("time.index", map_.index_column, false);
    std::vector<std::pair<const char*, const std::vector<MappedColumn>*>> groups{
        {"torque_target", &map_.torque_target},
        {"torque_actual", &map_.torque_actual},
        {"motor_position", &map_.motor_position},
        {"tension", &map_.tension},
        {"tip", &map_.tip},
        {"disks", &map_.disks},
        {"orientation", &map_.orientation.columns},
        {"bending", &map_.bending}};
    for (const MappedOrientation& of_disk : map_.disk_orientations)
      groups.emplace_back("disk_orientations", &of_disk.columns);
    for (const auto& [channel, columns] : groups) {
      const bool a_tendon = columns == &map_.torque_target || columns == &map_.torque_actual ||
                            columns == &map_.motor_position || columns == &map_.tension;
      for (const MappedColumn& column : *columns) use(channel, column.name, a_tendon);
    }
  }

  void Format(YamlBlock block) {
    map_.format.delimiter = block.Choice<char>(
        "delimiter", {{"auto", '\0'}, {"comma", ','}, {"semicolon", ';'}, {"tab", '\t'}, {"space", ' '}},
        "auto");
    map_.format.decimal =
        block.Choice<char>("decimal", {{"auto", '\0'}, {"point", '.'}, {"comma", ','}}, "auto");
    map_.format.header = block.Choice<Header>(
        "header", {{"first", Header::kFirstLine}, {"comment", Header::kRemark}, {"none", Header::kNone}},
        "first");
    map_.format.skip_lines = block.Whole("skip_lines", 0, 0, 1000000);
    map_.format.unit_rows = block.Whole("unit_rows", 0, 0, 100);
    if (map_.format.header == Header::kNone && map_.format.unit_rows > 0)
      block.Fail("unit_rows", "is set without names", "skip_lines beside header: none");
    Comment(block);
    block.Close();
  }

  void Comment(YamlBlock& block) {
    const std::string marks = block.Text("comment", map_.format.comment);
    map_.format.comment = marks == "none" ? "" : marks;
    const bool fit = std::all_of(marks.begin(), marks.end(), [&](char c) {
      return std::ispunct(static_cast<unsigned char>(c)) && c != '"' && c != '-' && c != '+' && c != '.' &&
             c != ',' && c != map_.format.delimiter;
    });
    if (marks != "none" && (marks.empty() || marks.size() > 8 || !fit)) {
      block.Fail(
          "comment", fmt::format("'{}' cannot begin a comment", Printable(marks)),
          "none, or characters with which comments begin, such as '#' or '#%;', other than the delimiter");
    }
    if (marks == "none" && map_.format.header == Header::kRemark)
      block.Fail("comment", "is none, but header: comment takes the names from a comment", "such as '#'");
  }

  void Time(YamlBlock block) {
    map_.time_column = block.Text("column", "");
    static const std::map<std::string, TimeKind> kWritten{{"iso8601", TimeKind::kIso8601},
                                                          {"clock", TimeKind::kClock}};
    const std::string unit = block.Text("unit", "s");
    if (const auto written = kWritten.find(unit); written != kWritten.end()) {
      map_.time_kind = written->second;
    } else if (const auto factor = kTimes.find(unit); factor != kTimes.end()) {
      map_.time_factor = factor->second;
    } else {
      block.Fail("unit", "'" + Printable(unit) + "' is not known", Names(kTimes) + ", " + Names(kWritten));
    }
    map_.rate_Hz = block.Number("rate_Hz", 0, 1e-3, 1e6);
    map_.index_column = block.Text("index", "");
    if (map_.time_column.empty() == (map_.rate_Hz == 0)) {
      block.Fail("", "has both or neither of column and rate_Hz",
                 "one of the two: a time column, or a constant rate");
    }
    if (!map_.index_column.empty() && map_.rate_Hz == 0)
      block.Fail("index", "needs rate_Hz", "rate_Hz beside index");
    block.Close();
  }

  MappedText Label(YamlBlock& block, const char* key) {
    MappedText text;
    const YAML::Node node = block.Get(key);
    if (!node) return text;
    if (node.IsScalar()) {
      text.constant = node.Scalar();
      return text;
    }
    YamlBlock sub = block.Sub(key);
    text.column = sub.Text("column", "");
    if (text.column.empty()) sub.Fail("column", "is missing", "the name of a column with labels");
    text.as = sub.Text("as", "$&");
    if (const std::string match = sub.Text("match", ""); !match.empty()) {
      try {
        text.match = std::regex(match, std::regex::ECMAScript);
      } catch (const std::regex_error& e) {
        sub.Fail("match", fmt::format("'{}' is not a regular expression ({})", Printable(match), e.what()),
                 "an ECMAScript expression that the whole label matches");
      }
    }
    sub.Close();
    return text;
  }

  void Runs(YamlBlock block) {
    map_.by = Label(block, "by");
    if (!map_.by.constant.empty())
      block.Fail("by", "is not a block", "{column: NAME, match: EXPRESSION, as: TEXT}");
    map_.family = Label(block, "family");
    map_.repeats = Label(block, "repeats");
    if (!map_.repeats.constant.empty())
      block.Fail("repeats", "is not a block", "{column: NAME, match: EXPRESSION, as: TEXT}");
    map_.longest_gap_s = block.Number("longest_gap_s", 0, 1e-6, 1e9);
    if (block.Has("load_cell")) {
      map_.load_cell =
          block.Choice<LoadCellPlace>("load_cell", {kLoadCellPlaces.begin(), kLoadCellPlaces.end()}, "");
    }
    block.Close();
  }

  /// Names with unit, scale, offset and sign of one channel; `units` by column.
  std::vector<MappedColumn> Group(YamlBlock& block, std::size_t count, const char* what,
                                  const std::vector<double>& unit) {
    const std::vector<std::string> names = block.Texts("names", count, what);
    const std::vector<double> scale = block.Numbers("scale", count, 1),
                              offset = block.Numbers("offset", count, 0),
                              sign = block.Numbers("sign", count, 1);
    std::vector<MappedColumn> columns;
    for (std::size_t i = 0; i < count; ++i) {
      if (sign[i] != 1 && sign[i] != -1)
        block.Fail("sign", fmt::format("{} is not a sign", sign[i]), "1 or -1");
      if (scale[i] == 0) block.Fail("scale", "is zero", "a factor other than 0");
      columns.push_back({names[i], sign[i] * scale[i] * unit[i], sign[i] * offset[i] * unit[i]});
    }
    block.Close();
    return columns;
  }

  const TendonDriveParameters& Drive(YamlBlock& block, std::size_t j) {
    if (!robot_.actuation) {
      block.Fail("unit", "needs a robot file with actuation", "a rig file with motors, gears and spools");
    }
    return robot_.actuation->tendons[j];
  }

  template <class UnitOf>
  std::vector<MappedColumn> ATendon(YamlBlock block, const std::vector<std::string>& units,
                                    const char* otherwise, UnitOf unit_of) {
    const std::string unit = block.Text("unit", otherwise);
    if (std::find(units.begin(), units.end(), unit) == units.end()) {
      block.Fail("unit", "'" + Printable(unit) + "' is not known", Join(units));
    }
    const auto tendons = static_cast<std::size_t>(robot_.body.tendons());
    std::vector<double> factors;
    for (std::size_t j = 0; j < tendons; ++j) factors.push_back(unit_of(block, unit, j));
    std::vector<MappedColumn> columns = Group(
        block, tendons, "one a tendon of the robot, in tendon order; null where there is none", factors);
    for (auto column = columns.begin(); column != columns.end(); ++column) {
      // A motor that winds one tendon in and another one out gives both by its column.
      const bool again = std::any_of(columns.begin(), column, [&](const MappedColumn& c) {
        return !c.name.empty() && c.name == column->name && c.factor * column->factor > 0;
      });
      if (again) {
        block.Fail("names", fmt::format("'{}' stands for two tendons", Printable(column->name)),
                   "a column of its own for each tendon, null, or sign: -1 for the other tendon of a motor "
                   "that has two");
      }
    }
    return columns;
  }

  void Columns(YamlBlock block) {
    const auto torque = [&](YamlBlock& at, const std::string& unit, std::size_t j) {
      static const Units kPlain{{"N m", 1}, {"Nm", 1}, {"mN m", 1e-3}, {"mNm", 1e-3}, {"N cm", 1e-2}};
      if (const auto found = kPlain.find(unit); found != kPlain.end()) return found->second;
      const auto& drive = Drive(at, j);
      if (unit == "permille") return 1e-3 * drive.drive.rated_torque_Nm;
      return (unit == "mA" ? 1e-3 : 1) * drive.motor.torque_constant_NmpA;
    };
    const std::vector<std::string> torques{"N m", "Nm", "mN m", "mNm", "N cm", "A", "mA", "permille"};
    bool any = false;
    const auto has = [&](const char* key) {
      const bool there = block.Has(key);
      any = any || there;
      return there;
    };
    if (has("torque_target"))
      map_.torque_target = ATendon(block.Sub("torque_target"), torques, "N m", torque);
    if (has("torque_actual"))
      map_.torque_actual = ATendon(block.Sub("torque_actual"), torques, "N m", torque);
    if (has("motor_position")) {
      map_.motor_position = ATendon(
          block.Sub("motor_position"), {"rad", "deg", "turns", "counts", "m", "cm", "mm", "um", "inch"},
          "rad", [&](YamlBlock& at, const std::string& unit, std::size_t j) {
            const std::string where = at.Text("at", "motor");
            if (where != "motor" && where != "spool")
              at.Fail("at", "'" + Printable(where) + "' is not known", "motor, spool");
            if (const auto length = kLengths.find(unit); length != kLengths.end()) {
              return length->second / Drive(at, j).SpoolTravelPerMotorRad();  // of the tendon
            }
            const double gear = where == "spool" ? Drive(at, j).gear.ratio : 1;
            if (const auto angle = kAngles.find(unit); angle != kAngles.end()) return gear * angle->second;
            return gear * 2 * std::numbers::pi / Drive(at, j).drive.encoder_counts_per_turn;
          });
    }
    if (has("tension")) {
      map_.tension = ATendon(block.Sub("tension"), {"N", "mN", "kN", "g", "kg", "V", "mV"}, "N",
                             [&](YamlBlock& at, const std::string& unit, std::size_t j) {
                               static const Units kPlain{
                                   {"N", 1}, {"mN", 1e-3}, {"kN", 1e3}, {"g", 9.80665e-3}, {"kg", 9.80665}};
                               if (const auto found = kPlain.find(unit); found != kPlain.end())
                                 return found->second;
                               const double gain = Drive(at, j).load_cell.gain_VpN;
                               if (!(gain > 0))
                                 at.Fail("unit", "needs a load cell in the robot file", "N, mN, kN, g, kg");
                               return (unit == "mV" ? 1e-3 : 1) / gain;
                             });
    }
    if (has("tip")) {
      YamlBlock tip = block.Sub("tip");
      const double unit = tip.Choice("unit", kLengths, "m");
      map_.tip = Group(tip, 3, "x, y, z", std::vector<double>(3, unit));
      if (std::any_of(map_.tip.begin(), map_.tip.end(), [](const auto& c) { return c.name.empty(); })) {
        block.Fail("tip", "lacks an axis", "three column names");
      }
    }
    if (has("disks")) Disks(block.Sub("disks"));
    if (has("orientation")) Orientation(block.Sub("orientation"));
    if (has("disk_orientations")) DiskOrientations(block.Sub("disk_orientations"));
    if (has("bending")) {
      YamlBlock bending = block.Sub("bending");
      map_.bending_is_polar =
          bending.Choice<bool>("kind", {{"us_vs", false}, {"angle_and_plane", true}}, "us_vs");
      const double unit = bending.Choice("unit", kAngles, "rad");
      const std::size_t count = 2 * robot_.body.sections.size();
      map_.bending =
          Group(bending, count,
                map_.bending_is_polar ? "angle and plane of each section" : "us and vs of each section",
                std::vector<double>(count, unit));
    }
    block.Close();
    if (!any)
      block.Fail("", "names no column",
                 "torque_target, torque_actual, motor_position, tension, tip, disks, orientation, "
                 "disk_orientations, "
                 "bending");
  }

  void Disks(YamlBlock block) {
    const double unit = block.Choice("unit", kLengths, "m");
    const int disks = robot_.body.disks();
    map_.disks.resize(static_cast<std::size_t>(3 * disks));
    bool any = false;
    for (int d = 1; d <= disks; ++d) {
      const std::string key = std::to_string(d);
      if (!block.Has(key.c_str())) continue;
      any = true;
      const std::vector<std::string> names = block.Texts(key.c_str(), 3, "columns of x, y and z");
      for (std::size_t i = 0; i < 3; ++i) {
        if (names[i].empty()) block.Fail(key.c_str(), "lacks an axis", "three column names");
        map_.disks[static_cast<std::size_t>(3 * (d - 1)) + i] = {names[i], unit, 0};
      }
    }
    block.Close();
    if (!any) block.Fail("", "names no disk", fmt::format("1 to {}, such as 1: [x1, y1, z1]", disks));
  }

  /// What a block says of its orientations, and how their numbers are to be read.
  struct Oriented {
    MappedOrientation how;  // without columns
    std::size_t count = 4;  // numbers of one
    const char* what = "";
    double unit = 1;
    std::string quaternion_order;  // of the table; empty: no quaternion

    MappedOrientation With(const std::vector<MappedColumn>& columns) const {
      MappedOrientation all = how;
      all.columns = columns;
      for (std::size_t i = 0; i < quaternion_order.size(); ++i)
        all.columns[i] = columns[quaternion_order.find("wxyz"[i])];
      return all;
    }
  };

  void Orientation(YamlBlock block) {
    const Oriented oriented = HowOriented(block);
    map_.orientation = oriented.With(
        Group(block, oriented.count, oriented.what, std::vector<double>(oriented.count, oriented.unit)));
    for (const MappedColumn& c : map_.orientation.columns) {
      if (c.name.empty()) block.Fail("names", "lack one", "a column for each number");
    }
  }

  void DiskOrientations(YamlBlock block) {
    const Oriented oriented = HowOriented(block);
    const int disks = robot_.body.disks();
    map_.disk_orientations.resize(static_cast<std::size_t>(disks));
    bool any = false;
    for (int d = 1; d <= disks; ++d) {
      const std::string key = std::to_string(d);
      if (!block.Has(key.c_str())) continue;
      any = true;
      std::vector<MappedColumn> columns;
      for (const std::string& name : block.Texts(key.c_str(), oriented.count, oriented.what)) {
        if (name.empty()) block.Fail(key.c_str(), "lacks a number", "a column for each number");
        columns.push_back({name, oriented.unit, 0});
      }
      map_.disk_orientations[static_cast<std::size_t>(d - 1)] = oriented.With(columns);
    }
    block.Close();
    if (!any) block.Fail("", "names no disk", fmt::format("1 to {}, such as 1: [qw1, qx1, qy1, qz1]", disks));
  }

  Oriented HowOriented(YamlBlock& block) {
    Oriented oriented;
    oriented.how.kind = block.Choice<OrientationKind>("kind",
                                                      {{"quaternion", OrientationKind::kQuaternion},
                                                       {"matrix", OrientationKind::kMatrix},
                                                       {"euler", OrientationKind::kEuler},
                                                       {"rotation_vector", OrientationKind::kRotationVector}},
                                                      "quaternion");
    switch (oriented.how.kind) {
      case OrientationKind::kNone:
      case OrientationKind::kQuaternion:
        oriented.what = "the quaternion in the given order";
        oriented.quaternion_order = QuaternionOrder(block);
        break;
      case OrientationKind::kMatrix:
        oriented.count = 9;
        oriented.what = "the matrix row by row; its columns are the axes of what is measured";
        break;
      case OrientationKind::kEuler:
      case OrientationKind::kRotationVector:
        oriented.count = 3;
        oriented.what = "the three angles";
        oriented.unit = block.Choice("unit", kAngles, "rad");
        if (oriented.how.kind == OrientationKind::kEuler) oriented.how.euler_order = EulerOrder(block);
        break;
    }
    return oriented;
  }

  static std::string QuaternionOrder(YamlBlock& block) {
    const std::string order = block.Text("order", "wxyz");
    std::string sorted = order;
    std::sort(sorted.begin(), sorted.end());
    if (sorted != "wxyz")
      block.Fail("order", "'" + Printable(order) + "' is not an order",
                 "wxyz, xyzw, or any other order of the four");
    return order;
  }

  static std::string EulerOrder(YamlBlock& block) {
    const std::string order = block.Text("order", "");
    const bool upper = order.find_first_not_of("XYZ") == order.npos,
               lower = order.find_first_not_of("xyz") == order.npos;
    if (order.size() != 3 || !(upper || lower) || order[0] == order[1] || order[1] == order[2]) {
      block.Fail("order", "'" + Printable(order) + "' is not an order",
                 "three axes such as ZYX (about the turned axes) or xyz (about the fixed ones)");
    }
    return order;
  }

  void Frame(YamlBlock block) {
    Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();
    if (block.Has("axes")) {
      const std::vector<std::string> names =
          block.Texts("axes", 3, "which of the table's axes are the base's x, y and z, such as [x, z, -y]");
      axes.setZero();
      for (int i = 0; i < 3; ++i) {
        const std::string& name = names[static_cast<std::size_t>(i)];
        const std::string axis = !name.empty() && (name[0] == '-' || name[0] == '+') ? name.substr(1) : name;
        if (axis != "x" && axis != "y" && axis != "z")
          block.Fail("axes", "'" + Printable(name) + "' is not an axis", "x, y, z, -x, -y, -z");
        axes(i, axis[0] - 'x') = name[0] == '-' ? -1 : 1;
      }
      if (std::abs(axes.determinant() - 1) > 1e-9) {
        block.Fail("axes", "these axes do not form a right-handed frame",
                   "each of x, y, z once, and an even number of exchanges and minus signs");
      }
    }
    map_.R_base_table = Rotation(block.Vector("rotation_rad")) * axes;
    map_.offset_m = block.Vector("offset_m");
    enum class Origin { kGiven, kRest, kFit };
    const Origin origin = block.Choice<Origin>(
        "origin", {{"given", Origin::kGiven}, {"rest", Origin::kRest}, {"fit", Origin::kFit}}, "given");
    map_.from_rest = origin == Origin::kRest;
    if (map_.from_rest && !map_.disks.empty() && map_.tip.empty())
      block.Fail("origin", "is rest, and no tip shows where that is", "given, fit, or columns.tip");
    map_.fit_frame = origin == Origin::kFit;
    block.Close();
  }

  const std::string& path_;
  const RobotParameters& robot_;
  ImportMap map_;
};

}  // namespace

ImportMap LoadImportMap(const std::string& path, const RobotParameters& robot) {
  return Reader(path, robot).Read();
}

}  // namespace tendril::gap
