// Parses a table of numbers; see the header.
// One pass over the bytes with std::from_chars; a cell is copied only when it is unusual.
#include "csv.h"

#include <fmt/core.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <optional>
#include <utility>

#include "cell.h"
#include "table_hints.h"
#include "tendril/gap/data_set.h"
#include "text.h"

namespace tendril::gap {
namespace {

// A file with more columns than this is not a table of a robot.
constexpr std::size_t kMostColumns = 4096;

bool IsSpace(char c) { return c == ' ' || c == '\t'; }
bool IsLineEnd(char c) { return c == '\n' || c == '\r'; }

class Parser {
 public:
  Parser(std::string_view text, const std::string& name, const TableFormat& format)
      : at_(text.data()), end_(text.data() + text.size()), name_(name), format_(format) {}

  Table Parse(const ChooseCells& choose) {
    SkipMark();
    SkipLines();
    const int names_line = ReadNames();
    kinds_ = choose(table_.names, names_line);
    SkipUnits();
    table_.numbers.resize(table_.names.size());
    table_.texts.resize(table_.names.size());
    Reserve();
    infinite_.assign(table_.names.size(), 0);
    while (at_ != end_) {
      if (SkipEmptyLine()) continue;
      ReadRow();
    }
    for (const auto& [word, found] : words_) {
      table_.notes.push_back(
          fmt::format("{}: {} '{}' taken as missing, the first in line {}, column {}", name_,
                      found.count == 1 ? "1 cell with" : fmt::format("{} cells with", found.count),
                      Printable(word), found.line, Printable(table_.names[found.column])));
    }
    for (std::size_t c = 0; c < infinite_.size(); ++c) {
      if (infinite_[c] == 0) continue;
      table_.notes.push_back(fmt::format("{}: column {}: {} infinite values taken as missing", name_,
                                         Printable(table_.names[c]), infinite_[c]));
    }
    return std::move(table_);
  }

 private:
  void SkipMark() {
    const auto left = static_cast<std::size_t>(end_ - at_);
    if (left >= 2 && (std::memcmp(at_, "\xFF\xFE", 2) == 0 || std::memcmp(at_, "\xFE\xFF", 2) == 0)) {
      RefuseUtf16();
    }
    // Without a byte order mark: every other byte of UTF-16 text in ASCII is zero.
    if (left >= 4 && ((at_[0] == 0 && at_[2] == 0) || (at_[1] == 0 && at_[3] == 0))) RefuseUtf16();
    if (left >= 4 && std::memcmp(at_, "PK\x03\x04", 4) == 0) {
      throw TableError(name_ + ":1: a zip file, as workbooks are (.xlsx); accepted: text; export it as CSV");
    }
    if (left >= 3 && std::memcmp(at_, "\xEF\xBB\xBF", 3) == 0) at_ += 3;
  }

  [[noreturn]] void RefuseUtf16() const {
    throw TableError(name_ + ":1: the text is UTF-16; accepted: ASCII or UTF-8; save it as UTF-8");
  }

  void PassLine() {
    at_ = std::find_if(at_, end_, IsLineEnd);
    EndLine();
  }

  void SkipLines() {
    for (int i = 0; i < format_.skip_lines; ++i) {
      if (at_ == end_) {
        throw TableError(
            fmt::format("{}:{}: the file ends within the {} lines that table.skip_lines skips; accepted: the "
                        "number of lines before the names; correct the map",
                        name_, line_, format_.skip_lines));
      }
      PassLine();
    }
  }

  /// Lines of units. A line that parses as a row is refused, since its data would be lost.
  void SkipUnits() {
    for (int i = 0; i < format_.unit_rows && at_ != end_; ++i) {
      while (at_ != end_ && SkipEmptyLine(false)) {
      }
      if (HoldsNumbers(at_)) {
        throw TableError(
            fmt::format("{}:{}: a row of numbers, which table.unit_rows: {} would skip; accepted: unit_rows: "
                        "{} for this table; correct the map",
                        name_, line_, format_.unit_rows, i));
      }
      PassLine();
    }
  }

