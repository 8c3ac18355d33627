// Which cause, how sure.
#include "judge.h"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "closure.h"
#include "locate.h"

namespace tendril::gap {
namespace {

// Constants calibrated on open data sets of another simulator of the rig (tests/blind), never on sealed ones.

// Tempering: log scores are divided by the first plus the second share of the best score, since a slightly
// inaccurate law costs in proportion to what it explains.
constexpr double kTemperature = 2.0;
constexpr double kRelativeTemperature = 0.005;
// Probability of a gap: log score at which the best cause makes a gap as likely as not, the change in
// materialities that it then needs in some channel, the log score at which one materiality is enough, and
// steepness. Chance alone brings a small score without a gap.
constexpr double kGapGain = 9.0;
// Higher where all runs are of one family: the held-out data are too similar to the fitted ones.
constexpr double kOneKind = 3.0;
constexpr double kGapDeltas = 2.5;
constexpr double kClearGain = 25.0;
constexpr double kGapSteepness = 6.0;
// Probability of a gap that the data do not show where repetitions differ by more than sensor noise.
constexpr double kUnseenInScatter = 0.4;
// Least share of the latter for effects outside the library: a library effect that made the runs differ would
// have set the floor.
constexpr double kUnlistedInScatter = 0.5;
// Floors that may remain at a place whatever the gap was: the uncertainty of the noise.
constexpr double kUnknownFloor = 0.3;
constexpr double kUnknownSteepness = 4.0;
// Upper limit where no place has anything left and the whole gap may be closed, as far as the runs show.
constexpr double kUnknownAllClosed = 0.3;
// Added to kLapse where the gap is so small that noise would hide the difference between a cause and
// something else: kMimic, halved at a log score of kMimicGain.
constexpr double kMimic = 0.1, kMimicGain = 50;
// From this leftover on [sigma] a cause has to close something; otherwise the cause is unknown with this
// probability.
constexpr double kLeftover = 1.0, kUnproven = 0.9;
constexpr double kParameterCost = 1.5, kBoundCost = 1.5;  // temperatures per parameter, and per bound
// Causes within kSame temperatures are not told apart if their signatures are this similar.
constexpr double kSameCosine = 0.95;
// A second cause needs: a log score, where the first leaves a gap and both leave none (otherwise kPairGain
// and more); materialities by which it changes some channel; a share of the gap there and in total, or of a
// channel of its own; and a share of what the first cause leaves there. The residual of a slightly inaccurate
// law is explained a little by many effects and mostly by none. The law of a file number is nearly exact.
constexpr double kPairExplains = 3.0;
constexpr double kPairDeltas = 2.0;
constexpr double kPairShare = 0.01, kPairShareNumber = 0.002;
constexpr double kOwnShare = 0.25;
constexpr double kPairOfLeft = 0.5;
// Two cancelling causes: floors by which each alone would change a place without a gap, share that cancels,
// and probability then that neither is the cause. Independent sizes rarely cancel so well, but an unlisted
// effect between the two causes does.
constexpr double kHides = 1.0, kHidden = 0.25, kUnknownHidden = 0.6;
constexpr std::size_t kListed = 12;  // causes listed in the report

Cause CauseOf(const Fit& fit, int part) {
  Cause cause;
  const Candidate& candidate = fit.model.parts[part];
  cause.effect = candidate.effect->name;
  cause.where = candidate.where;
  cause.bound_hit = fit.bound_hit;
  if (fit.only_fold >= 0)
    cause.note = "only one kind of experiment shows it, so it is judged on the data it was fitted to";
  const int offset = fit.model.offset(part);
  for (int k = 0; k < candidate.size(); ++k) {
    const auto& p = candidate.parameters[k];
    const double value = fit.model.values[offset + k];
    const double half = 1.96 * std::sqrt(std::max(0.0, fit.covariance(offset + k, offset + k)));
    cause.parameters[std::string(p.name)] = {value, std::max(p.lower, value - half),
                                             std::min(p.upper, value + half)};
  }
  return cause;
}

/// By the screening: to first order.
Cause CauseOf(const Screened& screened) {
  Cause cause;
  cause.effect = screened.candidate.effect->name;
  cause.where = screened.candidate.where;
  cause.note = "screened only, not refitted: the interval is the physically possible range";
  for (std::size_t k = 0; k < screened.primary.size(); ++k) {
    const auto& p = screened.start.parameter(screened.primary[k]);
    const double value =
        screened.start.values[screened.primary[k]] + screened.linear.value[static_cast<int>(k)];
    cause.parameters[std::string(p.name)] = {value, p.lower, p.upper};
  }
  return cause;
}

/// Cosine between the changes that two models make, weighted.
double Cosine(const Weights& weights, const Residuals& nominal, const Residuals& a, const Residuals& b) {
  double aa = 0, bb = 0, ab = 0;
  for (int i = 0; i < static_cast<int>(nominal.size()); ++i) {
    for (int c = 0; c < static_cast<int>(nominal[i].size()); ++c) {
      const bool has_a = !a[i].empty() && a[i][c].size() > 0, has_b = !b[i].empty() && b[i][c].size() > 0;
      const auto w = weights(i, c).array();
      if (has_a) aa += (w * (nominal[i][c] - a[i][c]).array().square()).sum();
      if (has_b) bb += (w * (nominal[i][c] - b[i][c]).array().square()).sum();
      if (has_a && has_b)
        ab += (w * (nominal[i][c] - a[i][c]).array() * (nominal[i][c] - b[i][c]).array()).sum();
    }
  }
  return aa > 0 && bb > 0 ? ab / std::sqrt(aa * bb) : 0;
}

/// Largest rms change by a model in a channel, in materialities: of a tip's axes relative to the largest
/// materiality, since an axis along which the tip hardly moves does not matter more.
double LargestChange(const Evaluator& evaluator, const Residuals& residuals) {
  const Residuals& nominal = evaluator.AtNominal();
  const auto materiality = [&](const Channel& channel) {
    double delta = channel.delta;
    for (const Channel& other : evaluator.channels()) {
      if (channel.cut == sim::Cut::kShape && other.quantity == channel.quantity)
        delta = std::max(delta, other.delta);
    }
    return delta;
  };
  double most = 0;
  for (int c = 0; c < static_cast<int>(evaluator.channels().size()); ++c) {
    const Channel& channel = evaluator.channels()[c];
    double square = 0, total = 0;
    for (std::size_t i = 0; i < nominal.size(); ++i) {
      const auto& v = evaluator.Variance()[i][c];
      const bool changed = !residuals[i].empty() && residuals[i][c].size() > 0;
      for (int w = 0; w < v.size(); ++w) {
        if (!std::isfinite(v[w])) continue;
        const double weight = 1 / (v[w] + channel.floor * channel.floor);
        total += weight;
        if (changed) square += weight * std::pow(nominal[i][c][w] - residuals[i][c][w], 2);
      }
    }
    if (total > 0) most = std::max(most, std::sqrt(square / total) / materiality(channel));
  }
  return most;
}

Residuals Difference(Residuals of, const Residuals& and_these) {
  for (std::size_t i = 0; i < of.size(); ++i) {
    for (std::size_t c = 0; c < of[i].size(); ++c) of[i][c] -= and_these[i][c];
  }
  return of;
}

/// From 0 to 1, with a half at x = 1.
double Saturating(double x, double steepness) { return 1 - 1 / (1 + std::pow(x, steepness)); }

/// From 0 to 1, with a half at `at`.
double Logistic(double gain, double at) { return 1 / (1 + std::exp(at - gain)); }

/// The judgement of one data set, from the presence of a gap to the verdict.
class Case {
 public:
  Case(const Evaluator& evaluator, const SearchResult& search, const std::vector<CutFinding>& location,
       std::uint64_t seed)
      : seed_(seed),
        evaluator_(evaluator),
        search_(search),
        location_(location),
        nominal_(evaluator.AtNominal()),
        with_gap_(ChannelsWithGap(evaluator, location)),
        weights_(evaluator, search.leftover),
        before_(ScoreChannels(evaluator, nominal_, nominal_)),
        base_gain_(search.base_score - LogScore(weights_, nominal_, nominal_)) {
    const double most = search.fits.empty() ? 0 : Gain(search.fits.front());
    temperature_ = kTemperature + kRelativeTemperature * std::max(0.0, most);
    for (const Fit& fit : search.fits) {
      if (single_ == nullptr || Gain(fit) - Cost(fit) > Gain(*single_) - Cost(*single_)) single_ = &fit;
    }
    if (!search.pairs.empty()) {
      pair_temperature_ = kTemperature;
      if (single_ != nullptr) {
        const double brings = search.pairs.front().held_out_score - single_->held_out_score;
        pair_temperature_ += kRelativeTemperature * std::max(0.0, brings);
      }
      for (const Fit& fit : search.pairs) {
        if (pair_ == nullptr || PairScore(fit) > PairScore(*pair_)) pair_ = &fit;
      }
    }
  }

