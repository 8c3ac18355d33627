// Sources of fault orders for a simulated rig: a command line, a scenario file, an LCM channel. Knows words
// and files; the faults themselves are the emulator's.
#pragma once

#include <lcm/lcm-cpp.hpp>
#include <string>
#include <tendril_lcm/fault_t.hpp>
#include <vector>

#include "tendril/core/clock.h"
#include "tendril/emulator/faults.h"

namespace tendril::rig {

struct FaultOrder {
  std::string where;  // for messages
  FaultParameters fault;
};

/// The orders of --fault. Throws config::ConfigError.
std::vector<FaultOrder> ReadFaults(const std::vector<std::string>& texts);
/// A scenario file. Throws config::ConfigError with the file's name and line.
std::vector<FaultOrder> ReadScenario(const std::string& path);
/// Throws config::ConfigError on a fault that does not fit the drives.
void Order(const std::vector<FaultOrder>& orders, emulator::FaultInjector& faults, TimeNs now_ns);

/// Orders the faults received on PREFIX_FAULT, whenever its LCM is handled; their times count from then. Each
/// is answered by an event on PREFIX_EVENT, source "plant", with the text of TakeLines.
class FaultListener {
 public:
  /// `lcm`, `faults` and `clock` must outlive the listener.
  FaultListener(lcm::LCM& lcm, const std::string& prefix, emulator::FaultInjector& faults,
                const Clock& clock);
  ~FaultListener();
  FaultListener(const FaultListener&) = delete;
  FaultListener& operator=(const FaultListener&) = delete;

  int ordered() const { return ordered_; }
  /// One line for each order since the last call: accepted, or why not.
  std::vector<std::string> TakeLines();

 private:
  void OnFault(const lcm::ReceiveBuffer*, const std::string& channel, const tendril_lcm::fault_t* message);

  void Answer(const std::string& line);

  lcm::LCM& lcm_;
  std::string event_channel_;
  emulator::FaultInjector& faults_;
  const Clock& clock_;
  lcm::Subscription* subscription_;
  int ordered_ = 0;
  std::vector<std::string> lines_;
};

}  // namespace tendril::rig
