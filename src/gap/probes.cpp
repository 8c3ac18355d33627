// Sensitivities at every start, onsets of effects without an initial response, and sums over places.
#include "probes.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "tendril/core/parallel.h"

namespace tendril::gap {
namespace {

constexpr double kScreeningStep = 0.5;  // of a parameter's plainly visible deviation
// The onset of an effect is located to 2^-kOnsetHalvings of the way to the bound, and probed at these shares
// from there.
constexpr int kOnsetHalvings = 6;
constexpr double kOnsetDerivative = 0.0125;  // in plainly visible deviations
constexpr double kOnsetSteps[] = {0.02, 0.1, 0.4};

/// Differences from the nominal robot, with the body in coarse steps: enough to rank candidates, of which the
/// likely ones are refitted.
class Screen {
 public:
  Screen(const Evaluator& evaluator, int threads) : evaluator_(evaluator), nominal_(evaluator.runs().size()) {
    try {
      ParallelFor(static_cast<int>(nominal_.size()), threads, [&](int i) {
        nominal_[i] = std::move(evaluator.At(evaluator.nominal(), kAllCuts, {i}, steps_)[i]);
      });
    } catch (const std::runtime_error&) {  // in fine steps it is known to work
      nominal_ = evaluator.AtNominal();
      steps_ = sim::Replay::Steps::kFine;
    }
  }

  const Evaluator& evaluator() const { return evaluator_; }

  /// d simulated / d value of parameter k of the nominal robot with an effect, over `step`.
  Column Response(const Model& model, int k, double step) const {
    const unsigned cuts = CutsOf(evaluator_, model);
    // Where the body moves as without the effect, that motion is known.
    if ((cuts & kBody) == 0) return Sensitivity(evaluator_, model, k, step, evaluator_.AtNominal(), cuts);
    return Sensitivity(evaluator_, model, k, step, nominal_, cuts, steps_);
  }

