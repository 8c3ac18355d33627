// In words, which ways a robot's tendons bend it.
#pragma once

#include <string>

#include "tendril/core/robot.h"

namespace tendril::model {

/// Of each section whose tendons do not pull it every way, one clause: "one tendon bends it only towards 0
/// deg, the backbone brings it back". Empty where all are pulled every way.
std::string HeldDirections(const BodyParameters& body);

}  // namespace tendril::model
