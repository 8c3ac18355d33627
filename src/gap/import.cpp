// Foreign tables as runs, through a column map; see the header.
#include "tendril/gap/import.h"

#include <fmt/core.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <set>

#include "csv.h"
#include "file_bytes.h"
#include "import_map.h"
#include "pair_motors.h"
#include "rotation.h"
#include "row_times.h"
#include "sources.h"
#include "table_hints.h"
#include "text.h"
#include "time_text.h"

namespace tendril::gap {
namespace {

namespace fs = std::filesystem;

constexpr double kRest_s = 0.5;          // that shows the robot at rest, where a map says so
constexpr std::size_t kLongLabel = 200;  // regular expressions are not run on longer ones

/// How unlike two names are: 0 the same, 1 nothing in common.
double Unlike(const std::string& a, const std::string& b) {
  const std::string x = LowerCase(a), y = LowerCase(b);
  std::vector<std::size_t> row(y.size() + 1);
  for (std::size_t j = 0; j <= y.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= x.size(); ++i) {
    std::size_t corner = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= y.size(); ++j) {
      const std::size_t change = corner + (x[i - 1] != y[j - 1]);
      corner = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, change});
    }
  }
  return static_cast<double>(row[y.size()]) /
         static_cast<double>(std::max<std::size_t>({x.size(), y.size(), 1}));
}

class Importer {
 public:
  Importer(const ImportMap& map, const std::string& map_path, const RobotParameters& robot,
           const fs::path& file)
      : map_(map),
        map_path_(map_path),
        robot_(robot),
        file_(file.string()),
        name_(RunName(file)),
        bytes_(ReadBytes(file)) {}

  std::vector<Run> Read(std::vector<std::string>& notes) {
    table_ = ParseTable(bytes_, file_, map_.format, [&](const auto& names, int line) {
      names_line_ = line;
      return Choose(names);
    });
    notes_.insert(notes_.end(), table_.notes.begin(), table_.notes.end());
    const std::size_t rows = table_.lines.size();
    if (rows == 0) {
      throw TableError(fmt::format(
          "{}: column names without any row; accepted: one row per sample; record or export it again",
          file_));
    }
    const std::vector<double> time = Times(rows);
    by_ = Labels(map_.by, rows);
    family_ = Labels(map_.family, rows);
    repeats_ = Labels(map_.repeats, rows);
    FindRest(time);
    std::vector<Run> runs;
    const std::string sha256 = Sha256(bytes_);
    for (std::size_t begin = 0; begin < rows;) {
      std::size_t end = begin + 1;
      while (end < rows && !Ends(end, time)) ++end;
      Run run = MakeRun(begin, end, time);
      if (run.time_s.size() < 2) {
        std::string why;
        for (const std::string& warning : run.warnings) why += " (" + warning + ")";
        notes.push_back(
            fmt::format("{}:{}: run {} left out: it has {} usable row{} of {}{}; accepted: at least 2", file_,
                        table_.lines[begin], run.name, run.time_s.size(), run.time_s.size() == 1 ? "" : "s",
                        end - begin, why));
      } else {
        run.sha256 = sha256;
        NoteGaps(run);
        if (runs.empty()) run.notes.insert(run.notes.end(), notes_.begin(), notes_.end());
        runs.push_back(std::move(run));
        keys_.push_back(repeats_.empty() ? std::string() : repeats_[begin]);
      }
      begin = end;
    }
    SettleNames(runs);
    return runs;
  }

 private:
  // ---- columns ----

  std::vector<const std::vector<MappedColumn>*> Groups() const {
    std::vector<const std::vector<MappedColumn>*> groups{
        &map_.torque_target, &map_.torque_actual, &map_.motor_position,      &map_.tension,
        &map_.tip,           &map_.disks,         &map_.orientation.columns, &map_.bending};
    for (const MappedOrientation& of_disk : map_.disk_orientations) groups.push_back(&of_disk.columns);
    return groups;
  }

