// A table of numbers out of the text of a file; see the header.
// One pass over the bytes with std::from_chars; a cell is copied only when it is unusual.
#include "csv.h"

#include <fmt/core.h>
#include <openssl/evp.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <map>
#include <memory>
#include <optional>

namespace tendril::gap {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
// A file that claims more columns than this is not a table of a robot.
constexpr std::size_t kMostColumns = 4096;
// A file that is larger, or has no end, is not a run.
constexpr std::size_t kMostBytes = std::size_t{4} << 30;

bool IsSpace(char c) { return c == ' ' || c == '\t'; }
bool IsLineEnd(char c) { return c == '\n' || c == '\r'; }

// True for the words that programs write where there is no value.
bool MeansNone(std::string_view cell) {
  if (cell.empty()) return true;
  const std::string low = LowerCase(cell.substr(0, 8));
  if (cell.size() > 4) return low == "-nan" || low == "missing" || low == "nan(ind)" || low == "-nan(ind";
  return low == "nan" || low == "-nan" || low == "+nan" || low == "na" || low == "n/a" || low == "null" ||
         low == "none" || low == "-";
}

std::optional<double> Number(std::string_view cell) {
  if (!cell.empty() && cell.front() == '+') cell.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(cell.data(), cell.data() + cell.size(), value);
  if (error == std::errc::result_out_of_range && end == cell.data() + cell.size()) {
    // Too small to be told from zero, or too large to be meant.
    return cell.find("e-") != cell.npos || cell.find("E-") != cell.npos ? std::optional(0.0) : std::nullopt;
  }
  if (error != std::errc{} || end != cell.data() + cell.size()) return std::nullopt;
  return value;
}

class Parser {
 public:
  Parser(std::string_view text, const std::string& name, const TableFormat& format)
      : at_(text.data()), end_(text.data() + text.size()), name_(name), format_(format) {}

  Table Parse(const ChooseCells& choose) {
    SkipMark();
    ReadNames();
    kinds_ = choose(table_.names);
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
                      found.count == 1 ? "1 cell that says" : fmt::format("{} cells that say", found.count),
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
      throw TableError(name_ + ":1: the text is UTF-16; accepted: ASCII or UTF-8; save it as UTF-8");
    }
    if (left >= 3 && std::memcmp(at_, "\xEF\xBB\xBF", 3) == 0) at_ += 3;
  }

  void EndLine() {
    if (at_ != end_ && *at_ == '\r') ++at_;
    if (at_ != end_ && *at_ == '\n') ++at_;
    ++line_;
  }

  // Passes a line with nothing on it, or a remark.
  bool SkipEmptyLine() {
    const char* p = at_;
    while (p != end_ && IsSpace(*p)) ++p;
    if (p != end_ && !IsLineEnd(*p) && *p != '#') return false;
    while (p != end_ && !IsLineEnd(*p)) ++p;
    at_ = p;
    EndLine();
    return true;
  }

  void ReadNames() {
    while (at_ != end_ && SkipEmptyLine()) {
    }
    if (at_ == end_) {
      throw TableError(name_ +
                       ":1: the file is empty; accepted: a line of column names, then one row a sample");
    }
    const char* line_end = std::find_if(at_, end_, IsLineEnd);
    if (format_.delimiter == 0) format_.delimiter = FindDelimiter({at_, line_end});
    if (format_.decimal == 0) format_.decimal = '.', comma_too_ = format_.delimiter != ',';
    bool more = true;
    while (more) {
      table_.names.emplace_back(Trimmed(Cell(more)));
      if (table_.names.size() > kMostColumns) {
        throw TableError(
            fmt::format("{}:{}: more than {} columns; is this a table?", name_, line_, kMostColumns));
      }
    }
    EndLine();
    // Some programs end each line with a delimiter.
    while (table_.names.size() > 1 && table_.names.back().empty()) table_.names.pop_back();
    const bool any_name = std::any_of(table_.names.begin(), table_.names.end(), [](const std::string& n) {
      return !n.empty() && !MeansNone(n) && !Number(n);
    });
    if (!any_name) {
      throw TableError(fmt::format(
          "{}:{}: the first line holds no column names; accepted: names such as t_s, tension_N_1; add them",
          name_, line_ - 1));
    }
  }

