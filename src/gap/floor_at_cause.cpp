// Floors and scores of a robot with a cause.
#include "floor_at_cause.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "comparable.h"

namespace tendril::gap {
namespace {

constexpr double kPlainlyLess = 0.5;  // of the differences between repetitions
constexpr double kMayHide = 2;        // in units of sensor noise; smaller differences hide little
// Number of best singles and best pairs tried as the cause of the differences between repetitions.
constexpr std::size_t kMayNotRepeat = 4;

/// Expected log score gained by the missing noise alone.
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

/// The repeated runs and their repetitions.
DataSet WithRepetitions(const DataSet& set) {
  std::set<std::string> names;
  for (const Run& run : set.runs) {
    if (run.repeat_of.empty()) continue;
    names.insert(run.repeat_of);
    names.insert(run.name);
  }
  DataSet repeated = set;
  std::erase_if(repeated.runs, [&](const Run& run) { return !names.contains(run.name); });
  return repeated;
}

/// The best single cause, if the floor may be determined with it: comparisons with runs from before contain
/// the noise of both.
const Fit* LikeliestCause(const DataSet& set, const SearchResult& search) {
  if (search.fits.empty() || Compared(set)) return nullptr;
  const Fit& best = search.fits.front();
  const bool found = !best.bound_hit && best.held_out_score - search.base_score >= kPairGain;
  return found ? &best : nullptr;
}

bool SameChannels(const Evaluator& a, const Evaluator& b) {
  return std::equal(a.channels().begin(), a.channels().end(), b.channels().begin(), b.channels().end(),
                    [](const Channel& one, const Channel& other) { return one.name == other.name; });
}

}  // namespace

std::optional<Evaluator> WithFloorOfCause(const Evaluator& evaluator, const DataSet& set,
                                          const SearchResult& search, const Evaluator::Options& options) {
  const Fit* best = LikeliestCause(set, search);
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

Evaluator AsThoughRepeated(const DataSet& set, const Evaluator::Options& options) {
  Evaluator::Options at = options;
  at.repeats = true;
  return {set, at};
}

bool MayHideCause(const Evaluator& evaluator) {
  return evaluator.repetitions_by().size() > 0 && evaluator.repetitions_by().maxCoeff() > kMayHide;
}

std::vector<Model> MayNotRepeat(const SearchResult& search) {
  std::vector<Model> causes;
  const auto add = [&](const Fit& fit) {
    if (!fit.bound_hit && fit.held_out_score - search.base_score >= kPairGain) causes.push_back(fit.model);
  };
  for (const std::vector<Fit>* fits : {&search.fits, &search.pairs}) {
    for (std::size_t k = 0; k < std::min(kMayNotRepeat, fits->size()); ++k) add((*fits)[k]);
  }
  return causes;
}

std::optional<Narrowed> WithRepeatabilityOfCause(const Evaluator& evaluator, const DataSet& set,
                                                 const std::vector<Model>& causes,
                                                 const Evaluator::Options& options) {
  const DataSet repeated = WithRepetitions(set);
  const Eigen::VectorXd& by = evaluator.repetitions_by();
  double least = 0;  // sum over non-repeating channels of log floors, less those of the nominal robot
  const Model* best = nullptr;
  double differed = 0;
  const auto with = [&](const Model& cause, const DataSet& runs) {
    DataSet with_cause = runs;
    with_cause.robot = cause.Robot(evaluator.nominal());
    return Evaluator(with_cause, options);
  };
  for (const Model& cause : causes) {
    try {
      const Evaluator there = with(cause, repeated);
      if (!SameChannels(there, evaluator)) continue;
      double sum = 0;
      double most = 0;  // of the channels that repeat clearly better with the cause
      for (int c = 0; c < by.size(); ++c) {
        if (by[c] <= kMayHide) continue;
        const double share = there.channels()[c].floor / evaluator.channels()[c].floor;
        sum += std::log(share);
        if (share < kPlainlyLess && there.repetitions_by()[c] < kPlainlyLess * by[c])
          most = std::max(most, by[c]);
      }
      if (most > 0 && sum < least) least = sum, best = &cause, differed = most;
    } catch (const std::exception&) {
      // A robot that cannot follow these runs does not show how they repeat.
    }
  }
  if (best == nullptr) return std::nullopt;
  try {
    const Evaluator there = with(*best, set);
    Evaluator::Options as_there = options;
    as_there.with_cause = &there;
    return Narrowed{Evaluator(set, as_there), *best, differed};
  } catch (const std::exception&) {
    return std::nullopt;
  }
}

void SubtractNoiseGain(const Evaluator& evaluator, const DataSet& set, const Evaluator::Options& options,
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
        // A robot that cannot follow alternative readings of these runs is not known to be quieter.
      }
      best.score -= *best.quiet;
      best.held_out_score -= *best.quiet;
      std::stable_sort(fits->begin(), fits->end(), ByHeldOut);
    }
  }
}

}  // namespace tendril::gap