  Judgement Judged(const std::function<std::vector<NumberFit>()>& fit_numbers) {
    const double shown = WithUnseen(GapProbability());
    // Differences between repetitions are not explained by any repeatable model, even where no place shows a
    // gap.
    const auto& repeatability = evaluator_.repeatability();
    judgement_.unrepeated = shown < 0.5 && repeatability;
    const double p_gap = judgement_.unrepeated ? repeatability->law ? 1 - kLapse : 0.5 : shown;
    two_ = HasSecond();
    judgement_.nearest = best_ = two_ ? pair_ : single_;
    // Everything that the best model explains, including the constants that every model may adjust.
    const double explains = best_ == nullptr ? 0 : Gain(*best_) + std::max(0.0, base_gain_);
    const double mimic = best_ == nullptr ? 0 : kMimic / (1 + std::max(0.0, explains) / kMimicGain);
    double unknown = kLapse + mimic + (1 - 2 * kLapse - mimic) * UnknownProbability();
    if (shown < 0.5 && evaluator_.repetitions_differ() > 0) unknown = std::max(unknown, kUnlistedInScatter);
    // A library law that made the runs differ would have set the floor.
    if (judgement_.unrepeated && repeatability->law) unknown = 1 - kLapse;
    judgement_.doubt = shown < 0.5 ? "" : WhyNotEstablished();
    const bool doubted = !judgement_.doubt.empty();
    if (doubted && !MayBeEnough()) unknown = std::max(unknown, 0.5);
    if (shown >= 0.5 && MayBeANumber()) unknown = std::max(unknown, Suspect(fit_numbers()));
    double p_unknown = p_gap * unknown;
    ListSingles(p_gap - p_unknown);
    if (two_) {
      SharePairs(p_gap - p_unknown);
    } else if (single_ != nullptr) {
      GroupSingles();
    }
    if (doubted) p_unknown = p_gap - CapAtHalf() * (p_gap - p_unknown);
    Conclude(p_gap, p_unknown);
    return judgement_;
  }

