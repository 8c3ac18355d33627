// Where a program leaves its results: the folder, and the script that draws them. Knows nothing of what the
// results are.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace tendril::tools {

/// Creates the folder with its parents and returns it; throws std::runtime_error with the remedy when nothing
/// can be written into it.
std::filesystem::path MakeOutputFolder(const std::filesystem::path& folder);

/// Runs an installed script (see ScriptFile) with Debian's Python and these folders as arguments. Throws
/// std::runtime_error naming `result`, which is then missing, and the last line the script wrote to stderr.
void RunPlotScript(const std::string& script, const std::vector<std::filesystem::path>& folders,
                   const std::string& result);

}  // namespace tendril::tools
