// Rows of numbers as CSV, columns matched by name, one row at a time and without mercy: what `tendril model`
// reads and writes, what studies and motions are made of. Knows nothing of what the numbers mean. Tables of
// robots as other programs write them, with all that is odd in them, are gap/csv's.
#pragma once

#include <cstdio>
#include <istream>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace tendril::io {

/// prefix1, prefix2, ..., prefix<count>.
std::vector<std::string> Numbered(std::string_view prefix, int count);
/// a1, b1, a2, b2, ..., a<count>, b<count>.
std::vector<std::string> NumberedPairs(std::string_view a, std::string_view b, int count);
/// Names of columns, one list after the other.
template <class... More>
std::vector<std::string> Columns(std::vector<std::string> first, const More&... more) {
  (first.insert(first.end(), more.begin(), more.end()), ...);
  return first;
}

/// Reads rows of finite numbers. Columns come in any order; each optional group is there as a whole or not at
/// all. Everything wrong is a std::runtime_error naming the input and the line.
class CsvReader {
 public:
  CsvReader(std::istream& in, std::string input_name, std::vector<std::string> required,
            std::vector<std::vector<std::string>> optional_groups = {});

  /// Reads the next row; false at the end of the input. Blank lines are passed over.
  bool Next();

  /// The required columns of the current row, in the order in which they were asked for.
  std::span<const double> required() const { return values_[0]; }
  bool has(std::size_t group) const { return !values_[group + 1].empty(); }
  /// Optional group (0-based) of the current row; empty when the input does not have it.
  std::span<const double> optional(std::size_t group) const { return values_[group + 1]; }

  /// 1-based line of the current row.
  std::size_t line() const { return line_; }
  /// What is wrong with the current row, as the exception to throw.
  std::runtime_error Error(std::string_view what) const;

 private:
  struct Slot {
    bool used = false;
    std::size_t group = 0, index = 0;
  };

  /// The next line as it is; false at the end of the input.
  bool Line(std::string& text);

  double Number(std::string_view cell, std::size_t column) const;
  /// Where the columns of a group stand; the names that the input lacks.
  std::vector<std::string> Place(const std::vector<std::string>& columns,
                                 const std::vector<std::string>& group, std::size_t index);
  void ReadHeader(std::string& header, const std::vector<std::string>& required);

  std::istream& in_;
  std::string name_;
  std::size_t line_ = 0;
  std::vector<Slot> slot_;                   // per input column
  std::vector<std::vector<double>> values_;  // required, then the optional groups
};

/// Writes a header and rows with 17 significant digits.
class CsvWriter {
 public:
  CsvWriter(std::FILE* out, const std::vector<std::string>& columns);

  CsvWriter& Put(double value);
  /// Anything with begin() and end(): std::span, Eigen vectors.
  template <class Values>
  CsvWriter& PutAll(const Values& values) {
    for (const double value : values) Put(value);
    return *this;
  }
  void EndRow();

 private:
  std::FILE* out_;
  std::size_t columns_, count_ = 0;
  std::string row_;
};

}  // namespace tendril::io
