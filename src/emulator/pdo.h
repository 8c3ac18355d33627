// One PDO of a drive: which changes of its communication and mapping objects are allowed, and its packing.
// Knows nothing of the bus, of time and of what the mapped values do.
#pragma once

#include <array>
#include <span>

#include "object_dictionary.h"
#include "tendril/canopen/pdo.h"

namespace tendril::emulator {

class Pdo {
 public:
  Pdo(ObjectDictionary& objects, bool transmit, int number);

  /// True when `address` is part of this PDO's communication or mapping record.
  bool Owns(canopen::ObjectAddress address) const noexcept;
  bool IsCobId(const Object& object) const noexcept { return cob_ == &object; }
  /// 0 when `value` may be written to `address` (which it owns) now, else the abort code. Choices left open
  /// by CiA 301 and maxon: every change needs NMT pre-operational; mapping and inhibit time change only while
  /// the PDO is invalid (bit 31), mapping entries only while the number of entries is 0; a valid PDO's
  /// identifier cannot change; RPDO types are 1 and 255, TPDO types 1, 253 and 255.
  std::uint32_t CheckWrite(canopen::ObjectAddress address, std::int64_t value, bool pre_operational);
  /// Reads the objects; call after each write or restore.
  void Refresh() noexcept;

  bool valid() const noexcept { return valid_; }
  std::uint32_t cob_id() const noexcept { return cob_id_; }
  bool synchronous() const noexcept { return type_ == 1; }
  bool on_event() const noexcept { return type_ == 255; }
  bool remote_allowed() const noexcept { return remote_allowed_; }
  TimeNs inhibit_ns() const noexcept { return inhibit_ns_; }
  int bytes() const noexcept { return bytes_; }

  /// Mapped values to bytes; returns how many.
  int Pack(std::span<std::uint8_t, 8> data) const noexcept;
  /// Bytes to mapped values; values outside an object's range are not taken. `data` holds at least bytes().
  void Unpack(std::span<const std::uint8_t> data) noexcept;

 private:
  std::uint32_t CheckCobId(std::uint32_t value) const;
  std::uint32_t CheckEntry(std::uint32_t value, const Object** object) const;
  std::uint32_t CheckCount(std::int64_t count) const;

  ObjectDictionary& objects_;
  bool transmit_;
  std::uint16_t communication_index_, mapping_index_;
  const Object* cob_;
  const Object* transmission_;
  const Object* inhibit_;  // TPDO only
  const Object* count_;
  std::array<const Object*, canopen::kMaxMappingEntries> entries_{};

  bool valid_ = false, remote_allowed_ = false;
  std::uint32_t cob_id_ = 0;
  int type_ = 0;
  TimeNs inhibit_ns_ = 0;
  int mapped_count_ = 0, bytes_ = 0;
  std::array<Object*, 8> mapped_{};
};

}  // namespace tendril::emulator
