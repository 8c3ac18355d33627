// The amount of an effect that changes the measurements by a given number of noise floors, searched within
// physical bounds.
#include "tendril/experiment/sized_effect.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <sstream>
#include <stdexcept>

namespace tendril::experiment {
namespace {

constexpr double kMostSigma = 1000, kNear = 0.02;
constexpr int kMostTries = 40;

std::invalid_argument Wrong(const std::string& what, const std::string& accepted) {
  return std::invalid_argument(fmt::format("{}; accepted: {}; correct it", what, accepted));
}

double ReadSigma(const std::string& name, const std::string& text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !(std::abs(value) <= kMostSigma) ||
      value == 0) {
    throw Wrong(fmt::format("{}: sigma = '{}'", name, text),
                fmt::format("a size in floors up to {}, negative for less than nominal", kMostSigma));
  }
  return value;
}

/// Four digits of the deviation distinguish amounts sufficiently, and are more readable than seventeen.
double ValueAt(double nominal, double deviation) {
  const int decimals = std::clamp(3 - static_cast<int>(std::floor(std::log10(std::abs(deviation)))), 0, 15);
  return std::stod(fmt::format("{:.{}f}", nominal + deviation, decimals));
}

}  // namespace

std::optional<RequestedSize> ParseRequestedSize(const std::string& text, const RobotParameters& robot) {
  std::istringstream words(text);
  std::string name, rest, sigma, vary, where = "all";
  words >> name;
  bool sized = false;
  for (std::string word; words >> word;) {
    if (word.starts_with("sigma=")) {
      if (sized) throw Wrong(name + ": sigma twice", "one size");
      sigma = word.substr(6);
      sized = true;
    } else if (word.starts_with("vary=")) {
      vary = word.substr(5);
    } else {
      if (word.starts_with("where=")) where = word.substr(6);
      rest += " " + word;
    }
  }
  if (!sized) {
    if (!vary.empty()) throw Wrong(name + ": vary without sigma", "vary=PARAMETER together with sigma=SIZE");
    return std::nullopt;
  }
  RequestedSize requested;
  requested.sigma = ReadSigma(name, sigma);
  const sim::Effect* effect = sim::FindEffect(name);
  if (effect == nullptr) sim::ParseEffect(text, robot);  // throws with the list of effects
  std::string primary;
  bool found = false;
  const sim::Target target = sim::ParseTarget(*effect, where, robot);
  for (const sim::EffectParameter& p : sim::ParametersOf(*effect, target, robot)) {
    if (p.shape) continue;
    primary += (primary.empty() ? "" : ", ") + std::string(p.name);
    if (!found && (vary.empty() || vary == p.name)) {
      requested.parameter = p;
      found = true;
    }
  }
  if (!found) throw Wrong(fmt::format("{}: vary = '{}'", name, vary), primary);
  const sim::EffectParameter& p = requested.parameter;
  if (rest.find(fmt::format(" {}=", p.name)) != std::string::npos) {
    throw Wrong(fmt::format("{}: {} and sigma", name, p.name),
                "one of them, since one follows from the other");
  }
  if ((requested.sigma > 0 ? p.upper : p.lower) == p.nominal) {
    throw Wrong(
        fmt::format("{}: sigma = {}", name, sigma),
        fmt::format("{} sizes, since {} lies in {} .. {} and is nominally {}",
                    requested.sigma > 0 ? "negative" : "positive", p.name, p.lower, p.upper, p.nominal));
  }
  requested.setting = sim::ParseEffect(fmt::format("{}{} {}={}", name, rest, p.name, p.nominal), robot);
  return requested;
}

SizedEffect AmountFor(const RequestedSize& requested,
                      const std::function<gap::EffectRuler::Size(const EffectSetting&)>& size_of) {
  const sim::EffectParameter& p = requested.parameter;
  const double sign = requested.sigma > 0 ? 1 : -1, target = std::abs(requested.sigma);
  const double bound = std::abs((requested.sigma > 0 ? p.upper : p.lower) - p.nominal);
  const auto setting_at = [&](double deviation) {
    EffectSetting setting = requested.setting;
    for (auto& [name, value] : setting.values) {
      if (name == p.name) value = std::clamp(ValueAt(p.nominal, sign * deviation), p.lower, p.upper);
    }
    return setting;
  };

  SizedEffect best;
  best.setting = requested.setting;
  double nearest = HUGE_VAL;
  // Too small below `low`, too large above `high`; `beyond` cannot be simulated.
  double low = 0, low_size = 0, high = 0, high_size = 0, beyond = HUGE_VAL;
  std::string why;
  double x = std::min(p.typical > 0 ? p.typical : 0.1 * bound, bound);
  for (int k = 0; k < kMostTries; ++k) {
    const EffectSetting setting = setting_at(x);
    gap::EffectRuler::Size size;
    bool simulated = true;
    try {
      size = size_of(setting);
    } catch (const std::runtime_error& e) {
      simulated = false;
      why = e.what();
    }
    if (simulated) {
      const double off = size.floors > 0 ? std::abs(std::log(size.floors / target)) : HUGE_VAL;
      if (off <= nearest) {
        nearest = off;
        best.setting = setting;
        best.size = size;
      }
      if (off < kNear) break;
      if (size.floors < target) {
        low = x;
        low_size = size.floors;
        if (x >= bound) break;
      } else {
        high = x;
        high_size = size.floors;
      }
    } else {
      beyond = x;
    }
    const double top = std::min(high > 0 ? high : bound, beyond);
    // Amounts equal to four digits are the same.
    if (low > 0 && top - low <= 1e-4 * top && (high > 0 || beyond < HUGE_VAL)) break;
    if (high == 0 && beyond == HUGE_VAL) {
      const double grow = low_size > 0 ? std::clamp(target / low_size, 1.1, 10.0) : 4;
      x = std::min(bound, x * grow);
    } else if (high > 0 && low == 0) {
      const double shrink = std::clamp(target / high_size, 1e-3, 0.9);
      x = high * shrink;
      if (x < 1e-9 * bound) break;
    } else if (high > 0 && low_size > 0) {
      const double share = std::log(target / low_size) / std::log(high_size / low_size);
      // Kept off the ends, so that the bracket shrinks.
      x = low * std::pow(high / low, std::clamp(share, 0.1, 0.9));
    } else {
      x = low > 0 ? std::sqrt(low * top) : top / 4;
    }
  }
  if (nearest > 2.5 * kNear || best.size.floors == 0) {
    if (best.size.floors == 0 && beyond < HUGE_VAL) {
      throw std::runtime_error(
          fmt::format("{}: no amount of it could be simulated: {}", requested.setting.name, why));
    }
    best.limited = low >= bound        ? fmt::format("that is the bound of {}", p.name)
                   : beyond < HUGE_VAL ? "more of it cannot be simulated: " + why
                                       : "its size jumps there";
  }
  return best;
}

}  // namespace tendril::experiment
