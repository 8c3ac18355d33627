// Whether any pose of the robot explains the recorded tip path: geometry of an inextensible backbone. Knows
// nothing of forces, models and effects.
#pragma once

#include <optional>
#include <string>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// A tip path for which the robot is too short.
struct PathBeyondReach {
  std::string run;       // the run that shows it best
  double moved_m = 0;    // largest distance of the tip from its rest position
  double needed_m = 0;   // length of the shortest backbone that has such poses
  double at_rest_m = 0;  // distance of the tip from the tracker's origin, at rest
};

/// Empty where the path is possible for this robot, in any tracker frame and with the base in any pose. Most
/// of the runs with a large tip motion have to be impossible; a single one indicates a bad run, not a wrong
/// robot file.
std::optional<PathBeyondReach> FindPathBeyondReach(const DataSet& set);

}  // namespace tendril::gap
