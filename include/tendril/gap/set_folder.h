// Where a command leaves a data set: what is there already is not harmed, and a set is there whole or not at
// all. Knows nothing of how the runs came about.
#pragma once

#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

class SetFolder {
 public:
  /// Looks only; makes and changes nothing. Throws UsageError when the folder holds runs and `overwrite` does
  /// not say that they may go, or when what would go is none of an earlier set's (another robot file, one of
  /// `inputs`); std::runtime_error when nothing can be written there.
  SetFolder(std::filesystem::path folder, bool overwrite, const std::vector<std::string>& inputs);

  /// Throws UsageError when a run of one of these names would replace a file that the earlier set does not
  /// list.
  void CheckNames(const std::vector<std::string>& runs) const;

  /// True when there is an earlier set, which is replaced.
  bool replaces() const { return !old_.empty(); }
  const std::filesystem::path& path() const { return folder_; }

  /// Writes the set beside the earlier one and exchanges the two when it is complete; with an error the
  /// earlier one stays. The earlier set's files are those that its runs.yaml lists, runs.yaml and robot.yaml;
  /// anything else in the folder is left alone.
  void Write(const DataSet& set) const;

  /// Of what must not be lost but is no complete set: as Write where nothing is replaced, else into a new
  /// folder beside this one. Returns where.
  std::filesystem::path WriteIncomplete(const DataSet& set) const;

 private:
  std::filesystem::path folder_;
  std::set<std::string> old_;  // file names of the earlier set
};

/// Throws UsageError when writing this file would replace one of these.
void RefuseToReplace(const std::string& file, const char* option, const std::vector<std::string>& inputs);

/// Throws std::runtime_error when the file could not be written; writes nothing.
void CheckWritable(const std::string& file);

}  // namespace tendril::gap