  /// True where a line has a number in at least one numeric column, and a number or nothing in all of them.
  bool HoldsNumbers(const char* line) {
    const char* at = std::exchange(at_, line);
    bool more = true, any = false, all = true;
    std::size_t c = 0;
    for (; more && c < table_.names.size(); ++c) {
      const std::string_view cell = Cell(more);
      if (kinds_[c] != CellKind::kNumber || MeansNone(cell)) continue;
      std::string with_point(cell);
      if (format_.decimal == ',' || comma_too_) std::replace(with_point.begin(), with_point.end(), ',', '.');
      const bool number = CellNumber(with_point).has_value();
      any = any || number;
      all = all && number;
    }
    at_ = at;
    return any && all && c == table_.names.size();
  }

  void EndLine() {
    if (at_ != end_ && *at_ == '\r') ++at_;
    if (at_ != end_ && *at_ == '\n') ++at_;
    ++line_;
  }

  bool IsMark(char c) const { return format_.comment.find(c) != format_.comment.npos; }

  // Skips an empty line or a comment.
  bool SkipEmptyLine(bool remarks = true) {
    const char* p = at_;
    while (p != end_ && IsSpace(*p)) ++p;
    if (p != end_ && !IsLineEnd(*p) && !(remarks && IsMark(*p))) return false;
    while (p != end_ && !IsLineEnd(*p)) ++p;
    at_ = p;
    EndLine();
    return true;
  }

  /// Returns the line of the names.
  int ReadNames() {
    const char* remark = nullptr;
    int remark_line = 0;
    while (at_ != end_) {
      const char* line = at_;
      const int number = line_;
      if (!SkipEmptyLine()) break;
      const std::string_view said = Trimmed({line, static_cast<std::size_t>(at_ - line)});
      const bool says = std::any_of(said.begin(), said.end(), [&](char c) { return !IsMark(c) && c != ' '; });
      if (says) remark = line, remark_line = number;
    }
    const bool by_place = format_.header == Header::kNone;
    const char* row = at_;
    const int row_line = line_;
    if (format_.header == Header::kRemark) {
      if (remark == nullptr) {
        throw TableError(
            fmt::format("{}:{}: no comment before the first row; accepted: with table.header: comment, a "
                        "line of names that begins with one of '{}' (table.comment); correct the map",
                        name_, row_line, Printable(format_.comment)));
      }
      at_ = remark;
      line_ = remark_line;
      while (at_ != row && (IsSpace(*at_) || IsMark(*at_))) ++at_;
    }
    if (at_ == end_) {
      throw TableError(name_ +
                       ":1: the file is empty; accepted: a line of column names, then one row per sample");
    }
    const int names_line = line_;
    const char* line_end = std::find_if(at_, end_, IsLineEnd);
    if (format_.delimiter == 0) {
      format_.delimiter = FindDelimiter({at_, static_cast<std::size_t>(line_end - at_)}, format_.comment);
    }
    if (format_.decimal == 0) format_.decimal = '.', comma_too_ = format_.delimiter != ',';
    SplitNames();
    if (by_place) {
      for (std::size_t c = 0; c < table_.names.size(); ++c) table_.names[c] = std::to_string(c + 1);
      at_ = row;
      line_ = row_line;
      return names_line;
    }
    // Some programs end each line with a delimiter.
    while (table_.names.size() > 1 && table_.names.back().empty()) table_.names.pop_back();
    const bool any_name = std::any_of(table_.names.begin(), table_.names.end(), [](const std::string& n) {
      return !n.empty() && !MeansNone(n) && !CellNumber(n);
    });
    if (!any_name) {
      const bool in_remark = remark != nullptr && CellsOf(remark) == table_.names.size();
      throw TableError(fmt::format(
          "{}:{}: the first line has no column names; accepted: names such as t_s, tension_N_1; add them, or "
          "{}",
          name_, names_line,
          in_remark
              ? fmt::format("if the comment in line {} holds them, set table: {{header: comment}} in a map "
                            "of tendril gap import",
                            remark_line)
              : "set table: {header: none} in a map of tendril gap import and call the columns 1, 2, ..."));
    }
    if (format_.header == Header::kRemark) {
      at_ = row;
      line_ = row_line;
    }
    return names_line;
  }

