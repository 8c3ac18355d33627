// A mean that outliers do not change.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace tendril::gap {

/// The upper of the two middle values for an even count; 0 of no values.
inline double Median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace tendril::gap
