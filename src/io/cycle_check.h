// Distinguishes a cycle's record from damaged bytes that decode as one. Knows what a controller may write.
#pragma once

#include <cstdint>

#include "tendril/io/wire.h"

namespace tendril::io {

/// Of one daemon's cycles, in the order in which they were recorded.
class CycleCheck {
 public:
  /// False for values that no controller writes but damaged bytes may contain.
  bool Possible(const tendril_lcm::cycle_t& m);

 private:
  // Cycles of another program in the same log count from its own start and keep its own offset.
  bool ClocksAgree(const tendril_lcm::cycle_t& m);

  bool known_ = false;
  std::int64_t epoch_us_ = 0, cycle_ = 0;  // offset from the cycle clock to that of the stamps
};

}  // namespace tendril::io
