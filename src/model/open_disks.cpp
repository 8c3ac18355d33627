#include "tendril/model/open_disks.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>

namespace tendril::model {
namespace {

// Of a bent unit's two ends; a turn by 2 pi has no rotation vector of its own.
bool IsOpen(const Body& body, int disk, double middle_m, double unit_length_m, const StrainVector& strains) {
  const double u = strains[0], v = strains[1], w = strains[2];
  if (std::hypot(std::hypot(u, v), w) >= 2 * std::numbers::pi) return false;
  const double length_m = unit_length_m * (1 + strains[3]);
  if (!(length_m > 0)) return false;
  for (int j = 0; j < body.tendons(); ++j) {
    if (body.tendon_end_disk(j) <= disk) continue;
    const Eigen::Vector3d hole = body.parameters().HoleOf(j, middle_m);
    if (!(length_m > u * hole.x() + v * hole.y())) return false;
  }
  return true;
}

std::string Number(double value) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.6g", value);
  return text.data();
}

}  // namespace

std::optional<int> FirstClosedUnit(const Body& body, ConstVectorRef q) {
  double begin_m = 0;
  int disk = 0;
  for (int s = 0; s < body.sections(); ++s) {
    const double length_m = body.parameters().sections[static_cast<std::size_t>(s)].unit_length_m;
    for (int i = body.first_unit(s); i < body.end_unit(s); ++i) {
      if (!IsOpen(body, disk, begin_m + length_m / 2, length_m, body.StrainsOf(i, q))) return i;
      begin_m += length_m;
      if (i == body.disk_unit(disk)) ++disk;
    }
  }
  return std::nullopt;
}

std::string WhyDisksClose(const Body& body, ConstVectorRef q) {
  const auto unit = FirstClosedUnit(body, q);
  if (!unit) return {};
  const StrainVector strains = body.StrainsOf(*unit, q);
  std::string text =
      "unit " + std::to_string(*unit + 1) + " is bent by " + Number(strains.head<2>().norm()) + " rad";
  if (body.bends_only()) return text + ": its disks would cut through each other; bend it less";
  if (body.twists(*unit)) text += ", twisted by " + Number(strains[2]) + " rad";
  if (body.stretches(*unit)) text += ", stretched by " + Number(strains[3]) + " of its length";
  if (body.shears(*unit)) text += ", sheared by " + Number(strains.tail<2>().norm());
  return text + ": its ends would cut through each other; strain it less";
}

}  // namespace tendril::model
