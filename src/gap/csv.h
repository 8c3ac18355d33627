// A table of numbers out of the text of a file, fast and distrustful. Knows nothing of what its columns mean.
#pragma once

#include <filesystem>
#include <functional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace tendril::gap {

/// What is wrong with a table; what() is the whole line: file:line: column: what; accepted; remedy.
class TableError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

enum class CellKind { kIgnored, kNumber, kText };

enum class Header {
  kFirstLine,  // the first line that is neither empty nor a remark names the columns
  kRemark,     // the last remark before the first row does
  kNone,       // nothing does: they are called by their places, 1, 2, ...
};

struct TableFormat {
  char delimiter = 0;  // 0: the one that splits the names (comma, semicolon, tab or spaces)
  char decimal = 0;    // 0: point, or comma where commas do not separate cells
  int skip_lines = 0;  // at the top, whatever they hold
  Header header = Header::kFirstLine;
  int unit_rows = 0;          // lines between the names and the numbers: units, a second line of names
  std::string comment = "#";  // a line that begins with one of these is a remark
};

struct Table {
  std::vector<std::string> names;               // without quotes and surrounding space
  std::vector<int> lines;                       // where in the file each row stands, from 1
  std::vector<std::vector<double>> numbers;     // by column; NaN where a cell is empty; empty unless kNumber
  std::vector<std::vector<std::string>> texts;  // by column; empty unless kText
  std::vector<std::string> notes;               // what was dropped
};

/// Says what to do with each column, once their names are known and the line that they stand in (from 1); one
/// answer a name.
using ChooseCells = std::function<std::vector<CellKind>(const std::vector<std::string>& names, int line)>;

/// Accepts a byte order mark, any line ends, quotes, spaces around cells, the usual words for "no value"
/// (empty, nan, na, null, none, -); a last line that is cut short is dropped with a note. Everything else
/// that is not a number throws TableError, as do rows with too few or too many cells; where an option of
/// TableFormat would read the table, the error names it as a column map says it.
Table ParseTable(std::string_view text, const std::string& name_for_errors, const TableFormat& format,
                 const ChooseCells& choose);

/// The bytes of a file; std::runtime_error with the remedy when it cannot be read.
std::string ReadBytes(const std::filesystem::path& file);

/// SHA-256 of bytes, lower-case hex.
std::string Sha256(std::string_view bytes);

/// Places, from 1, at which a column of this name stands, as "columns 2 and 20" in errors; empty when there
/// is one at most.
std::string Twice(const std::vector<std::string>& names, std::string_view name);

/// Without spaces and control characters at both ends.
std::string_view Trimmed(std::string_view text);
std::string LowerCase(std::string_view text);
/// Of bytes that may be anything: at most `most` characters, what cannot be printed as '?'.
std::string Printable(std::string_view text, std::size_t most = 40);

}  // namespace tendril::gap
