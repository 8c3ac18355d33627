// What reading and writing the drive's objects does. Choices left open by CiA 301, CiA 402 and the makers are
// noted beside the code. Knows nothing of frames.
#include <algorithm>
#include <cstring>

#include "drive.h"
#include "tendril/canopen/sdo.h"

namespace tendril::emulator {

namespace sdo_abort = canopen::sdo_abort;
using canopen::NmtState;

std::uint32_t Drive::Read(canopen::ObjectAddress address, std::span<std::uint8_t> to, std::size_t* size) {
  ShowProcessValues();
  const Object* object = objects_.Find(address);
  if (object == nullptr)
    return profile_->objects.HasIndex(address.index) ? sdo_abort::kNoSubIndex : sdo_abort::kNoObject;
  if (object->entry->access == canopen::Access::kWriteOnly) return sdo_abort::kWriteOnly;
  if (object->bytes() == 0) {
    const char* text = object->entry->text == nullptr ? "" : object->entry->text;
    *size = std::min(to.size(), std::strlen(text));
    std::copy_n(text, *size, to.begin());
    return 0;
  }
  *size = static_cast<std::size_t>(object->bytes());
  canopen::PutLe(to, static_cast<std::uint64_t>(object->value), object->bytes());
  return 0;
}

std::uint32_t Drive::Write(canopen::ObjectAddress address, std::span<const std::uint8_t> from, bool exact) {
  Object* object = objects_.Find(address);
  if (object == nullptr)
    return profile_->objects.HasIndex(address.index) ? sdo_abort::kNoSubIndex : sdo_abort::kNoObject;
  const canopen::Access access = object->entry->access;
  if (access == canopen::Access::kConst || access == canopen::Access::kReadOnly) return sdo_abort::kReadOnly;
  const auto width = static_cast<std::size_t>(object->bytes());
  if (exact && from.size() > width) return sdo_abort::kLengthHigh;
  if (from.size() < width) return sdo_abort::kLengthLow;
  const std::uint64_t raw = canopen::GetLe(from, object->bytes());
  const std::int64_t value = canopen::TypeSigned(object->entry->type)
                                 ? canopen::SignExtend(raw, 8 * object->bytes())
                                 : static_cast<std::int64_t>(raw);
  if (value > object->entry->max) return sdo_abort::kValueHigh;
  if (value < object->entry->min) return sdo_abort::kValueLow;
  if (const std::uint32_t error = CheckWrite(*object, value); error != 0) return error;
  object->value = value;
  AfterWrite(*object);
  return 0;
}

std::uint32_t Drive::CheckWrite(const Object& object, std::int64_t value) {
  const canopen::ObjectAddress address = object.address();
  for (auto* pdos : {&rpdos_, &tpdos_}) {
    for (Pdo& pdo : *pdos) {
      if (!pdo.Owns(address)) continue;
      const std::uint32_t error = pdo.CheckWrite(address, value, nmt_ == NmtState::kPreOperational);
      return error != 0 ? error : CheckCollision(pdo, object, static_cast<std::uint32_t>(value));
    }
  }
  // Currents and heat may change in operation, pole pairs and torque constant may not.
  if (&object == &pole_pairs_ || &object == &torque_constant_)
    return stage_.powered() ? sdo_abort::kDeviceState : 0;
  switch (address.index) {
    case 0x1010:
    case 0x1011:
      if (value != (address.index == 0x1010 ? canopen::kSignatureSave : canopen::kSignatureLoad)) {
        return sdo_abort::kTransfer;
      }
      return stage_.powered() ? sdo_abort::kDeviceState : 0;
    case 0x1016:
      return CheckConsumer(object, static_cast<std::uint32_t>(value));
    case 0x6076:
    case 0x6402:
      return stage_.powered() ? sdo_abort::kDeviceState : 0;
    case 0x6060:
      return SupportedMode(value) ? 0 : sdo_abort::kValueRange;
    default:
      return 0;
  }
}

/// An identifier used by two PDOs, or by a PDO and SYNC or our own EMCY, is ambiguous. A real drive reports
/// error 8150; refusing the write is our choice.
std::uint32_t Drive::CheckCollision(const Pdo& pdo, const Object& object, std::uint32_t value) const {
  if (!pdo.IsCobId(object) || (value & canopen::kPdoInvalid) != 0) return 0;
  const std::uint32_t id = value & 0x7FFu;
  bool taken = id == canopen::kSyncCobId || id == canopen::kEmcyBase + static_cast<std::uint32_t>(node_id_);
  for (const auto* pdos : {&rpdos_, &tpdos_}) {
    for (const Pdo& other : *pdos) taken = taken || (&other != &pdo && other.valid() && other.cob_id() == id);
  }
  return taken ? sdo_abort::kIncompatible : 0;
}

/// Two consumers of one node would contradict each other (CiA 301).
std::uint32_t Drive::CheckConsumer(const Object& object, std::uint32_t value) const {
  const std::uint32_t node = value >> 16, time_ms = value & 0xFFFFu;
  if (node > static_cast<std::uint32_t>(canopen::kMaxNodeId)) return sdo_abort::kValueRange;
  for (const Consumer& consumer : consumers_) {
    const auto other = static_cast<std::uint32_t>(consumer.setting->value);
    if (consumer.setting != &object && node != 0 && time_ms != 0 && (other & 0xFFFFu) != 0 &&
        (other >> 16) == node) {
      return sdo_abort::kIncompatible;
    }
  }
  return 0;
}

void Drive::AfterWrite(const Object& object) {
  const std::uint16_t index = object.entry->index;
  const std::uint8_t sub = object.entry->sub;
  if (index >= 0x1400 && index <= 0x1BFF) {
    for (auto* pdos : {&rpdos_, &tpdos_}) {
      for (Pdo& pdo : *pdos) {
        if (pdo.Owns(object.address())) pdo.Refresh();
      }
    }
    return;
  }
  if (&object == &nominal_current_ || &object == &torque_constant_) RefreshRatedTorque();
  switch (index) {
    case 0x1003:
      for (std::uint8_t i = 1; i <= kHistory; ++i) objects_.At(0x1003, i).value = 0;
      break;
    case 0x1010:  // reading returns the capability: save, restore on command
    case 0x1011:
      objects_.At(index, sub).value = object.entry->default_value;
      if (index == 0x1010) {
        objects_.Store();
      } else {
        objects_.Load();
      }
      break;
    case 0x1016:
      for (Consumer& consumer : consumers_) {
        if (consumer.setting == &object) consumer.heard = false;
      }
      break;
    case 0x1017:
      next_heartbeat_ns_ = now_ns_ + heartbeat_time_.value * kNsPerMs;
      break;
    case 0x6040:
    case 0x6060:
      if (index == 0x6060) {
        mode_shown_.value = mode_.value;
      } else {
        ActOnControlword();
      }
      RunStage(now_ns_);
      break;
    default:
      break;
  }
}

}  // namespace tendril::emulator
