// How a drive's start-up is written down, and the steps that are alike in every drive. Knows CiA 301 and 402,
// no maker's objects.
#pragma once

#include <utility>
#include <vector>

#include "tendril/canopen/boot_script.h"
#include "tendril/canopen/object_table.h"
#include "tendril/canopen/pdo.h"

namespace tendril::canopen {

class Script {
 public:
  void Step(const char* step) { step_ = step; }
  void Add(BootAction::Kind kind, std::uint16_t index, std::uint8_t sub, std::int64_t value = 0,
           std::int64_t max = 0) {
    actions_.push_back({step_, kind, {index, sub}, value, max});
  }
  void Write(std::uint16_t index, std::uint8_t sub, std::int64_t value) {
    Add(BootAction::Kind::kWrite, index, sub, value);
  }
  std::vector<BootAction> Finished() { return std::move(actions_); }

 private:
  const char* step_ = "";
  std::vector<BootAction> actions_;
};

/// CiA 301's order: off, type, times, entries off, entries, number of entries, on. What `objects` lack of
/// inhibit time and event timer is left out.
void Remap(Script& script, const PdoLayout& pdo, int node_id, const ObjectTable& objects);
/// Cyclic synchronous torque, and the drive shows it.
void SetTorqueMode(Script& script);
/// NMT start, first feedback, and then the state: from here on the statusword's TPDO reports every change.
void StartAndReadState(Script& script, const ObjectTable& objects);

}  // namespace tendril::canopen
