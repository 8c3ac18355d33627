#include "tendril/core/load_cell_place.h"

namespace tendril {

std::string_view LoadCellPlaceText(LoadCellPlace place) {
  for (const auto& [text, of] : kLoadCellPlaces) {
    if (of == place) return text;
  }
  return "none";
}

std::optional<LoadCellPlace> FindLoadCellPlace(std::string_view text) {
  for (const auto& [of, place] : kLoadCellPlaces) {
    if (of == text) return place;
  }
  return std::nullopt;
}

}  // namespace tendril
