// The requests of a program by name, as `tendril send` and `tendril home` have them.
#pragma once

#include <optional>
#include <string_view>

#include "tendril/core/cycle.h"

namespace tendril::python {

inline std::optional<ModeRequest> FindModeRequest(std::string_view name) {
  if (name == "arm") return ModeRequest::kArm;
  if (name == "disarm") return ModeRequest::kDisarm;
  if (name == "hold") return ModeRequest::kHold;
  if (name == "clear") return ModeRequest::kClear;
  if (name == "home") return ModeRequest::kHome;
  return std::nullopt;
}

}  // namespace tendril::python
