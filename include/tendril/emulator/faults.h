// Faults on demand between a CAN port and the emulated drives: frames lost, late, doubled or spoilt, drives
// and the bus failing at given times. Time is passed in, and one seed gives one course of events. Knows
// nothing of where orders come from.
#pragma once

#include <cstdint>
#include <memory>

#include "tendril/can/can_port.h"
#include "tendril/core/fault.h"
#include "tendril/emulator/drive_rack.h"

namespace tendril::emulator {

/// Frames that faults touched.
struct FaultCounters {
  std::uint64_t dropped = 0, delayed = 0, duplicated = 0, corrupted = 0;
};

/// The port of the drives: whatever they send or hear passes through it.
class FaultInjector final : public can::CanPort {
 public:
  /// `bus` must outlive the injector.
  FaultInjector(can::CanPort& bus, std::uint64_t seed);
  ~FaultInjector() override;

  /// The drives on this port, to be called once, before Add; they must outlive the injector's use.
  void Attach(DriveRack& rack) noexcept;
  /// Orders a fault; its times count from `now_ns`. Throws std::invalid_argument naming what does not fit: a
  /// node that is none of the drives.
  void Add(const FaultParameters& fault, TimeNs now_ns);
  /// Begins and ends what is due at `now_ns` and lets delayed frames go. Call before the drives' Poll.
  void Poll(TimeNs now_ns);

  const FaultCounters& faults() const noexcept;
  /// Ordered and not over.
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
