// The values behind one drive's object dictionary.
// Knows nothing of what a value does.
#include "object_dictionary.h"

#include <algorithm>
#include <stdexcept>
#include <string>

namespace tendril::emulator {
namespace {

using canopen::ObjectAddress;

bool Before(ObjectAddress a, ObjectAddress b) {
  return a.index != b.index ? a.index < b.index : a.sub < b.sub;
}

/// Commands, targets and the error history restart with the drive.
bool Stored(const canopen::ObjectEntry& entry) {
  if (entry.access != canopen::Access::kReadWrite) return false;
  switch (entry.index) {
    case 0x1003:
    case 0x1010:
    case 0x1011:
    case 0x6040:
    case 0x6071:
    case 0x607A:
    case 0x60B2:
    case 0x60FF:
      return false;
    default:
      return true;
  }
}

}  // namespace

ObjectDictionary::ObjectDictionary(int node_id) {
  for (const canopen::ObjectEntry& entry : canopen::ObjectTable()) {
    const std::int64_t value = entry.default_value + (entry.plus_node_id ? node_id : 0);
    objects_.push_back({.entry = &entry, .value = value, .factory = value, .power_on = value});
  }
}

Object* ObjectDictionary::Find(ObjectAddress address) noexcept {
  const auto at = std::lower_bound(objects_.begin(), objects_.end(), address,
                                   [](const Object& o, ObjectAddress a) { return Before(o.address(), a); });
  return at != objects_.end() && at->address() == address ? &*at : nullptr;
}

Object& ObjectDictionary::At(std::uint16_t index, std::uint8_t sub) {
  Object* object = Find({index, sub});
  if (object == nullptr) {
    throw std::logic_error("object table lacks index " + std::to_string(index) + " sub " +
                           std::to_string(sub));
  }
  return *object;
}

void ObjectDictionary::Restore(std::uint16_t first, std::uint16_t last) noexcept {
  for (Object& o : objects_) {
    if (o.entry->index >= first && o.entry->index <= last) o.value = o.power_on;
  }
}

void ObjectDictionary::Store() noexcept {
  for (Object& o : objects_) {
    if (Stored(*o.entry)) o.power_on = o.value;
  }
}

void ObjectDictionary::MoveNodeId(int from, int to) noexcept {
  for (Object& o : objects_) {
    if (!o.entry->plus_node_id || o.entry->index == 0x2000) continue;
    const std::int64_t before = o.entry->default_value + from, after = o.entry->default_value + to;
    for (std::int64_t* value : {&o.value, &o.factory, &o.power_on}) {
      if (*value == before) *value = after;
    }
  }
}

void ObjectDictionary::Load() noexcept {
  for (Object& o : objects_) {
    if (Stored(*o.entry)) o.power_on = o.factory;
  }
}

}  // namespace tendril::emulator
