// Finds the column-map option that would read a refused table, for the error line. Reads a few lines only and
// changes nothing.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "csv.h"

namespace tendril::gap {

/// An option of a column map, such as "table: {skip_lines: 3}", and why it is needed.
struct NamesOption {
  std::string why, option;
};

/// The option that reads the names of `columns`, where they are in another line than the one taken for the
/// names, or between other delimiters.
std::optional<NamesOption> OptionForNames(std::string_view text, const TableFormat& format,
                                          const std::vector<std::string>& columns);

/// For a cell that is not a number: "; " and its meaning with the remedy (a time, grouped thousands, a
/// decimal comma); else empty. `column` is its name and `line` its whole line.
std::string HintForCell(std::string_view cell, std::string_view column, std::string_view line,
                        const TableFormat& format);

/// The delimiter of the cells in a line (comma, semicolon, tab or space); ',' where there is none.
char FindDelimiter(std::string_view line, std::string_view comment);

}  // namespace tendril::gap
