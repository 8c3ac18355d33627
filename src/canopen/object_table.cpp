// A sorted table of objects. Knows no drive.
#include "tendril/canopen/object_table.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <stdexcept>

namespace tendril::canopen {
namespace {

bool Before(ObjectAddress a, ObjectAddress b) {
  return a.index != b.index ? a.index < b.index : a.sub < b.sub;
}

}  // namespace

ObjectEntry& ObjectTable::Add(ObjectAddress address, DataType type, Access access, const char* name) {
  ObjectEntry entry;
  entry.index = address.index;
  entry.sub = address.sub;
  entry.type = type;
  entry.access = access;
  entry.min = TypeMin(type);
  entry.max = TypeMax(type);
  entry.name = name;
  entries_.push_back(entry);
  return entries_.back();
}

void ObjectTable::Sort() {
  std::sort(entries_.begin(), entries_.end(),
            [](const ObjectEntry& a, const ObjectEntry& b) { return Before(a.address(), b.address()); });
  const auto twice = std::adjacent_find(
      entries_.begin(), entries_.end(),
      [](const ObjectEntry& a, const ObjectEntry& b) { return a.address() == b.address(); });
  if (twice == entries_.end()) return;
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "object 0x%04X:%02X is there twice", twice->index, twice->sub);
  throw std::invalid_argument(text.data());
}

void ObjectTable::SetDefault(ObjectAddress address, std::int64_t value) noexcept {
  for (ObjectEntry& entry : entries_) {
    if (entry.address() != address) continue;
    entry.default_value = value;
    entry.states_default = true;
  }
}

const ObjectEntry* ObjectTable::Find(ObjectAddress address) const noexcept {
  const auto at =
      std::lower_bound(entries_.begin(), entries_.end(), address,
                       [](const ObjectEntry& e, ObjectAddress a) { return Before(e.address(), a); });
  return at != entries_.end() && at->address() == address ? &*at : nullptr;
}

bool ObjectTable::HasIndex(std::uint16_t index) const noexcept {
  const auto at =
      std::lower_bound(entries_.begin(), entries_.end(), ObjectAddress{index, 0},
                       [](const ObjectEntry& e, ObjectAddress a) { return Before(e.address(), a); });
  return at != entries_.end() && at->index == index;
}

}  // namespace tendril::canopen
