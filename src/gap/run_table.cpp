// Reads and writes one run as a CSV with the canonical columns. Knows the columns' names and their relations,
// nothing of folders.
#include "tendril/gap/run_table.h"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <utility>

#include "csv.h"
#include "file_bytes.h"
#include "health_signal.h"
#include "row_times.h"
#include "sources.h"
#include "table_hints.h"
#include "tendril/core/limits.h"
#include "text.h"

namespace tendril::gap {
namespace {

// Maximum number of names in a note.
constexpr std::size_t kNamed = 6;

/// One canonical block of columns and its destination.
struct Block {
  Eigen::MatrixXd Run::*matrix;
  std::vector<std::string> names;  // in the matrix's order
  bool whole;                      // a missing column makes the others useless
};

constexpr ColumnText kTime{"t_s", "s", "Time, increasing."};

/// A row of the column table and the matrix it goes into; rows of one matrix follow each other.
struct ColumnOf {
  ColumnText text;
  Eigen::MatrixXd Run::*matrix;
};
const ColumnOf kColumns[] = {
    {{"torque_target_Nm_j", "N·m",
      "Commanded torque at the motor shaft, stamped when sent; it acts one bus cycle later."},
     &Run::torque_target_Nm},
    {{"torque_actual_Nm_j", "N·m", "Reported torque at the motor shaft."}, &Run::torque_actual_Nm},
    {{"motor_position_rad_j", "rad", "Angle of the motor shaft, pulling positive."},
     &Run::motor_position_rad},
    {{"tension_N_j", "N", "Load cell."}, &Run::tension_N},
    {{"tip_x_m", "m", "Tip position by a tracker, x in the base frame."}, &Run::tip_m},
    {{"tip_y_m", "m", "The same, y."}, &Run::tip_m},
    {{"tip_z_m", "m", "The same, z; the straight robot points along +z."}, &Run::tip_m},
    {{"tip_qw", "", "Orientation of the tip in the base frame, unit quaternion, w."}, &Run::tip_quaternion},
    {{"tip_qx", "", "The same, x."}, &Run::tip_quaternion},
    {{"tip_qy", "", "The same, y."}, &Run::tip_quaternion},
    {{"tip_qz", "", "The same, z."}, &Run::tip_quaternion},
    {{"us_k", "rad", "Bending of section k, θ cos β."}, &Run::bending_rad},
    {{"vs_k", "rad", "Bending of section k, θ sin β."}, &Run::bending_rad},
    {{"disk_x_m_d", "m",
      "Position of disk d by a tracker, x in the base frame; disk 1 is the one nearest the base."},
     &Run::disks_m},
    {{"disk_y_m_d", "m", "The same, y."}, &Run::disks_m},
    {{"disk_z_m_d", "m", "The same, z."}, &Run::disks_m},
    {{"disk_qw_d", "", "Orientation of disk d in the base frame, unit quaternion, w."},
     &Run::disk_quaternion},
    {{"disk_qx_d", "", "The same, x."}, &Run::disk_quaternion},
    {{"disk_qy_d", "", "The same, y."}, &Run::disk_quaternion},
    {{"disk_qz_d", "", "The same, z."}, &Run::disk_quaternion},
};

/// The column of tendon, section or disk `n`: "tension_N_2" of "tension_N_j".
std::string Numbered(std::string_view name, int n) {
  return fmt::format("{}{}", name.substr(0, name.size() - 1), n);
}

struct Counts {
  int tendons = 0, sections = 0, disks = 0;
};

/// Of how many a column is one: 0 for a column of the robot's.
int CountOf(std::string_view column, const Counts& counts) {
  if (column.ends_with("_j")) return counts.tendons;
  if (column.ends_with("_k")) return counts.sections;
  return column.ends_with("_d") ? counts.disks : 0;
}

std::vector<Block> Blocks(const Counts& counts) {
  std::vector<Block> blocks;
  for (std::size_t first = 0; first < std::size(kColumns);) {
    std::size_t end = first;
    while (end < std::size(kColumns) && kColumns[end].matrix == kColumns[first].matrix) ++end;
    const std::string_view name = kColumns[first].text.name;
    const bool whole = CountOf(name, {1, 1, 1}) == 0;
    blocks.push_back({kColumns[first].matrix, {}, whole});
    // The columns of a section or a disk are adjacent.
    for (int n = 1; n <= (whole ? 1 : CountOf(name, counts)); ++n) {
      for (std::size_t c = first; c < end; ++c) {
        const std::string_view column = kColumns[c].text.name;
        blocks.back().names.push_back(whole ? std::string(column) : Numbered(column, n));
      }
    }
    first = end;
  }
  return blocks;
}

/// Its columns are those of disks, each with or without a sensor.
bool IsOfDisks(const Block& block) {
  return block.matrix == &Run::disks_m || block.matrix == &Run::disk_quaternion;
}

/// Its columns are one a tendon.
bool IsOfTendons(const Block& block) {
  return !block.whole && block.matrix != &Run::bending_rad && !IsOfDisks(block);
}

std::string Listed(const std::vector<std::string>& names) {
  std::string text;
  for (std::size_t i = 0; i < std::min(names.size(), kNamed); ++i) {
    text += (i ? ", " : "") + Printable(names[i]);
  }
  if (names.size() > kNamed) text += fmt::format(" and {} more", names.size() - kNamed);
  return text;
}

/// Unit quaternions; rows that are not rotations become NaN. The number of those.
int Normalise(Eigen::Ref<Eigen::MatrixXd> quaternions) {
  int bad = 0;
  for (Eigen::Index i = 0; i < quaternions.rows(); ++i) {
    const double norm = quaternions.row(i).norm();
    if (std::isnan(norm)) {
      quaternions.row(i).setConstant(kNoReading);
    } else if (std::abs(norm - 1) > 0.05) {
      quaternions.row(i).setConstant(kNoReading);
      ++bad;
    } else if (std::abs(norm - 1) > 1e-12) {
      quaternions.row(i) /= norm;
    }
  }
  return bad;
}

void Normalise(Run& run) {
  const auto warn = [&](int bad, const char* names) {
    if (bad > 0)
      run.warnings.push_back(fmt::format("{} orientation{} ({}) whose norm is not 1 taken as missing", bad,
                                         bad == 1 ? "" : "s", names));
  };
  if (run.tip_quaternion.cols() > 0) {
    for (const auto number : run.tip_quaternion.colwise())
      run.tip_quaternion_step = std::max(run.tip_quaternion_step, DecimalStep(number));
    warn(Normalise(run.tip_quaternion), "tip_qw, tip_qx, tip_qy, tip_qz");
  }
  int bad = 0;
  for (Eigen::Index d = 0; d + 3 < run.disk_quaternion.cols(); d += 4)
    bad += Normalise(run.disk_quaternion.middleCols(d, 4));
  warn(bad, "disk_qw_d, disk_qx_d, disk_qy_d, disk_qz_d");
}

/// Columns of a table by lower-case name.
class Columns {
 public:
  explicit Columns(const std::vector<std::string>& names) {
    for (const std::string& name : names) lower_.push_back(LowerCase(name));
    for (std::size_t c = 0; c < names.size(); ++c) index_.emplace(lower_[c], c);
  }
  /// Its index, or -1; throws TableError, beginning with `where`, when several have the name.
  int Find(const std::string& name, const std::string& where) const {
    const std::string lower = LowerCase(name);
    if (const std::string places = Twice(lower_, lower); !places.empty()) {
      throw TableError(
          fmt::format("{}: {} are both called {}; accepted: one column per name; rename or remove the other",
                      where, places, name));
    }
    const auto found = index_.find(lower);
    return found == index_.end() ? -1 : static_cast<int>(found->second);
  }

