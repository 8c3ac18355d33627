// Reads a table of numbers from the text of a file, fast and with strict checks. Knows nothing of what its
// columns mean.
#pragma once

#include <functional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace tendril::gap {

/// An error in a table; what() is the whole line: file:line: column: what; accepted; remedy.
class TableError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

enum class CellKind { kIgnored, kNumber, kText };

enum class Header {
  kFirstLine,  // the first line that is neither empty nor a comment names the columns
  kRemark,     // the last comment before the first row names them
  kNone,       // no names: columns are called by position, 1, 2, ...
};

struct TableFormat {
  char delimiter = 0;  // 0: detected from the names (comma, semicolon, tab or spaces)
  char decimal = 0;    // 0: point, or comma where commas do not separate cells
  int skip_lines = 0;  // at the top, regardless of their content
  Header header = Header::kFirstLine;
  int unit_rows = 0;          // lines between names and numbers: units, a second line of names
  std::string comment = "#";  // a line that begins with one of these characters is a comment
};

struct Table {
  std::vector<std::string> names;               // without quotes and surrounding spaces
  std::vector<int> lines;                       // line of each row in the file, from 1
  std::vector<std::vector<double>> numbers;     // by column; NaN where a cell is empty; empty unless kNumber
  std::vector<std::vector<std::string>> texts;  // by column; empty unless kText
  std::vector<std::string> notes;               // what was dropped
};

/// Decides what to do with each column, given their names and the line of the names (from 1); one answer per
/// name.
using ChooseCells = std::function<std::vector<CellKind>(const std::vector<std::string>& names, int line)>;

/// Accepts a byte order mark, any line endings, quotes, spaces around cells and the usual words for "no
/// value" (empty, nan, na, null, none, -); a truncated last line is dropped with a note. Throws TableError
/// for any other cell that is not a number and for rows with too few or too many cells; where an option of
/// TableFormat would read the table, the error names that option of the column map.
Table ParseTable(std::string_view text, const std::string& name_for_errors, const TableFormat& format,
                 const ChooseCells& choose);

/// Positions, from 1, of the columns with this name, as "columns 2 and 20" for errors; empty for at most one.
std::string Twice(const std::vector<std::string>& names, std::string_view name);

}  // namespace tendril::gap