  static char FindDelimiter(std::string_view line) {
    for (const char c : {';', '\t', ','}) {
      if (line.find(c) != line.npos) return c;
    }
    return Trimmed(line).find(' ') != std::string_view::npos ? ' ' : ',';
  }

  // The text of the next cell of this line, without quotes; at_ is then behind its delimiter (more) or at the
  // line's end.
  std::string_view Cell(bool& more) {
    const char d = format_.delimiter;
    while (at_ != end_ && IsSpace(*at_) && *at_ != d) ++at_;
    if (d == ' ') {
      while (at_ != end_ && *at_ == ' ') ++at_;
    }
    const char* first = at_;
    const char* last = nullptr;
    if (at_ != end_ && *at_ == '"') {
      first = ++at_;
      while (at_ != end_ && *at_ != '"' && !IsLineEnd(*at_)) ++at_;
      last = at_;
      while (at_ != end_ && *at_ != d && !IsLineEnd(*at_)) ++at_;
    } else {
      while (at_ != end_ && *at_ != d && !IsLineEnd(*at_)) ++at_;
      last = at_;
      while (last != first && IsSpace(last[-1])) --last;
    }
    if (d == ' ') {
      while (at_ != end_ && *at_ == ' ') ++at_;
      more = at_ != end_ && !IsLineEnd(*at_);
    } else {
      more = at_ != end_ && *at_ == d;
      if (more) ++at_;
    }
    return {first, static_cast<std::size_t>(last - first)};
  }

  // The common cell, a plain number right up to the delimiter, without looking at its bytes twice.
  bool PlainNumber(double& value, bool& more) {
    const char d = format_.delimiter;
    if (format_.decimal != '.') return false;
    const auto [p, error] = std::from_chars(at_, end_, value);
    if (error != std::errc{} || p == at_ || !std::isfinite(value)) return false;
    if (p == end_ || IsLineEnd(*p)) {
      at_ = p;
      more = false;
      return true;
    }
    if (*p != d || d == ' ') return false;
    at_ = p + 1;
    more = true;
    return true;
  }

  double NumberOf(std::string_view cell, std::size_t column) {
    if (MeansNone(cell)) {
      if (!cell.empty()) ++words_.try_emplace(std::string(cell), Word{0, line_, column}).first->second.count;
      return kNone;
    }
    std::optional<double> value;
    if (format_.decimal == '.') value = Number(cell);
    if (!value && (format_.decimal == ',' || comma_too_) && std::count(cell.begin(), cell.end(), ',') == 1) {
      std::string with_point(cell);
      std::replace(with_point.begin(), with_point.end(), ',', '.');
      value = Number(with_point);
    } else if (!value && format_.decimal == ',') {
      value = Number(cell);  // a whole number has neither
    }
    if (!value) {
      throw TableError(fmt::format(
          "{}:{}: column {}: '{}' is not a number; accepted: a number such as -0.0125, or an "
          "empty cell for no "
          "value; correct the cell or remove the line{}",
          name_, line_, Printable(table_.names[column]), Printable(cell),
          std::count(cell.begin(), cell.end(), ',') == 1
              ? "; if its comma is a decimal one, say table: {decimal: comma} in a map of tendril gap import"
              : ""));
    }
    if (std::isinf(*value)) {
      ++infinite_[column];
      return kNone;
    }
    return *value;
  }

