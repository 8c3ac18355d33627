// Linux SocketCAN raw socket as a CanPort: non-blocking, sized buffers, drop counter, error frames.
#pragma once

#include <memory>
#include <string>

#include "tendril/can/can_port.h"

namespace tendril::can {

class SocketCanPort final : public CanPort {
 public:
  struct Options {
    int receive_buffer_bytes = 1 << 20;
    bool error_frames = true;
  };
  /// Opens interface (for example "can0"). Throws std::system_error with the remedy in its text when the
  /// kernel has no CAN, the interface does not exist or is down.
  explicit SocketCanPort(const std::string& interface);
  SocketCanPort(const std::string& interface, const Options& options);
  ~SocketCanPort() override;

  bool Send(const CanFrame& frame) noexcept override;
  int SendAll(std::span<const CanFrame> frames) noexcept override;
  int Receive(std::span<StampedFrame> frames) noexcept override;
  bool WaitUntil(TimeNs deadline_ns) noexcept override;
  bool up() const noexcept override;
  bool bus_off() const noexcept override;
  /// The request needs CAP_NET_ADMIN and a controller without restart-ms. Reading the interface's state needs
  /// neither, and detects a restart without an error frame.
  void Restart() noexcept override;
  const CanCounters& counters() const noexcept override;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace tendril::can
