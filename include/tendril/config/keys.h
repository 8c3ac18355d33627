// Every key of the configuration files with its meaning and accepted values, from the files' descriptions,
// for the reference, the JSON Schemas and what asks for values. Reads no file.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace tendril::config {

/// Accepted values: [min, max], or (min, max] where `above_min`.
struct Range {
  double min = 0;
  double max = 0;
  bool above_min = false;
};

struct Key {
  /// A kMapping with a range: more keys of the same block, each a number. Without: entries by number, each
  /// with blocks that the mapping's own block requires, in part.
  enum class Kind { kValue, kBlock, kList, kMapping };
  /// Of a value; of a list of values that of each.
  enum class Type { kNumber, kInteger, kFlag, kText, kChoice };

  std::string path;     // "bus.cycle_ns"; for entries of a list "body.sections[].units"
  std::string meaning;  // a sentence
  Kind kind = Kind::kValue;
  std::string accepted;  // "0.0001 .. 1", "paper, equilibrium"; for a list the number of entries
  std::string unit;      // "N·m"; empty: none
  std::optional<std::string> otherwise;  // the default where the key may be omitted; none: required
  std::string without_block;             // for a block that may be omitted: the default

  // The same for programs.
  Type type = Type::kText;
  std::optional<Range> range;           // of a number; in a mapping, of each of its numbers
  std::optional<Range> count;           // of a list: its entries
  std::vector<std::string> choices;     // of a kChoice; the only numbers accepted of an integer that has any
  std::string pattern;                  // of a kText: a regular expression (ECMAScript) for the whole text
  std::vector<std::string> instead_of;  // keys of the same block in whose place this one stands
  std::pair<std::string, std::string>
      needless;  // the key of the same block, and its value, without need of this
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
