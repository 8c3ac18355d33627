// The project's robot files by name.
#pragma once

#include <string>

#include "tendril/config/config.h"
#include "tendril/core/robot.h"

namespace tendril::test {

/// "rig_90mm" is config/robots/rig_90mm.yaml.
inline RobotParameters Rig(const std::string& name = "rig_90mm") {
  return config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/" + name + ".yaml");
}

}  // namespace tendril::test
