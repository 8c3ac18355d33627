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

// Set on open data sets of another simulator of the rig (tests/blind) and on campaigns that had been opened,
// never on sealed ones.

// Log scores are divided by the first and by the second share of the best score: a law that differs a little
// from the real one costs in proportion to what it explains.
constexpr double kTemperature = 2.0;
constexpr double kRelativeTemperature = 0.005;
// A gap: log score at which the best cause makes one as likely as not, with the materialities by which it
// then has to move some channel (without a gap the best of all candidates brings some 2; what two simulations
// of one robot differ by brings 20 and moves less); log score with which one materiality is enough;
// steepness.
constexpr double kGapGain = 9.0;
// More where all runs are of one kind of motion: what is held out of it is too like what is fitted.
constexpr double kOneKind = 3.0;
constexpr double kGapDeltas = 2.5;
constexpr double kClearGain = 25.0;
constexpr double kGapSteepness = 6.0;
// That there is a gap although the data show none: one too small for them, or, where runs differ from their
// repetitions by more than the sensors' noise, hidden in that. Of the robots of an opened campaign that
// showed none, one third in all had one, most of less than 0.3 floors.
constexpr double kUnseen = 0.3, kUnseenInScatter = 0.4;
// Share of the latter that no effect of the library has, at least: had one made the runs differ so, the floor
// would be taken at it. Of fourteen opened sets without a gap in such scatter nine had one, three of them
// gusts and a fixture with play.
constexpr double kUnlistedInScatter = 0.5;
// Share of a gap's mean square that a right cause may leave, since its law differs a little from the real one: of
// all places together, and at each place of the largest gap. What leaves more is not established.
constexpr double kMayStay = 0.1;
// Floors that may remain at a place whatever the gap was: noise is known within so much, and the most that
// anything established leaves.
constexpr double kUnknownFloor = 0.3, kMostLeft_sigma = 5;
constexpr double kUnknownSteepness = 4.0;
// Where no place has anything left and all of the gap may be closed, so far as its runs tell: at most this.
// Of six opened sets in which that was called unexplained, all had a cause of the library.
constexpr double kUnknownAllClosed = 0.3;
// That something else has the very effect of a cause that explains everything; more where the gap is so small
// that noise would hide how the two differ: kMimic, halved at a log score of kMimicGain.
constexpr double kLapse = 0.03, kMimic = 0.1, kMimicGain = 50;
// From this leftover on [sigma] a cause has to close something; else it is unknown with so much probability.
constexpr double kLeftover = 1.0, kUnproven = 0.9;
constexpr double kParameterCost = 1.5, kBoundCost = 1.5;  // temperatures a parameter, and for a bound
// Two causes are not told apart within so many temperatures and with marks so alike.
constexpr double kSame = 3.0;
constexpr double kSameCosine = 0.95;
constexpr double kClear = 0.8;  // share of its group's probability that a cause named alone has
// A second cause: log score that is enough where the first leaves a gap and both together leave none
// (otherwise kPairGain and more); materialities by which it moves some channel, least share of the gap there
// and in all, or share in some channel of its own; share of what the first leaves there: of what a law that
// is a little off leaves, another takes up a little of everything and most of nothing. A number of the robot
// file is hardly off.
constexpr double kPairExplains = 3.0;
constexpr double kPairDeltas = 2.0;
constexpr double kPairShare = 0.01, kPairShareNumber = 0.002;
constexpr double kOwnShare = 0.25;
constexpr double kPairOfLeft = 0.5;
// Two causes that hide each other: floors by which each alone would change a place without a gap, share of it
// that both together change, probability then that neither is the cause. Sizes that were drawn apart cancel
// so well by a small chance; an unlisted effect that lies between what the two do makes them do it.
constexpr double kHides = 1.0, kHidden = 0.25, kUnknownHidden = 0.6;
constexpr std::size_t kListed = 12;  // causes in the report

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

/// As the screening sees it: to first order.
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

