// The values behind one drive's object dictionary: current, power-on and factory. Types, access and ranges
// come from the one object table. Knows nothing of what a value does.
#pragma once

#include <vector>

#include "tendril/canopen/epos4.h"

namespace tendril::emulator {

struct Object {
  const canopen::ObjectEntry* entry = nullptr;
  std::int64_t value = 0;     // as the type says, signed or not; strings keep theirs in the table
  std::int64_t factory = 0;   // what "load" brings back
  std::int64_t power_on = 0;  // factory, or what was stored last

  canopen::ObjectAddress address() const { return entry->address(); }
  int bytes() const { return canopen::TypeBytes(entry->type); }
};

class ObjectDictionary {
 public:
  explicit ObjectDictionary(int node_id);

  /// nullptr when there is no such entry. Pointers stay good as long as the dictionary lives.
  Object* Find(canopen::ObjectAddress address) noexcept;
  /// The same for entries that the emulator itself needs; throws std::logic_error when the table lacks one.
  Object& At(std::uint16_t index, std::uint8_t sub);

  /// Values of first..last back to those of power-on.
  void Restore(std::uint16_t first, std::uint16_t last) noexcept;
  /// What can be stored becomes the power-on value.
  void Store() noexcept;
  /// What follows the node id and was left at its default moves along.
  void MoveNodeId(int from, int to) noexcept;
  /// The factory values become those of power-on; current values stay until the next reset.
  void Load() noexcept;

 private:
  std::vector<Object> objects_;
};

}  // namespace tendril::emulator
