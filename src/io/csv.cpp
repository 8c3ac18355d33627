#include "tendril/io/csv.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <cstdlib>
#include <iterator>

namespace tendril::io {
namespace {

std::string_view Trim(std::string_view s) {
  constexpr std::string_view kBlank = " \t\r\n";
  const auto first = s.find_first_not_of(kBlank);
  if (first == std::string_view::npos) return {};
  s = s.substr(first, s.find_last_not_of(kBlank) - first + 1);
  if (s.size() >= 2 && s.front() == '"' && s.back() == '"') s = s.substr(1, s.size() - 2);
  return s;
}

std::vector<std::string_view> Split(std::string_view row) {
  std::vector<std::string_view> cells;
  for (;;) {
    const auto comma = row.find(',');
    cells.push_back(row.substr(0, comma));
    if (comma == std::string_view::npos) return cells;
    row.remove_prefix(comma + 1);
  }
}

std::string Join(const std::vector<std::string>& names) { return fmt::format("{}", fmt::join(names, ",")); }

}  // namespace

std::vector<std::string> Numbered(std::string_view prefix, int count) {
  std::vector<std::string> names;
  for (int i = 1; i <= count; ++i) names.push_back(fmt::format("{}{}", prefix, i));
  return names;
}

std::vector<std::string> NumberedPairs(std::string_view a, std::string_view b, int count) {
  std::vector<std::string> names;
  for (int i = 1; i <= count; ++i) {
    names.push_back(fmt::format("{}{}", a, i));
    names.push_back(fmt::format("{}{}", b, i));
  }
  return names;
}

CsvReader::CsvReader(std::istream& in, std::string input_name, std::vector<std::string> required,
                     std::vector<std::vector<std::string>> optional_groups)
    : in_(in), name_(std::move(input_name)) {
  values_.resize(1 + optional_groups.size());
  values_[0].resize(required.size());
  std::string header;
  ReadHeader(header, required);

  std::vector<std::string> columns;
  for (std::string_view cell : Split(header)) columns.emplace_back(Trim(cell));
  slot_.assign(columns.size(), Slot{});
  for (std::size_t c = 0; c < columns.size(); ++c) {
    for (std::size_t earlier = 0; earlier < c; ++earlier) {
      if (columns[earlier] == columns[c]) throw Error(fmt::format("column '{}' appears twice", columns[c]));
    }
  }
  if (const auto missing = Place(columns, required, 0); !missing.empty()) {
    throw Error(fmt::format("missing column{} {}: expected {}", missing.size() > 1 ? "s" : "", Join(missing),
                            Join(required)));
  }
  for (std::size_t g = 0; g < optional_groups.size(); ++g) {
    const auto missing = Place(columns, optional_groups[g], g + 1);
    if (missing.size() == optional_groups[g].size()) continue;
    if (!missing.empty()) {
      throw Error(fmt::format("missing column{} {}: {} must be given together or not at all",
                              missing.size() > 1 ? "s" : "", Join(missing), Join(optional_groups[g])));
    }
    values_[g + 1].resize(optional_groups[g].size());
  }
  for (std::size_t c = 0; c < columns.size(); ++c) {
    if (!slot_[c].used) {
      std::vector<std::string> known = required;
      for (const auto& group : optional_groups) known = Columns(known, group);
      throw Error(fmt::format("unknown column '{}': expected {}", columns[c], Join(known)));
    }
  }
}

std::vector<std::string> CsvReader::Place(const std::vector<std::string>& columns,
                                          const std::vector<std::string>& group, std::size_t index) {
  std::vector<std::string> missing;
  for (std::size_t i = 0; i < group.size(); ++i) {
    std::size_t c = 0;
    while (c < columns.size() && columns[c] != group[i]) ++c;
    if (c == columns.size()) {
      missing.push_back(group[i]);
    } else {
      slot_[c] = {true, index, i};
    }
  }
  return missing;
}

/// The first line that is not blank, without a byte order mark.
void CsvReader::ReadHeader(std::string& header, const std::vector<std::string>& required) {
  do {
    if (!Line(header)) {
      throw std::runtime_error(
          fmt::format("{}: empty input: expected a CSV header with the columns {}", name_, Join(required)));
    }
    if (line_ == 1 && header.starts_with("\xEF\xBB\xBF")) header.erase(0, 3);
  } while (Trim(header).empty());
}

bool CsvReader::Next() {
  std::string text;
  do {
    if (!Line(text)) return false;
  } while (Trim(text).empty());
  const std::vector<std::string_view> cells = Split(text);
  if (cells.size() != slot_.size()) {
    throw Error(
        fmt::format("{} value{} for {} columns", cells.size(), cells.size() == 1 ? "" : "s", slot_.size()));
  }
  for (std::size_t c = 0; c < cells.size(); ++c)
    values_[slot_[c].group][slot_[c].index] = Number(cells[c], c);
  return true;
}

std::runtime_error CsvReader::Error(std::string_view what) const {
  return std::runtime_error(fmt::format("{}: line {}: {}", name_, line_, what));
}

bool CsvReader::Line(std::string& text) {
  if (!std::getline(in_, text)) {
    // A folder opens like a file.
    if (in_.bad())
      throw std::runtime_error(fmt::format("{}: cannot be read; name a file, not a folder", name_));
    return false;
  }
  ++line_;
  // A message would end there.
  if (text.find('\0') != std::string::npos) throw Error("a NUL byte; accepted: text; give a CSV file");
  return true;
}

double CsvReader::Number(std::string_view cell, std::size_t column) const {
  std::string_view s = Trim(cell);
  if (s.size() > 1 && s.front() == '+' && s[1] != '-') s.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(s.data(), s.data() + s.size(), value);
  // Underflow is reported like overflow; a number too small for a double is zero for every use here.
  if (error == std::errc::result_out_of_range && end == s.data() + s.size()) {
    value = std::strtod(std::string(s).c_str(), nullptr);
  } else if (error != std::errc() || end != s.data() + s.size()) {
    throw Error(fmt::format("column {}: '{}' is not a number", column + 1, Trim(cell)));
  }
  if (!std::isfinite(value))
    throw Error(fmt::format("column {}: '{}' is not finite", column + 1, Trim(cell)));
  return value;
}

CsvWriter::CsvWriter(std::FILE* out, const std::vector<std::string>& columns)
    : out_(out), columns_(columns.size()) {
  fmt::print(out_, "{}\n", fmt::join(columns, ","));
}

CsvWriter& CsvWriter::Put(double value) {
  fmt::format_to(std::back_inserter(row_), "{}{:.17g}", count_++ > 0 ? "," : "", value);
  return *this;
}

void CsvWriter::EndRow() {
  if (count_ != columns_) throw std::logic_error("CSV row does not match its header");
  row_.push_back('\n');
  std::fwrite(row_.data(), 1, row_.size(), out_);
  row_.clear();
  count_ = 0;
}

}  // namespace tendril::io
