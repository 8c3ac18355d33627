// Describes in words the directions in which a robot's tendons bend it.
#pragma once

#include <string>

#include "tendril/core/robot.h"

namespace tendril::model {

/// One clause per section whose tendons do not pull it in every direction: "one tendon bends it only towards
/// 0 deg, the backbone brings it back". Empty when all sections are pulled in every direction.
std::string HeldDirections(const BodyParameters& body);

}  // namespace tendril::model
