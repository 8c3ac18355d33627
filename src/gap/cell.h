// One cell of a table of numbers as programs write it. Knows nothing of lines and columns.
#pragma once

#include <optional>
#include <string_view>

namespace tendril::gap {

/// True for an empty cell and for the words that programs write for a missing value.
bool MeansNone(std::string_view cell);

/// The whole cell as a number with a decimal point; empty where it is none, or overflows. May be infinite or
/// NaN where the cell says so.
std::optional<double> CellNumber(std::string_view cell);

}  // namespace tendril::gap
