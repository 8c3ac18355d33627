// Calibration of a position-controlled robot: its numbers as LearnPostures infers them, in the words of a
// calibration. Knows nothing of changes.
#pragma once

#include "tendril/gap/calibrate.h"

namespace tendril::gap {

/// The runs show postures, enough of them to infer a robot's numbers.
bool CanCalibratePostures(const DataSet& set);

/// Numbers that no robot file can hold (zeros of the tendons, the tracker's frame, a lag) are among those
/// found, 0 in the file; rest bends and the direction of gravity are in the robot.
Calibration CalibratePostures(const DataSet& set, const CalibrateOptions& options);

}  // namespace tendril::gap
