// Readings of markers on disks that are those of another marker, or of nothing on the robot. Knows nothing of
// models: a marker moves little from one frame to the next.
#pragma once

#include <string>
#include <vector>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// Turns into missing values: markers whose names are exchanged, as long as they are, and frames that show a
/// marker far from where it is before and after: by a twentieth of `length_m` and ten times the usual
/// distance from its neighbours' median. `said` gains one line for each kind. Leaps are found in 10 frames a
/// second and more; a run with frames more than kQuasiStatic_s apart is left as it is.
void MaskMarkerErrors(Run& run, double length_m, std::vector<std::string>& said);

}  // namespace tendril::gap