 private:
  const Evaluator& evaluator_;
  sim::Replay::Steps steps_ = sim::Replay::Steps::kCoarse;
  Residuals nominal_;
};

/// Index of the candidate's parameter that each place has of its own, or -1.
int PerPlaceParameter(const Candidate& candidate) {
  if (candidate.target) return -1;
  for (int k = 0; k < candidate.size(); ++k) {
    if (!candidate.parameters[k].each.empty()) return k;
  }
  return -1;
}

/// Every combination of the shape parameters' starts; parameters of single places stay nominal.
std::vector<Model> Variants(const Candidate& candidate) {
  std::vector<Model> variants{Model::Of(candidate)};
  for (int k = 0; k < candidate.size(); ++k) {
    const auto& p = candidate.parameters[k];
    if (!p.shape || p.starts.empty() || k == PerPlaceParameter(candidate)) continue;
    std::vector<Model> more;
    for (const auto& variant : variants) {
      for (const double start : p.starts) {
        more.push_back(variant);
        more.back().values[k] = start;
      }
    }
    variants = std::move(more);
  }
  return variants;
}

/// The change moves no channel beyond rounding.
bool IsSilent(const Evaluator& evaluator, const Column& column, double change) {
  constexpr double kRounding = 1e-6;  // of a floor
  for (const auto& run : column) {
    for (std::size_t c = 0; c < run.size(); ++c) {
      const double most = kRounding * evaluator.channels()[c].floor;
      if (run[c].size() > 0 && run[c].cwiseAbs().maxCoeff() * std::abs(change) > most) return false;
    }
  }
  return true;
}

void AddTo(Column& sum, const Column& column) {
  for (std::size_t i = 0; i < sum.size(); ++i) {
    if (sum[i].empty()) sum[i].resize(column[i].size());
    for (std::size_t c = 0; c < column[i].size(); ++c) {
      if (column[i][c].size() == 0) continue;
      if (sum[i][c].size() == 0) {
        sum[i][c] = column[i][c];
      } else {
        sum[i][c] += column[i][c];
      }
    }
  }
}

/// Every candidate at every start, without columns.
std::vector<Probe> Starts(const Evaluator& evaluator, const std::vector<Candidate>& candidates) {
  std::vector<Probe> probes;
  for (const Candidate& c : candidates) {
    std::vector<int> primary;
    for (int k = 0; k < c.size(); ++k) {
      if (!c.parameters[k].shape) primary.push_back(k);
    }
    // With a single tendon there is no candidate beside that of all.
    const bool summed = c.effect->on_all && c.effect->on_one && !c.target &&
                        c.effect->scope == sim::Scope::kTendon && evaluator.nominal().body.tendons() > 1;
    for (const auto& variant : Variants(c)) {
      probes.push_back({c, variant, primary, {}, kScreeningStep, summed, PerPlaceParameter(c)});
      if (primary.size() != 1) continue;
      // Effects that act differently where they are weak, or far off, are probed there too.
      const auto& p = c.parameters[primary[0]];
      for (const double start : p.starts) {
        probes.push_back(
            {c, variant, primary, {}, (start - p.nominal) / ScaleOf(p), summed, PerPlaceParameter(c)});
        probes.back().variant.derivative_step = kOnsetDerivative;
      }
    }
  }
  for (Probe& probe : probes) probe.columns.resize(probe.primary.size());
  return probes;
}

/// Of a probe without response.
Column EmptyColumn(const Evaluator& evaluator) {
  return Column(evaluator.runs().size(), std::vector<Eigen::VectorXd>(evaluator.channels().size()));
}

void Differentiate(const Screen& screen, std::vector<Probe>& probes, int threads,
                   const std::function<void(double)>& progress) {
  std::vector<std::pair<int, int>> tasks;  // probe, and index of its primary
  for (int p = 0; p < static_cast<int>(probes.size()); ++p) {
    if (probes[p].summed) continue;
    for (int k = 0; k < static_cast<int>(probes[p].primary.size()); ++k) tasks.emplace_back(p, k);
  }
  std::atomic<int> done{0};
  ParallelFor(static_cast<int>(tasks.size()), threads, [&](int t) {
    Probe& probe = probes[tasks[t].first];
    const int k = probe.primary[tasks[t].second];
    try {
      probe.columns[tasks[t].second] =
          screen.Response(probe.variant, k, probe.step * ScaleOf(probe.variant.parameter(k)));
    } catch (const std::exception&) {
      probe.columns[tasks[t].second] = EmptyColumn(screen.evaluator());
    }
    progress(++done / static_cast<double>(tasks.size()));
  });
}

/// The probe at the onset of the effect, on the way to the bound that its step points to, or to the other
/// bound if no start lies in that direction; empty without any response.
std::vector<Probe> FromItsOnset(const Screen& screen, const Probe& probe) {
  std::vector<Probe> at_onset;
  const int k = probe.primary[0];
  const auto& p = probe.variant.parameter(k);
  const auto try_towards = [&](double bound) {
    const double way = kFarStep * (bound - probe.variant.values[k]);
    const auto column = [&](double from, double step) {
      Model at = probe.variant;
      at.values[k] += from * way;
      return screen.Response(at, k, step * way);
    };
    // A probe that cannot be simulated does have a response.
    const auto is_silent = [&](double step) {
      try {
        return IsSilent(screen.evaluator(), column(0, step), step * way);
      } catch (const std::exception&) {
        return false;
      }
    };
    if (is_silent(1)) return;
    double quiet = 0, loud = 1;
    for (int half = 0; half < kOnsetHalvings; ++half) {
      const double middle = 0.5 * (quiet + loud);
      (is_silent(middle) ? quiet : loud) = middle;
    }
    for (const double step : kOnsetSteps) {
      if (quiet + step > 1) continue;
      try {
        Probe there = probe;
        there.variant.values[k] += quiet * way;
        there.variant.derivative_step = kOnsetDerivative;
        there.columns[0] = column(quiet, step);
        at_onset.push_back(std::move(there));
      } catch (const std::exception&) {
        // A probe that cannot be simulated explains nothing.
      }
    }
  };
  try_towards(probe.step < 0 ? p.lower : p.upper);
  const bool other_way = probe.step > 0 && p.starts.empty() && p.lower < p.nominal;
  if (at_onset.empty() && other_way) try_towards(p.lower);
  return at_onset;
}

/// Limits, contacts and dead zones have no response before they are reached, so they are probed from their
/// onset.
void ProbeFromOnset(const Screen& screen, std::vector<Probe>& probes, int threads) {
  const Evaluator& evaluator = screen.evaluator();
  std::vector<int> silent;
  for (int p = 0; p < static_cast<int>(probes.size()); ++p) {
    const Probe& probe = probes[p];
    if (probe.summed || probe.primary.size() != 1) continue;
    const double change = probe.step * ScaleOf(probe.variant.parameter(probe.primary[0]));
    if (IsSilent(evaluator, probe.columns[0], change)) silent.push_back(p);
  }
  for (int p = 0; p < static_cast<int>(probes.size()); ++p) {
    const auto its_place = [&](int other) {
      return probes[other].candidate.effect == probes[p].candidate.effect;
    };
    if (!probes[p].summed || probes[p].each >= 0) continue;
    if (std::none_of(silent.begin(), silent.end(), its_place)) continue;
    probes[p].summed = false;  // places with different onsets do not add up
    probes[p].columns[0] = EmptyColumn(evaluator);
    silent.push_back(p);
  }
  std::vector<std::vector<Probe>> at_onset(silent.size());
  ParallelFor(static_cast<int>(silent.size()), threads,
              [&](int i) { at_onset[i] = FromItsOnset(screen, probes[silent[i]]); });
  for (std::size_t i = 0; i < silent.size(); ++i) {
    if (at_onset[i].empty()) continue;
    probes[silent[i]] = std::move(at_onset[i].front());
    for (std::size_t v = 1; v < at_onset[i].size(); ++v) probes.push_back(std::move(at_onset[i][v]));
  }
}

/// An effect on all tendons is, to first order, the sum of the effects on each.
void SumPlaces(std::vector<Probe>& probes, std::size_t runs) {
  for (auto& probe : probes) {
    if (!probe.summed) continue;
    for (std::size_t k = 0; k < probe.primary.size(); ++k) probe.columns[k].resize(runs);
    if (probe.each >= 0) continue;
    for (const auto& other : probes) {
      if (other.summed || other.candidate.effect != probe.candidate.effect ||
          other.variant.values != probe.variant.values || other.step != probe.step)
        continue;
      for (std::size_t k = 0; k < probe.primary.size(); ++k) AddTo(probe.columns[k], other.columns[k]);
    }
  }
}

}  // namespace

Probe WithEach(Probe probe, const std::vector<Probe>& probes, const std::vector<double>& gains) {
  const int shared = static_cast<int>(probe.candidate.effect->parameters.size());
  const auto is_at = [&](const Probe& other, int place) {
    if (other.candidate.effect != probe.candidate.effect || other.candidate.target != place ||
        other.step != probe.step)
      return false;
    for (int k = 0; k < shared; ++k) {
      if (k != probe.each && other.variant.values[k] != probe.variant.values[k]) return false;
    }
    return true;
  };
  double& first = probe.variant.values[probe.each];
  for (int place = 0; place <= probe.variant.size() - shared; ++place) {
    const Probe* best = nullptr;
    double most = 0;
    for (std::size_t p = 0; p < probes.size(); ++p) {
      if (is_at(probes[p], place) && (best == nullptr || gains[p] > most)) best = &probes[p], most = gains[p];
    }
    if (best == nullptr) continue;
    const double own = best->variant.values[probe.each];
    if (place == 0) {
      first = own;
    } else {
      probe.variant.values[shared + place - 1] = own - first;
    }
    for (std::size_t k = 0; k < probe.columns.size(); ++k) {
      AddTo(probe.columns[k], best->columns[k]);
    }
  }
  return probe;
}

std::vector<Probe> MakeProbes(const Evaluator& evaluator,
                              const std::function<bool(const Candidate&)>& excluded, int threads,
                              const std::function<void(double)>& progress) {
  std::vector<Candidate> candidates =
      AllCandidates(evaluator.nominal(), evaluator.has_cells(), evaluator.has_tracker());
  std::erase_if(candidates, [&](const Candidate& candidate) {
    return (evaluator.zeros_from_rest() && candidate.effect->zero) || excluded(candidate);
  });
  std::vector<Probe> probes = Starts(evaluator, candidates);
  const Screen screen(evaluator, threads);
  Differentiate(screen, probes, threads, progress);
  ProbeFromOnset(screen, probes, threads);
  SumPlaces(probes, evaluator.runs().size());
  return probes;
}

}  // namespace tendril::gap