  /// Number of cells in a comment after its mark.
  std::size_t CellsOf(const char* remark) {
    const char* at = std::exchange(at_, remark);
    while (at_ != end_ && (IsSpace(*at_) || IsMark(*at_))) ++at_;
    std::size_t cells = 0;
    for (bool more = true; more; ++cells) Cell(more);
    at_ = at;
    return cells;
  }

  void SplitNames() {
    bool more = true;
    while (more) {
      table_.names.emplace_back(Trimmed(Cell(more)));
      if (table_.names.size() > kMostColumns) {
        throw TableError(
            fmt::format("{}:{}: more than {} columns; is this a table?", name_, line_, kMostColumns));
      }
    }
    EndLine();
  }

  // The text of the next cell of this line, without quotes; at_ is then after its delimiter (more) or at the
  // end of the line.
  std::string_view Cell(bool& more) {
    const char d = format_.delimiter;
    const auto is_delimiter = [d](char c) { return d == ' ' ? IsSpace(c) : c == d; };
    while (at_ != end_ && IsSpace(*at_) && *at_ != d) ++at_;
    if (d == ' ') {
      while (at_ != end_ && IsSpace(*at_)) ++at_;
    }
    const char* first = at_;
    const char* last = nullptr;
    if (at_ != end_ && *at_ == '"') {
      first = ++at_;
      while (at_ != end_ && *at_ != '"' && !IsLineEnd(*at_)) ++at_;
      last = at_;
      while (at_ != end_ && !is_delimiter(*at_) && !IsLineEnd(*at_)) ++at_;
    } else {
      while (at_ != end_ && !is_delimiter(*at_) && !IsLineEnd(*at_)) ++at_;
      last = at_;
      while (last != first && IsSpace(last[-1])) --last;
    }
    if (d == ' ') {
      while (at_ != end_ && IsSpace(*at_)) ++at_;
      more = at_ != end_ && !IsLineEnd(*at_);
    } else {
      more = at_ != end_ && *at_ == d;
      if (more) ++at_;
    }
    return {first, static_cast<std::size_t>(last - first)};
  }

  // The common cell, a plain number up to the delimiter, without reading its bytes twice.
  bool PlainNumber(double& value, bool& more) {
    const char d = format_.delimiter;
    if (format_.decimal != '.') return false;
    const auto [p, error] = std::from_chars(at_, end_, value);
    if (error != std::errc{} || p == at_ || !std::isfinite(value)) return false;
    const bool ends = p == end_ || IsLineEnd(*p);
    if (!ends && (*p != d || d == ' ')) return false;
    if (comma_too_ && point_line_ == 0) NotePoint({at_, static_cast<std::size_t>(p - at_)});
    at_ = ends ? p : p + 1;
    more = !ends;
    return true;
  }

  // Where the decimal mark is not given only one kind is accepted; the other could be a thousands separator.
  void NotePoint(std::string_view cell) {
    if (cell.find('.') == cell.npos) return;
    point_line_ = line_;
    RefuseBothMarks(cell, "comma", comma_line_);
  }
  void NoteComma(std::string_view cell) {
    comma_line_ = line_;
    RefuseBothMarks(cell, "point", point_line_);
  }
  void RefuseBothMarks(std::string_view cell, const char* other, int its_line) const {
    if (its_line == 0) return;
    throw TableError(fmt::format(
        "{}:{}: '{}', but a decimal {} in line {}; accepted: one decimal mark, without thousands separators; "
        "set table: {{decimal: point}} or {{decimal: comma}} in a map of tendril gap import, or export again",
        name_, line_, Printable(cell), other, its_line));
  }