 private:
  std::vector<std::string> lower_;
  std::map<std::string, std::size_t> index_;
};

/// Highest tendon number in canonical names; 0: none.
int TendonsNamed(const Columns& columns, const std::string& where) {
  int most = 0;
  for (const Block& block : Blocks({.tendons = kMaxTendons})) {
    if (!IsOfTendons(block)) continue;
    for (int j = 0; j < static_cast<int>(block.names.size()); ++j) {
      if (columns.Find(block.names[static_cast<std::size_t>(j)], where) >= 0) most = std::max(most, j + 1);
    }
  }
  return most;
}

/// Reads one canonical CSV: columns found by name, then rows in the order of their times.
class TableReader {
 public:
  TableReader(const std::filesystem::path& file, const RobotParameters& robot)
      : name_(file.string()), robot_(robot), bytes_(ReadBytes(file)) {
    run_.name = RunName(file);
    run_.family = "unknown";
    run_.load_cell = CellPlace(robot);
    run_.sha256 = Sha256(bytes_);
  }

  Run Read() {
    const Table table = ParseTable(bytes_, name_, {}, [&](const std::vector<std::string>& names, int line) {
      return FindColumns(names, line);
    });
    run_.notes.insert(run_.notes.end(), table.notes.begin(), table.notes.end());
    TakeRows(table);
    Normalise(run_);
    NoteGaps(run_);
    return std::move(run_);
  }