  std::vector<CellKind> Choose(const std::vector<std::string>& names) {
    std::vector<CellKind> kinds(names.size(), CellKind::kIgnored);
    const auto want = [&](const std::string& name, CellKind kind) {
      if (name.empty()) return;
      const auto found = std::find(names.begin(), names.end(), name);
      if (found == names.end()) ThrowUnknown(name, names);
      if (const std::string places = Twice(names, name); !places.empty()) ThrowTwice(name, places);
      const auto c = static_cast<std::size_t>(found - names.begin());
      if (kinds[c] != CellKind::kIgnored && kinds[c] != kind) {
        throw TableError(
            fmt::format("{}: column '{}' is used as a number and as a label; accepted: one of the two; "
                        "correct the map {}",
                        file_, Printable(name), map_path_));
      }
      kinds[c] = kind;
      column_[name] = c;
    };
    want(map_.time_column, map_.time_kind == TimeKind::kNumber ? CellKind::kNumber : CellKind::kText);
    want(map_.index_column, CellKind::kNumber);
    for (const auto* text : {&map_.by, &map_.family, &map_.repeats}) want(text->column, CellKind::kText);
    for (const auto* group : Groups()) {
      for (const MappedColumn& column : *group) want(column.name, CellKind::kNumber);
    }
    std::string ignored;
    for (std::size_t c = 0; c < names.size(); ++c) {
      if (kinds[c] == CellKind::kIgnored && !names[c].empty())
        ignored += (ignored.empty() ? "" : ", ") + names[c];
    }
    if (!ignored.empty())
      notes_.push_back("columns of the table that the map does not use: " + Printable(ignored, 200));
    return kinds;
  }

  [[noreturn]] void ThrowUnknown(const std::string& name, const std::vector<std::string>& names) const {
    const auto nearest = std::min_element(names.begin(), names.end(), [&](const auto& a, const auto& b) {
      return Unlike(name, a) < Unlike(name, b);
    });
    std::string all;
    for (const std::string& n : names) all += (all.empty() ? "" : ", ") + n;
    const auto option = OptionForNames(bytes_, map_.format, MappedNames());
    throw TableError(fmt::format(
        "{}:{}: no column '{}', which the map {} names{}; there are: {}; {}", file_, names_line_,
        Printable(name), map_path_,
        !option && Unlike(name, *nearest) < 0.4 ? "; did you mean '" + Printable(*nearest) + "'?" : "",
        Printable(all, 300),
        option ? option->why + ": set " + option->option + " in the map" : "correct the map"));
  }

  /// All columns that the map names.
  std::vector<std::string> MappedNames() const {
    std::vector<std::string> names{map_.time_column, map_.index_column, map_.by.column, map_.family.column,
                                   map_.repeats.column};
    for (const auto* group : Groups()) {
      for (const MappedColumn& column : *group) names.push_back(column.name);
    }
    std::erase(names, "");
    return names;
  }

  [[noreturn]] void ThrowTwice(const std::string& name, const std::string& places) const {
    throw TableError(fmt::format(
        "{}:{}: {} are both called '{}', which the map {} names; accepted: a name of its own for each; "
        "rename one, or set table: {{header: none, skip_lines: {}}} in the map and call all columns 1, 2, "
        "...",
        file_, names_line_, places, Printable(name), map_path_, names_line_ + map_.format.unit_rows));
  }

  const std::vector<double>& Numbers(const std::string& name) const {
    return table_.numbers[column_.at(name)];
  }

  std::vector<double> Times(std::size_t rows) {
    std::vector<double> time(rows);
    if (!map_.time_column.empty() && map_.time_kind != TimeKind::kNumber) {
      time = WrittenTimes();
    } else if (!map_.time_column.empty()) {
      time = Numbers(map_.time_column);
      for (double& t : time) t *= map_.time_factor;
    } else if (!map_.index_column.empty()) {
      time = Numbers(map_.index_column);
      for (double& t : time) t /= map_.rate_Hz;
    } else {
      for (std::size_t i = 0; i < rows; ++i) time[i] = static_cast<double>(i) / map_.rate_Hz;
    }
    return time;
  }

