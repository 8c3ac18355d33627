// Names of the coordinates q of a body, as the columns of `tendril model` and the Python package have them.
#pragma once

#include <string>
#include <vector>

#include "tendril/model/body.h"

namespace tendril::model {

/// u1, v1 and, where the unit has them, w1 (torsion), e1 (extension), sx1, sy1 (shear); then those of unit 2.
std::vector<std::string> CoordinateNames(const Body& body);

}  // namespace tendril::model
