#include "tendril/config/keys.h"

#include "describe_daemon.h"
#include "describe_fault.h"
#include "describe_robot.h"
#include "lister.h"
#include "units.h"

namespace tendril::config {
namespace {

template <class T>
std::vector<Key> KeysOf(T value) {
  std::vector<Key> keys;
  Lister lister(keys, "");
  Describe(lister, value);
  return keys;
}

}  // namespace

std::vector<Key> RobotFileKeys() { return KeysOf(RobotParameters()); }
std::vector<Key> DaemonFileKeys() { return KeysOf(DaemonParameters()); }

std::vector<FaultKeys> KeysOfFaults() {
  std::vector<FaultKeys> faults;
  for (const auto& [name, kind] : kFaultKinds) {
    faults.push_back(
        {std::string(name), std::string(MeaningOf(kind)), KeysOf(FaultParameters{.kind = kind})});
  }
  return faults;
}

std::string UnitOfKey(std::string_view key) { return std::string(UnitText(UnitSuffix(key))); }

}  // namespace tendril::config
