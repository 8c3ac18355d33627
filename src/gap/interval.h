// Intervals of 95 %, and values as exact as they are known.
#pragma once

#include <cmath>

namespace tendril::gap {

/// Half of one, in standard deviations.
inline constexpr double kTwoSided95 = 1.959964;

/// The value without digits far beyond its standard deviation, which would only burden its reader.
inline double RoundedTo(double value, double deviation) {
  constexpr double kFiner = 0.01;
  if (!(deviation > 0)) return value;
  const double unit = std::pow(10, std::floor(std::log10(kFiner * deviation)));
  return std::round(value / unit) * unit;
}

}  // namespace tendril::gap