 private:
  struct Scored {
    Cause cause;
    double gain = 0;
    const Fit* fit = nullptr;
    bool screened_only = false;

    bool Is(const Candidate& c) const { return cause.effect == c.effect->name && cause.where == c.where; }
  };

  double Gain(const Fit& fit) const { return fit.held_out_score - search_.base_score; }
  /// Every additional parameter is another way to fit what a simpler cause nearly explains; a law at its
  /// bound has become a different law.
  double Cost(const Fit& fit) const { return temperature_ * Penalty(fit); }
  /// In temperatures.
  static double Penalty(const Fit& fit) {
    return kParameterCost * (fit.model.size() - 1) + (fit.bound_hit ? kBoundCost : 0.0);
  }
  /// Among pairs the common part is not in question and does not count in their temperature.
  double PairScore(const Fit& fit) const { return fit.held_out_score - pair_temperature_ * Penalty(fit); }
  double InFloors(int channel, double square) const {
    return square / std::pow(evaluator_.channels()[channel].floor, 2);
  }
  void Sort() {
    std::stable_sort(scored_.begin(), scored_.end(),
                     [](const Scored& a, const Scored& b) { return a.cause.p > b.cause.p; });
  }

  /// From the largest excess, or from the best cause's score and its largest change, both in materialities.
  double GapProbability() const {
    double in_deltas = 0;
    for (const auto& f : location_) {
      if (f.excess && f.cut != sim::Cut::kClock && f.delta > 0)
        in_deltas = std::max(in_deltas, f.excess_sigma * f.floor / f.delta);
    }
    double p = Saturating(in_deltas, kGapSteepness);
    // The log score treats windows as independent. Where repetitions differ by much more than sensor noise,
    // the differences last longer than a window, and only the excess counts.
    if (single_ != nullptr && evaluator_.repetitions_differ() == 0) {
      const double gain = Gain(*single_) - Cost(*single_);
      const double change = LargestChange(evaluator_, single_->residuals);
      p = std::max(p, Logistic(gain, kClearGain) * Saturating(change, kGapSteepness));
      const double enough = kGapGain + (OneKindOfMotion() ? kOneKind : 0);
      if (!single_->bound_hit)
        p = std::max(p, Logistic(gain, enough) * Saturating(change / kGapDeltas, kGapSteepness));
    }
    return p;
  }

