// The robot and daemon files of the answers, as text and on disk.
#pragma once

#include <filesystem>
#include <string>

#include "tendril/first_robot/questions.h"

namespace tendril::first_robot {

/// The commented files. `schema` is the path of the JSON Schema for editors, empty where there is none.
std::string RobotFileText(const NewRobot& made, const std::string& schema);
std::string DaemonFileText(const NewRobot& made, const std::string& schema);

struct FilePair {
  std::filesystem::path robot, daemon;
};

/// NAME.yaml and NAME_tendrild.yaml in the folder. Throws std::runtime_error with the remedy when one of them
/// exists, unless it may be replaced.
FilePair FilesFor(const std::filesystem::path& folder, const std::string& name, bool replace);

/// Both, in a folder that is there; the schemas are in the order robot, daemon. Nothing is written when either
/// cannot be.
void WriteFiles(const NewRobot& made, const FilePair& files, const FilePair& schemas);

}  // namespace tendril::first_robot
