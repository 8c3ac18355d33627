// The values behind one drive's object dictionary: current, power-on and factory. Types, access and ranges
// come from the profile's object table. Knows nothing of what a value does.
#pragma once

#include <algorithm>
#include <vector>

#include "tendril/canopen/drive_profile.h"

namespace tendril::emulator {

struct Object {
  const canopen::ObjectEntry* entry = nullptr;
  std::int64_t value = 0;     // signed or unsigned by type; strings stay in the table
  std::int64_t factory = 0;   // value restored by "load"
  std::int64_t power_on = 0;  // factory, or stored last

  canopen::ObjectAddress address() const { return entry->address(); }
  int bytes() const { return canopen::TypeBytes(entry->type); }
};

class ObjectDictionary {
 public:
  ObjectDictionary(const canopen::DriveProfile& profile, int node_id);

  /// nullptr when the drive shows no such entry. Pointers stay valid as long as the dictionary lives.
  Object* Find(canopen::ObjectAddress address) noexcept;
  /// What the emulation works with, by its address in an EPOS4: motor data, fault options, PDOs. Where the
  /// drive shows no such object, or has its maker's own at that place, this is a value that no bus sees.
  /// Throws std::logic_error for an address that an EPOS4 lacks too.
  Object& At(std::uint16_t index, std::uint8_t sub);

  /// Restores the power-on values of first..last.
  void Restore(std::uint16_t first, std::uint16_t last) noexcept;
  /// Storable values become the power-on values.
  void Store() noexcept;
  /// Values that depend on the node id and are at their default follow its change.
  void MoveNodeId(int from, int to) noexcept;
  /// The factory values become those of power-on; current values stay until the next reset.
  void Load() noexcept;

 private:
  template <class Act>
  void Each(Act act) {
    for (auto* objects : {&shown_, &inner_}) std::for_each(objects->begin(), objects->end(), act);
  }

  std::vector<Object> shown_, inner_;  // ascending
};

}  // namespace tendril::emulator