  bool OneKindOfMotion() const {
    const auto& runs = evaluator_.runs();
    return std::all_of(runs.begin(), runs.end(),
                       [&](const PreparedRun& run) { return run.family == runs.front().family; });
  }

  /// Limits the probability to below one half, keeping its order: the data show no gap, but that does not
  /// exclude one.
  double WithUnseen(double p) const {
    const double unseen = evaluator_.repetitions_differ() > 0 ? kUnseenInScatter : kUnseen;
    return p >= 0.5 ? p : unseen + (1 - 2 * unseen) * p;
  }

  /// The largest excess beyond the floor.
  double LeavesSigma(const Residuals& with) const {
    double most = 0;
    for (const auto& f : Locate(evaluator_, Completed(with, nominal_), kLeftDiscoveries)) {
      if (f.excess && f.cut != sim::Cut::kClock) most = std::max(most, f.excess_sigma);
    }
    return most;
  }

  bool HasSecond() const {
    if (single_ == nullptr || pair_ == nullptr) return false;
    const double brings = pair_->held_out_score - single_->held_out_score;
    const bool explains = LeavesSigma(single_->held_out) > kLeftover && LeavesSigma(pair_->held_out) == 0;
    // Where the first leaves no excess at any place, only the score supports a second cause; it has to reach
    // what distinguishes two causes.
    const bool hidden = LeavesSigma(single_->held_out) == 0;
    const double unexpected = hidden ? std::max(kPairGain, kSame * temperature_) : kPairGain;
    const double enough = explains ? kPairExplains : unexpected;
    if (brings <= enough) return false;
    const ChannelScore one = ScoreChannels(evaluator_, single_->held_out, nominal_);
    const ChannelScore both = ScoreChannels(evaluator_, pair_->held_out, nominal_);
    const double share = single_->model.parts[0].effect->edit != nullptr ? kPairShareNumber : kPairShare;
    double in_one = 0, own = 0, gap_in_all = 0, more_in_all = 0;
    for (int c = 0; c < before_.square.size(); ++c) {
      const double gap = before_.Excess(c) * before_.Excess(c);
      const double more = one.square[c] - both.square[c];
      gap_in_all += InFloors(c, gap);
      more_in_all += InFloors(c, more);
      if (more <= share * gap || more <= kPairOfLeft * std::pow(one.Excess(c), 2)) continue;
      const double in_deltas = std::sqrt(more) / evaluator_.channels()[c].delta;
      in_one = std::max(in_one, in_deltas);
      // Where the first cause has little effect the second may explain nearly everything.
      if (more > kOwnShare * gap) own = std::max(own, in_deltas);
    }
    return own > kPairDeltas || (in_one > kPairDeltas && more_in_all > share * gap_in_all);
  }

  /// Probability, given a gap, that its cause is not among the candidates: from what the best of them leaves.
  double UnknownProbability() {
    if (best_ == nullptr) return 1;
    const std::array<std::vector<double>, 2> changed = ChangedByEach();
    double largest = 0;
    for (const auto& g : location_) {
      if (g.excess && g.cut != sim::Cut::kClock && g.cut != sim::Cut::kSensors)
        largest = std::max(largest, g.excess_sigma);
    }
    double unknown = 0;  // largest leftover relative to what may be left
    for (const auto& f : Locate(evaluator_, Completed(best_->held_out, nominal_), kLeftDiscoveries)) {
      if (!f.excess || f.cut == sim::Cut::kClock || f.cut == sim::Cut::kSensors) continue;
      double was = 0;
      for (std::size_t k = 0; k < location_.size(); ++k) {
        const auto& g = location_[k];
        if (g.cut == f.cut && g.where == f.where && g.quantity == f.quantity)
          was = std::max(g.excess_sigma, std::hypot(changed[0][k], changed[1][k]));
      }
      judgement_.leftover_sigma = std::max(judgement_.leftover_sigma, f.excess_sigma);
      const double allowed = std::hypot(kUnknownFloor, std::sqrt(kMayStay) * std::max(was, largest));
      unknown = std::max(unknown, f.excess_sigma / allowed);
    }
    const auto& closed = closed_ = Closed(best_->held_out);
    if (closed) {
      // A small gap is uncertain; half of the doubt concerns the cause, or all of it where runs do not repeat
      // and no place has an excess, since their scatter distorts the closed fraction.
      const auto independent = std::count_if(evaluator_.runs().begin(), evaluator_.runs().end(),
                                             [](const PreparedRun& run) { return run.repeat_of.empty(); });
      const bool scatter = evaluator_.repetitions_differ() > 0 && judgement_.leftover_sigma == 0 &&
                           independent >= 4 && closed->low > 0;
      const double closes = scatter ? closed->high : 0.5 * (closed->value + closed->high);
      unknown = std::max(unknown, std::sqrt(std::max(0.0, 1 - closes) / kMayStay));
    }
    double p = Saturating(unknown, kUnknownSteepness);
    if (judgement_.leftover_sigma == 0 && closed && closed->high >= 1) p = std::min(p, kUnknownAllClosed);
    if (p < kUnknownHidden) judgement_.hidden_at = HiddenAt(changed);
    if (judgement_.hidden_at) p = kUnknownHidden;
    // A cause that leaves a gap and closes nothing significantly on held-out data is unlikely.
    const bool unproven = closed && closed->low <= 0 && judgement_.leftover_sigma >= kLeftover;
    return unproven ? std::max(p, kUnproven) : p;
  }

