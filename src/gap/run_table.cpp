// Reads and writes one run as a CSV with the canonical columns. Knows the columns' names and their relations,
// nothing of folders.
#include <fmt/core.h>

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
#include "median.h"
#include "sources.h"
#include "table_hints.h"
#include "tendril/core/limits.h"
#include "text.h"

namespace tendril::gap {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
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
};

/// The column of tendon or section `n`: "tension_N_2" of "tension_N_j".
std::string Numbered(std::string_view name, int n) {
  return fmt::format("{}{}", name.substr(0, name.size() - 1), n);
}

std::vector<Block> Blocks(int tendons, int sections) {
  std::vector<Block> blocks;
  for (const ColumnOf& column : kColumns) {
    const bool each_tendon = column.text.name.ends_with("_j"),
               each_section = column.text.name.ends_with("_k");
    if (blocks.empty() || blocks.back().matrix != column.matrix)
      blocks.push_back({column.matrix, {}, !each_tendon && !each_section});
    Block& block = blocks.back();
    if (block.whole) block.names.emplace_back(column.text.name);
    for (int j = 1; each_tendon && j <= tendons; ++j) block.names.push_back(Numbered(column.text.name, j));
  }
  // The two columns of a section are adjacent.
  for (int k = 1; k <= sections; ++k) {
    for (const ColumnOf& column : kColumns) {
      if (column.text.name.ends_with("_k")) blocks.back().names.push_back(Numbered(column.text.name, k));
    }
  }
  return blocks;
}

std::string Listed(const std::vector<std::string>& names) {
  std::string text;
  for (std::size_t i = 0; i < std::min(names.size(), kNamed); ++i) {
    text += (i ? ", " : "") + Printable(names[i]);
  }
  if (names.size() > kNamed) text += fmt::format(" and {} more", names.size() - kNamed);
  return text;
}

// Unit quaternions; rows that are not rotations become NaN.
void Normalise(Run& run) {
  if (run.tip_quaternion.cols() == 0) return;
  for (const auto number : run.tip_quaternion.colwise())
    run.tip_quaternion_step = std::max(run.tip_quaternion_step, DecimalStep(number));
  int bad = 0;
  for (Eigen::Index i = 0; i < run.tip_quaternion.rows(); ++i) {
    const double norm = run.tip_quaternion.row(i).norm();
    if (std::isnan(norm)) {
      run.tip_quaternion.row(i).setConstant(kNone);
    } else if (std::abs(norm - 1) > 0.05) {
      run.tip_quaternion.row(i).setConstant(kNone);
      ++bad;
    } else if (std::abs(norm - 1) > 1e-12) {
      run.tip_quaternion.row(i) /= norm;
    }
  }
  if (bad > 0) {
    run.warnings.push_back(fmt::format(
        "{} orientations (tip_qw, tip_qx, tip_qy, tip_qz) whose norm is not 1 taken as missing", bad));
  }
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
  for (const Block& block : Blocks(kMaxTendons, 0)) {
    if (block.whole) continue;
    for (int j = 0; j < static_cast<int>(block.names.size()); ++j) {
      if (columns.Find(block.names[static_cast<std::size_t>(j)], where) >= 0) most = std::max(most, j + 1);
    }
  }
  return most;
}

/// Rows [begin, end) of the longest part of a table whose clock restarted: time jumps back and continues for
/// long without reaching its previous value.
std::pair<std::size_t, std::size_t> LongestOfOneClock(const std::vector<double>& t,
                                                      const std::vector<int>& lines, Run& run) {
  constexpr std::size_t kLong = 50;
  std::pair<std::size_t, std::size_t> longest{0, 0};
  std::size_t begin = 0, restarts = 0;
  int first_line = 0;
  const auto part_ends = [&](std::size_t end) {
    if (end - begin > longest.second - longest.first) longest = {begin, end};
    begin = end;
  };
  for (std::size_t i = 2; i + kLong <= t.size(); ++i) {
    // A single row that jumps ahead is also followed by a jump back.
    const double before = std::min(t[i - 2], t[i - 1]);
    bool restarted = t[i] < before && t[i + kLong - 1] < before;
    for (std::size_t k = i + 1; k < i + kLong && restarted; ++k) restarted = t[k] > t[k - 1];
    if (!restarted) continue;
    if (restarts++ == 0) first_line = lines[i];
    part_ends(i);
  }
  part_ends(t.size());
  if (restarts > 0) {
    run.warnings.push_back(fmt::format(
        "the clock restarts {} time{}, first in line {}: the longest part is read, {} of {} rows; split the "
        "file there to use the others",
        restarts, restarts == 1 ? "" : "s", first_line, longest.second - longest.first, t.size()));
  }
  return longest;
}

