// Screening, refits of the best, and a refit of everything.
#include "search.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <iterator>
#include <map>

#include "searching.h"
#include "tendril/core/parallel.h"

namespace tendril::gap {
namespace {

// Prior of nuisances, in plainly visible deviations: small changes are free, at most three of these.
constexpr double kNuisancePrior = 0.05;
constexpr int kPolish = 6, kPolished = 3;
// Share of a fit's gain that the linear step may lose on held-out folds; beyond it, this many of the best are
// refitted without each fold, with this many steps.
constexpr double kFoldLoss = 0.05;
constexpr int kHeldOutAgain = 2, kFoldIterations = 3;
constexpr int kPlacesOfOneEffect = 2;  // among the refitted candidates
constexpr int kAlike = 4;              // look-alikes of the best, refitted as well

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

/// Start of a refit: the screening's linear solution.
Model StartOf(const Screened& s) {
  Model start = s.start;
  for (std::size_t k = 0; k < s.primary.size(); ++k) {
    double& value = start.values[s.primary[k]];
    value = Inside(start.parameter(s.primary[k]), value + s.linear.value[static_cast<int>(k)]);
  }
  return start;
}

}  // namespace

double Inside(const sim::EffectParameter& p, double value) {
  return std::clamp(value, kFarStep * p.lower + (1 - kFarStep) * p.nominal,
                    kFarStep * p.upper + (1 - kFarStep) * p.nominal);
}

bool LookAlike(const sim::Effect& a, const sim::Effect& b) {
  const auto names = [](const sim::Effect& one, const sim::Effect& other) {
    return std::find(one.confusable.begin(), one.confusable.end(), other.name) != one.confusable.end();
  };
  return names(a, b) || names(b, a);
}

Searching::Searching(const Evaluator& evaluator, const Folds& folds, const SearchOptions& options,
                     const std::vector<Probe>& probes)
    : evaluator_(evaluator),
      folds_(folds),
      options_(options),
      nominal_(evaluator.AtNominal()),
      probes_(probes) {
  for (const Probe& probe : probes) {
    if (std::find(candidates_.begin(), candidates_.end(), probe.candidate) == candidates_.end())
      candidates_.push_back(probe.candidate);
  }
}

void Searching::FindNuisances() {
  result_.nuisances = options_.numbers;
  for (const Probe& probe : probes_) {
    const auto& c = probe.candidate;
    const bool frame = evaluator_.frame() && c.effect->frame;
    if ((!c.effect->nuisance && !frame) || c.target) continue;
    for (std::size_t k = 0; k < probe.primary.size(); ++k) {
      const sim::EffectParameter& parameter = c.parameters[probe.primary[k]];
      const double prior = !frame                             ? kNuisancePrior * ScaleOf(parameter)
                           : parameter.name.ends_with("_rad") ? TrackerFrame::kTurn_rad
                                                              : TrackerFrame::Shift_m(evaluator_.nominal());
      result_.nuisances.push_back({c.effect, std::make_shared<Column>(probe.columns[k]), prior, 0});
    }
  }
}

Weights Searching::WeightsNow() const {
  std::vector<const Column*> columns;
  Bounds bounds;
  result_.nuisances.AddTo(columns, bounds);
  Weights weights(evaluator_, leftover_);
  weights.Multiply(columns, folds_);
  return weights;
}

std::vector<Screened> Searching::Screen(const Weights& weights) const {
  std::vector<Screened> best(candidates_.size());
  std::vector<char> found(candidates_.size(), 0);
  std::vector<Screened> all(probes_.size());
  const auto screen = [&](const Probe& probe, Screened& s) {
    s.candidate = probe.candidate;
    s.start = probe.variant;
    s.primary = probe.primary;
    std::vector<const Column*> columns;
    Bounds bounds;
    for (const auto& column : probe.columns) columns.push_back(&column);
    for (const int k : s.primary) bounds.Add(s.start.parameter(k), s.start.values[k]);
    for (const Nuisance& nuisance : result_.nuisances) {
      if (nuisance.effect == s.candidate.effect) continue;
      columns.push_back(nuisance.column.get());
      bounds.AddNuisance(nuisance.prior, nuisance.center);
    }
    s.linear = SolveLinear(Accumulate(columns, nominal_, nominal_, weights, folds_), bounds,
                           static_cast<int>(s.primary.size()));
    s.gain = s.linear.held_out_score;
  };
  const int count = static_cast<int>(probes_.size());
  ParallelFor(count, options_.threads, [&](int p) {
    if (probes_[p].each < 0) screen(probes_[p], all[p]);
  });
  std::vector<double> gains;
  for (const Screened& s : all) gains.push_back(s.gain);
  ParallelFor(count, options_.threads, [&](int p) {
    if (probes_[p].each < 0) return;
    Probe whole = WithEach(probes_[p], probes_, gains);
    screen(whole, all[p]);
    all[p].columns = std::move(whole.columns);
  });
  for (std::size_t p = 0; p < probes_.size(); ++p) {
    const auto c =
        std::find(candidates_.begin(), candidates_.end(), probes_[p].candidate) - candidates_.begin();
    if (found[c] && all[p].gain <= best[c].gain) continue;
    found[c] = 1;
    best[c] = std::move(all[p]);
    if (probes_[p].each < 0) best[c].columns = probes_[p].columns;
  }
  std::stable_sort(best.begin(), best.end(),
                   [](const Screened& a, const Screened& b) { return a.gain > b.gain; });
  return best;
}

/// Held-out log score of the nominal model with its nuisances free.
double Searching::BaseScore(const Weights& weights) const {
  std::vector<const Column*> columns;
  Bounds bounds;
  result_.nuisances.AddTo(columns, bounds);
  if (columns.empty()) return LogScore(weights, nominal_, nominal_);
  const LinearFit fit = SolveLinear(Accumulate(columns, nominal_, nominal_, weights, folds_), bounds);
  return LogScore(weights, nominal_, nominal_) + fit.held_out_score;
}

void Searching::ScreenAll() {
  leftover_ = Eigen::VectorXd::Zero(static_cast<int>(evaluator_.channels().size()));
  for (int pass = 0; pass < 2; ++pass) {
    const Weights weights = WeightsNow();
    result_.screened = Screen(weights);
    result_.base_score = BaseScore(weights);
    if (pass == 1) break;
    // Residual of the best candidate, to first order: models are not distinguished by less than that.
    Eigen::VectorXd least;
    for (int k = 0; k < std::min<int>(3, static_cast<int>(result_.screened.size())); ++k) {
      std::vector<const Column*> columns;
      for (const auto& column : result_.screened[k].columns) columns.push_back(&column);
      const Eigen::VectorXd x = result_.screened[k].linear.value.head(static_cast<int>(columns.size()));
      const Eigen::VectorXd l = Leftover(evaluator_, Subtract(nominal_, columns, x));
      least = least.size() == 0 ? l : least.cwiseMin(l).eval();
    }
    if (least.size() > 0) leftover_ = least;
  }
}

bool Searching::Explained(const Fit& fit) const {
  return options_.explained && options_.explained(Completed(fit.held_out, nominal_));
}

std::vector<Fit> Searching::Refit(const std::vector<Model>& starts, const Weights& weights, int iterations,
                                  Span span, const std::vector<Fit>* unless) const {
  std::vector<Fit> fits(starts.size());
  std::vector<char> good(starts.size(), 0);
  std::atomic<int> done{0};
  ParallelFor(static_cast<int>(starts.size()), options_.threads, [&](int k) {
    const Nuisances beside = result_.nuisances.Beside(starts[k]);
    try {
      fits[k] = Fitter(evaluator_, folds_, weights, beside).Refit(starts[k], iterations);
      good[k] = 1;
    } catch (const std::exception&) {
      // A candidate that cannot be simulated explains nothing.
    }
    Progress(span.from + (span.to - span.from) * ++done / static_cast<double>(starts.size()));
  });
  std::vector<Fit> kept;
  for (std::size_t k = 0; k < fits.size(); ++k) {
    if (good[k]) {
      kept.push_back(std::move(fits[k]));
    } else if (unless != nullptr) {
      kept.push_back((*unless)[k]);
      kept.back().Rescore(weights, nominal_);
    }
  }
  std::stable_sort(kept.begin(), kept.end(), ByHeldOut);
  return kept;
}

std::vector<Fit> Searching::Polished(std::vector<Fit> fits, std::ptrdiff_t count, const Weights& weights,
                                     Span span) const {
  std::vector<Model> starts;
  for (auto fit = fits.begin(); fit != fits.begin() + count; ++fit) starts.push_back(fit->model);
  std::vector<Fit> polished = Refit(starts, weights, kPolish, span, &fits);
  for (auto fit = fits.begin() + count; fit != fits.end(); ++fit) {
    fit->Rescore(weights, nominal_);
    polished.push_back(std::move(*fit));
  }
  std::stable_sort(polished.begin(), polished.end(), ByHeldOut);
  return polished;
}

bool Searching::HoldOutAgain(std::vector<Fit>& fits, const Weights& weights, bool anyway) const {
  std::vector<Fit*> best;
  bool any = anyway;
  for (Fit& fit : fits) {
    const bool may_win = fit.score > fits.front().held_out_score || &fit == &fits.front();
    if (!may_win || std::ssize(best) >= kHeldOutAgain) continue;
    best.push_back(&fit);
    const double loss = fit.score - fit.held_out_score;
    any = any || loss > std::max(kPairGain, kFoldLoss * (fit.score - result_.base_score));
  }
  if (!any) return false;
  ParallelFor(static_cast<int>(best.size()), options_.threads, [&](int k) {
    const Nuisances beside = result_.nuisances.Beside(best[k]->model);
    try {
      Fitter(evaluator_, folds_, weights, beside).HoldOutByRefits(*best[k], kFoldIterations);
    } catch (const std::exception&) {
      // Without this fold it cannot be simulated: the linear step stays.
    }
  });
  std::stable_sort(fits.begin(), fits.end(), ByHeldOut);
  return true;
}

void Searching::RefitBest() {
  std::vector<int> chosen;
  std::map<const sim::Effect*, int> places;
  for (int k = 0;
       k < static_cast<int>(result_.screened.size()) && static_cast<int>(chosen.size()) < options_.refits;
       ++k) {
    if (result_.screened[k].gain <= 0 && chosen.size() >= 3) break;
    if (places[result_.screened[k].candidate.effect]++ >= kPlacesOfOneEffect) continue;
    chosen.push_back(k);
  }
  {
    const Weights weights = WeightsNow();
    std::vector<Model> starts;
    for (const int k : chosen) starts.push_back(StartOf(result_.screened[k]));
    result_.fits = Refit(starts, weights, kIterations, {0.1, 0.5});
  }
  if (result_.fits.empty()) return;
  {
    // A look-alike of the best may be behind others to first order and still be the cause.
    const Weights weights = WeightsNow();
    const sim::Effect& best = *result_.fits.front().model.parts.front().effect;
    std::vector<Model> starts;
    for (const Screened& s : result_.screened) {
      if (s.gain <= 0 || std::ssize(starts) >= kAlike) break;
      if (places[s.candidate.effect]++ == 0 && LookAlike(best, *s.candidate.effect))
        starts.push_back(StartOf(s));
    }
    for (Fit& fit : Refit(starts, weights, kIterations, {0.5, 0.6})) result_.fits.push_back(std::move(fit));
    std::stable_sort(result_.fits.begin(), result_.fits.end(), ByHeldOut);
  }
  // Again from the optimum, with the residual that the best really leaves.
  leftover_ = Leftover(evaluator_, result_.fits.front().residuals);
  const Weights weights = WeightsNow();
  // If a gap remains, a fit that has not converged may be the cause: large effects take more steps.
  const bool far = !Explained(result_.fits.front());
  const auto others = result_.fits.begin() + std::min<std::ptrdiff_t>(kPolished, std::ssize(result_.fits));
  const auto on = std::stable_partition(others, result_.fits.end(),
                                        [far](const Fit& fit) { return far && !fit.bound_hit; });
  const std::ptrdiff_t count = on - result_.fits.begin();
  result_.fits = Polished(std::move(result_.fits), count, weights, {0.6, 0.75});
  result_.screened = Screen(weights);
  result_.base_score = BaseScore(weights);
  singles_again_ = HoldOutAgain(result_.fits, weights, false);
}

/// All numbers of the nominal file together, to first order.
void Searching::RefitEverything() {
  const Weights weights = WeightsNow();
  std::vector<const Column*> columns;
  std::vector<double> prior;
  for (const auto& s : result_.screened) {
    const bool number = s.candidate.effect->edit != nullptr;
    const bool own = s.candidate.target.has_value() || !s.candidate.effect->on_one;
    if (!number || (!own && s.candidate.effect->scope == sim::Scope::kTendon)) continue;
    for (std::size_t k = 0; k < s.columns.size(); ++k) {
      columns.push_back(&s.columns[k]);
      prior.push_back(3 * ScaleOf(s.start.parameter(s.primary[k])));
      result_.everything_moved.emplace_back(s.candidate, 0.0);
    }
  }
  for (const Nuisance& nuisance : result_.nuisances) {
    if (nuisance.effect != nullptr && !evaluator_.frame()) continue;
    columns.push_back(nuisance.column.get());
    prior.push_back(nuisance.prior);
  }
  if (!columns.empty()) {
    const int n = static_cast<int>(columns.size());
    const Eigen::VectorXd sd = Eigen::Map<Eigen::VectorXd>(prior.data(), n);
    const Normal normal = Accumulate(columns, nominal_, nominal_, weights, folds_);
    Eigen::MatrixXd A = sd.array().square().inverse().matrix().asDiagonal();
    Eigen::VectorXd b = Eigen::VectorXd::Zero(n);
    for (std::size_t f = 0; f < normal.A.size(); ++f) A += normal.A[f], b += normal.b[f];
    const Eigen::VectorXd moved = A.ldlt().solve(b);
    // The nuisances among them are not numbers of the file.
    for (std::size_t k = 0; k < result_.everything_moved.size(); ++k) {
      const auto at = static_cast<Eigen::Index>(k);
      result_.everything_moved[k].second = 3 * moved[at] / sd[at];
    }
    std::vector<Eigen::VectorXd> x;
    for (std::size_t f = 0; f < normal.A.size(); ++f)
      x.push_back((A - normal.A[f]).ldlt().solve(b - normal.b[f]));
    result_.everything = nominal_;
    for (std::size_t i = 0; i < nominal_.size(); ++i) {
      for (std::size_t c = 0; c < nominal_[i].size(); ++c) {
        auto& r = result_.everything[i][c];
        const int windows = static_cast<int>(r.size());
        for (int k = 0; k < n; ++k) {
          if ((*columns[k])[i].empty() || (*columns[k])[i][c].size() == 0) continue;
          const auto& j = (*columns[k])[i][c];
          if (!folds_.by_time) {
            r -= x[folds_.of_run[i]][k] * j;
          } else {
            for (int w = 0; w < windows; ++w) r[w] -= x[folds_.Of(static_cast<int>(i), w, windows)][k] * j[w];
          }
        }
      }
    }
  }
}

SearchResult Searching::Result() {
  FindNuisances();
  ScreenAll();
  RefitBest();
  result_.leftover = leftover_;
  if (!result_.fits.empty() && options_.pairs) FindPairs();
  RefitEverything();
  return std::move(result_);
}

SearchResult Searching::ScreenedOnly() {
  FindNuisances();
  ScreenAll();
  result_.leftover = leftover_;
  return std::move(result_);
}

SearchResult Search(const Evaluator& evaluator, const Folds& folds, const SearchOptions& options,
                    const std::vector<Probe>& probes) {
  return Searching(evaluator, folds, options, probes).Result();
}

SearchResult ScreenOnly(const Evaluator& evaluator, const Folds& folds, const SearchOptions& options,
                        const std::vector<Probe>& probes) {
  return Searching(evaluator, folds, options, probes).ScreenedOnly();
}

bool ContainsCause(const SearchResult& search, const Model& cause) {
  const auto in = [&](const Fit& fit) {
    const auto& found = fit.model.parts;
    return std::all_of(cause.parts.begin(), cause.parts.end(), [&](const Candidate& part) {
      return std::find(found.begin(), found.end(), part) != found.end();
    });
  };
  if (search.fits.empty()) return false;
  const Fit& single = search.fits.front();
  return in(single) || (!search.pairs.empty() && in(search.pairs.front()) &&
                        search.pairs.front().held_out_score >= single.held_out_score + kPairGain);
}

std::vector<Model> LikelyCauses(const SearchResult& search) {
  constexpr std::size_t kMost = 4;
  std::vector<Model> causes;
  for (const Fit& fit : search.fits) {
    const bool tried = std::any_of(causes.begin(), causes.end(), [&](const Model& other) {
      return other.parts.front().effect == fit.model.parts.front().effect;
    });
    if (!tried && causes.size() < kMost) causes.push_back(fit.model);
  }
  return causes;
}

}  // namespace tendril::gap
