// The times of a table's rows: clocks that restart or tick coarsely, rows out of order, gaps. Knows nothing
// of columns.
#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "csv.h"
#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// True where two rows hold the same numbers.
using SameRow = std::function<bool(std::size_t, std::size_t)>;
/// For the rows of a table, counted from row `from`.
SameRow SameNumbers(const Table& table, std::size_t from);

/// Rows with a time that is greater than that of the row before, from the longest part where the clock
/// restarts; warns of dropped rows. Rows that share the stamp of a coarse clock are spread evenly to its next
/// tick in `time_s`. `lines` are the rows' lines in the file.
std::vector<int> RowsInTime(std::vector<double>& time_s, const std::vector<int>& lines, const SameRow& same,
                            Run& run);

/// Notes gaps in the time grid: steps of more than 1.5 times the usual one.
void NoteGaps(Run& run);

}  // namespace tendril::gap
