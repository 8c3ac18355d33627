// Findings into the files: nodes and directions into the daemon's, the cells' zeros into the robot's. Knows
// nothing of how they were found.
#pragma once

#include <functional>
#include <string>

#include "tendril/commission/commission.h"

namespace tendril::commission {

/// Changes both files where the findings say so, each whole or not at all, and tells each file's name with
/// the lines that changed. Throws std::runtime_error when nothing can be written: a drive is not understood,
/// or what disagrees is in neither file.
void WriteFindings(const CommissionResult& result, const std::string& config_path,
                   const std::string& robot_path, const std::function<void(const std::string&)>& tell);

}  // namespace tendril::commission
