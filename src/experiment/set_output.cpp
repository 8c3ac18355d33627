#include "tendril/experiment/set_output.h"

#include <fmt/format.h>

#include <stdexcept>

namespace tendril::experiment {

std::vector<std::string> FileNames(const Plan& plan) {
  std::vector<std::string> names;
  for (const NamedRun& run : NameRuns(plan)) names.push_back(run.name);
  return names;
}

std::filesystem::path WriteSet(const ExperimentSet& set, const gap::SetFolder& folder, bool measured) {
  if (set.data.runs.empty()) throw std::runtime_error("nothing was recorded: " + set.trouble);
  if (set.trouble.empty()) {
    folder.Write(set.data);
    return folder.path();
  }
  if (folder.replaces() && !measured) {
    throw std::runtime_error(fmt::format("the set is not complete: {}; {} still holds the earlier one",
                                         set.trouble, folder.path().string()));
  }
  return folder.WriteIncomplete(set.data);
}

}  // namespace tendril::experiment
