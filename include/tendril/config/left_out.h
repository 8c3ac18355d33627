// What a daemon file leaves to its defaults.
#pragma once

#include <string>

#include "tendril/core/daemon.h"

namespace tendril::config {

/// Keys of the resolved `daemon` that the file it was loaded from does not have, with the values that stand
/// in: "bus.max_load: 0.7, controller.take_up"; empty where it has all. The file can be read.
std::string LeftOut(const DaemonParameters& daemon, const std::string& path);

}  // namespace tendril::config
