// Where a robot ends that is loaded from rest. For programs, not for the tick.
#pragma once

#include "tendril/model/body.h"

namespace tendril::model {

/// Whether tensions raised from zero end at the equilibrium q (2N), within a microradian: other equilibria
/// under the same tensions exist, but the robot does not come to them by itself.
bool LoadingEndsAt(const Body& body, ConstVectorRef tension_N, ConstVectorRef q);

}  // namespace tendril::model
