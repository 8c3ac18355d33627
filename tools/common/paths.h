// Locations of the files installed with the programs: beside an installed binary or in the source tree from
// which it was built.
#pragma once

#include <string>

namespace tendril::tools {

/// Path of a file of the configuration folder, for example ConfigFile("robots/rig_60mm.yaml").
/// TENDRIL_CONFIG_DIR in the environment comes first, then the places relative to the running binary. Throws
/// std::runtime_error naming all of them.
std::string ConfigFile(const std::string& name);

/// Path of a helper script that is installed with the programs, for example ScriptFile("plot_demo.py").
std::string ScriptFile(const std::string& name);

/// Path of the JSON Schema of the "robot" or "daemon" file; empty where it is not installed.
std::string SchemaFile(const std::string& kind);

}  // namespace tendril::tools
