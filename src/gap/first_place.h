// Marks the place of a diagnosis at which the chain first goes wrong. Knows nothing of residuals.
#pragma once

#include "tendril/core/robot.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

/// Marks the first place with an excess; a faulty sensor explains the excess at all cuts that read it.
/// `place`: where the load cells are.
void MarkFirst(Diagnosis& d, LoadCellPlace place);

/// Marks the place where repetitions differ by a law, if no place has a common gap.
void MarkUnrepeated(Diagnosis& d);

}  // namespace tendril::gap
