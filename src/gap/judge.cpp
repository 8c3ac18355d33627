// Where, what, how sure.
#include "judge.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

namespace tendril::gap {
namespace {

using Quantity = Channel::Quantity;

// Set on open data sets of another simulator of the rig (tests/blind), never on sealed ones.
constexpr double kTemperature =
    2.0;  // log scores are divided by this and by a share of the best score: a law that
constexpr double kRelativeTemperature = 0.005;  // differs a little from the real one costs in proportion
constexpr double kGapGain = 25.0;      // log score that the best cause must bring to count as a gap by itself
constexpr double kGapSteepness = 6.0;  // of the change from "no gap" to "gap" about the materiality
constexpr double kUnknownFloor = 0.3;  // sigma that may remain beyond the floor
constexpr double kUnknownShare =
    0.25;  // and share of the gap that a right cause with a slightly different law may leave
constexpr double kUnknownSteepness = 4.0;
constexpr double kNoiseSlack = 1.3;     // the noise is known within some tens of per cent
constexpr double kParameterCost = 1.5;  // temperatures a parameter
constexpr double kSame = 3.0;           // temperatures within which two causes are not told apart
constexpr double kSameCosine = 0.95;
constexpr double kPairGain = 12.0;   // log score that a second cause must bring
constexpr double kPairDeltas = 2.0;  // and how many materialities it must move some channel
constexpr double kPairShare = 0.01;  // and the least share of the gap it must explain
constexpr double kClear = 0.8;       // share of its group's probability that a cause named alone has
constexpr double kOwnShare = 0.25;   // or this share of the gap in some channel
constexpr std::size_t kListed = 12;  // causes in the report
constexpr double kBlock_s = 1.0;
constexpr double kMotionWindow_s = 1.0;  // slower is shape (C4), faster is motion (C5)

/// One-sided p-value that blocks with these sums have a mean above zero by chance.
double PositiveMean(const std::vector<double>& blocks) {
  const int n = static_cast<int>(blocks.size());
  if (n < 4) return 1;
  const double mean = std::accumulate(blocks.begin(), blocks.end(), 0.0) / n;
  double square = 0;
  for (const double b : blocks) square += (b - mean) * (b - mean);
  const double error = std::sqrt(square / (n - 1) / n);
  if (error <= 0) return mean > 0 ? 0 : 1;
  return 0.5 * std::erfc(mean / error / std::sqrt(2.0));
}

struct Part {
  CutFinding finding;
  std::vector<int> channels;
  bool fast = false;  // of a tip channel: faster than kMotionWindow_s; else slower
};

/// Slow part of a residual: mean over a window about each sample.
Eigen::VectorXd Slow(const Eigen::VectorXd& r, const Eigen::VectorXd& variance, int half) {
  Eigen::VectorXd slow(r.size());
  double sum = 0;
  int count = 0, low = 0, high = 0;
  const int n = static_cast<int>(r.size());
  for (int w = 0; w < n; ++w) {
    for (; high < std::min(n, w + half + 1); ++high) {
      if (std::isfinite(variance[high])) sum += r[high], ++count;
    }
    for (; low < w - half; ++low) {
      if (std::isfinite(variance[low])) sum -= r[low], --count;
    }
    slow[w] = count > 0 ? sum / count : 0;
  }
  return slow;
}

void Measure(const Evaluator& evaluator, const Residuals& residuals, Part& part) {
  const auto& channels = evaluator.channels();
  double square = 0, noise = 0, total = 0;
  std::vector<double> blocks;
  double floor2 = 0, delta = 0;
  for (const int c : part.channels)
    floor2 += std::pow(channels[c].floor, 2), delta = std::max(delta, channels[c].delta);
  for (int i = 0; i < static_cast<int>(residuals.size()); ++i) {
    for (const int c : part.channels) {
      const auto& v = evaluator.Variance()[i][c];
      Eigen::VectorXd r = residuals[i][c];
      if (r.size() == 0) continue;
      double share = 1;  // of white noise that the filter lets through
      const double white = evaluator.WhiteVariance(i, c);
      if (channels[c].cut == sim::Cut::kShape) {
        const int half = std::max(1, static_cast<int>(0.5 * kMotionWindow_s / evaluator.window_s(i, c)));
        const Eigen::VectorXd slow = Slow(r, v, half);
        share = part.fast ? 1 - 1.0 / (2 * half + 1) : 1.0 / (2 * half + 1);
        r = part.fast ? Eigen::VectorXd(r - slow) : slow;
      }
      const int per_block = std::max(1, static_cast<int>(kBlock_s / evaluator.window_s(i, c)));
      const double most = LargestSquare(r, v);
      double block = 0;
      int in_block = 0;
      for (int w = 0; w < r.size(); ++w) {
        if (std::isfinite(v[w])) {
          const double weight = 1 / (v[w] + std::pow(channels[c].floor, 2));
          const double expected = v[w] - (1 - share) * std::min(white, v[w]);
          const double r2 = std::min(r[w] * r[w], most + 36 * expected);
          square += weight * r2;
          noise += weight * expected;
          total += weight;
          block += weight * (r2 - kNoiseSlack * expected);
          ++in_block;
        }
        if ((w + 1) % per_block == 0) {
          if (in_block > 0) blocks.push_back(block / in_block);
          block = 0;
          in_block = 0;
        }
      }
    }
  }
  CutFinding& f = part.finding;
  if (total <= 0) {
    f.measured = false;
    f.note = "no valid samples";
    return;
  }
  const int axes = static_cast<int>(part.channels.size());
  square *= axes / total;
  noise *= axes / total;
  f.rms = std::sqrt(square);
  f.floor = std::sqrt(floor2);
  f.delta = delta * std::sqrt(axes);
  f.excess_sigma = std::sqrt(std::max(0.0, square - noise)) / f.floor;
  f.p_value = PositiveMean(blocks);
  f.excess = std::sqrt(std::max(0.0, square - kNoiseSlack * noise)) > f.delta;
}

}  // namespace

std::vector<CutFinding> Locate(const Evaluator& evaluator, const Residuals& residuals,
                               double false_discoveries) {
  const auto& channels = evaluator.channels();
  std::vector<Part> parts;
  const auto tip = fmt::format("section:{}", evaluator.nominal().body.sections.size());
  std::vector<int> position, direction;
  for (int c = 0; c < static_cast<int>(channels.size()); ++c) {
    const auto& channel = channels[c];
    if (channel.quantity == Quantity::kTipPosition) {
      position.push_back(c);
    } else if (channel.quantity == Quantity::kTipDirection) {
      direction.push_back(c);
    } else {
      Part part;
      part.finding.cut = channel.cut;
      part.finding.where = fmt::format("tendon:{}", channel.index + 1);
      part.finding.quantity = channel.quantity == Quantity::kTorque ? "torque" : "tension";
      part.finding.unit = channel.unit;
      part.channels = {c};
      parts.push_back(part);
    }
  }
  for (const bool fast : {false, true}) {
    for (const auto* list : {&position, &direction}) {
      if (list->empty()) continue;
      Part part;
      part.finding.cut = fast ? sim::Cut::kMotion : sim::Cut::kShape;
      part.finding.where = tip;
      part.finding.quantity = list == &position ? "tip position" : "tip direction";
      part.finding.unit = list == &position ? "m" : "rad";
      part.channels = *list;
      part.fast = fast;
      parts.push_back(part);
    }
  }
  for (auto& part : parts) Measure(evaluator, residuals, part);

  // Benjamini-Hochberg over all places.
  std::vector<Part*> sorted;
  for (auto& part : parts) {
    if (part.finding.measured) sorted.push_back(&part);
  }
  std::sort(sorted.begin(), sorted.end(),
            [](const Part* a, const Part* b) { return a->finding.p_value < b->finding.p_value; });
  double limit = 0;
  for (std::size_t k = 0; k < sorted.size(); ++k) {
    const double allowed =
        false_discoveries * static_cast<double>(k + 1) / static_cast<double>(sorted.size());
    if (sorted[k]->finding.p_value <= allowed) limit = allowed;
  }
  for (auto* part : sorted) part->finding.excess = part->finding.excess && part->finding.p_value <= limit;

  std::vector<CutFinding> location;
  // C0: the time stamps themselves.
  {
    CutFinding f;
    f.cut = sim::Cut::kClock;
    f.where = "all";
    f.quantity = "timestamps";
    f.unit = "s";
    double square = 0, step = 0, lost = 0, samples = 0;
    for (const auto& run : evaluator.runs()) {
      square += run.jitter_s * run.jitter_s * run.samples();
      step += run.signals.step_s * run.samples();
      lost += run.lost;
      samples += run.samples();
    }
    f.rms = std::sqrt(square / samples);
    f.floor = 0.02 * step / samples;
    f.delta = 0.2 * step / samples;
    f.excess_sigma = std::sqrt(std::max(0.0, f.rms * f.rms - f.floor * f.floor)) / f.floor;
    f.excess = f.rms > f.delta || lost / samples > 0.01;
    f.p_value = f.excess ? 0 : 1;
    f.note = fmt::format("{:.0f} of {:.0f} samples lost", lost, samples);
    location.push_back(f);
  }
  for (auto& part : parts) location.push_back(part.finding);
  const auto missing = [&](sim::Cut cut, const char* why) {
    CutFinding f;
    f.cut = cut;
    f.where = "all";
    f.measured = false;
    f.note = why;
    location.push_back(f);
  };
  if (!evaluator.has(kC1)) missing(sim::Cut::kCurrentLoop, "needs target and actual torque");
  if (!evaluator.has(kC2)) missing(sim::Cut::kDrivetrain, "needs actual torque and load cells");
  if (!evaluator.has(kC3)) missing(sim::Cut::kTendon, "needs load cells");
  if (!evaluator.has(kBody)) {
    missing(sim::Cut::kShape, "needs a tracker");
    missing(sim::Cut::kMotion, "needs a tracker");
  }
  // C6: what both ways to a load cell's reading agree on is the cell's.
  for (int j = 0; j < evaluator.nominal().body.tendons(); ++j) {
    int c2 = -1, c3 = -1;
    for (int c = 0; c < static_cast<int>(channels.size()); ++c) {
      if (channels[c].quantity != Quantity::kTension || channels[c].index != j) continue;
      (channels[c].cut == sim::Cut::kDrivetrain ? c2 : c3) = c;
    }
    if (c2 < 0 || c3 < 0) continue;
    double product = 0, total = 0;
    std::vector<double> blocks;
    for (int i = 0; i < static_cast<int>(residuals.size()); ++i) {
      const auto &a = residuals[i][c2], &b = residuals[i][c3];
      const auto &va = evaluator.Variance()[i][c2], &vb = evaluator.Variance()[i][c3];
      const int per_block = std::max(1, static_cast<int>(kBlock_s / evaluator.window_s(i, c2)));
      double block = 0;
      for (int w = 0; w < std::min(a.size(), b.size()); ++w) {
        if (std::isfinite(va[w]) && std::isfinite(vb[w])) {
          const double weight = 1 / (va[w] + vb[w]);
          // White noise of the cell is in both.
          const double common = a[w] * b[w] - std::pow(channels[c2].white, 2) *
                                                  evaluator.runs()[i].signals.step_s /
                                                  evaluator.window_s(i, c2);
          product += weight * common;
          total += weight;
          block += weight * common;
        }
        if ((w + 1) % per_block == 0) blocks.push_back(block), block = 0;
      }
    }
    if (total <= 0) continue;
    CutFinding f;
    f.cut = sim::Cut::kSensors;
    f.where = fmt::format("tendon:{}", j + 1);
    f.quantity = "tension, common to C2 and C3";
    f.unit = "N";
    f.rms = std::sqrt(std::max(0.0, product / total));
    f.floor = channels[c3].floor;
    f.delta = channels[c3].delta;
    f.excess_sigma = f.rms / f.floor;
    f.p_value = PositiveMean(blocks);
    f.excess = f.rms > 2 * f.delta && f.p_value < false_discoveries;
    location.push_back(f);
  }
  std::stable_sort(location.begin(), location.end(),
                   [](const CutFinding& a, const CutFinding& b) { return a.cut < b.cut; });
  return location;
}

namespace {

Cause CauseOf(const Fit& fit, int part) {
  Cause cause;
  const Candidate& candidate = fit.model.parts[part];
  cause.effect = candidate.effect->name;
  cause.where = candidate.where;
  cause.bound_hit = fit.bound_hit;
  const int offset = fit.model.offset(part);
  for (int k = 0; k < candidate.size(); ++k) {
    const auto& p = candidate.effect->parameters[k];
    const double value = fit.model.values[offset + k];
    const double half = 1.96 * std::sqrt(std::max(0.0, fit.covariance(offset + k, offset + k)));
    cause.parameters[std::string(p.name)] = {value, std::max(p.lower, value - half),
                                             std::min(p.upper, value + half)};
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

/// Largest rms change that a model makes in a channel, in that channel's materialities.
double Material(const Evaluator& evaluator, const Residuals& residuals) {
  const Residuals& nominal = evaluator.AtNominal();
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
    if (total > 0) most = std::max(most, std::sqrt(square / total) / channel.delta);
  }
  return most;
}

}  // namespace

Judgement Judge(const Evaluator& evaluator, const SearchResult& search,
                const std::vector<CutFinding>& location) {
  Judgement j;
  const Residuals& nominal = evaluator.AtNominal();
  const Weights weights(evaluator, search.leftover);
  const ChannelScore before = ScoreChannels(evaluator, nominal, nominal);

  // Every further parameter is another way to take up what a simpler cause has nearly explained.
  const double most = search.fits.empty() ? 0 : search.fits.front().held_out_score - search.base_score;
  const double temperature = kTemperature + kRelativeTemperature * std::max(0.0, most);
  const double same_gain = kSame * temperature;
  const auto cost = [&](const Fit& fit) { return kParameterCost * temperature * (fit.model.size() - 1); };
  const Fit* single = nullptr;
  for (const Fit& fit : search.fits) {
    if (single == nullptr || fit.held_out_score - cost(fit) > single->held_out_score - cost(*single))
      single = &fit;
  }
  const Fit* pair = search.pairs.empty() ? nullptr : &search.pairs.front();
  const double gain = single ? single->held_out_score - search.base_score : 0;

  // ---- is there a gap? ----
  double in_deltas = 0;
  for (const auto& f : location) {
    if (f.excess && f.cut != sim::Cut::kClock && f.delta > 0)
      in_deltas = std::max(in_deltas, f.excess_sigma * f.floor / f.delta);
  }
  ChannelScore after_single = before;
  if (single) after_single = ScoreChannels(evaluator, single->held_out, nominal);
  if (gain > kGapGain) in_deltas = std::max(in_deltas, Material(evaluator, single->residuals));
  const double p_gap = 1 - 1 / (1 + std::pow(in_deltas, kGapSteepness));

  // ---- a second cause? ----
  bool two = false;
  if (single && pair && pair->held_out_score - single->held_out_score > kPairGain) {
    const ChannelScore after_pair = ScoreChannels(evaluator, pair->held_out, nominal);
    double in_one = 0, own = 0, gap_in_all = 0, more_in_all = 0;
    for (int c = 0; c < before.square.size(); ++c) {
      const double gap = before.Excess(c) * before.Excess(c);
      const double more = after_single.square[c] - after_pair.square[c];
      gap_in_all += gap / std::pow(evaluator.channels()[c].floor, 2);
      more_in_all += more / std::pow(evaluator.channels()[c].floor, 2);
      if (more <= kPairShare * gap) continue;
      const double in_deltas_here = std::sqrt(more) / evaluator.channels()[c].delta;
      in_one = std::max(in_one, in_deltas_here);
      // Where the first cause does little, the second may be nearly all there is.
      if (more > kOwnShare * gap) own = std::max(own, in_deltas_here);
    }
    two = own > kPairDeltas || (in_one > kPairDeltas && more_in_all > kPairShare * gap_in_all);
  }
  const Fit* best = two ? pair : single;

  // ---- does the best model explain it? ----
  double unknown = 0;  // largest leftover over what may be left
  if (best) {
    const std::vector<CutFinding> after_location =
        Locate(evaluator, Completed(best->held_out, nominal), kLeftDiscoveries);
    for (const auto& f : after_location) {
      if (!f.excess || f.cut == sim::Cut::kClock || f.cut == sim::Cut::kSensors) continue;
      double was = 0;
      for (const auto& g : location) {
        if (g.cut == f.cut && g.where == f.where && g.quantity == f.quantity) was = g.excess_sigma;
      }
      j.leftover_sigma = std::max(j.leftover_sigma, f.excess_sigma);
      unknown = std::max(unknown, f.excess_sigma / std::hypot(kUnknownFloor, kUnknownShare * was));
    }
  } else {
    unknown = 10;
  }
  const double p_unknown = p_gap * (1 - 1 / (1 + std::pow(unknown, kUnknownSteepness)));

  // ---- which cause? ----
  struct Scored {
    Cause cause;
    double gain = 0;
    const Fit* fit = nullptr;
    const Screened* screened = nullptr;
  };
  std::vector<Scored> scored;
  const double base_gain = search.base_score - LogScore(weights, nominal, nominal);
  const auto is_listed = [&](const std::string& effect, const std::string& where) {
    return std::any_of(scored.begin(), scored.end(),
                       [&](const Scored& s) { return s.cause.effect == effect && s.cause.where == where; });
  };
  for (const Fit& fit : search.fits) {
    scored.push_back({CauseOf(fit, 0), fit.held_out_score - search.base_score - cost(fit), &fit, nullptr});
  }
  for (const auto& s : search.screened) {
    if (is_listed(std::string(s.candidate.effect->name), s.candidate.where)) continue;
    Scored entry;
    entry.cause.effect = s.candidate.effect->name;
    entry.cause.where = s.candidate.where;
    entry.gain = s.gain - base_gain;
    entry.screened = &s;
    for (std::size_t k = 0; k < s.primary.size(); ++k) {
      const auto& p = s.start.parameter(s.primary[k]);
      const double value = s.start.values[s.primary[k]] + s.linear.value[static_cast<int>(k)];
      entry.cause.parameters[std::string(p.name)] = {value, p.lower, p.upper};
    }
    scored.push_back(entry);
  }
  // Where the constants that every model may move explain the gap by themselves, one of them is its cause.
  if (gain < kGapGain && base_gain > kGapGain) {
    for (auto& s : scored) {
      if (!sim::FindEffect(s.cause.effect)->nuisance) s.gain -= base_gain;
    }
  }
  // What screening alone saw is not worth more than the best refit.
  double top = -1e300, sum = 0;
  for (auto& s : scored) {
    if (s.screened && single) s.gain = std::min(s.gain, gain - same_gain - cost(*single));
    top = std::max(top, s.gain);
  }
  for (const auto& s : scored) sum += std::exp((s.gain - top) / temperature);
  double base_square = 0;
  for (int c = 0; c < before.square.size(); ++c) {
    base_square += std::pow(before.Excess(c) / evaluator.channels()[c].floor, 2);
  }
  for (auto& s : scored) {
    s.cause.p = (p_gap - p_unknown) * std::exp((s.gain - top) / temperature) / sum;
    s.cause.screening_gain = s.screened ? s.gain : 0;
    if (s.fit && base_square > 0) {
      const ChannelScore with = ScoreChannels(evaluator, s.fit->held_out, nominal);
      double left = 0;
      for (int c = 0; c < with.square.size(); ++c) {
        left += (with.square[c] - before.noise[c]) / std::pow(evaluator.channels()[c].floor, 2);
      }
      s.cause.held_out_gain = 1 - left / base_square;
    }
  }
  std::stable_sort(scored.begin(), scored.end(),
                   [](const Scored& a, const Scored& b) { return a.cause.p > b.cause.p; });

  // Members of an accepted pair are both causes: their probability is that of the pair.
  if (two) {
    // What the pairs have in common is not in question.
    const double pair_temperature =
        kTemperature + kRelativeTemperature * (pair->held_out_score - single->held_out_score);
    double pair_sum = 0;
    for (const Fit& fit : search.pairs)
      pair_sum += std::exp((fit.held_out_score - pair->held_out_score) / pair_temperature);
    for (auto& s : scored) {
      double with = 0;
      for (const Fit& fit : search.pairs) {
        const bool contains = std::any_of(
            fit.model.parts.begin(), fit.model.parts.end(),
            [&](const Candidate& c) { return c.effect->name == s.cause.effect && c.where == s.cause.where; });
        if (contains) with += std::exp((fit.held_out_score - pair->held_out_score) / pair_temperature);
      }
      s.cause.p = (p_gap - p_unknown) * with / pair_sum;
    }
    for (int part = 0; part < 2; ++part) {
      const Candidate& member = pair->model.parts[part];
      const Candidate& partner = pair->model.parts[1 - part];
      const auto entry_of = [&](const Candidate& c) {
        return std::find_if(scored.begin(), scored.end(), [&](const Scored& s) {
          return s.cause.effect == c.effect->name && s.cause.where == c.where;
        });
      };
      const auto mine = entry_of(member);
      if (mine == scored.end()) continue;
      const double p = mine->cause.p;
      mine->cause = CauseOf(*pair, part);
      mine->cause.p = p;
      mine->cause.note = "one of two causes that act together";
      // What could stand in its place beside the same partner.
      for (const Fit& fit : search.pairs) {
        const auto other = std::find_if(fit.model.parts.begin(), fit.model.parts.end(),
                                        [&](const Candidate& c) { return !(c == partner); });
        const bool same_partner = std::any_of(fit.model.parts.begin(), fit.model.parts.end(),
                                              [&](const Candidate& c) { return c == partner; });
        if (!same_partner || other == fit.model.parts.end() || *other == member) continue;
        const double behind = pair->held_out_score - fit.held_out_score;
        if (behind >= kSame * pair_temperature) continue;
        const auto rival = entry_of(*other);
        if (rival == scored.end()) continue;
        mine->cause.group = rival->cause.group = part + 1;
        j.confusable.push_back({member.Name(), other->Name(),
                                Cosine(weights, nominal, pair->residuals, fit.residuals), behind, true});
      }
    }
    std::stable_sort(scored.begin(), scored.end(),
                     [](const Scored& a, const Scored& b) { return a.cause.p > b.cause.p; });
  }

  // ---- groups that these runs cannot tell apart ----
  if (!two && single) {
    for (const Fit& fit : search.fits) {
      if (&fit == single) continue;
      const double cosine = Cosine(weights, nominal, single->residuals, fit.residuals);
      const double behind = single->held_out_score - cost(*single) - fit.held_out_score + cost(fit);
      if (cosine < kSameCosine) continue;
      j.confusable.push_back(
          {single->model.parts[0].Name(), fit.model.parts[0].Name(), cosine, behind, behind < same_gain});
      if (behind >= same_gain) continue;
      for (auto& s : scored) {
        if (s.fit == &fit || s.fit == single) s.cause.group = 1;
      }
    }
  }

  // ---- the verdict ----
  for (const auto& s : scored) {
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

  // The share that the first of a group has of it; a group of one cause has none.
  double first = 0;
  bool divided = false;
  for (const int number : {1, 2}) {
    double group = 0, first_of_group = 0;
    for (const auto& s : scored) {
      if (s.cause.group == number) group += s.cause.p, first_of_group = std::max(first_of_group, s.cause.p);
    }
    divided = divided || first_of_group < kClear * group;
  }
  for (const auto& s : scored) first = std::max(first, s.cause.p);
  if (p_gap < 0.5) {
    j.verdict = Verdict::kNoGap;
  } else if (p_unknown > 0.5 * p_gap) {
    j.verdict = Verdict::kUnexplained;
  } else if (divided || first <= 0.5 * (p_gap - p_unknown)) {
    j.verdict = Verdict::kAmbiguousGroup;
  } else {
    j.verdict = Verdict::kAttributed;
  }
  if (j.verdict == Verdict::kAttributed || j.verdict == Verdict::kAmbiguousGroup) {
    j.best = best;
    if (best) {
      for (int part = 0; part < static_cast<int>(best->model.parts.size()); ++part) {
        Cause cause = CauseOf(*best, part);
        for (const auto& s : scored) {
          if (s.cause.effect == cause.effect && s.cause.where == cause.where) {
            cause.p = s.cause.p;
            cause.group = s.cause.group;
            cause.held_out_gain = s.cause.held_out_gain;
          }
        }
        j.accepted.push_back(cause);
      }
    }
  }
  return j;
}

namespace {

constexpr int kResamples = 400;

struct Resampler {
  std::mt19937_64 random;
  std::vector<int> Draw(int runs) {
    std::uniform_int_distribution<int> pick(0, runs - 1);
    std::vector<int> drawn(runs);
    for (int& i : drawn) i = pick(random);
    return drawn;
  }
};

Estimate WithInterval(double value, std::vector<double> draws) {
  if (draws.size() < 20) return {value, value, value};
  std::sort(draws.begin(), draws.end());
  const auto at = [&](double q) { return draws[static_cast<std::size_t>(q * (draws.size() - 1))]; };
  return {value, std::min(value, at(0.025)), std::max(value, at(0.975))};
}

}  // namespace

std::vector<Closure> Closures(const Evaluator& evaluator, const Residuals& before, const Residuals& after,
                              std::uint64_t seed) {
  const int runs = static_cast<int>(before.size());
  std::vector<ChannelScore> b(runs), a(runs);
  std::vector<Closure> closures;
  const ChannelScore all_before = ScoreChannels(evaluator, before, before);
  const ChannelScore all_after = ScoreChannels(evaluator, after, before);
  for (int i = 0; i < runs; ++i) {
    b[i] = ScoreChannels(evaluator, before, before, {i});
    a[i] = ScoreChannels(evaluator, after, before, {i});
  }
  for (int c = 0; c < static_cast<int>(evaluator.channels().size()); ++c) {
    const auto& channel = evaluator.channels()[c];
    Closure closure;
    closure.channel = channel.name;
    closure.unit = channel.unit;
    closure.cut = channel.cut;
    closure.before_rms = std::sqrt(all_before.square[c]);
    closure.after_rms = std::sqrt(all_after.square[c]);
    closure.floor_rms = std::sqrt(all_before.noise[c]);
    if (all_before.Excess(c, kNoiseSlack) > channel.delta) {
      const double value = 1 - std::max(0.0, all_after.square[c] - all_before.noise[c]) /
                                   (all_before.square[c] - all_before.noise[c]);
      Resampler resampler{std::mt19937_64(seed + c)};
      std::vector<double> draws;
      for (int k = 0; k < kResamples; ++k) {
        double over = 0, under = 0;
        for (const int i : resampler.Draw(runs)) {
          over += a[i].square[c] - b[i].noise[c];
          under += b[i].square[c] - b[i].noise[c];
        }
        if (under > 0) draws.push_back(1 - std::max(0.0, over) / under);
      }
      closure.closed = WithInterval(value, draws);
    }
    closures.push_back(closure);
  }
  return closures;
}

std::optional<Estimate> PooledClosure(const Evaluator& evaluator, const Residuals& before,
                                      const Residuals& after, std::uint64_t seed) {
  const int runs = static_cast<int>(before.size());
  const int count = static_cast<int>(evaluator.channels().size());
  std::vector<double> over(runs), under(runs);
  const ChannelScore all = ScoreChannels(evaluator, before, before);
  double total_over = 0, total_under = 0;
  bool any = false;
  for (int i = 0; i < runs; ++i) {
    const ChannelScore b = ScoreChannels(evaluator, before, before, {i}),
                       a = ScoreChannels(evaluator, after, before, {i});
    for (int c = 0; c < count; ++c) {
      if (all.Excess(c, kNoiseSlack) <= evaluator.channels()[c].delta) continue;
      any = true;
      const double scale = std::pow(evaluator.channels()[c].floor, -2);
      over[i] += scale * (a.square[c] - b.noise[c]);
      under[i] += scale * (b.square[c] - b.noise[c]);
    }
    total_over += over[i];
    total_under += under[i];
  }
  if (!any || total_under <= 0) return std::nullopt;
  Resampler resampler{std::mt19937_64(seed)};
  std::vector<double> draws;
  for (int k = 0; k < kResamples; ++k) {
    double o = 0, u = 0;
    for (const int i : resampler.Draw(runs)) o += over[i], u += under[i];
    if (u > 0) draws.push_back(1 - std::max(0.0, o) / u);
  }
  return WithInterval(1 - std::max(0.0, total_over) / total_under, draws);
}

}  // namespace tendril::gap