  std::optional<Estimate> Closed(const Residuals& with) const {
    return PooledClosure(evaluator_, nominal_, Completed(with, nominal_), with_gap_, seed_);
  }

  /// Why the best is not established despite its lead, as a clause; empty where it is.
  std::string WhyNotEstablished() const {
    if (best_ == nullptr) return "";
    if (judgement_.leftover_sigma > kMostLeft_sigma) {
      return fmt::format(
          "{:.2g} noise floors remain with it, more than the {:.2g} that a slightly inaccurate law leaves",
          judgement_.leftover_sigma, kMostLeft_sigma);
    }
    if (closed_ && closed_->value < 1 - kMayStay) {
      return fmt::format(
          "it closes {:.0f} % (95 %: {:.0f} to {:.0f}) of the gap on held-out data, and a cause has to close "
          "{:.0f} %",
          100 * closed_->value, 100 * closed_->low, 100 * closed_->high, 100 * (1 - kMayStay));
    }
    if (best_->bound >= 0) return "its " + AtBoundText(*best_);
    const Fit* rival = InseparableAtBound();
    if (rival == nullptr) return "";
    return fmt::format("{} explains as much although its {}: beyond it, it may explain more",
                       rival->model.parts[0].Name(), AtBoundText(*rival));
  }

  static std::string AtBoundText(const Fit& fit) {
    const sim::EffectParameter& p = fit.model.parameter(fit.bound);
    return fmt::format("{} is at {:.4g}, a bound of the search range ({:.4g} to {:.4g})", p.name,
                       fit.model.values[fit.bound], p.lower, p.upper);
  }

  /// A cause that the data do not separate from the single best (which it may be itself) and that ends at a
  /// bound of its range; null: none. Beyond the bound it may explain more, so the best is not established. It
  /// is compared by what it explains: the price of a bound does not apply, for the law may hold beyond it.
  const Fit* InseparableAtBound() const {
    if (best_ == nullptr || two_) return nullptr;
    for (const Fit& fit : search_.fits) {
      if (fit.bound < 0 || Gain(*best_) - Gain(fit) >= kSame * temperature_) continue;
      if (Cosine(weights_, nominal_, best_->residuals, fit.residuals) >= kSameCosine) return &fit;
    }
    return nullptr;
  }

  /// Reduces the causes' probabilities by the factor at which none is likelier than not. Returns the factor.
  double CapAtHalf() {
    double first = 0.5;
    for (const Scored& s : scored_) first = std::max(first, s.cause.p);
    for (Scored& s : scored_) s.cause.p *= 0.5 / first;
    return 0.5 / first;
  }

  /// Only the data may be insufficient: they do not show whether enough closes.
  bool MayBeEnough() const {
    return judgement_.leftover_sigma <= kMostLeft_sigma && best_->bound < 0 && closed_ &&
           closed_->high >= 1 - kMayStay;
  }

  /// The best leaves a significant part of the gap, is not established, or takes two causes.
  bool MayBeANumber() const {
    return best_ == nullptr || two_ || !judgement_.doubt.empty() || judgement_.leftover_sigma > 0 ||
           (closed_ && closed_->high < 1);
  }

  /// The library's own search has fitted this number, and could have come to this value.
  bool Searched(const NumberFit& fit) const {
    const double by = fit.number.angle ? fit.value - fit.number.in_file : fit.value / fit.number.in_file;
    return std::any_of(search_.fits.begin(), search_.fits.end(), [&](const Fit& searched) {
      const Candidate& part = searched.model.parts.front();
      const sim::EffectParameter& p = part.parameters.front();
      return part.effect->name == fit.number.effect && p.lower < by && by < p.upper;
    });
  }

