// Screening, refits, pairs.
#include "search.h"

#include <fmt/core.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <set>

#include "parallel.h"

namespace tendril::gap {
namespace {

constexpr double kScreeningStep = 0.5;  // of a parameter's typical deviation
constexpr double kFarStep = 0.95;       // of the way to the bound, where that changes nothing
// Where an effect begins to act is found to this share of the way, and it is tried in steps of these from
// there.
constexpr int kOnsetHalvings = 6;
constexpr double kOnsetDerivative = 0.0125;  // plainly visible deviations
constexpr double kOnsetSteps[] = {0.02, 0.1, 0.4};
constexpr double kNuisancePrior =
    0.05;  // the same: constants nobody knows move freely by little, and by no more than three of these
// The same of a tracker's frame that nobody knows, about the one fitted to the nominal robot.
constexpr double kFrameTurn_rad = 0.1, kFrameShift_m = 0.02;
constexpr int kIterations = 3, kPolish = 6, kPairIterations = 3;
constexpr int kPolished = 3;
// Share of what a fit brings that a straight line may lose on the folds held out; where it loses more, so
// many of the best are refitted without each fold, by so many steps.
constexpr double kFoldLoss = 0.05;
constexpr int kHeldOutAgain = 2, kFoldIterations = 3;
constexpr int kPlacesOfOneEffect = 2;  // of the candidates that are refitted
constexpr int kPairStarts = 4;
constexpr double kLeastStart = 0.1, kNearStart = 0.2,
                 kMostStart = 2;  // of a second, in plainly visible deviations
constexpr int kPolishedPairs = 3;
constexpr double kNoiseSlack = 1.2;  // the noise is known within some tens of per cent

/// Every combination of the shape parameters' starts.
std::vector<Model> Variants(const Candidate& candidate) {
  std::vector<Model> variants{Model::Of(candidate)};
  for (int k = 0; k < candidate.size(); ++k) {
    const auto& p = candidate.effect->parameters[k];
    if (!p.shape || p.starts.empty()) continue;
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

/// A change of the parameter by `change` moves no channel: what remains is rounding.
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

struct Bounds {
  Eigen::VectorXd prior, lower, upper;
};

Bounds BoundsOf(const Model& model, const std::vector<int>& which,
                const std::vector<const Column*>& nuisances, const Eigen::VectorXd& nuisance_prior) {
  const int n = static_cast<int>(which.size()), extra = static_cast<int>(nuisances.size());
  Bounds b{Eigen::VectorXd(n + extra), Eigen::VectorXd(n + extra), Eigen::VectorXd(n + extra)};
  for (int k = 0; k < n; ++k) {
    const auto& p = model.parameter(which[k]);
    b.prior[k] = 30 * ScaleOf(p);
    b.lower[k] = p.lower - model.values[which[k]];
    b.upper[k] = p.upper - model.values[which[k]];
  }
  for (int e = 0; e < extra; ++e) {
    b.prior[n + e] = nuisance_prior[e];
    b.lower[n + e] = -3 * nuisance_prior[e];
    b.upper[n + e] = 3 * nuisance_prior[e];
  }
  return b;
}

Residuals Subtract(const Residuals& from, const std::vector<const Column*>& columns,
                   const Eigen::VectorXd& values) {
  Residuals r = from;
  for (std::size_t k = 0; k < columns.size(); ++k) {
    for (std::size_t i = 0; i < r.size(); ++i) {
      if ((*columns[k])[i].empty()) continue;
      for (std::size_t c = 0; c < r[i].size(); ++c) {
        if ((*columns[k])[i][c].size() > 0) r[i][c] -= values[static_cast<int>(k)] * (*columns[k])[i][c];
      }
    }
  }
  return r;
}

Eigen::VectorXd Leftover(const Evaluator& evaluator, const Residuals& part) {
  const ChannelScore score = ScoreChannels(evaluator, part, evaluator.AtNominal());
  Eigen::VectorXd leftover(score.square.size());
  for (int c = 0; c < leftover.size(); ++c) leftover[c] = score.Excess(c, kNoiseSlack);
  return leftover;
}

}  // namespace

SearchResult Search(const Evaluator& evaluator, const Folds& folds, const SearchOptions& options) {
  SearchResult result;
  const Residuals& nominal = evaluator.AtNominal();
  const auto progress = [&](double fraction) {
    if (options.progress) options.progress(fraction);
  };

  // ---- sensitivities ----
  std::vector<Candidate> candidates;
  for (const auto& c : AllCandidates(evaluator.nominal(), evaluator.has(kC3), evaluator.has_tracker())) {
    if (std::find(options.without.begin(), options.without.end(), c.effect->name) == options.without.end())
      candidates.push_back(c);
  }
  struct Probe {
    int candidate;
    Model variant;
    std::vector<int> primary;
    std::vector<Column> columns;
    double step = kScreeningStep;  // of the primary's plainly visible deviation
    bool summed = false;           // from those of its places
  };
  std::vector<Probe> probes;
  for (int i = 0; i < static_cast<int>(candidates.size()); ++i) {
    const auto& c = candidates[i];
    std::vector<int> primary;
    for (int k = 0; k < c.size(); ++k) {
      if (!c.effect->parameters[k].shape) primary.push_back(k);
    }
    const bool summed = c.effect->on_all && c.effect->on_one && !c.target &&
                        c.effect->scope == sim::Scope::kTendon && evaluator.nominal().body.tendons() > 0;
    for (const auto& variant : Variants(c)) {
      probes.push_back({i, variant, primary, {}, kScreeningStep, summed});
      if (primary.size() != 1) continue;
      // What acts otherwise where it is weak, or far off, is tried there as well.
      const auto& p = c.effect->parameters[primary[0]];
      for (const double start : p.starts) {
        probes.push_back({i, variant, primary, {}, (start - p.nominal) / ScaleOf(p), summed});
        probes.back().variant.derivative_step = kOnsetDerivative;
      }
    }
  }
  std::vector<std::pair<int, int>> tasks;  // probe, index of its primary
  for (int p = 0; p < static_cast<int>(probes.size()); ++p) {
    probes[p].columns.resize(probes[p].primary.size());
    if (probes[p].summed) continue;
    for (int k = 0; k < static_cast<int>(probes[p].primary.size()); ++k) tasks.emplace_back(p, k);
  }
  const Column nothing(nominal.size(), std::vector<Eigen::VectorXd>(evaluator.channels().size()));
  std::atomic<int> done{0};
  ParallelFor(static_cast<int>(tasks.size()), options.threads, [&](int t) {
    Probe& probe = probes[tasks[t].first];
    const int k = probe.primary[tasks[t].second];
    const unsigned cuts = evaluator.CutsOf(*candidates[probe.candidate].effect);
    try {
      probe.columns[tasks[t].second] = Sensitivity(
          evaluator, probe.variant, k, probe.step * ScaleOf(probe.variant.parameter(k)), nominal, cuts);
    } catch (const std::exception&) {
      probe.columns[tasks[t].second] = nothing;
    }
    progress(0.6 * ++done / static_cast<double>(tasks.size()));
  });
  // A limit, a contact, a dead zone: nothing happens before it is reached. Probed from where something does.
  std::vector<int> silent;
  for (int p = 0; p < static_cast<int>(probes.size()); ++p) {
    const Probe& probe = probes[p];
    if (probe.summed || probe.primary.size() != 1) continue;
    const double change = probe.step * ScaleOf(probe.variant.parameter(probe.primary[0]));
    if (IsSilent(evaluator, probe.columns[0], change)) silent.push_back(p);
  }
  for (int p = 0; p < static_cast<int>(probes.size()); ++p) {
    const auto its_place = [&](int other) {
      return candidates[probes[other].candidate].effect == candidates[probes[p].candidate].effect;
    };
    if (!probes[p].summed || std::none_of(silent.begin(), silent.end(), its_place)) continue;
    probes[p].summed = false;  // places that begin to act at different values do not add up
    probes[p].columns[0] = nothing;
    silent.push_back(p);
  }
  std::vector<std::vector<Probe>> woken(silent.size());
  ParallelFor(static_cast<int>(silent.size()), options.threads, [&](int i) {
    const Probe& probe = probes[silent[i]];
    const int k = probe.primary[0];
    const auto& p = probe.variant.parameter(k);
    const unsigned cuts = evaluator.CutsOf(*candidates[probe.candidate].effect);
    const auto try_towards = [&](double bound) {
      const double way = kFarStep * (bound - probe.variant.values[k]);
      const auto column = [&](double from, double step) {
        Model at = probe.variant;
        at.values[k] += from * way;
        return Sensitivity(evaluator, at, k, step * way, nominal, cuts);
      };
      // What cannot be simulated is not silent.
      const auto is_silent = [&](double step) {
        try {
          return IsSilent(evaluator, column(0, step), step * way);
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
          woken[i].push_back(std::move(there));
        } catch (const std::exception&) {
          // What cannot be simulated explains nothing.
        }
      }
    };
    try_towards(probe.step < 0 ? p.lower : p.upper);
    const bool other_way = probe.step > 0 && p.starts.empty() && p.lower < p.nominal;
    if (woken[i].empty() && other_way) try_towards(p.lower);
  });
  for (std::size_t i = 0; i < silent.size(); ++i) {
    if (woken[i].empty()) continue;
    probes[silent[i]] = std::move(woken[i].front());
    for (std::size_t v = 1; v < woken[i].size(); ++v) probes.push_back(std::move(woken[i][v]));
  }
  // An effect on all tendons is, to first order, the sum of those on each.
  for (auto& probe : probes) {
    if (!probe.summed) continue;
    for (std::size_t k = 0; k < probe.primary.size(); ++k) probe.columns[k].resize(nominal.size());
    for (const auto& other : probes) {
      if (other.summed || candidates[other.candidate].effect != candidates[probe.candidate].effect ||
          other.variant.values != probe.variant.values || other.step != probe.step)
        continue;
      for (std::size_t k = 0; k < probe.primary.size(); ++k) AddTo(probe.columns[k], other.columns[k]);
    }
  }

  // ---- nuisances ----
  for (const auto& probe : probes) {
    const auto& c = candidates[probe.candidate];
    const bool turn = c.effect->name == "tracker_rotation", shift = c.effect->name == "tracker_offset";
    const bool frame = evaluator.frame() && (turn || shift);
    if ((!c.effect->nuisance && !frame) || c.target) continue;
    for (std::size_t k = 0; k < probe.primary.size(); ++k) {
      result.nuisances.candidates.push_back(c);
      result.nuisances.columns.push_back(probe.columns[k]);
      result.nuisances.prior.conservativeResize(static_cast<int>(result.nuisances.columns.size()));
      result.nuisances.prior[static_cast<int>(result.nuisances.columns.size()) - 1] =
          frame ? (turn ? kFrameTurn_rad : kFrameShift_m)
                : kNuisancePrior * ScaleOf(c.effect->parameters[probe.primary[k]]);
    }
  }
  const auto nuisances_beside = [&](const Candidate& c) {
    std::vector<int> which;
    for (int e = 0; e < static_cast<int>(result.nuisances.candidates.size()); ++e) {
      if (result.nuisances.candidates[e].effect != c.effect) which.push_back(e);
    }
    return which;
  };

  // ---- screening ----
  const auto screen = [&](const Weights& weights) {
    std::vector<Screened> best(candidates.size());
    std::vector<char> found(candidates.size(), 0);
    std::vector<Screened> all(probes.size());
    ParallelFor(static_cast<int>(probes.size()), options.threads, [&](int p) {
      const Probe& probe = probes[p];
      Screened& s = all[p];
      s.candidate = candidates[probe.candidate];
      s.start = probe.variant;
      s.primary = probe.primary;
      std::vector<const Column*> columns, extra;
      for (const auto& column : probe.columns) columns.push_back(&column);
      Eigen::VectorXd prior(0);
      for (const int e : nuisances_beside(s.candidate)) {
        extra.push_back(&result.nuisances.columns[e]);
        prior.conservativeResize(prior.size() + 1);
        prior[prior.size() - 1] = result.nuisances.prior[e];
      }
      const Bounds bounds = BoundsOf(s.start, s.primary, extra, prior);
      columns.insert(columns.end(), extra.begin(), extra.end());
      s.linear = SolveLinear(Accumulate(columns, nominal, nominal, weights, folds), bounds.prior,
                             bounds.lower, bounds.upper, static_cast<int>(s.primary.size()));
      s.gain = s.linear.held_out_score;
    });
    for (std::size_t p = 0; p < probes.size(); ++p) {
      const int c = probes[p].candidate;
      if (found[c] && all[p].gain <= best[c].gain) continue;
      found[c] = 1;
      best[c] = std::move(all[p]);
      best[c].columns = probes[p].columns;
    }
    std::stable_sort(best.begin(), best.end(),
                     [](const Screened& a, const Screened& b) { return a.gain > b.gain; });
    return best;
  };
  const auto base = [&](const Weights& weights) {
    std::vector<const Column*> columns;
    for (const auto& column : result.nuisances.columns) columns.push_back(&column);
    if (columns.empty()) return LogScore(weights, nominal, nominal);
    const Bounds bounds = BoundsOf(Model{}, {}, columns, result.nuisances.prior);
    const LinearFit fit = SolveLinear(Accumulate(columns, nominal, nominal, weights, folds), bounds.prior,
                                      bounds.lower, bounds.upper);
    return LogScore(weights, nominal, nominal) + fit.held_out_score;
  };

  Eigen::VectorXd leftover = Eigen::VectorXd::Zero(static_cast<int>(evaluator.channels().size()));
  for (int pass = 0; pass < 2; ++pass) {
    const Weights weights(evaluator, leftover);
    result.screened = screen(weights);
    result.base_score = base(weights);
    if (pass == 1) break;
    // What the best candidate would leave, to first order: nothing else is worth distinguishing by less than
    // that.
    Eigen::VectorXd least;
    for (int k = 0; k < std::min<int>(3, static_cast<int>(result.screened.size())); ++k) {
      std::vector<const Column*> columns;
      for (const auto& column : result.screened[k].columns) columns.push_back(&column);
      const Eigen::VectorXd x = result.screened[k].linear.value.head(static_cast<int>(columns.size()));
      const Eigen::VectorXd l = Leftover(evaluator, Subtract(nominal, columns, x));
      least = least.size() == 0 ? l : least.cwiseMin(l).eval();
    }
    if (least.size() > 0) leftover = least;
  }
  progress(0.65);

  // ---- full refits of the best ----
  std::vector<int> chosen;
  std::map<const sim::Effect*, int> places;
  for (int k = 0;
       k < static_cast<int>(result.screened.size()) && static_cast<int>(chosen.size()) < options.refits;
       ++k) {
    if (result.screened[k].gain <= 0 && chosen.size() >= 3) break;
    if (places[result.screened[k].candidate.effect]++ >= kPlacesOfOneEffect) continue;
    chosen.push_back(k);
  }
  const auto start_of = [&](const Screened& s) {
    Model start = s.start;
    for (std::size_t k = 0; k < s.primary.size(); ++k) {
      const auto& p = start.parameter(s.primary[k]);
      const double wanted = start.values[s.primary[k]] + s.linear.value[static_cast<int>(k)];
      start.values[s.primary[k]] = std::clamp(wanted, kFarStep * p.lower + (1 - kFarStep) * p.nominal,
                                              kFarStep * p.upper + (1 - kFarStep) * p.nominal);
    }
    return start;
  };
  const auto by_held_out = [](const Fit& a, const Fit& b) { return a.held_out_score > b.held_out_score; };
  const auto rescored = [&](Fit fit, const Weights& weights) {
    fit.score = LogScore(weights, fit.residuals, nominal);
    fit.held_out_score = HeldOutScore(weights, fit, nominal);
    return fit;
  };
  // Of starts that cannot be simulated, what `unless` has of them stays.
  const auto refit = [&](const std::vector<Model>& starts, const Weights& weights, int iterations,
                         double from, double to, const std::vector<Fit>* unless = nullptr) {
    std::vector<Fit> fits(starts.size());
    std::vector<char> good(starts.size(), 0);
    done = 0;
    ParallelFor(static_cast<int>(starts.size()), options.threads, [&](int k) {
      const Nuisances beside = result.nuisances.Beside(starts[k]);
      try {
        fits[k] = Fitter(evaluator, folds, weights, beside).Refit(starts[k], iterations);
        good[k] = 1;
      } catch (const std::exception&) {
        // A candidate that cannot be simulated explains nothing.
      }
      progress(from + (to - from) * ++done / static_cast<double>(starts.size()));
    });
    std::vector<Fit> kept;
    for (std::size_t k = 0; k < fits.size(); ++k) {
      if (good[k]) {
        kept.push_back(std::move(fits[k]));
      } else if (unless != nullptr) {
        kept.push_back(rescored((*unless)[k], weights));
      }
    }
    std::stable_sort(kept.begin(), kept.end(), by_held_out);
    return kept;
  };
  // The best are held out by refits where a straight line loses much for one of them, or `anyway`: what is
  // compared has to be held out alike. True when it was done.
  const auto hold_out_again = [&](std::vector<Fit>& fits, const Weights& weights, bool anyway) {
    std::vector<Fit*> best;
    bool any = anyway;
    for (Fit& fit : fits) {
      const bool may_win = fit.score > fits.front().held_out_score || &fit == &fits.front();
      if (!may_win || std::ssize(best) >= kHeldOutAgain) continue;
      best.push_back(&fit);
      const double loss = fit.score - fit.held_out_score;
      any = any || loss > std::max(kPairGain, kFoldLoss * (fit.score - result.base_score));
    }
    if (!any) return false;
    ParallelFor(static_cast<int>(best.size()), options.threads, [&](int k) {
      const Nuisances beside = result.nuisances.Beside(best[k]->model);
      try {
        Fitter(evaluator, folds, weights, beside).HoldOutByRefits(*best[k], kFoldIterations);
      } catch (const std::exception&) {
        // Without a fold it cannot be simulated: the straight line stays.
      }
    });
    std::stable_sort(fits.begin(), fits.end(), by_held_out);
    return true;
  };
  {
    const Weights weights(evaluator, leftover);
    std::vector<Model> starts;
    for (const int k : chosen) starts.push_back(start_of(result.screened[k]));
    result.fits = refit(starts, weights, kIterations, 0.65, 0.82);
  }
  const auto explained = [&](const Fit& fit) {
    return options.explained && options.explained(Completed(fit.held_out, nominal));
  };
  bool singles_again = false;  // held out by refits
  // With what the best really leaves, once more from there.
  if (!result.fits.empty()) {
    leftover = Leftover(evaluator, result.fits.front().residuals);
    const Weights weights(evaluator, leftover);
    // Where that is a gap, what is still on its way may be the cause: a large one takes more steps.
    const bool far = !explained(result.fits.front());
    const auto others = result.fits.begin() + std::min<std::ptrdiff_t>(kPolished, std::ssize(result.fits));
    const auto on = std::stable_partition(others, result.fits.end(),
                                          [far](const Fit& fit) { return far && !fit.bound_hit; });
    std::vector<Model> starts;
    for (auto fit = result.fits.begin(); fit != on; ++fit) starts.push_back(fit->model);
    std::vector<Fit> polished = refit(starts, weights, kPolish, 0.82, 0.9, &result.fits);
    for (std::size_t k = starts.size(); k < result.fits.size(); ++k)
      polished.push_back(rescored(std::move(result.fits[k]), weights));
    result.fits = std::move(polished);
    std::stable_sort(result.fits.begin(), result.fits.end(), by_held_out);
    result.screened = screen(weights);
    result.base_score = base(weights);
    singles_again = hold_out_again(result.fits, weights, false);
  }
  result.leftover = leftover;

  // ---- pairs: add a second, then try others in the place of the first ----
  if (!result.fits.empty()) {
    const Weights weights(evaluator, leftover);
    const auto sort_pairs = [&] { std::stable_sort(result.pairs.begin(), result.pairs.end(), by_held_out); };
    const auto at_model = [&](const Model& model) {
      unsigned cuts = 0;
      for (const Candidate& part : model.parts) cuts |= evaluator.CutsOf(*part.effect);
      return Completed(evaluator.At(model.Robot(evaluator.nominal()), cuts), nominal);
    };
    // Less what the first fit's nuisances and last step took out of it.
    const auto score_at = [&](const Model& model, const Residuals& taken_out) {
      try {
        Residuals r = at_model(model);
        for (std::size_t i = 0; i < r.size(); ++i) {
          for (std::size_t c = 0; c < r[i].size(); ++c) r[i][c] -= taken_out[i][c];
        }
        return LogScore(weights, r, nominal);
      } catch (const std::exception&) {
        return -std::numeric_limits<double>::infinity();
      }
    };
    const auto partners = [&](const Fit& first, int count, double least) {
      std::vector<std::pair<double, int>> gains(result.screened.size());
      std::vector<Eigen::VectorXd> together(result.screened.size());  // to first order: its own, the first's
      ParallelFor(static_cast<int>(result.screened.size()), options.threads, [&](int k) {
        const Screened& s = result.screened[k];
        gains[k] = {-1e300, k};
        if (s.candidate.effect == first.model.parts[0].effect &&
            (!s.candidate.target || !first.model.parts[0].target ||
             s.candidate.target == first.model.parts[0].target))
          return;
        std::vector<const Column*> columns;
        for (const auto& column : s.columns) columns.push_back(&column);
        const int own = static_cast<int>(columns.size());
        for (const auto& column : first.columns) columns.push_back(&column);
        Bounds b = BoundsOf(s.start, s.primary, {}, Eigen::VectorXd(0));
        const int n = static_cast<int>(columns.size());
        b.prior.conservativeResize(n);
        b.lower.conservativeResize(n);
        b.upper.conservativeResize(n);
        for (int i = own; i < n; ++i) {
          const auto& p = first.model.parameter(i - own);
          b.prior[i] = 30 * ScaleOf(p);
          b.lower[i] = p.lower - first.model.values[i - own];
          b.upper[i] = p.upper - first.model.values[i - own];
        }
        const LinearFit fit = SolveLinear(Accumulate(columns, first.residuals, nominal, weights, folds),
                                          b.prior, b.lower, b.upper, own);
        gains[k].first = fit.held_out_score;
        together[static_cast<std::size_t>(k)] = fit.value;
        result.screened[k].linear.by_fold = fit.by_fold;
      });
      std::stable_sort(gains.begin(), gains.end(),
                       [](const auto& a, const auto& b) { return a.first > b.first; });
      std::vector<Model> starts;
      Residuals taken_out;
      try {
        taken_out = at_model(first.model);
      } catch (const std::exception&) {
        return starts;
      }
      const Residuals left_by_first = Completed(first.residuals, nominal);
      for (std::size_t i = 0; i < taken_out.size(); ++i) {
        for (std::size_t c = 0; c < taken_out[i].size(); ++c) taken_out[i][c] -= left_by_first[i][c];
      }
      std::map<const sim::Effect*, int> seen;
      for (const auto& [gain, k] : gains) {
        if (static_cast<int>(starts.size()) >= count || gain < least) break;
        const Screened& s = result.screened[k];
        if (seen[s.candidate.effect]++ >= 1) continue;
        Model both = first.model.With(s.candidate);
        both.derivative_step = std::min(both.derivative_step, s.start.derivative_step);
        const int offset = first.model.size();
        for (int i = 0; i < s.candidate.size(); ++i) both.values[offset + i] = s.start.values[i];
        const Eigen::VectorXd& step = together[static_cast<std::size_t>(k)];
        const auto inside = [](const sim::EffectParameter& p, double value) {
          return std::clamp(value, kFarStep * p.lower + (1 - kFarStep) * p.nominal,
                            kFarStep * p.upper + (1 - kFarStep) * p.nominal);
        };
        const int own = static_cast<int>(s.primary.size());
        Model near = both;  // what a line laid far from here says may be far off: a little of the second then
        for (int i = 0; i < own; ++i) {
          const int at = offset + s.primary[i];
          const auto& p = s.start.parameter(s.primary[i]);
          // Not where the effect is gone: there its shape means nothing.
          const double size =
              std::clamp(std::abs(step[i]), kLeastStart * ScaleOf(p), kMostStart * ScaleOf(p));
          both.values[at] = inside(p, s.start.values[s.primary[i]] + std::copysign(size, step[i]));
          near.values[at] = inside(p, s.start.values[s.primary[i]] + kNearStart * ScaleOf(p));
        }
        for (int i = 0; i < offset; ++i)
          both.values[i] = inside(first.model.parameter(i), first.model.values[i] + step[own + i]);
        if (score_at(near, taken_out) > score_at(both, taken_out)) both = std::move(near);
        starts.push_back(both);
      }
      return starts;
    };
    // Where nothing is left at any one place, what is spread thinly over many of them still has a score.
    const bool left = !explained(result.fits.front());
    std::vector<Model> starts = partners(result.fits[0], kPairStarts, left ? 1 : kPairGain);
    if (result.fits.size() > 1 && (left || !starts.empty())) {
      for (const auto& other : partners(result.fits[1], 2, 1)) starts.push_back(other);
    }
    result.pairs = refit(starts, weights, kPairIterations, 0.9, 0.95);
    if (!result.pairs.empty()) {
      // The second may be the real first: keep it and look for another partner.
      const Model& best = result.pairs[0].model;
      Model second;
      second.parts = {best.parts[1]};
      second.derivative_step = best.derivative_step;
      second.values = best.values.tail(best.parts[1].size());
      const std::vector<Fit> alone = refit({second}, weights, kIterations, 0.95, 0.97);
      if (!alone.empty()) {
        std::vector<Fit> swapped = refit(partners(alone[0], 3, 1), weights, kPairIterations, 0.97, 0.98);
        for (auto& fit : swapped) result.pairs.push_back(std::move(fit));
      }
      sort_pairs();
      // Beside each partner one place of an effect was tried, by a score of first order that places share:
      // the best two once more, each of them everywhere if it was at one place and at one if everywhere, and
      // at the units beside its own.
      std::vector<Model> elsewhere;
      const auto try_at = [&](int part, const auto& moves) {
        const Model& both = result.pairs[0].model;
        const auto other = std::find_if(result.screened.begin(), result.screened.end(), [&](const auto& s) {
          return s.candidate.effect == both.parts[part].effect && moves(s.candidate.target);
        });
        if (other == result.screened.end()) return;
        Model moved = both;
        moved.parts[part] = other->candidate;
        const bool known = std::any_of(result.pairs.begin(), result.pairs.end(), [&](const Fit& fit) {
          return std::is_permutation(moved.parts.begin(), moved.parts.end(), fit.model.parts.begin());
        });
        if (!known) elsewhere.push_back(moved);
      };
      for (int part = 0; part < 2; ++part) {
        const Candidate& here = result.pairs[0].model.parts[part];
        try_at(part, [&](sim::Target target) { return target.has_value() != here.target.has_value(); });
        if (!here.target || here.effect->scope != sim::Scope::kUnit) continue;
        for (const int beside : {*here.target - 1, *here.target + 1})
          try_at(part, [&](sim::Target target) { return target == beside; });
      }
      for (Fit& fit : refit(elsewhere, weights, kPairIterations, 0.98, 1.0))
        result.pairs.push_back(std::move(fit));
      sort_pairs();
      // The same two, found from either.
      const auto same = [](const Fit& a, const Fit& b) {
        return a.model.parts[0] == b.model.parts[1] && a.model.parts[1] == b.model.parts[0];
      };
      std::vector<Fit> distinct;
      for (Fit& fit : result.pairs) {
        const bool known =
            std::any_of(distinct.begin(), distinct.end(), [&](const Fit& other) { return same(other, fit); });
        if (!known) distinct.push_back(std::move(fit));
      }
      result.pairs = std::move(distinct);
      // What is still on its way takes more steps, where a gap is left.
      if (left) {
        std::vector<Model> on;
        const auto count = std::min<std::ptrdiff_t>(kPolishedPairs, std::ssize(result.pairs));
        for (std::ptrdiff_t k = 0; k < count; ++k)
          on.push_back(result.pairs[static_cast<std::size_t>(k)].model);
        std::vector<Fit> polished = refit(on, weights, kPolish, 1.0, 1.0, &result.pairs);
        polished.insert(polished.end(), std::make_move_iterator(result.pairs.begin() + count),
                        std::make_move_iterator(result.pairs.end()));
        result.pairs = std::move(polished);
        sort_pairs();
      }
      const bool pairs_again = hold_out_again(result.pairs, weights, singles_again);
      if (pairs_again && !singles_again) hold_out_again(result.fits, weights, true);
      // Each of the best two by itself.
      std::vector<Model> missing;
      for (const Candidate& part : result.pairs[0].model.parts) {
        const auto known = std::find_if(result.fits.begin(), result.fits.end(),
                                        [&](const Fit& fit) { return fit.model.parts.front() == part; });
        if (known != result.fits.end()) {
          result.members.push_back(*known);
          continue;
        }
        Model one = Model::Of(part);
        const Model& both = result.pairs[0].model;
        one.derivative_step = both.derivative_step;
        const int at = both.offset(part == both.parts[0] ? 0 : 1);
        one.values = both.values.segment(at, one.size());
        missing.push_back(one);
      }
      for (Fit& fit : refit(missing, weights, kIterations, 1.0, 1.0))
        result.members.push_back(std::move(fit));
    }
  }

  // ---- all numbers of the nominal file at once, to first order ----
  {
    const Weights weights(evaluator, leftover);
    std::vector<const Column*> columns;
    std::vector<double> prior;
    for (const auto& s : result.screened) {
      const bool number = s.candidate.effect->edit != nullptr;
      const bool own = s.candidate.target.has_value() || !s.candidate.effect->on_one;
      if (!number || (!own && s.candidate.effect->scope == sim::Scope::kTendon)) continue;
      for (std::size_t k = 0; k < s.columns.size(); ++k) {
        columns.push_back(&s.columns[k]);
        prior.push_back(3 * ScaleOf(s.start.parameter(s.primary[k])));
        result.everything_moved.emplace_back(s.candidate, 0.0);
      }
    }
    for (std::size_t e = 0; evaluator.frame() && e < result.nuisances.columns.size(); ++e) {
      columns.push_back(&result.nuisances.columns[e]);
      prior.push_back(result.nuisances.prior[static_cast<int>(e)]);
    }
    if (!columns.empty()) {
      const int n = static_cast<int>(columns.size());
      const Eigen::VectorXd sd = Eigen::Map<Eigen::VectorXd>(prior.data(), n);
      const Normal normal = Accumulate(columns, nominal, nominal, weights, folds);
      Eigen::MatrixXd A = sd.array().square().inverse().matrix().asDiagonal();
      Eigen::VectorXd b = Eigen::VectorXd::Zero(n);
      for (std::size_t f = 0; f < normal.A.size(); ++f) A += normal.A[f], b += normal.b[f];
      const Eigen::VectorXd moved = A.ldlt().solve(b);
      for (int k = 0; k < n; ++k)
        result.everything_moved[static_cast<std::size_t>(k)].second = 3 * moved[k] / sd[k];
      std::vector<Eigen::VectorXd> x;
      for (std::size_t f = 0; f < normal.A.size(); ++f)
        x.push_back((A - normal.A[f]).ldlt().solve(b - normal.b[f]));
      result.everything = nominal;
      for (std::size_t i = 0; i < nominal.size(); ++i) {
        for (std::size_t c = 0; c < nominal[i].size(); ++c) {
          auto& r = result.everything[i][c];
          const int windows = static_cast<int>(r.size());
          for (int k = 0; k < n; ++k) {
            if ((*columns[k])[i].empty() || (*columns[k])[i][c].size() == 0) continue;
            const auto& j = (*columns[k])[i][c];
            if (!folds.by_time) {
              r -= x[folds.of_run[i]][k] * j;
            } else {
              for (int w = 0; w < windows; ++w)
                r[w] -= x[folds.Of(static_cast<int>(i), w, windows)][k] * j[w];
            }
          }
        }
      }
    }
  }
  return result;
}

}  // namespace tendril::gap