/// Spreads rows with equal stamps, from a clock coarser than the log: evenly from its tick to the next. After
/// the beginning and after a pause, where rows of a tick may be missing, they end at the next tick; before
/// the end and before a pause they begin at their own.
void SpreadStamps(std::vector<double>& t, const SameRow& same, Run& run) {
  constexpr double kMany = 0.2;     // of the rows: fewer are duplicates
  constexpr double kPause = 1.5;    // in usual ticks
  std::vector<std::size_t> begins;  // first row of each stamp
  bool others = false;
  for (std::size_t i = 0; i < t.size(); ++i) {
    if (i == 0 || t[i] != t[i - 1])
      begins.push_back(i);
    else
      others = others || !same(i, i - 1);
  }
  const std::size_t stamps = begins.size(), shared = t.size() - stamps;
  if (!others || stamps < 3 || static_cast<double>(shared) < kMany * static_cast<double>(t.size())) return;
  begins.push_back(t.size());
  const std::vector<double> stamp = t;
  std::vector<double> ticks_s, steps_s;
  for (std::size_t k = 1; k + 1 < stamps; ++k) {
    const double tick_s = stamp[begins[k + 1]] - stamp[begins[k]];
    if (!(tick_s > 0)) continue;
    ticks_s.push_back(tick_s);
    steps_s.push_back(tick_s / static_cast<double>(begins[k + 1] - begins[k]));
  }
  if (ticks_s.empty()) return;
  const double usual_s = Median(std::move(ticks_s)), step_s = Median(std::move(steps_s));
  const auto goes_on = [&](std::size_t k) {  // from stamp k - 1 to stamp k
    const double tick_s = k > 0 && k < stamps ? stamp[begins[k]] - stamp[begins[k - 1]] : 0;
    return tick_s > 0 && tick_s < kPause * usual_s;
  };
  for (std::size_t k = 0; k < stamps; ++k) {
    const std::size_t begin = begins[k], count = begins[k + 1] - begin;
    const auto rows = static_cast<double>(count);
    double from_s = stamp[begin], each_s = step_s;
    if (goes_on(k + 1)) {
      const double next_s = stamp[begins[k + 1]];
      if (goes_on(k))
        each_s = (next_s - from_s) / rows;
      else
        from_s = next_s - rows * step_s;
    }
    for (std::size_t i = 0; i < count; ++i) t[begin + i] = from_s + static_cast<double>(i) * each_s;
  }
  run.warnings.push_back(fmt::format(
      "{} of {} rows have the stamp of the row before, of a clock that ticks every {:.3g} s: spread evenly "
      "between the ticks; fast effects (delay, damping) are blurred; stamp rows where they are taken",
      shared, t.size(), usual_s));
}

}  // namespace

// Rows after a clock restart belong to another run. A single row that jumps ahead of the next two is itself
// wrong.
std::vector<int> RowsInTime(std::vector<double>& t, const std::vector<int>& lines, const SameRow& same,
                            Run& run) {
  SpreadStamps(t, same, run);
  const auto [begin, end] = LongestOfOneClock(t, lines, run);
  std::vector<int> rows;
  rows.reserve(t.size());
  const auto later = [&](std::size_t i, std::size_t than) { return t[i] > t[than]; };
  std::size_t without = 0, back = 0, earlier = 0;
  int first_back = 0;
  for (std::size_t i = begin; i < end; ++i) {
    if (!std::isfinite(t[i])) {
      ++without;
      continue;
    }
    const auto last = rows.empty() ? t.size() : static_cast<std::size_t>(rows.back());
    const bool jumped = i + 2 < end && !later(i + 1, i) && !later(i + 2, i) && later(i + 2, i + 1) &&
                        (rows.empty() || later(i + 1, last));
    if (jumped || (!rows.empty() && !later(i, last))) {
      if (back++ == 0) first_back = lines[i];
      if (!rows.empty() && later(last, i)) ++earlier;
      continue;
    }
    rows.push_back(static_cast<int>(i));
  }
  if (without > 0) run.warnings.push_back(fmt::format("{} rows without a time dropped", without));
  // More rows that go back than rows that go on: what goes on is chance, and no run.
  if (earlier > rows.size()) {
    run.warnings.push_back(
        fmt::format("the rows are not in the order of their times, the first that goes back in line {}; sort "
                    "the table by its time",
                    first_back));
    return {};
  }
  if (back > 0) {
    run.warnings.push_back(
        fmt::format("{} rows whose time does not increase dropped, the first in line {}; if the clock "
                    "restarted there, split "
                    "the file",
                    back, first_back));
  }
  return rows;
}