  /// Numbers of the file that explain the runs better than the best cause by enough to tell two causes apart,
  /// with the model discrepancy reduced to what the best number leaves. Returns the probability that it is
  /// one of them.
  double Suspect(std::vector<NumberFit> numbers) {
    std::erase_if(numbers, [&](const NumberFit& fit) { return Searched(fit); });
    if (numbers.empty()) return 0;
    const Eigen::VectorXd left = Leftover(evaluator_, numbers.front().residuals).cwiseMin(search_.leftover);
    const Weights weights(evaluator_, left);
    const auto score = [&](const Residuals& residuals) { return LogScore(weights, residuals, nominal_); };
    for (NumberFit& fit : numbers) fit.score = score(fit.residuals);
    std::stable_sort(numbers.begin(), numbers.end(),
                     [](const NumberFit& a, const NumberFit& b) { return a.score > b.score; });
    const double nominal = score(nominal_);
    // A number that leaves nothing where the best cause leaves a gap, or no more than a slightly inaccurate
    // law where the best cause leaves more, shows that the model has no such discrepancy here.
    const double leaves = LeavesSigma(numbers.front().residuals);
    const bool exact = (judgement_.leftover_sigma > 0 && leaves == 0) ||
                       (judgement_.leftover_sigma > kMostLeft_sigma && leaves <= kMostLeft_sigma);
    const double relative = exact ? 0 : kRelativeTemperature;
    const double temperature = kTemperature + relative * std::max(0.0, numbers.front().score - nominal);
    // A cause with more parameters for the same explanation is less likely.
    const double best = best_ == nullptr ? nominal : score(best_->residuals) - temperature * Penalty(*best_);
    const double ahead = numbers.front().score - best;
    // A number that a cause was searching when it came to its bound is the same hypothesis beyond it: it only
    // has to explain as much as the best cause.
    const Fit* bounded = InseparableAtBound();
    const bool pointed_to =
        bounded != nullptr && numbers.front().number.effect == bounded->model.parts[0].effect->name;
    if (ahead < (pointed_to ? 0 : kSame * temperature)) return 0;
    for (const NumberFit& fit : numbers) {
      if (numbers.front().score - fit.score > kSame * temperature) break;
      const auto closed = Closed(fit.residuals);
      if (closed && closed->value < 0.5) continue;  // most of the gap has another reason
      judgement_.suspected.push_back({fit.number.key, fit.number.in_file, fit.value, closed});
    }
    return judgement_.suspected.empty() ? 0 : Logistic(ahead / temperature, 0);
  }

  /// rms of a residual change at each place of `location_`, in floors.
  std::vector<double> InFloorsByPlace(const Residuals& change) const {
    std::vector<double> changed(location_.size(), 0.0);
    for (const auto& g : Locate(evaluator_, change, kLeftDiscoveries)) {
      for (std::size_t k = 0; k < location_.size(); ++k) {
        const auto& f = location_[k];
        if (g.cut == f.cut && g.where == f.where && g.quantity == f.quantity && g.floor > 0)
          changed[k] = g.rms / g.floor;
      }
    }
    return changed;
  }

  /// The change by each of a pair at each place of `location_`, in addition to the other, in floors; opposing
  /// laws each take a share of more than the gap. 0 for a single cause, whose change is the gap if it is
  /// right.
  std::array<std::vector<double>, 2> ChangedByEach() const {
    const std::vector<double> nothing(location_.size(), 0.0);
    std::array<std::vector<double>, 2> changed{nothing, nothing};
    if (!two_) return changed;
    const Model& both = best_->model;
    const unsigned cuts = CutsOf(evaluator_, both);
    const auto at = [&](const Model& model) {
      return Completed(evaluator_.At(model.Robot(evaluator_.nominal()), cuts), nominal_);
    };
    for (int part = 0; part < 2; ++part) {
      try {
        changed[part] = InFloorsByPlace(Difference(at(both), at(both.Alone(1 - part))));
      } catch (const std::exception&) {
        // A member that cannot be simulated alone is not conclusive.
      }
    }
    return changed;
  }

