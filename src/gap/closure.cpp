// Closed fractions by channel and pooled over all channels with a gap, and their bootstrap.
#include "closure.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

#include "locate.h"
#include "score.h"

namespace tendril::gap {
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
                              const std::vector<char>& with_gap, std::uint64_t seed) {
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
    if (with_gap[c] && all_before.Excess(c, kNoiseSlack) > channel.delta) {
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
                                      const Residuals& after, const std::vector<char>& with_gap,
                                      std::uint64_t seed, const std::vector<int>& only) {
  std::vector<int> chosen = only;
  if (chosen.empty()) {
    chosen.resize(before.size());
    std::iota(chosen.begin(), chosen.end(), 0);
  }
  const int runs = static_cast<int>(chosen.size());
  const int count = static_cast<int>(evaluator.channels().size());
  std::vector<double> over(runs), under(runs);
  const ChannelScore all = ScoreChannels(evaluator, before, before);
  double total_over = 0, total_under = 0;
  bool any = false;
  for (int i = 0; i < runs; ++i) {
    const ChannelScore b = ScoreChannels(evaluator, before, before, {chosen[i]}),
                       a = ScoreChannels(evaluator, after, before, {chosen[i]});
    for (int c = 0; c < count; ++c) {
      if (!with_gap[c] || all.Excess(c, kNoiseSlack) <= evaluator.channels()[c].delta) continue;
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

std::vector<FamilyClosure> ClosuresByFamily(const Evaluator& evaluator, const Residuals& before,
                                            const Residuals& after, const std::vector<char>& with_gap,
                                            std::uint64_t seed) {
  std::vector<FamilyClosure> families;
  std::vector<std::vector<int>> members;
  for (int i = 0; i < static_cast<int>(evaluator.runs().size()); ++i) {
    const std::string& name = evaluator.runs()[i].family;
    auto at = std::find_if(families.begin(), families.end(), [&](const auto& f) { return f.family == name; });
    if (at == families.end()) {
      families.emplace_back().family = name;
      members.emplace_back();
      at = families.end() - 1;
    }
    members[static_cast<std::size_t>(at - families.begin())].push_back(i);
  }
  for (std::size_t f = 0; f < families.size(); ++f) {
    FamilyClosure& family = families[f];
    family.runs = static_cast<int>(members[f].size());
    const ChannelScore b = ScoreChannels(evaluator, before, before, members[f]),
                       a = ScoreChannels(evaluator, after, before, members[f]);
    double was = 0, is = 0, noise = 0;
    for (int c = 0; c < static_cast<int>(evaluator.channels().size()); ++c) {
      if (evaluator.channels()[c].quantity != Channel::Quantity::kTipPosition) continue;
      was += b.square[c];
      is += a.square[c];
      noise += b.noise[c];
    }
    family.before_m = std::sqrt(was);
    family.after_m = std::sqrt(is);
    family.floor_m = std::sqrt(noise);
    family.closed = PooledClosure(evaluator, before, after, with_gap, seed, members[f]);
  }
  return families;
}

}  // namespace tendril::gap
