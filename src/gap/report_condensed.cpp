// Thins a diagnosis to what a page can plot.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <iterator>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "tendril/gap/report.h"

namespace tendril::gap {
namespace {

constexpr std::size_t kPointsInAll = 24000, kMostPoints = 1200, kFewestPoints = 200;

// Six digits: finer than any plot, and half the size.
void Round(std::vector<double>& curve) {
  for (double& v : curve) {
    if (!std::isfinite(v)) continue;
    const std::string text = fmt::format("{:.6g}", v);
    std::from_chars(text.data(), text.data() + text.size(), v);
  }
}

void Keep(std::vector<double>& curve, const std::vector<std::size_t>& indices) {
  if (curve.empty()) return;
  std::vector<double> kept;
  kept.reserve(indices.size());
  for (const std::size_t i : indices) kept.push_back(curve[i]);
  curve = std::move(kept);
}

// Of each interval of samples, the first and those with extreme measurements and simulation errors.
void Thin(Overlay& o, std::size_t most) {
  const std::size_t samples = o.time_s.size();
  for (const auto* curve : {&o.measured, &o.before, &o.after, &o.x}) {
    if (!curve->empty() && curve->size() != samples) {
      throw std::runtime_error(
          fmt::format("overlay of {}, {}: curves of different lengths", o.run, o.channel));
    }
  }
  if (samples <= most) return;
  const std::size_t stretches = most / 5;
  std::set<std::size_t> indices{samples - 1};
  const auto missed = [&](std::size_t i) {
    return (o.measured.empty() ? 0.0 : o.measured[i]) - (o.before.empty() ? 0.0 : o.before[i]);
  };
  const auto measured = [&](std::size_t i) { return o.measured.empty() ? 0.0 : o.measured[i]; };
  for (std::size_t s = 0; s < stretches; ++s) {
    const std::size_t begin = s * samples / stretches, end = (s + 1) * samples / stretches;
    std::array<std::size_t, 5> chosen;
    chosen.fill(begin);
    for (std::size_t i = begin; i < end; ++i) {
      if (measured(i) < measured(chosen[1])) chosen[1] = i;
      if (measured(i) > measured(chosen[2])) chosen[2] = i;
      if (missed(i) < missed(chosen[3])) chosen[3] = i;
      if (missed(i) > missed(chosen[4])) chosen[4] = i;
    }
    indices.insert(chosen.begin(), chosen.end());
  }
  while (indices.size() > most) indices.erase(std::prev(indices.end(), 2));
  const std::vector<std::size_t> kept(indices.begin(), indices.end());
  for (auto* curve : {&o.time_s, &o.measured, &o.before, &o.after, &o.x}) Keep(*curve, kept);
}

}  // namespace

Diagnosis Condensed(const Diagnosis& diagnosis) {
  Diagnosis d = diagnosis;
  for (const char* always : {"no_gap", "unknown"}) {
    if (std::none_of(d.causes.begin(), d.causes.end(), [&](const Cause& c) { return c.effect == always; })) {
      d.causes.emplace_back().effect = always;
    }
  }
  const auto rank = [](const Cause& c) { return std::isfinite(c.p) ? c.p : -1; };
  std::stable_sort(d.causes.begin(), d.causes.end(),
                   [&](const Cause& a, const Cause& b) { return rank(a) > rank(b); });
  const std::size_t most =
      std::clamp(kPointsInAll / std::max<std::size_t>(d.overlays.size(), 1), kFewestPoints, kMostPoints);
  for (Overlay& o : d.overlays) {
    Thin(o, most);
    for (auto* curve : {&o.time_s, &o.measured, &o.before, &o.after, &o.x}) Round(*curve);
  }
  for (ConditionMap& m : d.maps) {
    for (auto* curve : {&m.at, &m.mean, &m.low, &m.high, &m.after}) Round(*curve);
  }
  for (Profile& p : d.profiles) {
    for (auto* curve : {&p.value, &p.score}) Round(*curve);
  }
  return d;
}

}  // namespace tendril::gap