  /// The first cut without a gap at which the two of a pair cancel each other.
  std::optional<sim::Cut> HiddenAt(const std::array<std::vector<double>, 2>& changed) const {
    if (!two_) return std::nullopt;
    const std::vector<double> together =
        InFloorsByPlace(Difference(Completed(best_->residuals, nominal_), nominal_));
    for (std::size_t k = 0; k < location_.size(); ++k) {
      const double least = std::min(changed[0][k], changed[1][k]);
      if (!location_[k].excess && location_[k].cut != sim::Cut::kSensors && least > kHides &&
          together[k] < kHidden * least)
        return location_[k].cut;
    }
    return std::nullopt;
  }

  /// All candidates, refitted or screened only, sharing the probability `p`.
  void ListSingles(double p) {
    for (const Fit& fit : search_.fits) scored_.push_back({CauseOf(fit, 0), Gain(fit) - Cost(fit), &fit});
    for (const Screened& s : search_.screened) {
      const bool refitted = std::any_of(scored_.begin(), scored_.end(),
                                        [&](const Scored& other) { return other.Is(s.candidate); });
      if (!refitted) scored_.push_back({CauseOf(s), s.gain - base_gain_, nullptr, true});
    }
    const double gain = single_ != nullptr ? Gain(*single_) : 0;
    // Where the constants that every model may adjust explain the gap, one of them is its cause.
    if (gain < kGapGain && base_gain_ > kGapGain) {
      for (auto& s : scored_) {
        if (!sim::FindEffect(s.cause.effect)->nuisance) s.gain -= base_gain_;
      }
    }
    // A screened candidate does not count more than the best refit.
    double top = -1e300, sum = 0;
    for (auto& s : scored_) {
      if (s.screened_only && single_ != nullptr)
        s.gain = std::min(s.gain, gain - kSame * temperature_ - Cost(*single_));
      top = std::max(top, s.gain);
    }
    for (const auto& s : scored_) sum += std::exp((s.gain - top) / temperature_);
    double gap = 0;
    for (int c = 0; c < before_.square.size(); ++c) {
      if (with_gap_[c]) gap += InFloors(c, std::pow(before_.Excess(c), 2));
    }
    for (auto& s : scored_) {
      s.cause.p = p * std::exp((s.gain - top) / temperature_) / sum;
      s.cause.screening_gain = s.screened_only ? s.gain : 0;
      if (s.fit == nullptr || gap <= 0) continue;
      const ChannelScore with = ScoreChannels(evaluator_, s.fit->held_out, nominal_);
      double left = 0;
      for (int c = 0; c < with.square.size(); ++c) {
        if (with_gap_[c]) left += InFloors(c, with.square[c] - before_.noise[c]);
      }
      s.cause.held_out_gain = 1 - left / gap;
    }
    Sort();
  }

  /// Both members of a pair are causes: the probability of each is that of all pairs containing it, and
  /// alternatives beside the same partner form a group with it.
  void SharePairs(double p) {
    const auto weight = [&](const Fit& fit) {
      return std::exp((PairScore(fit) - PairScore(*pair_)) / pair_temperature_);
    };
    double sum = 0;
    for (const Fit& fit : search_.pairs) sum += weight(fit);
    for (auto& s : scored_) {
      double with = 0;
      for (const Fit& fit : search_.pairs) {
        if (s.Is(fit.model.parts[0]) || s.Is(fit.model.parts[1])) with += weight(fit);
      }
      s.cause.p = p * with / sum;
    }
    const auto entry_of = [&](const Candidate& c) {
      return std::find_if(scored_.begin(), scored_.end(), [&](const Scored& s) { return s.Is(c); });
    };
    for (int part = 0; part < 2; ++part) {
      const Candidate& member = pair_->model.parts[part];
      const Candidate& partner = pair_->model.parts[1 - part];
      const auto mine = entry_of(member);
      if (mine == scored_.end()) continue;
      const double p_member = mine->cause.p;
      mine->cause = CauseOf(*pair_, part);
      mine->cause.p = p_member;
      mine->cause.note = (mine->cause.note.empty() ? "" : mine->cause.note + "; ") +
                         std::string("one of two causes that act together");
      for (const Fit& fit : search_.pairs) {
        const auto& parts = fit.model.parts;
        if (!(parts[0] == partner) && !(parts[1] == partner)) continue;
        const Candidate& other = parts[0] == partner ? parts[1] : parts[0];
        const double behind = PairScore(*pair_) - PairScore(fit);
        const auto rival = entry_of(other);
        if (other == member || behind >= kSame * pair_temperature_ || rival == scored_.end()) continue;
        mine->cause.group = rival->cause.group = part + 1;
        const double cosine = Cosine(weights_, nominal_, pair_->residuals, fit.residuals);
        judgement_.confusable.push_back({member.Name(), other.Name(), cosine, behind, true});
      }
    }
    Sort();
  }

