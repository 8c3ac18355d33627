// Hands over to a part of the Python package, which is installed apart from the programs. Knows none of its
// parts.
#pragma once

#include <string>
#include <vector>

namespace tendril::tools {

/// An interpreter that has the package tendril and these modules ("textual"); empty: none. TENDRIL_PYTHON in
/// the environment is the only one asked where it is set; else those of the build and of the installation,
/// and python3.
std::string FindPython(const std::vector<std::string>& modules = {});

/// Becomes `python -m MODULE ARGUMENTS...` ("tendril.view") with an interpreter that has `modules` too.
/// Throws std::runtime_error: what is missing, and the command that installs it.
[[noreturn]] void RunPython(const std::string& module, const std::vector<std::string>& arguments,
                            const std::vector<std::string>& modules = {});
/// The same; returns where no interpreter has them.
void RunPythonIfThere(const std::string& module, const std::vector<std::string>& arguments,
                      const std::vector<std::string>& modules);

}  // namespace tendril::tools
