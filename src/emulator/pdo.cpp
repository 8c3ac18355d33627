// One PDO of a drive: the rules of remapping, and packing without look-ups.
// Knows nothing of the bus, of time and of what the mapped values do.
#include "pdo.h"

#include <algorithm>

#include "tendril/canopen/sdo.h"

namespace tendril::emulator {
namespace {

namespace sdo_abort = canopen::sdo_abort;

constexpr std::uint32_t kExtendedId = 0x20000000u;

/// CiA 301's restricted CAN identifiers: NMT, SDO, heartbeat and reserved ones.
bool Restricted(std::uint32_t id) {
  return id <= 0x07F || (id >= 0x101 && id <= 0x180) || (id >= 0x581 && id <= 0x5FF) ||
         (id >= 0x601 && id <= 0x67F) || id >= 0x6E0;
}

}  // namespace

Pdo::Pdo(ObjectDictionary& objects, bool transmit, int number)
    : objects_(objects),
      transmit_(transmit),
      communication_index_(static_cast<std::uint16_t>((transmit ? 0x1800 : 0x1400) + number - 1)),
      mapping_index_(static_cast<std::uint16_t>((transmit ? 0x1A00 : 0x1600) + number - 1)),
      cob_(&objects.At(communication_index_, 1)),
      transmission_(&objects.At(communication_index_, 2)),
      inhibit_(transmit ? &objects.At(communication_index_, 3) : nullptr),
      count_(&objects.At(mapping_index_, 0)) {
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    entries_[i] = &objects.At(mapping_index_, static_cast<std::uint8_t>(i + 1));
  }
  Refresh();
}

bool Pdo::Owns(canopen::ObjectAddress address) const noexcept {
  return address.index == communication_index_ || address.index == mapping_index_;
}

std::uint32_t Pdo::CheckWrite(canopen::ObjectAddress address, std::int64_t value, bool pre_operational) {
  if (!pre_operational) return sdo_abort::kDeviceState;
  if (address.index == communication_index_) {
    if (address.sub == 1) return CheckCobId(static_cast<std::uint32_t>(value));
    if (address.sub == 2) {
      const bool known = value == 1 || value == 255 || (transmit_ && value == 253);
      return known ? 0 : sdo_abort::kValueRange;
    }
    return valid_ ? sdo_abort::kDeviceState : 0;
  }
  if (valid_) return sdo_abort::kDeviceState;
  if (address.sub == 0) return CheckCount(value);
  if (count_->value != 0) return sdo_abort::kDeviceState;
  const Object* object = nullptr;
  return value == 0 ? 0 : CheckEntry(static_cast<std::uint32_t>(value), &object);
}

std::uint32_t Pdo::CheckCobId(std::uint32_t value) const {
  const std::uint32_t id = value & 0x7FFu;
  if ((value & kExtendedId) || (value & 0x1FFFF800u) || Restricted(id)) return sdo_abort::kValueRange;
  const bool becomes_valid = (value & canopen::kPdoInvalid) == 0;
  if (becomes_valid && valid_ && id != cob_id_) return sdo_abort::kValueRange;
  return 0;
}

std::uint32_t Pdo::CheckEntry(std::uint32_t value, const Object** object) const {
  const canopen::ObjectAddress address{static_cast<std::uint16_t>(value >> 16),
                                       static_cast<std::uint8_t>(value >> 8)};
  const Object* found = objects_.Find(address);
  if (found == nullptr) return sdo_abort::kNoObject;
  const canopen::Mapping mapping = found->entry->mapping;
  const bool this_way = mapping == canopen::Mapping::kBoth ||
                        mapping == (transmit_ ? canopen::Mapping::kTransmit : canopen::Mapping::kReceive);
  if (!this_way || static_cast<int>(value & 0xFFu) != 8 * found->bytes()) return sdo_abort::kNotMappable;
  *object = found;
  return 0;
}

std::uint32_t Pdo::CheckCount(std::int64_t count) const {
  if (count > canopen::kMaxMappingEntries) return sdo_abort::kValueHigh;
  int bytes = 0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
    const Object* object = nullptr;
    const std::uint32_t error = CheckEntry(static_cast<std::uint32_t>(entries_[i]->value), &object);
    if (error != 0) return error;
    bytes += object->bytes();
  }
  return bytes > 8 ? sdo_abort::kPdoLength : 0;
}

void Pdo::Refresh() noexcept {
  const auto cob = static_cast<std::uint32_t>(cob_->value);
  valid_ = (cob & canopen::kPdoInvalid) == 0;
  remote_allowed_ = (cob & canopen::kPdoNoRtr) == 0;
  cob_id_ = cob & 0x7FFu;
  type_ = static_cast<int>(transmission_->value);
  inhibit_ns_ = inhibit_ == nullptr ? 0 : inhibit_->value * 100 * kNsPerUs;
  mapped_count_ = 0;
  bytes_ = 0;
  // A data sheet may give defaults that map more than fits, or objects that it does not have.
  const auto count = std::min(static_cast<std::size_t>(count_->value), entries_.size());
  for (std::size_t i = 0; i < count; ++i) {
    const auto value = static_cast<std::uint32_t>(entries_[i]->value);
    Object* object =
        objects_.Find({static_cast<std::uint16_t>(value >> 16), static_cast<std::uint8_t>(value >> 8)});
    if (object == nullptr || object->bytes() == 0 || bytes_ + object->bytes() > 8) continue;
    mapped_[static_cast<std::size_t>(mapped_count_++)] = object;
    bytes_ += object->bytes();
  }
}

int Pdo::Pack(std::span<std::uint8_t, 8> data) const noexcept {
  std::size_t at = 0;
  for (int i = 0; i < mapped_count_; ++i) {
    const Object& object = *mapped_[static_cast<std::size_t>(i)];
    canopen::PutLe(data.subspan(at), static_cast<std::uint64_t>(object.value), object.bytes());
    at += static_cast<std::size_t>(object.bytes());
  }
  return static_cast<int>(at);
}

void Pdo::Unpack(std::span<const std::uint8_t> data) noexcept {
  std::size_t at = 0;
  for (int i = 0; i < mapped_count_; ++i) {
    Object& object = *mapped_[static_cast<std::size_t>(i)];
    const std::uint64_t raw = canopen::GetLe(data.subspan(at), object.bytes());
    at += static_cast<std::size_t>(object.bytes());
    const std::int64_t value = canopen::TypeSigned(object.entry->type)
                                   ? canopen::SignExtend(raw, 8 * object.bytes())
                                   : static_cast<std::int64_t>(raw);
    if (value >= object.entry->min && value <= object.entry->max) object.value = value;
  }
}

}  // namespace tendril::emulator