  /// Of texts, in seconds since the first; NaN where a cell is empty.
  std::vector<double> WrittenTimes() {
    const std::vector<std::string>& texts = table_.texts[column_.at(map_.time_column)];
    std::vector<std::optional<std::int64_t>> ns(texts.size());
    std::optional<bool> with_offset;
    for (std::size_t i = 0; i < texts.size(); ++i) {
      if (texts[i].empty()) continue;
      if (map_.time_kind == TimeKind::kClock) {
        ns[i] = ParseClock(texts[i]);
      } else if (const auto moment = ParseIso8601(texts[i])) {
        if (with_offset.value_or(moment->with_offset) != moment->with_offset)
          ThrowTime(i, texts[i], "an offset from UTC (Z, +02:00) in every time or in none");
        with_offset = moment->with_offset;
        ns[i] = moment->ns;
      }
      if (!ns[i])
        ThrowTime(i, texts[i],
                  map_.time_kind == TimeKind::kClock
                      ? "HH:MM:SS with or without a fraction, such as 23:59:59.990"
                      : "such as 2024-05-01T12:00:00.010Z, with T or a space, with or without an offset");
    }
    if (map_.time_kind == TimeKind::kClock) {
      if (const int row = PassMidnights(ns); row >= 0)
        notes_.push_back(fmt::format("the clock of '{}' passes midnight in line {}",
                                     Printable(map_.time_column),
                                     table_.lines[static_cast<std::size_t>(row)]));
    }
    const auto first = std::find_if(ns.begin(), ns.end(), [](const auto& t) { return t.has_value(); });
    std::vector<double> time(ns.size(), kNoReading);
    for (std::size_t i = 0; i < ns.size(); ++i) {
      if (ns[i]) time[i] = static_cast<double>(*ns[i] - **first) / 1e9;
    }
    return time;
  }

  [[noreturn]] void ThrowTime(std::size_t row, const std::string& text, const char* accepted) const {
    throw TableError(fmt::format(
        "{}:{}: column {}: '{}' is not a time; accepted: {}; correct the cell, or time.unit of the map {}",
        file_, table_.lines[row], Printable(map_.time_column), Printable(text), accepted, map_path_));
  }

  /// Of every row; empty when the map does not tell.
  std::vector<std::string> Labels(const MappedText& text, std::size_t rows) const {
    if (!text.constant.empty()) return std::vector<std::string>(rows, text.constant);
    if (text.column.empty()) return {};
    std::vector<std::string> labels = table_.texts[column_.at(text.column)];
    if (!text.match) return labels;
    std::map<std::string, std::string> done;  // labels repeat
    for (std::string& label : labels) {
      const auto [at, first] = done.try_emplace(label, label);
      std::smatch parts;
      if (first && label.size() <= kLongLabel && std::regex_match(label, parts, *text.match)) {
        at->second = parts.format(text.as);
      }
      label = at->second;
    }
    return labels;
  }

  bool Ends(std::size_t row, const std::vector<double>& time) const {
    if (!by_.empty() && by_[row] != by_[row - 1]) return true;
    return map_.longest_gap_s > 0 && time[row] - time[row - 1] > map_.longest_gap_s;
  }

  // ---- rows ----

