// Allows one program of a kind per bus: refuses a second one on the same interface. Knows nothing of what the
// program does with the bus.
#pragma once

#include <string>

namespace tendril::can {

/// Held by a program on an interface for its lifetime. Like the interface's name it is valid within one
/// network namespace; the kernel releases it when the process dies.
class BusGuard {
 public:
  /// `program` names the kind, for example "tendrild". Throws std::runtime_error naming the interface and the
  /// holder's process id when it is held already.
  BusGuard(const std::string& program, const std::string& interface);
  ~BusGuard();
  BusGuard(const BusGuard&) = delete;
  BusGuard& operator=(const BusGuard&) = delete;

 private:
  int socket_;
};

}  // namespace tendril::can
