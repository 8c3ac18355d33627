// User-defined motions: along a path as fast as the limits allow, or through a table of times. Knows nothing
// of files.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "tendril/motion/motion.h"
#include "tendril/motion/path.h"

namespace tendril::motion {

/// Along curves in sequence, from rest to rest on each, with a short rest at the end. Throws PathError.
std::unique_ptr<Motion> MakePathMotion(std::string name, const std::vector<Spline>& curves,
                                       const PathLimits& limits, const RobotParameters& robot);

/// Bendings at times, interpolated by a spline over time. Throws std::runtime_error where `limits` are
/// exceeded, with the factor by which the times would have to be stretched.
std::unique_ptr<Motion> MakeTableMotion(std::string name, const Spline& table, const PathLimits& limits,
                                        const RobotParameters& robot);

}  // namespace tendril::motion
