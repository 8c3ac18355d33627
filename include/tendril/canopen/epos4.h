// The drive's object dictionary as a table: type, access, default, range, mapping. It defines the emulator's
// dictionary, the widths that the master reads and writes, and the EDS.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "tendril/canopen/wire.h"

namespace tendril::canopen {

enum class DataType : std::uint8_t { kI8, kI16, kI32, kU8, kU16, kU32, kString };
enum class Access : std::uint8_t { kConst, kReadOnly, kReadWrite };
enum class Mapping : std::uint8_t { kNone, kReceive, kTransmit, kBoth };

/// Bytes of a value; 0 for a string, which has its own length.
constexpr int TypeBytes(DataType type) {
  switch (type) {
    case DataType::kI8:
    case DataType::kU8:
      return 1;
    case DataType::kI16:
    case DataType::kU16:
      return 2;
    case DataType::kI32:
    case DataType::kU32:
      return 4;
    case DataType::kString:
      return 0;
  }
  return 0;
}
constexpr bool TypeSigned(DataType type) { return type <= DataType::kI32; }

struct ObjectEntry {
  std::uint16_t index = 0;
  std::uint8_t sub = 0;
  DataType type = DataType::kU32;
  Access access = Access::kReadOnly;
  Mapping mapping = Mapping::kNone;
  bool plus_node_id = false;  // the node id is added to default_value
  std::int64_t default_value = 0;
  std::int64_t min = 0, max = 0;  // writable range; the type's range where the drive states none
  const char* name = "";
  const char* text = nullptr;  // value of a string
  ObjectAddress address() const { return {index, sub}; }
};

/// Every object, ascending by index and sub-index. Sub-index 0 of a record or array is an entry like any
/// other.
std::span<const ObjectEntry> ObjectTable();
/// nullptr when the drive has no such entry.
const ObjectEntry* FindObject(ObjectAddress address) noexcept;
/// True when any sub-index of `index` exists (distinguishes "no object" from "no sub-index").
bool HasIndex(std::uint16_t index) noexcept;

inline constexpr std::uint32_t kMaxonVendorId = 0x000000FB;
inline constexpr std::int8_t kModeCyclicSynchronousTorque = 10;
inline constexpr std::uint32_t kSignatureSave = 0x65766173;  // "save"
inline constexpr std::uint32_t kSignatureLoad = 0x64616F6C;  // "load"

/// 0x6076 [uNm] from a nominal current and a torque constant, as the drive computes it (rounded to nearest,
/// after parameter files of real drives).
constexpr std::uint32_t RatedTorque_uNm(std::uint32_t nominal_current_mA,
                                        std::uint32_t torque_constant_uNmpA) {
  return static_cast<std::uint32_t>(
      (static_cast<std::uint64_t>(nominal_current_mA) * torque_constant_uNmpA + 500u) / 1000u);
}

/// The table as an electronic data sheet (CiA 306), for other CANopen tools.
std::string EdsText();

}  // namespace tendril::canopen
