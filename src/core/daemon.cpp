// What the configuration's plain numbers and texts are checked by in more than one room.
#include "tendril/core/daemon.h"

#include <algorithm>

namespace tendril {

bool IsChannelPrefix(std::string_view prefix) noexcept {
  return !prefix.empty() && prefix.size() <= 40 && std::all_of(prefix.begin(), prefix.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
  });
}

}  // namespace tendril
