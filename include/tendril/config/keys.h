// Every key of the configuration files with its meaning and accepted values, from the files' descriptions,
// for the reference and its tests. Reads no file.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace tendril::config {

struct Key {
  enum class Kind { kValue, kBlock, kList, kMapping };

  std::string path;     // "bus.cycle_ns"; for entries of a list "body.sections[].units"
  std::string meaning;  // a sentence
  Kind kind = Kind::kValue;
  std::string accepted;  // "0.0001 .. 1", "paper, equilibrium"; for a list the number of entries
  std::string unit;      // "N·m"; empty: none
  std::optional<std::string> otherwise;  // the default where the key may be omitted; none: required
  std::string without_block;             // for a block that may be omitted: the default
};

std::vector<Key> RobotFileKeys();
std::vector<Key> DaemonFileKeys();

struct FaultKeys {
  std::string name, meaning;  // "drop"
  std::vector<Key> keys;
};
/// Every kind of fault that a scenario file, or a command to the plant, may have.
std::vector<FaultKeys> KeysOfFaults();

/// "N·m" for "rated_torque_Nm"; empty when the key has no unit suffix.
std::string UnitOfKey(std::string_view key);

}  // namespace tendril::config
