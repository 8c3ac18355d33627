#include "tendril/model/coordinate_names.h"

namespace tendril::model {

std::vector<std::string> CoordinateNames(const Body& body) {
  std::vector<std::string> names;
  for (int i = 0; i < body.units(); ++i) {
    const auto add = [&](const char* strain) { names.push_back(strain + std::to_string(i + 1)); };
    add("u");
    add("v");
    if (body.twists(i)) add("w");
    if (body.stretches(i)) add("e");
    if (!body.shears(i)) continue;
    add("sx");
    add("sy");
  }
  return names;
}

}  // namespace tendril::model
