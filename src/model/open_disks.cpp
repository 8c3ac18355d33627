#include "tendril/model/open_disks.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>

namespace tendril::model {
namespace {

bool IsOpen(const BodyParameters& body, std::size_t section, double u, double v) {
  if (std::hypot(u, v) >= 2 * std::numbers::pi) return false;
  for (std::size_t k = section; k < body.sections.size(); ++k) {
    for (const TendonRoute& t : body.sections[k].tendons) {
      const double towards = u * std::cos(t.angle_rad) + v * std::sin(t.angle_rad);
      if (!(body.sections[section].unit_length_m > t.radius_m * towards)) return false;
    }
  }
  return true;
}

}  // namespace

std::optional<int> FirstClosedUnit(const Body& body, ConstVectorRef q) {
  for (int s = 0; s < body.sections(); ++s) {
    for (int i = body.first_unit(s); i < body.end_unit(s); ++i) {
      if (!IsOpen(body.parameters(), static_cast<std::size_t>(s), q[2 * i], q[2 * i + 1])) return i;
    }
  }
  return std::nullopt;
}

std::string WhyDisksClose(const Body& body, ConstVectorRef q) {
  const auto unit = FirstClosedUnit(body, q);
  if (!unit) return {};
  std::array<char, 160> text{};
  std::snprintf(text.data(), text.size(),
                "unit %d is bent by %.6g rad: its disks would cut through each other; bend it less",
                *unit + 1, std::hypot(q[2 * *unit], q[2 * *unit + 1]));
  return text.data();
}

}  // namespace tendril::model
