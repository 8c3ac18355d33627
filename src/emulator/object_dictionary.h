// The values behind one drive's object dictionary: current, power-on and factory. Types, access and ranges
// come from the one object table. Knows nothing of what a value does.
#pragma once

#include <vector>

#include "tendril/canopen/epos4.h"

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
  explicit ObjectDictionary(int node_id);

  /// nullptr when there is no such entry. Pointers stay valid as long as the dictionary lives.
  Object* Find(canopen::ObjectAddress address) noexcept;
  /// The same for entries that the emulator itself needs; throws std::logic_error when the table lacks one.
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
  std::vector<Object> objects_;
};

}  // namespace tendril::emulator
