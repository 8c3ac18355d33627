// What would read a table that is refused: the option of a column map, with its value, for the error line.
// Changes nothing and reads a few lines only.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "csv.h"

namespace tendril::gap {

/// Where the column names `wanted` stand in another line than the one that was taken for the names: the
/// option that reads them, such as "table: {skip_lines: 3}", or empty.
std::string OptionForNames(std::string_view text, const TableFormat& format,
                           const std::vector<std::string>& wanted);

/// Of a cell that is no number: "; " and what it is with the remedy (a time, grouped thousands, a decimal
/// comma), or empty. `column` is its name and `line` its
/// whole line.
std::string HintForCell(std::string_view cell, std::string_view column, std::string_view line,
                        const TableFormat& format);

/// The character that separates the cells of a line (comma, semicolon, tab or space), for one without any
/// ','.
char FindDelimiter(std::string_view line, std::string_view comment);

}  // namespace tendril::gap
