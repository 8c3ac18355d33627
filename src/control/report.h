// How a stage reports a status of the cycle.
#pragma once

#include "tendril/core/cycle.h"

namespace tendril::control {

/// Records a status, and separately the most severe one.
inline void Report(CycleOutput& output, Status status) noexcept {
  if (static_cast<int>(status) > static_cast<int>(output.status)) output.status = status;
  for (Status& s : output.reported) {
    if (s == Status::kOk) s = status;
    if (s == status) return;
  }
}

}  // namespace tendril::control
