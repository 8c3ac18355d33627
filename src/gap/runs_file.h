// The list of runs of a folder, runs.yaml: read, resolved and written. Knows nothing of the runs' files.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "tendril/core/robot.h"
#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// One entry of runs.yaml as written.
struct ListedRun {
  std::filesystem::path file;
  std::string family = "unknown", repeat_of{}, before{};
  std::optional<LoadCellPlace> load_cell{};
  bool zero_at_rest = false;
};

/// The entries of a list of runs; what it says of the whole set, and notes, go into `set`. Throws
/// std::runtime_error for a file that is no list.
std::vector<ListedRun> ReadList(const std::filesystem::path& file, DataSet& set);

/// Makes the names of the runs from index `from` on unique, and resolves each before and repeat_of to an
/// existing run, repeat_of to the first of its kind.
void SettleNames(std::vector<Run>& runs, std::size_t from, std::vector<std::string>& notes);

/// The list that reads back as the runs of the set, one file a run named by FileOf.
std::string ListText(const DataSet& set);
/// "circle_1.csv".
std::string FileOf(const std::string& run);

}  // namespace tendril::gap
