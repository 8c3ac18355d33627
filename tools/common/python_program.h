// Hands this process over to a module of the Python package tendril. Knows no module.
#pragma once

#include <string>
#include <vector>

namespace tendril::tools {

/// Becomes `python -m MODULE ARGUMENTS...` and does not return. Throws std::runtime_error, with the command
/// that installs it, where no Python has the package.
int RunPython(const std::string& module, const std::vector<std::string>& arguments);

}  // namespace tendril::tools
