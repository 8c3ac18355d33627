// Motions that a user describes: along a path as fast as limits allow, or through a table of times. Knows
// nothing of files.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "motion.h"
#include "path.h"

namespace tendril::tools {

/// Along curves one after the other, from rest to rest on each, with a moment's rest at the end. Throws
/// PathError.
std::unique_ptr<Motion> MakePathMotion(std::string name, const std::vector<Spline>& curves,
                                       const PathLimits& limits, const RobotParameters& robot);

/// Bendings at times, joined by a spline over time. `limits` are kept or std::runtime_error says where they
/// are not and by which factor the times would have to be stretched.
std::unique_ptr<Motion> MakeTableMotion(std::string name, const Spline& table, const PathLimits& limits,
                                        const RobotParameters& robot);

}  // namespace tendril::tools