  void GroupSingles() {
    const double same = kSame * temperature_;
    for (const Fit& fit : search_.fits) {
      if (&fit == single_) continue;
      const double cosine = Cosine(weights_, nominal_, single_->residuals, fit.residuals);
      if (cosine < kSameCosine) continue;
      const double behind = Gain(*single_) - Cost(*single_) - Gain(fit) + Cost(fit);
      judgement_.confusable.push_back({single_->model.parts[0].Name(), fit.model.parts[0].Name(), cosine,
                                       behind, std::exp(-behind / temperature_) > 1 / kClear - 1});
      if (behind >= same) continue;
      for (auto& s : scored_) {
        if (s.fit == &fit || s.fit == single_) s.cause.group = 1;
      }
    }
  }

  void Conclude(double p_gap, double p_unknown) {
    Judgement& j = judgement_;
    for (const auto& s : scored_) {
      if (j.causes.size() < kListed) j.causes.push_back(s.cause);
    }
    Cause none, other;
    none.effect = "no_gap";
    none.p = 1 - p_gap;
    other.effect = "unknown";
    other.p = p_unknown;
    j.causes.push_back(none);
    j.causes.push_back(other);
    std::stable_sort(j.causes.begin(), j.causes.end(),
                     [](const Cause& a, const Cause& b) { return a.p > b.p; });

    double first = 0;
    bool divided = false;  // a group without a member that has most of its probability
    for (const auto& s : scored_) first = std::max(first, s.cause.p);
    for (const int number : {1, 2}) {
      double group = 0, first_of_group = 0;
      for (const auto& s : scored_) {
        if (s.cause.group != number) continue;
        group += s.cause.p;
        first_of_group = std::max(first_of_group, s.cause.p);
      }
      divided = divided || first_of_group < kClear * group;
    }
    if (p_gap < 0.5) {
      j.verdict = Verdict::kNoGap;
    } else if (j.unrepeated) {
      // Without a law, the robot may have been changed or pushed between the runs.
      j.verdict = evaluator_.repeatability()->law ? Verdict::kUnexplained : Verdict::kInsufficientData;
    } else if (p_unknown > 0.5 * p_gap) {
      j.verdict = Verdict::kUnexplained;
    } else if (!j.doubt.empty() && !MayBeEnough()) {
      j.verdict = Verdict::kUnexplained;
    } else if (!j.doubt.empty() || divided || first <= 0.5 * (p_gap - p_unknown)) {
      j.verdict = Verdict::kAmbiguousGroup;
    } else {
      j.verdict = Verdict::kAttributed;
    }
    if (j.verdict != Verdict::kAttributed && j.verdict != Verdict::kAmbiguousGroup) return;
    j.best = best_;
    for (int part = 0; part < static_cast<int>(best_->model.parts.size()); ++part) {
      Cause cause = CauseOf(*best_, part);
      for (const auto& s : scored_) {
        if (!s.Is(best_->model.parts[part])) continue;
        cause.p = s.cause.p;
        cause.group = s.cause.group;
        cause.held_out_gain = s.cause.held_out_gain;
      }
      j.accepted.push_back(cause);
    }
  }

  const std::uint64_t seed_;
  const Evaluator& evaluator_;
  const SearchResult& search_;
  const std::vector<CutFinding>& location_;
  const Residuals& nominal_;
  const std::vector<char> with_gap_;
  const Weights weights_;
  const ChannelScore before_;
  const double base_gain_;  // of the constants that every model may adjust, over the nominal robot
  double temperature_ = 0, pair_temperature_ = 0;
  const Fit* single_ = nullptr;
  const Fit* pair_ = nullptr;
  const Fit* best_ = nullptr;
  std::optional<Estimate> closed_;  // by the best, on held-out data
  bool two_ = false;
  std::vector<Scored> scored_;
  Judgement judgement_;
};

}  // namespace

Judgement Judge(const Evaluator& evaluator, const SearchResult& search,
                const std::vector<CutFinding>& location, std::uint64_t seed,
                const std::function<std::vector<NumberFit>()>& fit_numbers) {
  return Case(evaluator, search, location, seed).Judged(fit_numbers);
}

}  // namespace tendril::gap
