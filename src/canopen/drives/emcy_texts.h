// The check that the texts of a table of emergency codes fit a line of the master. Knows no drive.
#pragma once

#include <algorithm>
#include <span>
#include <string>

#include "tendril/canopen/emcy.h"
#include "tendril/canopen/master.h"

namespace tendril::canopen {

/// True when a line of the master holds each entry's texts whole, with node, code and register around them.
constexpr bool EmcyTextsFit(std::span<const EmcyInfo> table) {
  std::size_t longest = 0;
  for (const EmcyInfo& info : table) {
    const auto length = [](const char* text) { return std::char_traits<char>::length(text); };
    longest = std::max(longest, length(info.text) + length(info.cause) + length(info.remedy));
  }
  return longest + sizeof("node 127: EMCY 0xFFFF (register 0xFF) : ; ") <= sizeof(EventText);
}

}  // namespace tendril::canopen
