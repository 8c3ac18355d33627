// Hints for tables that are refused; see the header.
#include "table_hints.h"

#include <fmt/core.h>

#include <algorithm>
#include <cctype>
#include <utility>

#include "text.h"
#include "time_text.h"

namespace tendril::gap {
namespace {

// Comment marks of common programs.
constexpr std::string_view kCommentMarks = "#%;!/";
// Maximum number of lines before a table's names.
constexpr int kMostPreamble = 200;

std::string_view Unquoted(std::string_view cell) {
  cell = Trimmed(cell);
  if (cell.size() >= 2 && cell.front() == '"' && cell.back() == '"') cell = cell.substr(1, cell.size() - 2);
  return Trimmed(cell);
}

bool HasAll(std::string_view line, char delimiter, const std::vector<std::string>& names) {
  std::vector<std::string_view> cells;
  while (true) {
    const std::size_t end = line.find(delimiter);
    cells.push_back(Unquoted(line.substr(0, end)));
    if (end == line.npos) break;
    line.remove_prefix(end + 1);
  }
  return std::all_of(names.begin(), names.end(), [&](const std::string& name) {
    return std::find(cells.begin(), cells.end(), name) != cells.end();
  });
}

/// Digits in groups of three with one kind of separator, optionally with a fraction after another mark.
bool Grouped(std::string_view cell) {
  std::string plain;  // multi-byte spaces replaced by one character
  for (std::size_t i = 0; i < cell.size(); ++i) {
    const std::string_view rest = cell.substr(i);
    if (rest.starts_with("\xC2\xA0")) {
      plain += ' ', i += 1;
    } else if (rest.starts_with("\xE2\x80\xAF") || rest.starts_with("\xE2\x80\x89")) {
      plain += ' ', i += 2;
    } else {
      plain += rest.front();
    }
  }
  if (!plain.empty() && (plain.front() == '-' || plain.front() == '+')) plain.erase(0, 1);
  const std::size_t first = plain.find_first_not_of("0123456789");
  if (first == plain.npos || first < 1 || first > 3 || plain.front() == '0') return false;
  const char mark = plain[first];
  if (std::string_view(",. '_").find(mark) == std::string_view::npos) return false;
  std::size_t at = first;
  while (at < plain.size() && plain[at] == mark) {
    const std::size_t end = std::min(plain.find_first_not_of("0123456789", at + 1), plain.size());
    if (end - at != 4) return false;
    at = end;
  }
  return at == plain.size() || ((plain[at] == '.' || plain[at] == ',') &&
                                plain.find_first_not_of("0123456789", at + 1) == plain.npos);
}

}  // namespace

char FindDelimiter(std::string_view line, std::string_view comment) {
  for (const char c : {';', '\t', ','}) {
    if (comment.find(c) == comment.npos && line.find(c) != line.npos) return c;
  }
  return Trimmed(line).find(' ') != std::string_view::npos ? ' ' : ',';
}

std::optional<NamesOption> OptionForNames(std::string_view text, const TableFormat& format,
                                          const std::vector<std::string>& columns) {
  if (columns.empty() || format.header == Header::kNone) return std::nullopt;
  const auto elsewhere = [](std::string option) {
    return NamesOption{"the names are in another line", std::move(option)};
  };
  char common = '\0';  // first character of every non-empty line so far
  bool all_alike = true;
  for (int line = 1; line <= kMostPreamble && !text.empty(); ++line) {
    const std::size_t end = std::min(text.find_first_of("\r\n"), text.size());
    std::string_view said = Trimmed(text.substr(0, end));
    text.remove_prefix(end);
    text.remove_prefix(text.starts_with("\r\n") ? 2 : std::min<std::size_t>(1, text.size()));
    if (said.starts_with("\xEF\xBB\xBF")) said.remove_prefix(3);
    if (said.empty()) continue;
    const auto all_in = [&](std::string_view names) {
      return HasAll(names, format.delimiter ? format.delimiter : FindDelimiter(names, format.comment),
                    columns);
    };
    if (format.delimiter && HasAll(said, FindDelimiter(said, format.comment), columns) && !all_in(said))
      return NamesOption{"the cells have another delimiter", "table: {delimiter: auto}"};
    if (all_in(said)) {
      const char* header = format.header == Header::kRemark ? "header: first, " : "";
      const bool marks = all_alike && kCommentMarks.find(common) != kCommentMarks.npos;
      if (marks && format.comment.find(common) == format.comment.npos)
        return elsewhere(fmt::format("table: {{{}comment: '{}'}}", header, common));
      if (line == 1 && format.skip_lines == 0 && *header == 0) return std::nullopt;
      return elsewhere(fmt::format("table: {{{}skip_lines: {}}}", header, line - 1));
    }
    const char mark = said.front();
    if (kCommentMarks.find(mark) != kCommentMarks.npos) {
      said.remove_prefix(std::min(said.find_first_not_of(mark), said.size()));
      if (all_in(Trimmed(said)))
        return elsewhere(fmt::format("table: {{header: comment{}}}",
                                     mark == '#' ? "" : fmt::format(", comment: '{}'", mark)));
    }
    all_alike = all_alike && (common == '\0' || common == mark);
    common = mark;
  }
  return std::nullopt;
}

std::string HintForCell(std::string_view cell, std::string_view column, std::string_view line,
                        const TableFormat& format) {
  if (const bool iso = ParseIso8601(cell).has_value(); iso || ParseClock(cell)) {
    return fmt::format("; if it is the time, set time: {{column: '{}', unit: {}}} in a map",
                       Printable(column), iso ? "iso8601" : "clock");
  }
  const std::string_view said = Trimmed(line);
  if (!said.empty() && kCommentMarks.find(said.front()) != kCommentMarks.npos &&
      format.comment.find(said.front()) == format.comment.npos) {
    return fmt::format("; if the line is a comment, set table: {{comment: '{}'}} in a map", said.front());
  }
  const bool one_comma = std::count(cell.begin(), cell.end(), ',') == 1;
  if (format.decimal == ',' && !one_comma && std::count(cell.begin(), cell.end(), '.') == 1 &&
      cell.find_first_not_of("+-.0123456789eE") == cell.npos)
    return "; the map says that decimals have a comma: set table: {decimal: point} in it";
  if (Grouped(cell)) {
    return fmt::format("; thousands separators are not read: export without them{}",
                       one_comma && format.decimal == '.' && cell.find('.') == cell.npos
                           ? ", or if the comma is a decimal one, set table: {decimal: comma} in a map"
                           : "");
  }
  if (one_comma && format.decimal == '.')
    return "; if its comma is a decimal one, set table: {decimal: comma} in a map of tendril gap import";
  return {};
}

}  // namespace tendril::gap