 private:
  std::vector<CellKind> FindColumns(const std::vector<std::string>& names, int line) {
    const Columns in_file(names);
    const std::string where = fmt::format("{}:{}", name_, line);
    std::vector<CellKind> kinds(names.size(), CellKind::kIgnored);
    time_column_ = in_file.Find("t_s", where);
    if (time_column_ < 0) RefuseWithoutTime(names, where);
    kinds[static_cast<std::size_t>(time_column_)] = CellKind::kNumber;
    named_ = TendonsNamed(in_file, where);
    blocks_ = Blocks({std::max(robot_.body.tendons(), named_), static_cast<int>(robot_.body.sections.size()),
                      robot_.body.disks()});
    for (const Block& block : blocks_) {
      columns_.push_back(ColumnsOf(block, in_file, where));
      for (const int c : columns_.back()) {
        if (c >= 0) kinds[static_cast<std::size_t>(c)] = CellKind::kNumber;
      }
    }
    std::vector<std::string> ignored;
    for (std::size_t c = 0; c < names.size(); ++c) {
      if (kinds[c] == CellKind::kIgnored && !names[c].empty()) ignored.push_back(names[c]);
    }
    if (!ignored.empty()) run_.notes.push_back("columns ignored: " + Listed(ignored));
    if (std::all_of(columns_.begin(), columns_.end(), [](const auto& c) { return c.empty(); })) {
      throw TableError(fmt::format(
          "{}: no usable column; there are: {}; accepted: torque_target_Nm_j, torque_actual_Nm_j, "
          "motor_position_rad_j, tension_N_j (j = 1..{}), tip_x_m, tip_y_m, tip_z_m, tip_qw, tip_qx, tip_qy, "
          "tip_qz, us_k, vs_k (k = 1..{}), disk_x_m_d, disk_y_m_d, disk_z_m_d, disk_qw_d, "
          "disk_qx_d, disk_qy_d, disk_qz_d (d = 1..{}); rename them or use "
          "tendril gap import with a column map",
          where, Listed(names), robot_.body.tendons(), robot_.body.sections.size(), robot_.body.disks()));
    }
    return kinds;
  }

  [[noreturn]] void RefuseWithoutTime(const std::vector<std::string>& names, const std::string& where) const {
    const auto option = OptionForNames(bytes_, {}, {"t_s"});
    throw TableError(fmt::format(
        "{}: no column t_s (time in seconds); there are: {}; {}", where, Listed(names),
        option ? "it is in another line: remove the lines before it, or set " + option->option +
                     " in a map of tendril gap import"
               : "rename the columns to the canonical ones or use tendril gap import with a column map"));
  }

  /// In the block's order, -1: missing; empty where the block cannot be used.
  std::vector<int> ColumnsOf(const Block& block, const Columns& in_file, const std::string& where) {
    std::vector<int> found;
    std::vector<std::string> missing;
    for (const std::string& column : block.names) {
      found.push_back(in_file.Find(column, where));
      if (found.back() < 0) missing.push_back(column);
    }
    if (missing.size() == block.names.size()) return {};
    // Few labs put a marker on every disk.
    if (missing.empty() || IsOfDisks(block)) return found;
    run_.notes.push_back(
        fmt::format("columns missing: {}{}", Listed(missing),
                    block.whole ? "; the others of their kind cannot be used without them" : ""));
    return block.whole ? std::vector<int>() : found;
  }

  void TakeRows(const Table& table) {
    std::vector<double> time = table.numbers[static_cast<std::size_t>(time_column_)];
    const std::vector<int> rows = RowsInTime(time, table.lines, SameNumbers(table, 0), run_);
    if (rows.size() < 2) {
      std::string why;
      for (const std::string& warning : run_.warnings) why += " (" + warning + ")";
      throw TableError(
          fmt::format("{}: {} usable row{}{}; accepted: at least 2 with increasing t_s; record the run again",
                      name_, rows.size(), rows.size() == 1 ? "" : "s", why));
    }
    const auto count = static_cast<Eigen::Index>(rows.size());
    const bool all = rows.size() == time.size();
    const auto copy = [&](const std::vector<double>& from, auto&& to) {
      if (all) {
        to = Eigen::Map<const Eigen::VectorXd>(from.data(), count);
      } else {
        for (Eigen::Index i = 0; i < count; ++i) {
          to[i] = from[static_cast<std::size_t>(rows[static_cast<std::size_t>(i)])];
        }
      }
    };
    run_.time_s.resize(count);
    copy(time, run_.time_s);
    for (std::size_t b = 0; b < blocks_.size(); ++b) {
      const std::vector<int>& columns = columns_[b];
      if (columns.empty()) continue;
      Eigen::MatrixXd& matrix = run_.*blocks_[b].matrix;
      matrix.resize(count, static_cast<Eigen::Index>(columns.size()));
      for (std::size_t c = 0; c < columns.size(); ++c) {
        auto column = matrix.col(static_cast<Eigen::Index>(c));
        if (columns[c] < 0) {
          column.setConstant(kNoReading);
        } else {
          copy(table.numbers[static_cast<std::size_t>(columns[c])], column);
        }
      }
      // Tendons without any column may still exist.
      if (IsOfTendons(blocks_[b]) && named_ < matrix.cols())
        matrix.conservativeResize(Eigen::NoChange, named_);
    }
  }

