// The first place in the order of the chain; see the header.
#include "first_place.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "tendril/sim/effects.h"

namespace tendril::gap {
namespace {

/// The cut that a cause belongs to, given the place of the load cell.
sim::Cut CutOf(const Cause& cause, LoadCellPlace place) {
  const sim::Effect* effect = sim::FindEffect(cause.effect);
  return place == LoadCellPlace::kRobotSide ? effect->cut_robot_side : effect->cut;
}

}  // namespace

void MarkFirst(Diagnosis& d, LoadCellPlace place) {
  std::optional<sim::Cut> cut;
  for (const auto& cause : d.accepted) {
    const sim::Cut its = CutOf(cause, place);
    if (!cut || its < *cut) cut = its;
  }
  CutFinding* chosen = nullptr;
  // A disagreement between cells and encoders is not a place of the tracker.
  const bool tracker = cut == sim::Cut::kSensors &&
                       std::all_of(d.accepted.begin(), d.accepted.end(),
                                   [](const Cause& cause) { return cause.effect.starts_with("tracker_"); });
  // A cause on one tendon marks that tendon, otherwise the largest excess is marked.
  const auto better = [&](const CutFinding& f) {
    const auto rank = [&](const CutFinding& x) {
      return std::pair(cut && x.where == d.accepted.front().where, x.excess_sigma);
    };
    return chosen == nullptr || rank(f) > rank(*chosen);
  };
  if (cut) {
    for (auto& f : d.location) {
      if (f.cut == *cut && f.measured && !tracker && better(f)) chosen = &f;
    }
    if (chosen == nullptr && *cut == sim::Cut::kSensors) {
      CutFinding f;
      f.cut = sim::Cut::kSensors;
      f.where = "all";
      f.quantity = "tracker";
      f.excess = true;
      f.note = "accepted as the cause; it shows at the cuts that use this sensor";
      for (const auto& other : d.location) f.excess_sigma = std::max(f.excess_sigma, other.excess_sigma);
      d.location.push_back(f);
      chosen = &d.location.back();
    }
    if (chosen != nullptr) chosen->excess = true;
  }
  // Without a cause, the first place in the chain. An excess in the body also distorts the tendons' stretch
  // derived from its shape, whereas differing tendons leave the path from load cell to shape unaffected.
  if (chosen == nullptr) {
    const bool body = std::any_of(d.location.begin(), d.location.end(), [](const CutFinding& f) {
      return f.excess && (f.cut == sim::Cut::kShape || f.cut == sim::Cut::kMotion);
    });
    for (auto& f : d.location) {
      if (!f.excess || (body && f.cut == sim::Cut::kTendon)) continue;
      // Lost samples are the gap only where there is no other.
      if (chosen == nullptr || chosen->cut == sim::Cut::kClock || (f.cut == chosen->cut && better(f)))
        chosen = &f;
    }
  }
  if (chosen != nullptr) chosen->first = true;
}

void MarkUnrepeated(Diagnosis& d) {
  for (auto& f : d.location) {
    f.first = f.cut == d.repeatability->cut && f.where == d.repeatability->where &&
              f.quantity == d.repeatability->quantity;
  }
}

}  // namespace tendril::gap
