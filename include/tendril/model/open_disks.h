// Whether a shape is one that a body with disks can have.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

#include "tendril/model/body.h"

namespace tendril::model {

/// The first unit (0-based) that q strains so far that its ends would cut through each other: it turns by a
/// whole turn, or a tendon of it or of a section above has no length left within it. Empty when every unit is
/// open.
std::optional<int> FirstClosedUnit(const Body& body, ConstVectorRef q);

/// "unit 2 is bent by 6.5 rad: ..." with the remedy; empty when every unit is open.
std::string WhyDisksClose(const Body& body, ConstVectorRef q);

}  // namespace tendril::model
