// Pairs of causes: what adds most to the best, what may replace it, and where.
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>

#include "searching.h"
#include "tendril/core/parallel.h"

namespace tendril::gap {
namespace {

constexpr int kPartners = 4, kPartnersOfNext = 2, kPartnersOfSecond = 3;
constexpr int kPolishedPairs = 3;
constexpr std::size_t kOtherSingles =
    2;                            // other singles, tried together with the best at their fitted values
constexpr int kAlikeMembers = 3;  // look-alikes of a member, tried in its place
constexpr double kFurther = 0.5;  // log score by which another start of the same cause has to be better
// Start of a second cause, in plainly visible deviations: near no effect, or at the joint linear solution,
// within these limits.
constexpr double kNearStart = 0.2, kLeastStart = 0.1, kMostStart = 2;

/// Subtracts `part` from `from`, channel by channel.
void SubtractPart(const Residuals& part, Residuals& from) {
  for (std::size_t i = 0; i < from.size(); ++i) {
    for (std::size_t c = 0; c < from[i].size(); ++c) from[i][c] -= part[i][c];
  }
}

void Append(std::vector<Fit> more, std::vector<Fit>& fits) {
  fits.insert(fits.end(), std::make_move_iterator(more.begin()), std::make_move_iterator(more.end()));
  std::stable_sort(fits.begin(), fits.end(), ByHeldOut);
}

}  // namespace

Residuals Searching::AtModel(const Model& model) const {
  const unsigned cuts = CutsOf(evaluator_, model);
  return Completed(evaluator_.At(model.Robot(evaluator_.nominal()), cuts), nominal_);
}

/// Gain of each candidate in addition to `first`, to first order, with the first's parameters free where it
/// has columns; by falling gain. A loss of the first on held-out data occurs with or without a second cause.
std::vector<Searching::SecondCause> Searching::SecondCauses(const Fit& first, const Weights& weights) const {
  const auto line_with = [&](const Screened* second) {
    std::vector<const Column*> columns;
    Bounds bounds;
    if (second != nullptr) {
      for (const auto& column : second->columns) columns.push_back(&column);
      for (const int k : second->primary) bounds.Add(second->start.parameter(k), second->start.values[k]);
    }
    const int own = static_cast<int>(columns.size());
    for (std::size_t k = 0; k < first.columns.size(); ++k) {
      columns.push_back(&first.columns[k]);
      bounds.Add(first.model.parameter(static_cast<int>(k)), first.model.values[static_cast<int>(k)]);
    }
    return SolveLinear(Accumulate(columns, first.residuals, nominal_, weights, folds_), bounds, own);
  };
  const double alone = first.columns.empty() ? 0 : line_with(nullptr).held_out_score;
  std::vector<SecondCause> ranked(result_.screened.size());
  ParallelFor(static_cast<int>(result_.screened.size()), options_.threads, [&](int k) {
    const Screened& s = result_.screened[k];
    ranked[k].candidate = k;
    if (s.candidate.effect == first.model.parts[0].effect &&
        (!s.candidate.target || !first.model.parts[0].target ||
         s.candidate.target == first.model.parts[0].target))
      return;
    const LinearFit fit = line_with(&s);
    ranked[k].gain = fit.held_out_score - alone;
    ranked[k].step = fit.value;
  });
  std::stable_sort(ranked.begin(), ranked.end(),
                   [](const SecondCause& a, const SecondCause& b) { return a.gain > b.gain; });
  return ranked;
}

/// Starts of pairs of `first` with each of the `count` most promising candidates, at least `least`; with
/// `like`, only with look-alikes of it.
std::vector<Model> Searching::PairStarts(const Fit& first, const Weights& weights, int count, double least,
                                         const sim::Effect* like) const {
  const std::vector<SecondCause> ranked = SecondCauses(first, weights);
  std::vector<Model> starts;
  Residuals taken_out;
  try {
    taken_out = AtModel(first.model);
  } catch (const std::exception&) {
    return starts;
  }
  SubtractPart(Completed(first.residuals, nominal_), taken_out);
  const auto score_at = [&](const Model& model) {
    try {
      Residuals r = AtModel(model);
      SubtractPart(taken_out, r);
      return LogScore(weights, r, nominal_);
    } catch (const std::exception&) {
      return -std::numeric_limits<double>::infinity();
    }
  };
  std::map<const sim::Effect*, int> seen;
  for (const SecondCause& second : ranked) {
    if (static_cast<int>(starts.size()) >= count || second.gain < least) break;
    const Screened& s = result_.screened[second.candidate];
    if (like != nullptr && !LookAlike(*like, *s.candidate.effect)) continue;
    if (seen[s.candidate.effect]++ >= 1) continue;
    Model both = first.model.With(s.candidate);
    both.derivative_step = std::min(both.derivative_step, s.start.derivative_step);
    const int offset = first.model.size();
    for (int i = 0; i < s.candidate.size(); ++i) both.values[offset + i] = s.start.values[i];
    const Eigen::VectorXd& step = second.step;
    const int own = static_cast<int>(s.primary.size());
    Model near = both;  // a linear prediction far away may be wrong, so a small second cause is tried too
    for (int i = 0; i < own; ++i) {
      const int at = offset + s.primary[i];
      const auto& p = s.start.parameter(s.primary[i]);
      // Unless the effect is absent, where its shape has no meaning.
      const double size = std::clamp(std::abs(step[i]), kLeastStart * ScaleOf(p), kMostStart * ScaleOf(p));
      both.values[at] = Inside(p, s.start.values[s.primary[i]] + std::copysign(size, step[i]));
      near.values[at] = Inside(p, s.start.values[s.primary[i]] + kNearStart * ScaleOf(p));
    }
    for (int i = 0; i < static_cast<int>(first.columns.size()); ++i)
      both.values[i] = Inside(first.model.parameter(i), first.model.values[i] + step[own + i]);
    if (score_at(near) > score_at(both)) both = std::move(near);
    starts.push_back(both);
  }
  return starts;
}

/// The best single with the `count` others that leave least in addition, each at its own fit: strongly
/// nonlinear effects, such as a wall, get further alone than by a linear prediction.
std::vector<Model> Searching::PairsOfSingles(const Weights& weights, std::size_t count) const {
  const Fit& first = result_.fits[0];
  std::vector<std::pair<double, Model>> tried;
  for (const Fit& other : result_.fits) {
    const Candidate &a = first.model.parts[0], &b = other.model.parts[0];
    if (a.effect == b.effect || LookAlike(*a.effect, *b.effect)) continue;
    if (other.score - result_.base_score < kPairGain) continue;
    Model both = first.model.With(b);
    both.values.tail(other.model.size()) = other.model.values;
    both.derivative_step = std::min(both.derivative_step, other.model.derivative_step);
    try {
      const double score = LogScore(weights, AtModel(both), nominal_);
      if (score > LogScore(weights, first.residuals, nominal_) + kFurther)
        tried.emplace_back(score, std::move(both));
    } catch (const std::exception&) {
      // The two together cannot be simulated.
    }
  }
  std::stable_sort(tried.begin(), tried.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<Model> best;
  for (std::size_t k = 0; k < std::min(count, tried.size()); ++k) best.push_back(std::move(tried[k].second));
  return best;
}

bool Searching::Tried(const Model& both) const {
  return std::any_of(result_.pairs.begin(), result_.pairs.end(), [&](const Fit& fit) {
    return std::is_permutation(both.parts.begin(), both.parts.end(), fit.model.parts.begin());
  });
}

/// Each partner was tried at one place, chosen by a first-order score that places share. The best two are
/// tried again at other places: everywhere if at one place, at one place if everywhere, and at neighbouring
/// units.
std::vector<Model> Searching::AtOtherPlaces() const {
  std::vector<Model> elsewhere;
  const auto try_at = [&](int part, const auto& moves) {
    const Model& both = result_.pairs[0].model;
    const auto other = std::find_if(result_.screened.begin(), result_.screened.end(), [&](const auto& s) {
      return s.candidate.effect == both.parts[part].effect && moves(s.candidate.target);
    });
    if (other == result_.screened.end()) return;
    Model moved = both;
    moved.parts[part] = other->candidate;
    if (!Tried(moved)) elsewhere.push_back(moved);
  };
  for (int part = 0; part < 2; ++part) {
    const Candidate& here = result_.pairs[0].model.parts[part];
    try_at(part, [&](sim::Target target) { return target.has_value() != here.target.has_value(); });
    if (!here.target || here.effect->scope != sim::Scope::kUnit) continue;
    for (const int beside : {*here.target - 1, *here.target + 1})
      try_at(part, [&](sim::Target target) { return target == beside; });
  }
  return elsewhere;
}

/// The best two with look-alikes of either in its place, starting at the other's fit: to first order they may
/// promise less than others and still be the cause.
std::vector<Model> Searching::LookAlikePairs(const Weights& weights) const {
  const Fit& both = result_.pairs[0];
  std::vector<Model> alike;
  try {
    Residuals taken_out = AtModel(both.model);
    SubtractPart(Completed(both.residuals, nominal_), taken_out);
    for (int part = 0; part < 2; ++part) {
      Fit beside;
      beside.model = both.model.Alone(1 - part);
      beside.residuals = AtModel(beside.model);
      SubtractPart(taken_out, beside.residuals);
      for (Model& start : PairStarts(beside, weights, kAlikeMembers, 1, both.model.parts[part].effect)) {
        if (!Tried(start)) alike.push_back(std::move(start));
      }
    }
  } catch (const std::exception&) {
    // A member that cannot be simulated alone cannot be replaced.
  }
  return alike;
}

/// The same two causes count once, whatever their order and start.
void Searching::KeepDistinct() {
  const auto same = [](const Fit& a, const Fit& b) {
    return std::is_permutation(a.model.parts.begin(), a.model.parts.end(), b.model.parts.begin());
  };
  std::vector<Fit> distinct;
  for (Fit& fit : result_.pairs) {
    const bool known =
        std::any_of(distinct.begin(), distinct.end(), [&](const Fit& other) { return same(other, fit); });
    if (!known) distinct.push_back(std::move(fit));
  }
  result_.pairs = std::move(distinct);
}

/// Each of the best two alone, starting at its fit in the pair: it may be better than its single fit, and a
/// pair has to beat the best single.
void Searching::AddMembers(const Weights& weights, bool held_out_again) {
  const Model& both = result_.pairs[0].model;
  bool further = false;
  for (Fit& fit : Refit({both.Alone(0), both.Alone(1)}, weights, kIterations, {0.98, 1})) {
    const auto known = std::find_if(result_.fits.begin(), result_.fits.end(), [&](const Fit& other) {
      return other.model.parts.front() == fit.model.parts.front();
    });
    if (known != result_.fits.end() && fit.score > known->score + kFurther) {
      *known = fit;
      further = true;
    }
    result_.members.push_back(known != result_.fits.end() ? *known : std::move(fit));
  }
  if (!further) return;
  std::stable_sort(result_.fits.begin(), result_.fits.end(), ByHeldOut);
  HoldOutAgain(result_.fits, weights, held_out_again);
}

void Searching::FindPairs() {
  const Weights weights = WeightsNow();
  // Where no single place has an excess, a small one spread over many places still has a score.
  const bool left = !Explained(result_.fits.front());
  std::vector<Model> starts = PairStarts(result_.fits[0], weights, kPartners, left ? 1 : kPairGain);
  if (result_.fits.size() > 1 && (left || !starts.empty())) {
    for (const auto& other : PairStarts(result_.fits[1], weights, kPartnersOfNext, 1))
      starts.push_back(other);
  }
  if (left) {
    for (Model& both : PairsOfSingles(weights, kOtherSingles)) starts.push_back(std::move(both));
  }
  result_.pairs = Refit(starts, weights, kIterations, {0.75, 0.81});
  if (result_.pairs.empty()) return;
  // The second may be the true first: keep it and look for another partner.
  const std::vector<Fit> second =
      Refit({result_.pairs[0].model.Alone(1)}, weights, kIterations, {0.81, 0.83});
  if (!second.empty()) {
    const std::vector<Model> swapped = PairStarts(second[0], weights, kPartnersOfSecond, 1);
    Append(Refit(swapped, weights, kIterations, {0.83, 0.87}), result_.pairs);
  }
  Append(Refit(AtOtherPlaces(), weights, kIterations, {0.87, 0.89}), result_.pairs);
  KeepDistinct();
  if (left) {
    Append(Refit(LookAlikePairs(weights), weights, kIterations, {0.89, 0.92}), result_.pairs);
    // Fits that have not converged get more steps if a gap is left, and so do fits that explain more than the
    // best before holding out: the linear held-out score may overstate their loss.
    const double best = result_.pairs.front().score;
    const auto others =
        result_.pairs.begin() + std::min<std::ptrdiff_t>(kPolishedPairs, std::ssize(result_.pairs));
    const auto on = std::stable_partition(others, result_.pairs.end(), [&](const Fit& fit) {
      return fit.score > best + kPairGain && !fit.bound_hit;
    });
    const std::ptrdiff_t count = on - result_.pairs.begin();
    result_.pairs = Polished(std::move(result_.pairs), count, weights, {0.92, 0.95});
  }
  const bool again = HoldOutAgain(result_.pairs, weights, singles_again_);
  if (again && !singles_again_) HoldOutAgain(result_.fits, weights, true);
  Progress(0.98);
  AddMembers(weights, again || singles_again_);
}

}  // namespace tendril::gap
