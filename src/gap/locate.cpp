// Excess over the noise by place, its significance from blocks of time, and what load cells read wrong.
#include "locate.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>

#include "median.h"
#include "score.h"

namespace tendril::gap {
namespace {

using Quantity = Channel::Quantity;

// Floors and materialities from which a gap of a few seconds counts.
constexpr double kPlainFloors = 2, kPlainDeltas = 3;
constexpr double kMotionWindow_s = 1.0;  // slower is shape (C4), faster is motion (C5)

/// One-sided p-value of blocks with these sums having a mean above zero by chance.
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

/// p-value of the largest block being one of the others, whose scatter is estimated from their median with an
/// uncertainty of a third. Detects a gap of a few seconds, which a mean over all blocks hides in its own
/// scatter.
double LargestBlock(std::vector<double> blocks) {
  constexpr double kTrust = 3;
  const std::size_t n = blocks.size();
  if (n < 8) return 1;
  const double largest = *std::max_element(blocks.begin(), blocks.end());
  const double median = Median(blocks);
  for (double& b : blocks) b = std::abs(b - median);
  const double scatter = 1.4826 * Median(std::move(blocks));
  if (scatter <= 0) return largest > median ? 0 : 1;
  const double sigmas = (largest - median) / (kTrust * scatter);
  return std::min(1.0, static_cast<double>(n) * 0.5 * std::erfc(sigmas / std::sqrt(2.0)));
}

struct Part {
  CutFinding finding;
  std::vector<int> channels;
  bool fast = false;  // of a tip channel: faster than kMotionWindow_s; else slower
};

/// Slow part of a residual: the mean over a window about each sample.
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
      double share = 1;  // of white noise, that the filter passes
      const double white = evaluator.WhiteVariance(i, c);
      const bool at_rest = evaluator.runs()[i].signals.at_rest;  // everything is shape
      if (at_rest && part.fast) continue;
      if (channels[c].cut == sim::Cut::kShape && !at_rest) {
        const int half = std::max(1, static_cast<int>(0.5 * kMotionWindow_s / evaluator.window_s(i, c)));
        const Eigen::VectorXd slow = Slow(r, v, half);
        share = part.fast ? 1 - 1.0 / (2 * half + 1) : 1.0 / (2 * half + 1);
        r = part.fast ? Eigen::VectorXd(r - slow) : slow;
      }
      const int per_block =
          at_rest ? static_cast<int>(evaluator.Correlated(i, c)) : evaluator.WindowsPerBlock(i, c);
      const Eigen::VectorXd expected =
          v.unaryExpr([&](double variance) { return variance - (1 - share) * std::min(white, variance); });
      const Eigen::VectorXd squares = CalmSquares(r, v, expected, evaluator.window_s(i, c));
      double block = 0;
      int in_block = 0;
      for (int w = 0; w < r.size(); ++w) {
        if (std::isfinite(v[w])) {
          const double weight = 1 / (v[w] + std::pow(channels[c].floor, 2));
          square += weight * squares[w];
          noise += weight * expected[w];
          total += weight;
          block += weight * (squares[w] - kNoiseSlack * expected[w]);
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
  const double excess = std::sqrt(std::max(0.0, square - kNoiseSlack * noise));
  f.excess = excess > f.delta;
  // In a slow log the seconds in which motors reverse have larger errors, because the motion between samples
  // is unknown.
  const bool slow = f.cut < sim::Cut::kTendon && evaluator.runs().front().signals.step_s >= kSlowLog_s;
  if (!slow && excess > std::max(kPlainFloors * f.floor, kPlainDeltas * f.delta))
    f.p_value = std::min(f.p_value, LargestBlock(blocks));
}

}  // namespace

std::string PlaceOf(const Channel& channel, const Evaluator& evaluator) {
  if (channel.quantity == Quantity::kBending) return fmt::format("section:{}", channel.index / 2 + 1);
  const bool tip = channel.cut == sim::Cut::kShape;
  return tip ? fmt::format("section:{}", evaluator.nominal().body.sections.size())
             : fmt::format("tendon:{}", channel.index + 1);
}

std::string_view NameOf(Quantity quantity) {
  switch (quantity) {
    case Quantity::kTorque:
      return "torque";
    case Quantity::kTension:
      return "tension";
    case Quantity::kTipPosition:
      return "tip position";
    case Quantity::kTipDirection:
      return "tip direction";
    case Quantity::kBending:
      return "bending";
  }
  return "";
}

namespace {

Part PartOf(const Evaluator& evaluator, sim::Cut cut, std::vector<int> channels, bool fast) {
  const Channel& channel = evaluator.channels()[channels.front()];
  Part part;
  part.finding.cut = cut;
  part.finding.where = PlaceOf(channel, evaluator);
  part.finding.quantity = NameOf(channel.quantity);
  part.finding.unit = channel.unit;
  part.channels = std::move(channels);
  part.fast = fast;
  return part;
}

/// Every run is a list of states at rest: nothing moves between rows.
bool OnlyStates(const Evaluator& evaluator) {
  return std::all_of(evaluator.runs().begin(), evaluator.runs().end(),
                     [](const PreparedRun& run) { return run.signals.at_rest; });
}

/// The places to compare: each channel of a tendon, and the channels of the tip or of a section together,
/// slow and fast.
std::vector<Part> PartsOf(const Evaluator& evaluator) {
  const auto& channels = evaluator.channels();
  std::vector<Part> parts;
  std::vector<std::vector<int>> shapes(2 +
                                       evaluator.nominal().body.sections.size());  // channels of one place
  for (int c = 0; c < static_cast<int>(channels.size()); ++c) {
    const auto& channel = channels[c];
    if (channel.quantity == Quantity::kTipPosition) {
      shapes[0].push_back(c);
    } else if (channel.quantity == Quantity::kTipDirection) {
      shapes[1].push_back(c);
    } else if (channel.quantity == Quantity::kBending) {
      shapes[2 + static_cast<std::size_t>(channel.index) / 2].push_back(c);
    } else {
      parts.push_back(PartOf(evaluator, channel.cut, {c}, false));
    }
  }
  for (const bool fast : {false, true}) {
    if (fast && OnlyStates(evaluator)) continue;
    for (const std::vector<int>& list : shapes) {
      if (list.empty()) continue;
      parts.push_back(PartOf(evaluator, fast ? sim::Cut::kMotion : sim::Cut::kShape, list, fast));
    }
  }
  return parts;
}

/// Keeps the excesses that pass Benjamini and Hochberg's procedure over all places.
void ControlDiscoveries(std::vector<Part>& parts, double false_discoveries) {
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
}

/// C0: the time stamps.
CutFinding OfClock(const Evaluator& evaluator) {
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
  return f;
}

/// The cuts that these logs do not show, and what they lack.
std::vector<CutFinding> NotMeasured(const Evaluator& evaluator) {
  std::vector<CutFinding> findings;
  const auto missing = [&](sim::Cut cut, const char* why) {
    CutFinding f;
    f.cut = cut;
    f.where = "all";
    f.measured = false;
    f.note = why;
    findings.push_back(f);
  };
  if (!evaluator.has(kC1)) missing(sim::Cut::kCurrentLoop, "needs target and actual torque");
  if (!evaluator.has(kC2)) missing(sim::Cut::kDrivetrain, "needs actual torque and motor positions");
  if (!evaluator.has(kC3)) missing(sim::Cut::kTendon, "needs load cells and motor positions");
  if (evaluator.has(kBody) && OnlyStates(evaluator))
    missing(sim::Cut::kMotion, "needs rows closer than 0.2 s");
  if (!evaluator.has(kBody)) {
    missing(sim::Cut::kShape, "needs a tracker");
    missing(sim::Cut::kMotion, "needs a tracker");
  }
  return findings;
}

/// C6: the residual of tendon j that is common to C2 and C3 belongs to its load cell; empty without both.
std::optional<CutFinding> OfCell(const Evaluator& evaluator, const Residuals& residuals, int j,
                                 double false_discoveries) {
  const auto& channels = evaluator.channels();
  int c2 = -1, c3 = -1;
  for (int c = 0; c < static_cast<int>(channels.size()); ++c) {
    if (channels[c].quantity != Quantity::kTension || channels[c].index != j) continue;
    (channels[c].cut == sim::Cut::kDrivetrain ? c2 : c3) = c;
  }
  if (c2 < 0 || c3 < 0) return std::nullopt;
  double product = 0, total = 0;
  std::vector<double> blocks;
  for (int i = 0; i < static_cast<int>(residuals.size()); ++i) {
    const auto &a = residuals[i][c2], &b = residuals[i][c3];
    const auto &va = evaluator.Variance()[i][c2], &vb = evaluator.Variance()[i][c3];
    const int per_block = evaluator.WindowsPerBlock(i, c2);
    double block = 0;
    for (int w = 0; w < std::min(a.size(), b.size()); ++w) {
      if (std::isfinite(va[w]) && std::isfinite(vb[w])) {
        const double weight = 1 / (va[w] + vb[w]);
        // The cell's white noise is in both.
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
  if (total <= 0) return std::nullopt;
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
  return f;
}

}  // namespace

std::vector<CutFinding> Locate(const Evaluator& evaluator, const Residuals& residuals,
                               double false_discoveries) {
  std::vector<Part> parts = PartsOf(evaluator);
  for (Part& part : parts) Measure(evaluator, residuals, part);
  ControlDiscoveries(parts, false_discoveries);

  std::vector<CutFinding> location{OfClock(evaluator)};
  for (const Part& part : parts) location.push_back(part.finding);
  for (CutFinding& missing : NotMeasured(evaluator)) location.push_back(std::move(missing));
  for (int j = 0; j < evaluator.nominal().body.tendons(); ++j) {
    if (auto cell = OfCell(evaluator, residuals, j, false_discoveries)) location.push_back(std::move(*cell));
  }
  std::stable_sort(location.begin(), location.end(),
                   [](const CutFinding& a, const CutFinding& b) { return a.cut < b.cut; });
  return location;
}

std::vector<char> ChannelsWithGap(const Evaluator& evaluator, const std::vector<CutFinding>& location) {
  std::vector<char> with_gap;
  for (const Channel& channel : evaluator.channels()) {
    with_gap.push_back(std::any_of(location.begin(), location.end(), [&](const CutFinding& f) {
      const bool cut =
          f.cut == channel.cut || (f.cut == sim::Cut::kMotion && channel.cut == sim::Cut::kShape);
      return f.excess && cut && f.quantity == NameOf(channel.quantity) &&
             f.where == PlaceOf(channel, evaluator);
    }));
  }
  if (std::find(with_gap.begin(), with_gap.end(), 1) == with_gap.end())
    std::fill(with_gap.begin(), with_gap.end(), 1);
  return with_gap;
}

}  // namespace tendril::gap
