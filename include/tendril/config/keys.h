// Every key of the configuration files with what it means and accepts, as the files' descriptions have them:
// for the reference and for whoever checks it. Reads no file.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace tendril::config {

struct Key {
  enum class Kind { kValue, kBlock, kList, kMapping };

  std::string path;     // "bus.cycle_ns"; of a list's entries "body.sections[].units"
  std::string meaning;  // a sentence
  Kind kind = Kind::kValue;
  std::string accepted;                  // "0.0001 .. 1", "paper, equilibrium"; of a list how many entries
  std::string unit;                      // "N·m"; empty: none
  std::optional<std::string> otherwise;  // what holds where the key is left out; none: it must be given
  std::string without_block;             // of a block that may be left out whole: what holds then
};

std::vector<Key> RobotFileKeys();
std::vector<Key> DaemonFileKeys();

struct FaultKeys {
  std::string name, meaning;  // "drop"
  std::vector<Key> keys;
};
/// Of every kind of fault that a scenario file, or an order to the plant, may have.
std::vector<FaultKeys> KeysOfFaults();

/// "N·m" of "rated_torque_Nm"; empty when the key ends in no unit.
std::string UnitOfKey(std::string_view key);

}  // namespace tendril::config