  Run MakeRun(std::size_t begin, std::size_t end, const std::vector<double>& time) {
    Run run;
    run.name = Named(by_.empty() ? name_ : name_ + "_" + by_[begin]);
    run.family = family_.empty() || family_[begin].empty() ? "unknown" : family_[begin];
    run.load_cell = map_.tension.empty() ? LoadCellPlace::kNone : map_.load_cell.value_or(CellPlace(robot_));
    if (!map_.tension.empty() && run.load_cell == LoadCellPlace::kNone)
      run.load_cell = LoadCellPlace::kMotorSide;
    std::vector<double> here(time.begin() + static_cast<std::ptrdiff_t>(begin),
                             time.begin() + static_cast<std::ptrdiff_t>(end));
    const std::vector<int> lines(table_.lines.begin() + static_cast<std::ptrdiff_t>(begin),
                                 table_.lines.begin() + static_cast<std::ptrdiff_t>(end));
    std::vector<int> rows = RowsInTime(here, lines, SameNumbers(table_, begin), run);
    run.time_s.resize(static_cast<Eigen::Index>(rows.size()));
    for (std::size_t i = 0; i < rows.size(); ++i) {
      run.time_s[static_cast<Eigen::Index>(i)] =
          here[static_cast<std::size_t>(rows[i])] - here[static_cast<std::size_t>(rows[0])];
    }
    for (int& row : rows) row += static_cast<int>(begin);  // of the table
    run.torque_target_Nm = Fill(map_.torque_target, rows);
    run.torque_actual_Nm = Fill(map_.torque_actual, rows);
    run.motor_position_rad = Fill(map_.motor_position, rows);
    CompletePairs(robot_, run);
    run.tension_N = Fill(map_.tension, rows);
    run.bending_rad = Fill(map_.bending, rows);
    if (map_.bending_is_polar) {
      for (Eigen::Index k = 0; k + 1 < run.bending_rad.cols(); k += 2) {
        const Eigen::ArrayXd angle = run.bending_rad.col(k), plane = run.bending_rad.col(k + 1);
        run.bending_rad.col(k) = angle * plane.cos();
        run.bending_rad.col(k + 1) = angle * plane.sin();
      }
    }
    FillPose(run, rows);
    return run;
  }

  Eigen::MatrixXd Fill(const std::vector<MappedColumn>& columns, const std::vector<int>& rows) const {
    Eigen::MatrixXd filled(static_cast<Eigen::Index>(rows.size()), static_cast<Eigen::Index>(columns.size()));
    for (std::size_t c = 0; c < columns.size(); ++c) {
      auto column = filled.col(static_cast<Eigen::Index>(c));
      if (columns[c].name.empty()) {
        column.setConstant(kNoReading);
        continue;
      }
      const std::vector<double>& numbers = Numbers(columns[c].name);
      for (std::size_t i = 0; i < rows.size(); ++i) {
        column[static_cast<Eigen::Index>(i)] =
            columns[c].factor * numbers[static_cast<std::size_t>(rows[i])] + columns[c].offset;
      }
    }
    return filled;
  }

  /// R in the table's frame; false where a number is missing or it is no rotation.
  static bool Rotation(const MappedOrientation& oriented, const Eigen::RowVectorXd& x, Eigen::Matrix3d& R) {
    if (!x.allFinite()) return false;
    switch (oriented.kind) {
      case OrientationKind::kQuaternion:
        if (std::abs(x.norm() - 1) > 0.05) return false;
        R = Eigen::Quaterniond(x[0], x[1], x[2], x[3]).normalized().toRotationMatrix();
        return true;
      case OrientationKind::kMatrix: {
        for (int i = 0; i < 9; ++i) R(i / 3, i % 3) = x[i];
        if ((R * R.transpose() - Eigen::Matrix3d::Identity()).norm() > 0.1 || R.determinant() < 0)
          return false;
        R = Eigen::Quaterniond(R).normalized().toRotationMatrix();
        return true;
      }
      case OrientationKind::kRotationVector:
        R = gap::Rotation(Eigen::Vector3d(x.transpose()));
        return true;
      case OrientationKind::kEuler: {
        R.setIdentity();
        for (int i = 0; i < 3; ++i) {
          const char axis = oriented.euler_order[static_cast<std::size_t>(i)];
          const bool turned = axis < 'a';
          const Eigen::Matrix3d turn =
              Eigen::AngleAxisd(x[i], Eigen::Vector3d::Unit(turned ? axis - 'X' : axis - 'x'))
                  .toRotationMatrix();
          R = turned ? Eigen::Matrix3d(R * turn) : Eigen::Matrix3d(turn * R);
        }
        return true;
      }
      case OrientationKind::kNone:
        break;
    }
    return false;
  }

