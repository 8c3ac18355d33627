// Whether a daemon can do what its files ask for, found without a bus: `tendril config check`. Knows what the
// files mean together; the values of each by itself are config's.
#pragma once

#include <string>
#include <vector>

#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"

namespace tendril::daemon {

/// The directions that the robot's tendons do not hold, as a YAML comment; empty where they hold all.
std::string DirectionsComment(const RobotParameters& robot);

/// What the robot's numbers amount to (model/figures.h), as YAML comments.
std::string FiguresComment(const RobotParameters& robot);

/// The numbers of which the robot file says how well they are known, as YAML comments; empty where of none.
std::string UncertaintyComment(const RobotParameters& robot);

/// The resolved daemon file, still one YAML file, with comments: what its robot's numbers amount to, the bus's
/// budget, margins of the load cells'
/// loops, the directions that cannot be held, and the keys at their defaults. Throws config::ConfigError for
/// files that do not fit each other, a drive that its EDS file says cannot do this, a bus that is too slow,
/// and load cell loops that would not be stable.
std::string CheckedText(const DaemonParameters& daemon, const RobotParameters& robot,
                        const std::string& path);

/// A line for each accepted value that makes no sense on its robot, or on this computer: trajectory limits
/// that delay every motion, a CPU that is not here, bends that the tendons do not hold, a tip correction that
/// is slow, and config::Warnings. Both files fit each other.
std::vector<std::string> FileWarnings(const DaemonParameters& daemon, const RobotParameters& robot,
                                      const std::string& path);

}  // namespace tendril::daemon
