// The interface between hardware and simulation: frames in, frames out. Code above it cannot distinguish a
// SocketCAN interface from the memory bus.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "tendril/core/clock.h"

namespace tendril::can {

/// Classic CAN 2.0A data frame (11-bit identifier), or an error frame reported by the interface.
struct CanFrame {
  std::uint32_t id = 0;   // 0..0x7FF; error class bits when error is set
  std::uint8_t size = 0;  // 0..8
  bool remote = false;
  bool error = false;
  std::array<std::uint8_t, 8> data{};
};

/// Error classes in CanFrame::id of an error frame (the kernel's numbers, linux/can/error.h).
inline constexpr std::uint32_t kErrorBusOff = 0x040;
inline constexpr std::uint32_t kErrorRestarted = 0x100;

struct StampedFrame {
  CanFrame frame;
  TimeNs time_ns = 0;  // arrival, port's clock
};

struct CanCounters {
  std::uint64_t sent = 0, received = 0;
  std::uint64_t send_refused = 0;     // ENOBUFS: the queue was full, the frame is lost
  std::uint64_t receive_dropped = 0;  // by the kernel: the reader was too slow
  std::uint64_t error_frames = 0, bus_off = 0;
  std::uint64_t bits = 0;  // worst-case bits of all frames seen (sent and received)
};

/// Worst-case bits on the wire of an 11-bit data frame with `size` bytes, stuffing and interframe space
/// included.
constexpr int WorstCaseBits(int size) { return 8 * size + 47 + (34 + 8 * size - 1) / 4; }

/// The same for a frame; a remote frame carries no data whatever its size field.
constexpr int WorstCaseBits(const CanFrame& frame) { return WorstCaseBits(frame.remote ? 0 : frame.size); }

class CanPort {
 public:
  virtual ~CanPort() = default;
  /// Queues one frame without blocking; false when it could not be queued (counted).
  virtual bool Send(const CanFrame& frame) noexcept = 0;
  /// Sends each frame as Send does, also after a failed one; returns how many were queued. Ports that can do
  /// so queue all at once.
  virtual int SendAll(std::span<const CanFrame> frames) noexcept {
    int queued = 0;
    for (const CanFrame& frame : frames) queued += Send(frame) ? 1 : 0;
    return queued;
  }
  /// Receives up to frames.size() waiting frames, oldest first; returns how many. Never blocks.
  virtual int Receive(std::span<StampedFrame> frames) noexcept = 0;
  /// Blocks until a frame waits or the deadline (port's clock) has passed; true when a frame waits.
  virtual bool WaitUntil(TimeNs deadline_ns) noexcept = 0;
  /// False after bus-off or when the interface went down, until it is back.
  virtual bool up() const noexcept = 0;
  /// True from bus-off until the controller runs again; an interface that is down is not bus-off.
  virtual bool bus_off() const noexcept { return false; }
  /// After bus-off without automatic restart: requests a restart of the controller, where this process may,
  /// and updates up(). Makes system calls, so it is not for a cycle under control.
  virtual void Restart() noexcept {}
  virtual const CanCounters& counters() const noexcept = 0;
};

}  // namespace tendril::can