  void FillPose(Run& run, const std::vector<int>& rows) {
    if (!map_.tip.empty()) {
      run.tip_m = Fill(map_.tip, rows) * map_.R_base_table.transpose();
      run.tip_m.rowwise() += (map_.offset_m + rest_offset_m_).transpose();
      for (Eigen::Index i = 0; i < run.tip_m.rows(); ++i) {
        if (!run.tip_m.row(i).allFinite()) run.tip_m.row(i).setConstant(kNoReading);
      }
    }
    run.disks_m = Fill(map_.disks, rows);
    for (Eigen::Index d = 0; d < run.disks_m.cols(); d += 3) {
      const Eigen::MatrixXd disk = run.disks_m.middleCols(d, 3) * map_.R_base_table.transpose();
      run.disks_m.middleCols(d, 3) = disk.rowwise() + (map_.offset_m + rest_offset_m_).transpose();
    }
    int bad = 0;
    const Eigen::Matrix3d unturned = Eigen::Matrix3d::Identity();
    run.tip_quaternion = Quaternions(map_.orientation, rest_turn_, rows, bad);
    if (!map_.disk_orientations.empty()) {
      run.disk_quaternion.setConstant(
          run.time_s.size(), 4 * static_cast<Eigen::Index>(map_.disk_orientations.size()), kNoReading);
    }
    for (std::size_t d = 0; d < map_.disk_orientations.size(); ++d) {
      if (map_.disk_orientations[d].columns.empty()) continue;
      run.disk_quaternion.middleCols(4 * static_cast<Eigen::Index>(d), 4) = Quaternions(
          map_.disk_orientations[d], disk_rest_turn_.empty() ? unturned : disk_rest_turn_[d], rows, bad);
    }
    if (bad > 0)
      run.warnings.push_back(
          fmt::format("{} orientation{} no rotation, taken as missing", bad, bad == 1 ? " is" : "s are"));
  }

  /// S x 4 in the base frame, w not negative; without columns where none are mapped. Counts in `bad` what is
  /// no rotation.
  Eigen::MatrixXd Quaternions(const MappedOrientation& oriented, const Eigen::Matrix3d& turn,
                              const std::vector<int>& rows, int& bad) const {
    if (oriented.columns.empty()) return {};
    const Eigen::MatrixXd numbers = Fill(oriented.columns, rows);
    Eigen::MatrixXd quaternions = Eigen::MatrixXd::Constant(numbers.rows(), 4, kNoReading);
    Eigen::Matrix3d R;
    for (Eigen::Index i = 0; i < numbers.rows(); ++i) {
      if (!Rotation(oriented, numbers.row(i), R)) {
        bad += numbers.row(i).allFinite();
        continue;
      }
      Eigen::Quaterniond q(Eigen::Matrix3d(map_.R_base_table * R * turn));
      if (q.w() < 0) q.coeffs() *= -1;
      quaternions.row(i) << q.w(), q.x(), q.y(), q.z();
    }
    return quaternions;
  }

