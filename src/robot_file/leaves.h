// A resolved robot as a tree of keys, leaf by leaf. Knows nothing of a file's layout.
#pragma once

#include <yaml-cpp/yaml.h>

#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "tendril/core/robot.h"

namespace tendril::robot_file {

using Path = std::vector<std::string>;
using Leaves = std::map<Path, std::string>;

/// Relative difference up to which two robots are the same.
inline constexpr double kSame = 1e-9;

Path Join(const Path& a, const Path& b);
std::optional<double> AsNumber(const std::string& text);
/// The same text, or numbers that differ by this share of the larger one at most: by default round-off only.
bool Same(const std::string& a, const std::string& b, double relative = 1e-12);

/// Without how well its numbers are known: that is no part of what the robot is.
YAML::Node Resolved(RobotParameters robot);
/// Undefined where there is none.
YAML::Node Find(YAML::Node node, const Path& path);
/// All leaves of one tendon's drivetrain, resolved.
Leaves TendonLeaves(RobotParameters robot, std::size_t tendon);
/// All other leaves, without effects.
Leaves OtherLeaves(const RobotParameters& robot);

}  // namespace tendril::robot_file
