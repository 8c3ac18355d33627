// Effects given by their size instead of their parameters: "backlash where=tendon:2 sigma=3". Knows nothing
// of how runs are made or diagnosed.
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "tendril/core/robot.h"
#include "tendril/gap/effect_size.h"
#include "tendril/sim/effects.h"

namespace tendril::experiment {

/// An effect whose amount is to be determined.
struct RequestedSize {
  EffectSetting setting;             // the parameter at its nominal value, others as given
  sim::EffectParameter parameter{};  // the one that is varied
  double sigma = 0;                  // floors; negative: below the nominal value
};

/// An effect in the form of sim::ParseEffect with sigma=S, and vary=PARAMETER for a parameter other than the
/// first; empty without sigma. Throws std::invalid_argument as sim::ParseEffect does.
std::optional<RequestedSize> ParseRequestedSize(const std::string& text, const RobotParameters& robot);

struct SizedEffect {
  EffectSetting setting;
  gap::EffectRuler::Size size;
  /// Empty, or why it does not have the requested size.
  std::string limited;
};

/// The amount of that size, within 2 %, with a deviation of four digits: a bracket from the parameter's
/// typical deviation on, then regula falsi on logarithms. Limited to the parameter's bound and to what can be
/// simulated. `size_of` throws std::runtime_error for what cannot be simulated.
SizedEffect AmountFor(const RequestedSize& requested,
                      const std::function<gap::EffectRuler::Size(const EffectSetting&)>& size_of);

}  // namespace tendril::experiment