  const std::string name_;
  const RobotParameters& robot_;
  const std::string bytes_;
  Run run_;
  int time_column_ = -1;
  std::vector<Block> blocks_;
  int named_ = 0;                          // number of tendons that the columns name
  std::vector<std::vector<int>> columns_;  // by block
};

}  // namespace

LoadCellPlace CellPlace(const RobotParameters& robot) {
  if (!robot.actuation) return LoadCellPlace::kNone;
  for (const auto& tendon : robot.actuation->tendons) {
    if (tendon.load_cell.place != LoadCellPlace::kNone) return tendon.load_cell.place;
  }
  return LoadCellPlace::kNone;
}

std::string RunName(const std::filesystem::path& file) {
  const std::string ending = LowerCase(file.extension().string());
  return ending == ".csv" || ending == ".lcmlog" ? file.stem().string() : file.filename().string();
}

std::span<const ColumnText> RunColumns() {
  static const std::vector<ColumnText> all = [] {
    std::vector<ColumnText> texts{kTime};
    for (const ColumnOf& column : kColumns) texts.push_back(column.text);
    return texts;
  }();
  return all;
}

Run ReadRunTable(const std::filesystem::path& file, const RobotParameters& robot) {
  return TableReader(file, robot).Read();
}

RunTable TableOf(const Run& run) {
  RunTable table{{"t_s"}, run.time_s};
  const auto columns = [](const Eigen::MatrixXd& m) { return static_cast<int>(m.cols()); };
  const int tendons = std::max({columns(run.torque_target_Nm), columns(run.torque_actual_Nm),
                                columns(run.motor_position_rad), columns(run.tension_N)});
  const int disks = std::max(columns(run.disks_m) / 3, columns(run.disk_quaternion) / 4);
  for (const Block& block : Blocks({tendons, columns(run.bending_rad) / 2, disks})) {
    const Eigen::MatrixXd& matrix = run.*block.matrix;
    if (matrix.cols() > 0 && matrix.rows() != run.time_s.size()) {
      throw std::runtime_error(fmt::format("run {}: {} has {} rows, the time {}", run.name,
                                           block.names.front(), matrix.rows(), run.time_s.size()));
    }
    if (matrix.cols() == 0) continue;
    table.names.insert(table.names.end(), block.names.begin(), block.names.begin() + matrix.cols());
    const Eigen::Index before = table.values.cols();
    table.values.conservativeResize(Eigen::NoChange, before + matrix.cols());
    table.values.rightCols(matrix.cols()) = matrix;
  }
  return table;
}

void WriteRun(const Run& run, const std::filesystem::path& file) {
  const RunTable table = TableOf(run);
  std::string text = fmt::format("{}", fmt::join(table.names, ","));
  text += '\n';
  std::array<char, 32> digits;
  const auto append = [&](double value) {
    if (std::isnan(value)) return;
    text.append(digits.data(), std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr);
  };
  text.reserve(text.size() + static_cast<std::size_t>(table.values.size()) * 20);
  for (Eigen::Index i = 0; i < table.values.rows(); ++i) {
    for (Eigen::Index c = 0; c < table.values.cols(); ++c) {
      if (c > 0) text += ',';
      append(table.values(i, c));
    }
    text += '\n';
  }
  std::FILE* out = std::fopen(file.c_str(), "wb");
  const bool written = out != nullptr && std::fwrite(text.data(), 1, text.size(), out) == text.size();
  const bool closed = out != nullptr && std::fclose(out) == 0;
  if (!written || !closed) {
    throw std::runtime_error("cannot write " + file.string() +
                             "; name a folder that exists, with room left, in which you may write");
  }
}

}  // namespace tendril::gap
