// One program of a kind a bus: keeps a second one off the same interface.
// Knows nothing of what the program does with the bus.
#pragma once

#include <string>

namespace tendril::can {

/// Held by a program on an interface for as long as it lives. Like the interface's name it is valid within
/// one network namespace, and nothing is left behind when the process dies.
class BusGuard {
 public:
  /// `program` is the name of the kind, for example "tendrild". Throws std::runtime_error naming the
  /// interface and the other one's process id when there is one.
  BusGuard(const std::string& program, const std::string& interface);
  ~BusGuard();
  BusGuard(const BusGuard&) = delete;
  BusGuard& operator=(const BusGuard&) = delete;

 private:
  int socket_;
};

}  // namespace tendril::can