/// Largest rms change that a model makes in a channel, in materialities: of a tip's axes in the largest of
/// them, since nobody cares about the axis along which this tip hardly moves more than about the others.
double Material(const Evaluator& evaluator, const Residuals& residuals) {
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

/// From 0 to 1, a half at x = 1.
double Saturating(double x, double steepness) { return 1 - 1 / (1 + std::pow(x, steepness)); }

/// From 0 to 1, a half at `at`.
double Sure(double gain, double at) { return 1 / (1 + std::exp(at - gain)); }

/// One case as it is judged, from is there a gap to the verdict.
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
    // What differs between runs of the same commands is in no model that repeats, though no place shows it.
    const auto& repeatability = evaluator_.repeatability();
    judgement_.unrepeated = shown < 0.5 && repeatability;
    const double p_gap = judgement_.unrepeated ? repeatability->law ? 1 - kLapse : 0.5 : shown;
    two_ = HasSecond();
    judgement_.nearest = best_ = two_ ? pair_ : single_;
    // All that the best explains, what the constants that every model may move take up included.
    const double explains = best_ == nullptr ? 0 : Gain(*best_) + std::max(0.0, base_gain_);
    const double mimic = best_ == nullptr ? 0 : kMimic / (1 + std::max(0.0, explains) / kMimicGain);
    double unknown = kLapse + mimic + (1 - 2 * kLapse - mimic) * UnknownProbability();
    if (shown < 0.5 && evaluator_.repetitions_differ() > 0) unknown = std::max(unknown, kUnlistedInScatter);
    // A law of the library that made them differ would have given the floor.
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
    if (doubted) p_unknown = p_gap - Halved() * (p_gap - p_unknown);
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
  /// Every further parameter is another way to take up what a simpler cause has nearly explained; a law at
  /// its bound has turned into something else.
  double Cost(const Fit& fit) const { return temperature_ * Burden(fit); }
  static double Burden(const Fit& fit) {
    return kParameterCost * (fit.model.size() - 1) + (fit.bound_hit ? kBoundCost : 0.0);
  }
  /// Among pairs: what they have in common is not in question, and takes no part in their temperature.
  double PairScore(const Fit& fit) const { return fit.held_out_score - pair_temperature_ * Burden(fit); }
  double InFloors(int channel, double square) const {
    return square / std::pow(evaluator_.channels()[channel].floor, 2);
  }
  void Sort() {
    std::stable_sort(scored_.begin(), scored_.end(),
                     [](const Scored& a, const Scored& b) { return a.cause.p > b.cause.p; });
  }

  /// From the largest excess, or from the score of the best cause and the largest change it makes, both in
  /// materialities.
  double GapProbability() const {
    double in_deltas = 0;
    for (const auto& f : location_) {
      if (f.excess && f.cut != sim::Cut::kClock && f.delta > 0)
        in_deltas = std::max(in_deltas, f.excess_sigma * f.floor / f.delta);
    }
    double p = Saturating(in_deltas, kGapSteepness);
    // The log score takes windows for independent. Where runs differ from their repetitions by so much more
    // than the sensors' noise, what makes them differ lasts longer than one, and only the excess counts.
    if (single_ != nullptr && evaluator_.repetitions_differ() == 0) {
      const double gain = Gain(*single_) - Cost(*single_);
      const double material = Material(evaluator_, single_->residuals);
      p = std::max(p, Sure(gain, kClearGain) * Saturating(material, kGapSteepness));
      const double enough = kGapGain + (OneKindOfMotion() ? kOneKind : 0);
      if (!single_->bound_hit)
        p = std::max(p, Sure(gain, enough) * Saturating(material / kGapDeltas, kGapSteepness));
    }
    return p;
  }

  bool OneKindOfMotion() const {
    const auto& runs = evaluator_.runs();
    return std::all_of(runs.begin(), runs.end(),
                       [&](const PreparedRun& run) { return run.family == runs.front().family; });
  }

  /// Below one half: the data show no gap, which is not that there is none. Order and one half stay.
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
    // Where the first leaves nothing at any place, only the score speaks for a second; it has to bring what
    // tells two causes apart.
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
      // Where the first cause does little, the second may be nearly all there is.
      if (more > kOwnShare * gap) own = std::max(own, in_deltas);
    }
    return own > kPairDeltas || (in_one > kPairDeltas && more_in_all > share * gap_in_all);
  }

  /// Given a gap, that its cause is not among the candidates: from what the best of them leaves.
  double UnknownProbability() {
    if (best_ == nullptr) return 1;
    const std::array<std::vector<double>, 2> changed = ChangedByEach();
    double largest = 0;
    for (const auto& g : location_) {
      if (g.excess && g.cut != sim::Cut::kClock && g.cut != sim::Cut::kSensors)
        largest = std::max(largest, g.excess_sigma);
    }
    double unknown = 0;  // largest leftover over what may be left
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
      // Of a small gap little is certain; half of the doubt is for the cause. All of it where runs do not
      // repeat and no place has anything left: what their scatter makes of the fraction is not the cause's
      // fault.
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
    // What leaves a gap, and closes nothing for sure of what it was not fitted to, is hardly its cause.
    const bool unproven = closed && closed->low <= 0 && judgement_.leftover_sigma >= kLeftover;
    return unproven ? std::max(p, kUnproven) : p;
  }

  std::optional<Estimate> Closed(const Residuals& with) const {
    return PooledClosure(evaluator_, nominal_, Completed(with, nominal_), with_gap_, seed_);
  }

  /// Why the best is not established however far it is ahead, as a clause; empty where it is.
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
    if (best_->bound < 0) return "";
    const sim::EffectParameter& p = best_->model.parameter(best_->bound);
    return fmt::format("its {} is at {:.4g}, a bound of the search range ({:.4g} to {:.4g})", p.name,
                       best_->model.values[best_->bound], p.lower, p.upper);
  }

  /// Takes the causes' probabilities down by the factor at which none is likelier than not. Returns the factor.
  double Halved() {
    double first = 0.5;
    for (const Scored& s : scored_) first = std::max(first, s.cause.p);
    for (Scored& s : scored_) s.cause.p *= 0.5 / first;
    return 0.5 / first;
  }

  /// The doubt may be of the data alone: they do not tell whether enough closes.
  bool MayBeEnough() const {
    return judgement_.leftover_sigma <= kMostLeft_sigma && best_->bound < 0 && closed_ &&
           closed_->high >= 1 - kMayStay;
  }

  /// The best leaves something of the gap for sure, is not established, or takes two causes.
  bool MayBeANumber() const {
    return best_ == nullptr || two_ || !judgement_.doubt.empty() || judgement_.leftover_sigma > 0 ||
           (closed_ && closed_->high < 1);
  }

  /// The library's own search has had this number at this value.
  bool Searched(const NumberFit& fit) const {
    const auto its = std::find_if(
        search_.screened.begin(), search_.screened.end(),
        [&](const Screened& s) { return s.candidate.effect->name == fit.number.effect; });
    if (its == search_.screened.end()) return false;
    const sim::EffectParameter& p = its->candidate.parameters.front();
    const double by = fit.number.angle ? fit.value - fit.number.in_file : fit.value / fit.number.in_file;
    return p.lower < by && by < p.upper;
  }

  /// Numbers of the file that explain the runs better than the best cause, by so much as tells two causes
  /// apart where no more is taken for the model's discrepancy than the best number leaves. Returns the
  /// probability that it is one of them.
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
    // A number that leaves nothing where the best cause leaves a gap shows that the model has no discrepancy here.
    const bool exact = judgement_.leftover_sigma > 0 && LeavesSigma(numbers.front().residuals) == 0;
    const double relative = exact ? 0 : kRelativeTemperature;
    const double temperature = kTemperature + relative * std::max(0.0, numbers.front().score - nominal);
    // What takes several parameters to say as much is less likely.
    const double best =
        best_ == nullptr ? nominal : score(best_->residuals) - temperature * Burden(*best_);
    const double ahead = numbers.front().score - best;
    if (ahead < kSame * temperature) return 0;
    for (const NumberFit& fit : numbers) {
      if (numbers.front().score - fit.score > kSame * temperature) break;
      const auto closed = Closed(fit.residuals);
      if (closed && closed->value < 0.5) continue;  // most of the gap has another reason
      judgement_.suspected.push_back({fit.number.key, fit.number.in_file, fit.value, closed});
    }
    return judgement_.suspected.empty() ? 0 : Sure(ahead / temperature, 0);
  }

  /// rms that a change of the residuals makes at each place of `location_`, in floors.
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

  /// What the two of a pair change at each place of `location_`, each beside the other, in floors: two laws
  /// that work against each other each leave their share, of more than the gap. 0 of a single, whose change
  /// is the gap where it is right.
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
      Model other = Model::Of(both.parts[1 - part]);
      other.values = both.values.segment(both.offset(1 - part), other.size());
      try {
        changed[part] = InFloorsByPlace(Difference(at(both), at(other)));
      } catch (const std::exception&) {
        // What one alone cannot be simulated with says nothing.
      }
    }
    return changed;
  }

  /// The first cut without a gap at which the two of a pair hide each other.
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

  /// All candidates, refitted or only screened, sharing the probability `p`.
  void ListSingles(double p) {
    for (const Fit& fit : search_.fits) scored_.push_back({CauseOf(fit, 0), Gain(fit) - Cost(fit), &fit});
    for (const Screened& s : search_.screened) {
      const bool refitted = std::any_of(scored_.begin(), scored_.end(),
                                        [&](const Scored& other) { return other.Is(s.candidate); });
      if (!refitted) scored_.push_back({CauseOf(s), s.gain - base_gain_, nullptr, true});
    }
    const double gain = single_ != nullptr ? Gain(*single_) : 0;
    // Where the constants that every model may move explain the gap by themselves, one of them is its cause.
    if (gain < kGapGain && base_gain_ > kGapGain) {
      for (auto& s : scored_) {
        if (!sim::FindEffect(s.cause.effect)->nuisance) s.gain -= base_gain_;
      }
    }
    // What screening alone saw is not worth more than the best refit.
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

  /// Both members of a pair are causes: the probability of each is that of all pairs with it, and what could
  /// stand in its place beside the same partner makes a group with it.
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
    bool divided = false;  // a group of which no member has most
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
      // Without a law in it the robot may have been changed or pushed between the runs.
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
  const double base_gain_;  // of the constants that every model may move, over the nominal robot
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