  double NumberOf(std::string_view cell, std::size_t column) {
    if (MeansNone(cell)) {
      if (!cell.empty()) ++words_.try_emplace(std::string(cell), Word{0, line_, column}).first->second.count;
      return kNoReading;
    }
    std::optional<double> value;
    // A point beside a decimal comma could be a thousands separator.
    if (format_.decimal == '.' || cell.find('.') == cell.npos) value = CellNumber(cell);
    if (value && comma_too_ && point_line_ == 0) NotePoint(cell);
    if (!value && (format_.decimal == ',' || comma_too_) && std::count(cell.begin(), cell.end(), ',') == 1 &&
        cell.find('.') == cell.npos) {
      std::string with_point(cell);
      std::replace(with_point.begin(), with_point.end(), ',', '.');
      value = CellNumber(with_point);
      if (value && comma_too_ && comma_line_ == 0) NoteComma(cell);
    }
    if (!value) {
      throw TableError(
          fmt::format("{}:{}: column {}: '{}' is not a number; accepted: a number such as -0.0125, or an "
                      "empty cell for no "
                      "value; correct the cell or remove the line{}",
                      name_, line_, Printable(table_.names[column]), Printable(cell), Hint(cell, column)));
    }
    if (std::isinf(*value)) {
      ++infinite_[column];
      return kNoReading;
    }
    return *value;
  }

  /// The option that would read a cell that is not a number. The first lines may contain something else than
  /// numbers.
  std::string Hint(std::string_view cell, std::size_t column) {
    const char* line_end = std::find_if(at_, end_, IsLineEnd);
    const std::string hint = HintForCell(
        cell, table_.names[column], {row_begin_, static_cast<std::size_t>(line_end - row_begin_)}, format_);
    constexpr int kMost = 5;
    const char* line = row_begin_;
    for (int passed = 1; hint.empty() && table_.lines.empty() && passed <= kMost; ++passed) {
      line = std::find_if(line, end_, IsLineEnd);
      line += line != end_ && *line == '\r';
      line += line != end_ && *line == '\n';
      if (line == end_) break;
      if (!HoldsNumbers(line)) continue;
      if (format_.header == Header::kNone)
        return fmt::format(
            "; if the lines before line {} are not rows, set table: {{skip_lines: {}}} in the map",
            line_ + passed, line_ + passed - 1);
      return fmt::format("; if it is a unit or another line of names, set table: {{unit_rows: {}}} in a map",
                         format_.unit_rows + passed);
    }
    return hint;
  }

  void ReadRow() {
    const std::size_t columns = table_.names.size();
    const char* line_begin = row_begin_ = at_;
    const std::size_t row = table_.lines.size();
    std::size_t cells = 0;
    bool more = true, trailing = false;
    std::string_view last;
    try {
      for (; more; ++cells) {
        if (cells >= columns) {
          const std::string_view rest = Cell(more);
          // A delimiter at the end, if every line has one.
          if (rest.empty() && !more && trailing_.value_or(true)) {
            trailing = true;
            break;
          }
          while (at_ != end_ && !IsLineEnd(*at_)) ++at_;
          cells = columns + 1;
          break;
        }
        const char* begin = at_;
        if (kinds_[cells] == CellKind::kNumber) {
          double value;
          if (!PlainNumber(value, more)) value = NumberOf(Cell(more), cells);
          table_.numbers[cells].push_back(value);
        } else {
          const std::string_view cell = Cell(more);
          if (kinds_[cells] == CellKind::kText) table_.texts[cells].emplace_back(Trimmed(cell));
        }
        last = {begin, static_cast<std::size_t>(at_ - begin)};
      }
    } catch (const TableError&) {
      if (std::find_if(at_, end_, IsLineEnd) != end_) throw;
      at_ = end_;
      Drop(row, "is truncated");
      return;
    }
    const bool unfinished = at_ == end_;
    if (unfinished && (cells < columns || last.size() < last_size_)) {
      Drop(row, "has no line end and may be truncated");
      return;
    }
    if (cells < columns && std::all_of(at_, end_, IsLineEnd)) {
      at_ = end_;
      Drop(row, "is truncated");
      return;
    }
    if (cells != columns) {
      at_ = line_begin;
      throw TableError(fmt::format(
          "{}:{}: {} cells in a table of {} columns; accepted: one cell per column (empty for no value); "
          "correct the line or remove it{}",
          name_, line_, cells < columns ? std::to_string(cells) : "too many", columns, HintForCount()));
    }
    if (!trailing_) trailing_ = trailing;
    last_size_ = last.size();
    table_.lines.push_back(line_);
    EndLine();
  }

