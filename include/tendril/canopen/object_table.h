// A drive's object dictionary as a table: type, access, default, range, mapping. Of each kind of drive it
// defines the emulator's dictionary and the widths that the master reads and writes. Knows no drive.
#pragma once

#include <cstdint>
#include <deque>
#include <span>
#include <string>
#include <vector>

#include "tendril/canopen/wire.h"

namespace tendril::canopen {

/// kOther: a type that no control needs (domain, real number, 64 bits); such a value is neither read nor
/// written.
enum class DataType : std::uint8_t { kI8, kI16, kI32, kU8, kU16, kU32, kString, kOther };
enum class Access : std::uint8_t { kConst, kReadOnly, kReadWrite, kWriteOnly };
enum class Mapping : std::uint8_t { kNone, kReceive, kTransmit, kBoth };

/// Bytes of a value; 0 for a string, which has its own length, and for other types.
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
    case DataType::kOther:
      return 0;
  }
  return 0;
}
constexpr bool TypeSigned(DataType type) { return type <= DataType::kI32; }
constexpr std::int64_t TypeMin(DataType type) {
  return TypeSigned(type) ? -(std::int64_t{1} << (8 * TypeBytes(type) - 1)) : 0;
}
constexpr std::int64_t TypeMax(DataType type) {
  return TypeBytes(type) == 0 ? 0
                              : (std::int64_t{1} << (8 * TypeBytes(type) - (TypeSigned(type) ? 1 : 0))) - 1;
}

struct ObjectEntry {
  std::uint16_t index = 0;
  std::uint8_t sub = 0;
  DataType type = DataType::kU32;
  Access access = Access::kReadOnly;
  Mapping mapping = Mapping::kNone;
  bool plus_node_id = false;    // the node id is added to default_value
  bool states_default = false;  // the drive's documentation gives default_value
  std::int64_t default_value = 0;
  std::int64_t min = 0, max = 0;  // writable range; the type's range where the drive states none
  const char* name = "";
  const char* text = nullptr;  // value of a string
  int line = 0;                // of the EDS file; 0: of no file
  ObjectAddress address() const { return {index, sub}; }
};

class ObjectTable {
 public:
  ObjectTable() = default;
  ObjectTable(ObjectTable&&) = default;
  ObjectTable& operator=(ObjectTable&&) = default;

  /// Whole range of the type, no default stated. Entries come in any order, before the first look-up.
  ObjectEntry& Add(ObjectAddress address, DataType type, Access access, const char* name);
  /// A text that lives as long as the table.
  const char* Keep(std::string text) { return texts_.emplace_back(std::move(text)).c_str(); }
  /// To be called once, after the last Add; throws std::invalid_argument when two entries have one address.
  void Sort();

  /// Of an entry that is there; nothing happens where there is none.
  void SetDefault(ObjectAddress address, std::int64_t value) noexcept;

  /// Every object, ascending by index and sub-index. Sub-index 0 of a record or array is an entry like any
  /// other.
  std::span<const ObjectEntry> entries() const noexcept { return entries_; }
  /// nullptr when the drive has no such entry.
  const ObjectEntry* Find(ObjectAddress address) const noexcept;
  /// True when any sub-index of `index` exists (distinguishes "no object" from "no sub-index").
  bool HasIndex(std::uint16_t index) const noexcept;

 private:
  std::vector<ObjectEntry> entries_;
  std::deque<std::string> texts_;
};

/// Signatures that objects 0x1010 and 0x1011 take.
inline constexpr std::uint32_t kSignatureSave = 0x65766173;  // "save"
inline constexpr std::uint32_t kSignatureLoad = 0x64616F6C;  // "load"
inline constexpr std::int8_t kModeCyclicSynchronousTorque = 10;

}  // namespace tendril::canopen