void NoteGaps(Run& run) {
  const Eigen::Index rows = run.time_s.size();
  if (rows < 3) return;
  std::vector<double> steps(static_cast<std::size_t>(rows - 1));
  for (Eigen::Index i = 0; i + 1 < rows; ++i) {
    steps[static_cast<std::size_t>(i)] = run.time_s[i + 1] - run.time_s[i];
  }
  const double usual = Median(steps);
  int gaps = 0;
  double longest = 0, where = 0, lost = 0;
  for (std::size_t i = 0; i < steps.size(); ++i) {
    if (steps[i] <= 1.5 * usual) continue;
    ++gaps;
    lost += std::round(steps[i] / usual) - 1;
    if (steps[i] > longest) {
      longest = steps[i];
      where = run.time_s[static_cast<Eigen::Index>(i)];
    }
  }
  // A log with irregular times has no grid in which rows could be missing.
  if (gaps == 0 || gaps > rows / 5) return;
  run.notes.push_back(
      fmt::format("{} gaps in the time grid of {:.6g} s ({:.0f} rows missing), the longest {:.6g} s "
                  "at t = {:.6g} s",
                  gaps, usual, lost, longest, where));
}

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

SameRow SameNumbers(const Table& table, std::size_t from) {
  return [&table, from](std::size_t a, std::size_t b) {
    return std::all_of(table.numbers.begin(), table.numbers.end(), [&](const std::vector<double>& column) {
      if (column.empty()) return true;
      const double x = column[from + a], y = column[from + b];
      return x == y || (std::isnan(x) && std::isnan(y));
    });
  };
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
  const std::string bytes = ReadBytes(file);
  Run run;
  run.name = RunName(file);
  run.family = "unknown";
  run.load_cell = CellPlace(robot);
  run.sha256 = Sha256(bytes);

  const int tendons = robot.body.tendons();
  std::vector<Block> blocks;
  int named = 0;  // number of tendons named
  int time_column = -1;
  std::vector<std::vector<int>> columns;  // by block; -1: missing
  const std::string name = file.string();
  Table table = ParseTable(bytes, name, {}, [&](const std::vector<std::string>& names, int line) {
    const Columns in_file(names);
    const std::string where = fmt::format("{}:{}", name, line);
    std::vector<CellKind> kinds(names.size(), CellKind::kIgnored);
    time_column = in_file.Find("t_s", where);
    if (time_column < 0) {
      const std::string option = OptionForNames(bytes, {}, {"t_s"});
      throw TableError(fmt::format(
          "{}: no column t_s (time in seconds); there are: {}; {}", where, Listed(names),
          option.empty()
              ? "rename the columns to the canonical ones or use tendril gap import with a column map"
              : "it is in another line: remove the lines before it, or set " + option +
                    " in a map of tendril gap import"));
    }
    kinds[static_cast<std::size_t>(time_column)] = CellKind::kNumber;
    named = TendonsNamed(in_file, where);
    blocks = Blocks(std::max(tendons, named), static_cast<int>(robot.body.sections.size()));
    for (const Block& block : blocks) {
      std::vector<int> found;
      std::vector<std::string> missing;
      for (const std::string& column : block.names) {
        found.push_back(in_file.Find(column, where));
        if (found.back() < 0) missing.push_back(column);
      }
      if (missing.size() == block.names.size()) {
        found.clear();
      } else if (!missing.empty()) {
        run.notes.push_back(
            fmt::format("columns missing: {}{}", Listed(missing),
                        block.whole ? "; the others of their kind cannot be used without them" : ""));
        if (block.whole) found.clear();
      }
      for (const int c : found) {
        if (c >= 0) kinds[static_cast<std::size_t>(c)] = CellKind::kNumber;
      }
      columns.push_back(found);
    }
    std::vector<std::string> ignored;
    for (std::size_t c = 0; c < names.size(); ++c) {
      if (kinds[c] == CellKind::kIgnored && !names[c].empty()) ignored.push_back(names[c]);
    }
    if (!ignored.empty()) run.notes.push_back("columns ignored: " + Listed(ignored));
    if (std::all_of(columns.begin(), columns.end(), [](const auto& c) { return c.empty(); })) {
      throw TableError(fmt::format(
          "{}: no usable column; there are: {}; accepted: torque_target_Nm_j, torque_actual_Nm_j, "
          "motor_position_rad_j, tension_N_j (j = 1..{}), tip_x_m, tip_y_m, tip_z_m, tip_qw, tip_qx, tip_qy, "
          "tip_qz, us_k, vs_k; rename them or use tendril gap import with a column map",
          where, Listed(names), tendons));
    }
    return kinds;
  });
  run.notes.insert(run.notes.end(), table.notes.begin(), table.notes.end());

  std::vector<double> time = table.numbers[static_cast<std::size_t>(time_column)];
  const std::vector<int> rows = RowsInTime(time, table.lines, SameNumbers(table, 0), run);
  if (rows.size() < 2) {
    std::string why;
    for (const std::string& warning : run.warnings) why += " (" + warning + ")";
    throw TableError(
        fmt::format("{}: {} usable row{}{}; accepted: at least 2 with increasing t_s; record the run again",
                    name, rows.size(), rows.size() == 1 ? "" : "s", why));
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
  run.time_s.resize(count);
  copy(time, run.time_s);
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    if (columns[b].empty()) continue;
    Eigen::MatrixXd& matrix = run.*blocks[b].matrix;
    matrix.resize(count, static_cast<Eigen::Index>(columns[b].size()));
    for (std::size_t c = 0; c < columns[b].size(); ++c) {
      auto column = matrix.col(static_cast<Eigen::Index>(c));
      if (columns[b][c] < 0) {
        column.setConstant(kNone);
      } else {
        copy(table.numbers[static_cast<std::size_t>(columns[b][c])], column);
      }
    }
    // Tendons without any column may still exist.
    const bool a_tendon = !blocks[b].whole && blocks[b].matrix != &Run::bending_rad;
    if (a_tendon && named < matrix.cols()) matrix.conservativeResize(Eigen::NoChange, named);
  }
  Normalise(run);
  NoteGaps(run);
  return run;
}

