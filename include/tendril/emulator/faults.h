// Fault injection between a CAN port and the emulated drives: frames lost, delayed, duplicated or corrupted,
// drives and the bus failing at given times. Time is passed in, and a seed determines the sequence. Knows
// nothing of where the orders come from.
#pragma once

#include <cstdint>
#include <memory>

#include "tendril/can/can_port.h"
#include "tendril/core/fault.h"
#include "tendril/emulator/drive_rack.h"

namespace tendril::emulator {

/// Frames affected by faults.
struct FaultCounters {
  std::uint64_t dropped = 0, delayed = 0, duplicated = 0, corrupted = 0;
};

/// The port of the drives: all their frames pass through it.
class FaultInjector final : public can::CanPort {
 public:
  /// `bus` must outlive the injector.
  FaultInjector(can::CanPort& bus, std::uint64_t seed);
  ~FaultInjector() override;

  /// The drives on this port, to be called once, before Add; they must outlive the injector's use.
  void Attach(DriveRack& rack) noexcept;
  /// Orders a fault; its times count from `now_ns`. Throws std::invalid_argument for a node that is not one
  /// of the drives.
  void Add(const FaultParameters& fault, TimeNs now_ns);
  /// Begins and ends the faults due at `now_ns` and releases delayed frames. Call before the drives' Poll.
  void Poll(TimeNs now_ns);

  const FaultCounters& faults() const noexcept;
  /// Faults ordered and not ended.
  int pending() const noexcept;

  bool Send(const can::CanFrame& frame) noexcept override;
  int SendAll(std::span<const can::CanFrame> frames) noexcept override;
  int Receive(std::span<can::StampedFrame> frames) noexcept override;
  bool WaitUntil(TimeNs deadline_ns) noexcept override;
  bool up() const noexcept override;
  const can::CanCounters& counters() const noexcept override;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace tendril::emulator
