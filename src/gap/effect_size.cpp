// Size of an effect: residuals with and without it, over the noise floors of the diagnosis.
#include "tendril/gap/effect_size.h"

#include <cmath>
#include <map>

#include "evaluator.h"
#include "tendril/core/parallel.h"

namespace tendril::gap {
namespace {

using Quantity = Channel::Quantity;

/// A position has three axes and one floor.
std::string PlaceOf(const Channel& channel) {
  if (channel.quantity == Quantity::kTipPosition) return "tip position";
  if (channel.quantity == Quantity::kTipDirection) return "tip direction";
  if (channel.quantity == Quantity::kBending) return "bending";
  return channel.name;
}

}  // namespace

struct EffectRuler::Impl {
  Evaluator evaluator;
  int threads;
};

EffectRuler::EffectRuler(const DataSet& runs, int threads)
    : impl_(new Impl{Evaluator(runs, {.threads = threads}), threads}) {}
EffectRuler::~EffectRuler() = default;

EffectRuler::Size EffectRuler::Of(const EffectSetting& effect) const {
  const Evaluator& evaluator = impl_->evaluator;
  RobotParameters robot = evaluator.nominal();
  robot.effects.push_back(effect);
  const unsigned cuts = evaluator.CutsOf(*sim::FindEffect(effect.name));
  const int runs = static_cast<int>(evaluator.runs().size());
  Residuals with(runs);
  ParallelFor(runs, impl_->threads, [&](int i) { with[i] = evaluator.At(robot, cuts, {i})[i]; });

  struct Sum {
    double square = 0, weight = 0, floor2 = 0;
    int axes = 0;
  };
  std::map<std::string, Sum> places;
  for (int c = 0; c < static_cast<int>(evaluator.channels().size()); ++c) {
    const Channel& channel = evaluator.channels()[c];
    Sum& sum = places[PlaceOf(channel)];
    ++sum.axes;
    sum.floor2 += channel.floor * channel.floor;
    for (int i = 0; i < runs; ++i) {
      const Eigen::VectorXd &r = with[i][c], &nominal = evaluator.AtNominal()[i][c],
                            &variance = evaluator.Variance()[i][c];
      for (Eigen::Index w = 0; w < r.size(); ++w) {
        if (!std::isfinite(variance[w])) continue;
        // Moments when a tendon catches or a motor breaks loose are uncertain and get little weight.
        const double weight = 1 / (variance[w] + channel.floor * channel.floor);
        sum.square += weight * (r[w] - nominal[w]) * (r[w] - nominal[w]);
        sum.weight += weight;
      }
    }
  }
  Size size;
  for (const auto& [place, sum] : places) {
    if (sum.weight <= 0) continue;
    const double floors = std::sqrt(sum.axes * sum.square / sum.weight / sum.floor2);
    if (floors > size.floors) size = {floors, place};
  }
  return size;
}

}  // namespace tendril::gap