void WriteRun(const Run& run, const std::filesystem::path& file) {
  std::string text = "t_s";
  std::vector<Eigen::Ref<const Eigen::VectorXd>> columns;
  const auto tendons = [](const Eigen::MatrixXd& m) { return static_cast<int>(m.cols()); };
  const int most = std::max({tendons(run.torque_target_Nm), tendons(run.torque_actual_Nm),
                             tendons(run.motor_position_rad), tendons(run.tension_N)});
  for (const Block& block : Blocks(most, tendons(run.bending_rad) / 2)) {
    const Eigen::MatrixXd& matrix = run.*block.matrix;
    if (matrix.cols() > 0 && matrix.rows() != run.time_s.size()) {
      throw std::runtime_error(fmt::format("run {}: {} has {} rows, the time {}", run.name,
                                           block.names.front(), matrix.rows(), run.time_s.size()));
    }
    for (Eigen::Index c = 0; c < matrix.cols(); ++c) {
      text += "," + block.names[static_cast<std::size_t>(c)];
      columns.push_back(matrix.col(c));
    }
  }
  text += '\n';
  std::array<char, 32> digits;
  const auto append = [&](double value) {
    if (std::isnan(value)) return;
    text.append(digits.data(), std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr);
  };
  text.reserve(text.size() + static_cast<std::size_t>(run.time_s.size()) * (columns.size() + 1) * 20);
  for (Eigen::Index i = 0; i < run.time_s.size(); ++i) {
    append(run.time_s[i]);
    for (const auto& column : columns) {
      text += ',';
      append(column[i]);
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
