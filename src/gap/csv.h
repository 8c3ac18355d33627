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

struct TableFormat {
  char delimiter = 0;  // 0: the one that splits the first line (comma, semicolon, tab or spaces)
  char decimal = 0;    // 0: point, and comma too where commas do not separate cells
};

struct Table {
  std::vector<std::string> names;               // of the first line, without quotes and surrounding space
  std::vector<int> lines;                       // where in the file each row stands, from 1
  std::vector<std::vector<double>> numbers;     // by column; NaN where a cell is empty; empty unless kNumber
  std::vector<std::vector<std::string>> texts;  // by column; empty unless kText
  std::vector<std::string> notes;               // what was dropped
};

/// Says what to do with each column, once their names are known; one answer a name.
using ChooseCells = std::function<std::vector<CellKind>(const std::vector<std::string>& names)>;

/// The first line that is neither empty nor begins with # names the columns. Accepts a byte order mark, any
/// line ends, quotes, spaces around cells, the usual words for "no value" (empty, nan, na, null, none, -);
/// a last line that is cut short is dropped with a note. Everything else that is not a number throws
/// TableError, as do rows with too few or too many cells.
Table ParseTable(std::string_view text, const std::string& name_for_errors, const TableFormat& format,
                 const ChooseCells& choose);

/// The bytes of a file; std::runtime_error with the remedy when it cannot be read.
std::string ReadBytes(const std::filesystem::path& file);

/// SHA-256 of bytes, lower-case hex.
std::string Sha256(std::string_view bytes);

/// Without spaces and control characters at both ends.
std::string_view Trimmed(std::string_view text);
std::string LowerCase(std::string_view text);
/// Of bytes that may be anything: at most `most` characters, what cannot be printed as '?'.
std::string Printable(std::string_view text, std::size_t most = 40);

}  // namespace tendril::gap
