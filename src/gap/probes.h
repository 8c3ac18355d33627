// The robot's response to a small amount of each effect: the columns that candidates are screened with. Knows
// nothing of scores.
#pragma once

#include <functional>
#include <vector>

#include "evaluator.h"
#include "fit.h"
#include "hypothesis.h"

namespace tendril::gap {

/// Fraction of the way to a bound that stands for the bound itself, where some robots cannot be simulated.
inline constexpr double kFarStep = 0.95;

/// One candidate at one start.
struct Probe {
  Candidate candidate;
  Model variant;                // linearisation point: nominal, or where an effect begins to act
  std::vector<int> primary;     // parameters with a column: all but shape parameters
  std::vector<Column> columns;  // d simulated / d value, a secant over `step`
  double step = 0;              // in plainly visible deviations of the primary
  bool summed = false;          // columns are the sum of those of its places
  /// Index of the value that each place chooses for itself, or -1: the data decide which start suits which
  /// place, so the search builds the columns (see WithEach).
  int each = -1;
};

/// `probe` with each place at the start that gains most there by the `gains` of all `probes`; its columns are
/// the sum of the places' columns. Empty where a place has none.
Probe WithEach(Probe probe, const std::vector<Probe>& probes, const std::vector<double>& gains);

/// Every start of every effect that these runs can show, at each of its places, but for the candidates that
/// are `excluded`; those that cannot be simulated have zero columns. `progress`: from 0 to 1.
std::vector<Probe> MakeProbes(const Evaluator& evaluator,
                              const std::function<bool(const Candidate&)>& excluded, int threads,
                              const std::function<void(double)>& progress);

}  // namespace tendril::gap
