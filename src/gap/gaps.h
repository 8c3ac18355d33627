// Gaps in what a run recorded: of one sensor, and of all signals while something moved. Knows no models.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "prepare.h"

namespace tendril::gap {

/// Gaps of column j longer than interpolation bridges: everywhere for a sensor that is always slower, or has
/// hardly any readings. `at`: grid sample of each row.
void FindDropouts(const Eigen::MatrixXd& values, const std::vector<int>& at, int samples, double step_s,
                  bool at_rest, int j, std::vector<Dropout>& dropouts);

/// Marks the time after samples [from, to) of a tendon (or of all, tendon -1) were lost: the body's position
/// and the direction of pulley friction are unknown if anything moved.
void MarkMoved(int tendon, int from, int to, PreparedRun& out);

}  // namespace tendril::gap
