// PDO mapping: one table for remapping, encoding, decoding and the start-up check. Knows the drive's objects
// by number only, and no port.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "tendril/can/can_port.h"
#include "tendril/canopen/wire.h"

namespace tendril::canopen {

struct MappingEntry {
  std::uint16_t index = 0;
  std::uint8_t sub = 0;
  std::uint8_t bits = 0;  // a multiple of 8, at most 64
  bool is_signed = false;
};

/// Value of the mapping objects 0x16xx and 0x1Axx: index, sub-index, length in bits.
constexpr std::uint32_t MappingValue(const MappingEntry& entry) {
  return (static_cast<std::uint32_t>(entry.index) << 16) | (static_cast<std::uint32_t>(entry.sub) << 8) |
         entry.bits;
}

inline constexpr int kMaxMappingEntries = 12;  // that a drive of ours has room for
inline constexpr int kMaxPdoEntries = 4;       // that ours use

/// One PDO as we use it.
struct PdoLayout {
  bool transmit = false;            // seen from the drive
  int number = 1;                   // 1..4
  std::uint8_t transmission = 0;    // object sub 2: 1 every SYNC, 255 on change
  std::uint16_t inhibit_100us = 0;  // TPDO sub 3; written to what is sent on change, and to where it exists
  int count = 0;
  std::array<MappingEntry, kMaxPdoEntries> entries{};

  constexpr int bytes() const {
    int bits = 0;
    for (int i = 0; i < count; ++i) bits += entries[static_cast<std::size_t>(i)].bits;
    return bits / 8;
  }
  constexpr std::uint16_t communication_index() const {
    return static_cast<std::uint16_t>((transmit ? 0x1800 : 0x1400) + number - 1);
  }
  constexpr std::uint16_t mapping_index() const {
    return static_cast<std::uint16_t>((transmit ? 0x1A00 : 0x1600) + number - 1);
  }
};

/// The COB-ID of a PDO, in its communication parameters.
constexpr bool IsPdoCobId(ObjectAddress a) {
  return a.sub == 1 && ((a.index >= 0x1400 && a.index < 0x1600) || (a.index >= 0x1800 && a.index < 0x1A00));
}

using PdoValues = std::array<std::int64_t, kMaxPdoEntries>;

/// Place of an object in a layout's values; -1: it is not mapped there.
constexpr int Slot(const PdoLayout& layout, std::uint16_t index, std::uint8_t sub) {
  for (int i = 0; i < layout.count; ++i) {
    const MappingEntry& entry = layout.entries[static_cast<std::size_t>(i)];
    if (entry.index == index && entry.sub == sub) return i;
  }
  return -1;
}

/// Packs one value per entry, first entry first, least significant byte first. Returns the bytes used (at
/// most 8).
int EncodePdo(std::span<const MappingEntry> entries, std::span<const std::int64_t> values,
              std::span<std::uint8_t, 8> data) noexcept;
/// The inverse; false when fewer than the mapped bytes arrived. Further bytes are ignored, as CiA 301 allows.
bool DecodePdo(std::span<const MappingEntry> entries, std::span<const std::uint8_t> data,
               std::span<std::int64_t> values) noexcept;

}  // namespace tendril::canopen
