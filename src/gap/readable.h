// What every inference does with a data set first: effects of the file folded in, runs that cannot be used
// left out, impossible readings masked. Knows nothing of models.
#pragma once

#include <string>
#include <vector>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

struct ReadableSet {
  DataSet set;
  std::vector<std::string> contradictions;  // see Masked
};

/// The set, ready for the evaluator; `notes` gains one line for each thing left out or masked. Throws
/// std::runtime_error where nothing is left, or where the time of all runs is in another unit.
ReadableSet Readable(const DataSet& given, std::vector<std::string>& notes);

/// Throws std::runtime_error with the first contradiction: from such readings no number can be inferred.
void RefuseContradictions(const ReadableSet& set);

}  // namespace tendril::gap
