// Floors and scores as a cause makes them.
#include "floor_at_cause.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>
#include <vector>

#include "alike.h"

namespace tendril::gap {
namespace {

constexpr double kPlainlyLess = 0.5;  // of what repetitions differ by

/// Log score that the missing noise alone is expected to bring.
double Quiet(const Evaluator& nominal, const Evaluator& other, const Weights& weights) {
  double sum = 0;
  for (int c = 0; c < static_cast<int>(nominal.channels().size()); ++c) {
    double channel = 0;
    for (int i = 0; i < static_cast<int>(nominal.runs().size()); ++i) {
      const auto &was = nominal.Carried()[i][c], &is = other.Carried()[i][c];
      if (was.size() != is.size()) continue;
      channel += 0.5 * (weights(i, c).array() * (was - is).array()).sum();
    }
    sum += std::max(0.0, channel);
  }
  return sum;
}

/// The best single cause, where the floor may be taken at it: what is compared with runs from before has the
/// noise of both.
const Fit* Cause(const DataSet& set, const SearchResult& search) {
  if (search.fits.empty() || Compared(set)) return nullptr;
  const Fit& best = search.fits.front();
  const bool found = !best.bound_hit && best.held_out_score - search.base_score >= kPairGain;
  return found ? &best : nullptr;
}

}  // namespace

std::optional<Evaluator> WidenedByCause(const Evaluator& evaluator, const DataSet& set,
                                        const SearchResult& search, const Evaluator::Options& options) {
  const Fit* best = Cause(set, search);
  if (best == nullptr || !evaluator.repeated()) return std::nullopt;
  DataSet with_cause = set;
  try {
    with_cause.robot = best->model.Robot(evaluator.nominal());
    std::optional<Evaluator> wide = evaluator;
    if (wide->Widen(Evaluator(with_cause, options))) return wide;
  } catch (const std::exception&) {
    // A robot that cannot follow these runs has no floor.
  }
  return std::nullopt;
}

std::optional<Evaluator> NarrowedByCause(const Evaluator& evaluator, const DataSet& set,
                                         const SearchResult& search, const Evaluator::Options& options) {
  const Fit* best = Cause(set, search);
  if (best == nullptr || evaluator.repetitions_differ() == 0) return std::nullopt;
  DataSet with_cause = set;
  try {
    with_cause.robot = best->model.Robot(evaluator.nominal());
    const Evaluator at_cause(with_cause, options);
    Evaluator::Options at = options;
    at.repeated = &at_cause.AtNominal();
    std::optional<Evaluator> narrow(std::in_place, set, at);
    if (narrow->repetitions_differ() < kPlainlyLess * evaluator.repetitions_differ()) return narrow;
  } catch (const std::exception&) {
    // A robot that cannot follow these runs says nothing of how they repeat.
  }
  return std::nullopt;
}

void TakeOffQuiet(const Evaluator& evaluator, const DataSet& set, const Evaluator::Options& options,
                  SearchResult& search) {
  if (Compared(set)) return;
  const Weights weights(evaluator, search.leftover);
  for (std::vector<Fit>* fits : {&search.fits, &search.pairs}) {
    while (!fits->empty() && !fits->front().quiet) {
      Fit& best = fits->front();
      best.quiet = 0;
      try {
        DataSet with_cause = set;
        with_cause.robot = best.model.Robot(evaluator.nominal());
        best.quiet = Quiet(evaluator, Evaluator(with_cause, options), weights);
      } catch (const std::exception&) {
        // A robot that cannot follow other readings of these runs is not known to be quiet.
      }
      best.score -= *best.quiet;
      best.held_out_score -= *best.quiet;
      std::stable_sort(fits->begin(), fits->end(), ByHeldOut);
    }
  }
}

}  // namespace tendril::gap
