// How the robot answers to each effect a little, from where it does: the columns that candidates are screened
// by. Knows nothing of scores.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "evaluator.h"
#include "fit.h"
#include "hypothesis.h"

namespace tendril::gap {

/// Share of the way to a bound that is gone where it is gone nearly: at the bound itself some robots cannot
/// be simulated.
inline constexpr double kFarStep = 0.95;

/// One candidate about one start.
struct Probe {
  Candidate candidate;
  Model variant;                // where the columns are laid: nominal, or where an effect begins to act
  std::vector<int> primary;     // parameters with a column: all but shapes
  std::vector<Column> columns;  // d simulated / d value, a secant over `step`
  double step = 0;              // of the primary's plainly visible deviation
  bool summed = false;          // from those of its places
  /// Of the variant's values, the one that each place has of its own, or -1: which start does best at which
  /// place the data say, so the columns are laid by the search (see WithEach).
  int each = -1;
};

/// `probe` with each place at that start of its own which does best there by the `gains` of all `probes`; the
/// columns are the sum of theirs. Nothing where a place has none.
Probe WithEach(Probe probe, const std::vector<Probe>& probes, const std::vector<double>& gains);

/// About every start of every effect that these runs may show, at each of its places, but for those of the
/// names `without`; what cannot be simulated has columns of zero. `progress`: from 0 to 1.
std::vector<Probe> MakeProbes(const Evaluator& evaluator, const std::vector<std::string>& without,
                              int threads, const std::function<void(double)>& progress);

}  // namespace tendril::gap
