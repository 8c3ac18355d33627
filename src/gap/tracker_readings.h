// The tracker's readings of a run, at their own times. Simulates nothing.
#pragma once

#include <cstdint>
#include <optional>
#include <random>
#include <vector>

#include "prepare.h"
#include "tendril/core/robot.h"
#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// Shape signals of the rows at samples `at`. Bending adds nothing to a tip pose from the same sensor.
void ReadTracker(const Run& run, const RobotParameters& robot, const std::vector<int>& at,
                 std::optional<std::uint64_t> seed, std::mt19937_64& random, PreparedRun& out);

}  // namespace tendril::gap