  void ReadRow() {
    const std::size_t columns = table_.names.size();
    const char* line_begin = at_;
    const std::size_t row = table_.lines.size();
    std::size_t cells = 0;
    bool more = true, trailing = false;
    std::string_view last;
    try {
      for (; more; ++cells) {
        if (cells >= columns) {
          const std::string_view rest = Cell(more);
          // A delimiter at the end, where every line has one.
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
      Drop(row, "is cut short");
      return;
    }
    const bool unfinished = at_ == end_;
    if (unfinished && (cells < columns || last.size() < last_size_)) {
      Drop(row, "has no end and may be cut short");
      return;
    }
    if (cells < columns && std::all_of(at_, end_, IsLineEnd)) {
      at_ = end_;
      Drop(row, "is cut short");
      return;
    }
    if (cells != columns) {
      at_ = line_begin;
      throw TableError(
          fmt::format("{}:{}: {} cells in a table of {} columns; accepted: one cell a column (empty "
                      "for no value); correct the line or remove it{}",
                      name_, line_, cells < columns ? std::to_string(cells) : "too many", columns,
                      format_.decimal == ',' && format_.delimiter == ','
                          ? "; where commas separate cells, numbers with a decimal comma stand in quotes"
                          : ""));
    }
    if (!trailing_) trailing_ = trailing;
    last_size_ = last.size();
    table_.lines.push_back(line_);
    EndLine();
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
  std::optional<bool> trailing_;  // whether lines end with a delimiter, as the first one does
  int line_ = 1;
  std::size_t last_size_ = 0;  // of the last cell of the row before, as written
  std::vector<CellKind> kinds_;
  std::vector<int> infinite_;
  struct Word {
    std::size_t count;
    int line;  // of the first
    std::size_t column;
  };
  std::map<std::string, Word> words_;  // that stand where there is no value
  Table table_;
};

struct FileCloser {
  void operator()(std::FILE* file) const noexcept { std::fclose(file); }
};

}  // namespace

Table ParseTable(std::string_view text, const std::string& name_for_errors, const TableFormat& format,
                 const ChooseCells& choose) {
  return Parser(text, name_for_errors, format).Parse(choose);
}

std::string ReadBytes(const std::filesystem::path& file) {
  std::error_code error;
  if (std::filesystem::is_directory(file, error)) {
    throw std::runtime_error("cannot read " + file.string() + ": it is a folder; name a file");
  }
  const std::unique_ptr<std::FILE, FileCloser> in(std::fopen(file.c_str(), "rb"));
  if (!in) {
    throw std::runtime_error("cannot read " + file.string() + ": " + std::strerror(errno) +
                             "; name a file that exists and may be read");
  }
  std::string bytes;
  const std::uintmax_t size = std::filesystem::file_size(file, error);
  const auto check = [&](std::uintmax_t bytes_so_far) {
    if (bytes_so_far > kMostBytes) {
      throw std::runtime_error(file.string() + ": more than 4 GiB; accepted: one run a file; split it");
    }
  };
  if (!error) {
    check(size);
    bytes.resize(size);
  }
  bytes.resize(std::fread(bytes.data(), 1, bytes.size(), in.get()));
  // What has grown since, and what has no size (a pipe).
  std::array<char, 65536> more;
  while (const std::size_t n = std::fread(more.data(), 1, more.size(), in.get())) {
    bytes.append(more.data(), n);
    check(bytes.size());
  }
  if (std::ferror(in.get()))
    throw std::runtime_error("cannot read " + file.string() + ": " + std::strerror(errno));
  return bytes;
}

std::string Sha256(std::string_view bytes) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest;
  unsigned size = 0;
  if (EVP_Digest(bytes.data(), bytes.size(), digest.data(), &size, EVP_sha256(), nullptr) != 1) {
    throw std::runtime_error("SHA-256 is not to be had from libcrypto on this machine");
  }
  std::string hex;
  for (unsigned i = 0; i < size; ++i) hex += fmt::format("{:02x}", digest[i]);
  return hex;
}

std::string_view Trimmed(std::string_view text) {
  const auto blank = [](char c) { return static_cast<unsigned char>(c) <= ' '; };
  while (!text.empty() && blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && blank(text.back())) text.remove_suffix(1);
  return text;
}

std::string LowerCase(std::string_view text) {
  std::string low(text);
  for (char& c : low) {
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  }
  return low;
}

std::string Printable(std::string_view text, std::size_t most) {
  std::string shown;
  for (const char c : text.substr(0, most)) shown += c >= ' ' && c <= '~' ? c : '?';
  if (text.size() > most) shown += "...";
  return shown;
}

}  // namespace tendril::gap
