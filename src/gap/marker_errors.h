// Readings of markers on disks that are those of another marker, or of nothing on the robot. Knows nothing of
// models: a marker moves little from one frame to the next.
#pragma once

#include <string>
#include <vector>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// Turns into missing values: markers whose names were exchanged, for as long as they are, and single frames
/// that show a marker far from where it is before and after. `said` gains one line for each kind and run.
/// Frames more than kQuasiStatic_s apart are left as they are. A leap is a twentieth of `length_m` at least
/// and ten times the usual distance from the neighbours' median: noise of a tracker never is.
void MaskMarkerErrors(Run& run, double length_m, std::vector<std::string>& said);

}  // namespace tendril::gap
