#include "tendril/model/held_directions.h"

#include <array>
#include <cmath>
#include <numbers>
#include <string>

#include "tendril/model/pull_cone.h"

namespace tendril::model {
namespace {

std::string Degrees(double angle_rad) {
  return std::to_string(std::lround(angle_rad * 180 / std::numbers::pi) % 360);
}

std::string Count(std::size_t tendons) {
  static constexpr std::array kWords{"no", "one", "two", "three", "four", "five", "six"};
  const std::string number = tendons < kWords.size() ? kWords[tendons] : std::to_string(tendons);
  return number + (tendons == 1 ? " tendon" : " tendons");
}

std::string Clause(const BodyParameters& body, int section) {
  const PullCone cone = PullConeOf(body, section);
  if (cone.kind == PullCone::Kind::kPlane) return "";
  const std::size_t tendons = body.sections[static_cast<std::size_t>(section)].tendons.size();
  const std::string bends = Count(tendons) + (tendons == 1 ? " bends it only " : " bend it only "),
                    from = Degrees(cone.from_rad), to = Degrees(cone.from_rad + cone.width_rad);
  if (cone.kind == PullCone::Kind::kLine)
    return bends + "in the plane through " + from + " and " + to + " deg";
  const std::string ways = cone.kind == PullCone::Kind::kRay ? from : from + " to " + to;
  return bends + "towards " + ways + " deg, the backbone brings it back";
}

}  // namespace

std::string HeldDirections(const BodyParameters& body) {
  std::string all;
  for (int k = 0; k < static_cast<int>(body.sections.size()); ++k) {
    const std::string clause = Clause(body, k);
    if (clause.empty()) continue;
    if (!all.empty()) all += "; ";
    if (body.sections.size() > 1) all += "section " + std::to_string(k + 1) + ": ";
    all += clause;
  }
  return all;
}

}  // namespace tendril::model
