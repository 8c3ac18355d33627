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

bool MakersOwn(std::uint16_t index) { return index >= 0x2000 && index < 0x6000; }

Object* FindIn(std::vector<Object>& objects, ObjectAddress address) {
  const auto at = std::lower_bound(objects.begin(), objects.end(), address,
                                   [](const Object& o, ObjectAddress a) { return Before(o.address(), a); });
  return at != objects.end() && at->address() == address ? &*at : nullptr;
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

ObjectDictionary::ObjectDictionary(const canopen::DriveProfile& profile, int node_id) {
  const auto add = [node_id](std::vector<Object>& to, const canopen::ObjectEntry& entry, std::int64_t value) {
    value += entry.plus_node_id ? node_id : 0;
    to.push_back({.entry = &entry, .value = value, .factory = value, .power_on = value});
  };
  for (const canopen::ObjectEntry& entry : profile.objects.entries()) add(shown_, entry, entry.default_value);
  const canopen::DriveProfile& epos4 = *canopen::Epos4Profile();
  if (&profile == &epos4) return;
  for (const canopen::ObjectEntry& entry : epos4.objects.entries()) {
    if (!MakersOwn(entry.index) && profile.objects.Find(entry.address()) != nullptr) continue;
    // PDOs that the drive does not have do not exist, and map nothing.
    const bool pdo = entry.index >= 0x1400 && entry.index < 0x1C00;
    const std::int64_t none = canopen::IsPdoCobId(entry.address()) ? canopen::kPdoInvalid : 0;
    add(inner_, entry, pdo ? none : entry.default_value);
  }
}

Object* ObjectDictionary::Find(ObjectAddress address) noexcept { return FindIn(shown_, address); }

Object& ObjectDictionary::At(std::uint16_t index, std::uint8_t sub) {
  Object* object = FindIn(inner_, {index, sub});
  if (object == nullptr) object = Find({index, sub});
  if (object == nullptr) {
    throw std::logic_error("object table lacks index " + std::to_string(index) + " sub " +
                           std::to_string(sub));
  }
  return *object;
}

void ObjectDictionary::Restore(std::uint16_t first, std::uint16_t last) noexcept {
  Each([=](Object& o) {
    if (o.entry->index >= first && o.entry->index <= last) o.value = o.power_on;
  });
}

void ObjectDictionary::Store() noexcept {
  Each([](Object& o) {
    if (Stored(*o.entry)) o.power_on = o.value;
  });
}

void ObjectDictionary::MoveNodeId(int from, int to) noexcept {
  Each([=](Object& o) {
    if (!o.entry->plus_node_id || o.entry->index == 0x2000) return;
    const std::int64_t before = o.entry->default_value + from, after = o.entry->default_value + to;
    for (std::int64_t* value : {&o.value, &o.factory, &o.power_on}) {
      if (*value == before) *value = after;
    }
  });
}

void ObjectDictionary::Load() noexcept {
  Each([](Object& o) {
    if (Stored(*o.entry)) o.power_on = o.factory;
  });
}

}  // namespace tendril::emulator
