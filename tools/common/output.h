// Output folder of a program, and the script that draws its results. Knows nothing of the results.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace tendril::tools {

/// Creates the folder with its parents and returns it; throws std::runtime_error with the remedy when it is
/// not writable.
std::filesystem::path MakeOutputFolder(const std::filesystem::path& folder,
                                       const std::string& remedy = "choose another folder with --out");

/// Runs an installed script (see ScriptFile) with Debian's Python and these folders as arguments. Throws
/// std::runtime_error naming the missing `result` and the last line of the script's stderr.
void RunPlotScript(const std::string& script, const std::vector<std::filesystem::path>& folders,
                   const std::string& result);

}  // namespace tendril::tools