  std::string HintForCount() const {
    if (format_.decimal == ',' && format_.delimiter == ',')
      return "; where commas separate cells, numbers with a decimal comma need quotes";
    if (format_.delimiter == ' ' && table_.lines.empty() && format_.header != Header::kNone) {
      return fmt::format(
          "; if names contain spaces, set table: {{header: none, skip_lines: {}}} in a map and call the "
          "columns 1, 2, ...",
          line_ - 1);
    }
    return {};
  }

  void Drop(std::size_t rows, const char* what) {
    for (auto& column : table_.numbers) column.resize(std::min(column.size(), rows));
    for (auto& column : table_.texts) column.resize(std::min(column.size(), rows));
    table_.notes.push_back(fmt::format("{}:{}: the last line {}; dropped", name_, line_, what));
  }

  void Reserve() {
    const auto bytes = static_cast<std::size_t>(end_ - at_);
    const std::size_t line = std::max<std::size_t>(
        2 * table_.names.size(), static_cast<std::size_t>(std::find_if(at_, end_, IsLineEnd) - at_));
    const std::size_t rows = bytes / line + bytes / line / 4 + 16;
    for (std::size_t c = 0; c < kinds_.size(); ++c) {
      if (kinds_[c] == CellKind::kNumber) table_.numbers[c].reserve(rows);
    }
    table_.lines.reserve(rows);
  }

  const char* at_;
  const char* end_;
  const std::string& name_;
  TableFormat format_;
  bool comma_too_ = false;
  int point_line_ = 0, comma_line_ = 0;  // of the first decimal mark of either kind, where either is allowed
  const char* row_begin_ = nullptr;
  std::optional<bool> trailing_;  // whether lines end with a delimiter, as on the first line
  int line_ = 1;
  std::size_t last_size_ = 0;  // of the last cell of the previous row, as written
  std::vector<CellKind> kinds_;
  std::vector<int> infinite_;
  struct Word {
    std::size_t count;
    int line;  // of the first occurrence
    std::size_t column;
  };
  std::map<std::string, Word> words_;  // words that stand for a missing value
  Table table_;
};

}  // namespace

Table ParseTable(std::string_view text, const std::string& name_for_errors, const TableFormat& format,
                 const ChooseCells& choose) {
  return Parser(text, name_for_errors, format).Parse(choose);
}

std::string Twice(const std::vector<std::string>& names, std::string_view name) {
  std::vector<std::string> places;
  for (std::size_t c = 0; c < names.size(); ++c) {
    if (names[c] == name) places.push_back(std::to_string(c + 1));
  }
  if (places.size() < 2) return {};
  std::string text = "columns " + places.front();
  for (std::size_t i = 1; i < places.size(); ++i)
    text += (i + 1 == places.size() ? " and " : ", ") + places[i];
  return text;
}

}  // namespace tendril::gap