  /// Offset and turn that make the first rows the straight robot at rest.
  void FindRest(const std::vector<double>& time) {
    if (!map_.from_rest || time.empty()) return;
    const auto first = std::find_if(time.begin(), time.end(), [](double t) { return std::isfinite(t); });
    std::vector<int> rows;
    for (auto t = first; t != time.end() && !(*t - *first > kRest_s); ++t)
      rows.push_back(static_cast<int>(t - time.begin()));
    if (!map_.tip.empty()) {
      const Eigen::MatrixXd tip = Fill(map_.tip, rows) * map_.R_base_table.transpose();
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      int count = 0;
      for (Eigen::Index i = 0; i < tip.rows(); ++i) {
        if (!tip.row(i).allFinite()) continue;
        sum += tip.row(i).transpose();
        ++count;
      }
      if (count == 0) {
        throw TableError(
            fmt::format("{}: no tip position in the first {} s, which should show the robot at rest "
                        "(frame.origin of {}); "
                        "accepted: origin: given, with offset_m",
                        file_, kRest_s, map_path_));
      }
      rest_offset_m_ = Eigen::Vector3d(0, 0, robot_.body.length_m()) - sum / count;
    }
    rest_turn_ = RestTurn(map_.orientation, rows);
    for (const MappedOrientation& of_disk : map_.disk_orientations)
      disk_rest_turn_.push_back(RestTurn(of_disk, rows));
  }

  /// What turns the first orientation in these rows into that of the straight robot: how a sensor is mounted.
  Eigen::Matrix3d RestTurn(const MappedOrientation& oriented, const std::vector<int>& rows) const {
    const Eigen::MatrixXd numbers = Fill(oriented.columns, rows);
    Eigen::Matrix3d R;
    for (Eigen::Index i = 0; i < numbers.rows(); ++i) {
      if (Rotation(oriented, numbers.row(i), R)) return (map_.R_base_table * R).transpose();
    }
    return Eigen::Matrix3d::Identity();
  }

  // ---- names ----

  /// As a file may be called.
  static std::string Named(std::string name) {
    for (char& c : name) {
      const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                         c == '.' || c == '-' || c == '_';
      if (!plain) c = '_';
    }
    return name.substr(0, kLongLabel);
  }

  void SettleNames(std::vector<Run>& runs) const {
    std::set<std::string> taken;
    std::map<std::string, std::string> first;  // of the runs that repeat each other
    for (std::size_t i = 0; i < runs.size(); ++i) {
      const std::string plain = runs[i].name;
      for (int n = 2; !taken.insert(runs[i].name).second; ++n) runs[i].name = fmt::format("{}_{}", plain, n);
      if (keys_[i].empty()) continue;
      const auto [at, is_first] = first.emplace(keys_[i], runs[i].name);
      if (!is_first) runs[i].repeat_of = at->second;
    }
  }

  const ImportMap& map_;
  const std::string& map_path_;
  const RobotParameters& robot_;
  std::string file_, name_, bytes_;
  int names_line_ = 0;
  Table table_;
  std::map<std::string, std::size_t> column_;
  std::vector<std::string> by_, family_, repeats_, keys_, notes_;
  Eigen::Vector3d rest_offset_m_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d rest_turn_ = Eigen::Matrix3d::Identity();
  std::vector<Eigen::Matrix3d> disk_rest_turn_;  // of every disk; empty: none is turned
};

}  // namespace

DataSet ImportTables(const std::string& map_path, const std::vector<std::string>& tables,
                     const RobotParameters& robot) {
  const ImportMap map = LoadImportMap(map_path, robot);
  DataSet set;
  set.robot = robot;
  set.fit_frame = map.fit_frame && (!map.tip.empty() || !map.disks.empty() || !map.disk_orientations.empty());
  std::set<std::string> taken;
  for (const std::string& table : tables) {
    try {
      for (Run& run : Importer(map, map_path, robot, table).Read(set.notes)) {
        if (!taken.insert(run.name).second) {
          throw std::runtime_error(fmt::format(
              "{}: a second run '{}'; accepted: tables of different names; rename one", table, run.name));
        }
        set.runs.push_back(std::move(run));
      }
    } catch (const std::exception& e) {
      if (tables.size() == 1) throw;
      set.notes.push_back(fmt::format("left out: {}", e.what()));
    }
  }
  if (!tables.empty()) set.name = RunName(tables.front());
  if (set.runs.empty()) {
    std::string why;
    for (const std::string& note : set.notes) why += "\n  " + note;
    throw std::runtime_error("no run could be imported" + why);
  }
  return set;
}

}  // namespace tendril::gap
