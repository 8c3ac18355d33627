// The SDO actions between a drive's boot-up message and readiness, as a list. Executes nothing; the list of a
// kind of drive is in its profile.
#pragma once

#include <cstdint>

#include "tendril/canopen/wire.h"

namespace tendril::canopen {

/// Node id of the master's heartbeat.
inline constexpr int kMasterNodeId = 127;

struct BootAction {
  enum class Kind : std::uint8_t {
    kWrite,          // write `value`, read it back
    kDisablePdo,     // read the COB-ID, write it with the invalid bit set, read it back
    kExpect,         // read: must lie in value..max
    kExpectBits,     // read: the bits of mask `max` must be `value`
    kExpectProduct,  // read: must be one of the configured product codes
    kConfirm,        // read repeatedly until it is `value`
    kNote,           // read and keep (serial number, statusword, error code)
    kStart,          // NMT start, then wait for the first feedback TPDO
  };
  const char* step = "";
  Kind kind = Kind::kNote;
  ObjectAddress address;
  std::int64_t value = 0, max = 0;
};

}  // namespace tendril::canopen
