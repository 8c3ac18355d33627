// Whether any pose of the robot explains the recorded path of its tip: geometry of a backbone that does not
// stretch. Knows nothing of forces, models and effects.
#pragma once

#include <optional>
#include <string>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// A path of the tip that the robot is too short for.
struct PathBeyondReach {
  std::string run;       // where it is clearest
  double moved_m = 0;    // farthest from where the tip was at rest
  double needed_m = 0;   // length of the shortest backbone that has such poses
  double at_rest_m = 0;  // distance of the tip from the tracker's origin, at rest
};

/// Empty where the path may be this robot's. In whatever frame the tracker reports, however the base is
/// turned and wherever it stands. Of the runs that move the tip far most have to be impossible; a single one
/// is odd, not the robot.
std::optional<PathBeyondReach> FindPathBeyondReach(const DataSet& set);

}  // namespace tendril::gap
