// A calibration for readers and programs: a table on the terminal, comment lines for the robot file, JSON.
// Knows nothing of how it was found.
#pragma once

#include <string>
#include <vector>

#include "tendril/gap/calibrate.h"

namespace tendril::gap {

/// Numbers with their intervals, what the runs did not say, what changes together, what is left.
std::string CalibrationText(const Calibration& calibration);

/// What the new file says about where its numbers come from, a line each.
std::vector<std::string> CalibrationHeading(const Calibration& calibration);

std::string CalibrationJson(const Calibration& calibration);

}  // namespace tendril::gap
