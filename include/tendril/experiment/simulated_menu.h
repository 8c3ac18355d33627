// The experiments that a diagnosis may ask for next, simulated in process. Knows nothing of the diagnosis.
#pragma once

#include <cstdint>
#include <string>

#include "tendril/core/robot.h"
#include "tendril/gap/diagnose.h"

namespace tendril::experiment {

/// Every family that `tendril excite` knows, each as its usual run: simulated with the controller of a daemon
/// file (empty: the one built in) that knows `nominal`, and as a plan for the robot. What ends early throws
/// std::runtime_error when it is simulated. Throws config::ConfigError for a wrong daemon file.
gap::ExperimentMenu SimulatedMenu(const RobotParameters& nominal, const std::string& daemon_file,
                                  std::uint64_t seed);

}  // namespace tendril::experiment
