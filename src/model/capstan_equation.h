// The Capstan equation between its solver and the table built from it: in ln T, in which both work.
#pragma once

#include <span>
#include <string>

#include "tendril/core/robot.h"

namespace tendril::model {

/// Relative tolerance with which tensions are solved for.
inline constexpr double kSolverTolerance = 1e-12;

struct LogPoint {
  double log_high = 0;  // ln of the high-side tension
  double slope = 1;     // d ln(high) / d ln(low)
};

/// The map of one pulley in log-log coordinates for all given low-side tensions; parameters already
/// validated.
void SolveLog(const PulleyParameters& pulley, std::span<const double> log_low, std::span<LogPoint> out,
              double relative_tolerance);

/// A number in an error line.
std::string NumberText(double value);

}  // namespace tendril::model
