// JSON Schemas (draft 7) of the configuration files, from the files' descriptions: completion, meanings and
// marks for errors in editors. Reads no file.
#pragma once

#include <string>

namespace tendril::config {

/// Every file that LoadRobot and LoadDaemon accept is valid, but for texts that YAML reads as numbers or
/// booleans ("name: 12") and have to be in quotes. Keys, types, ranges and choices of a file that is valid
/// are right; the rules between keys are those functions' alone.
std::string RobotFileSchema();
std::string DaemonFileSchema();

}  // namespace tendril::config
