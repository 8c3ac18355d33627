// CANopen master for CiA 402 torque drives: boots each node, checks and configures it, then runs the cycle of
// SYNC, RPDO and TPDO. Passive: time is passed in, frames go through a CanPort, nothing blocks or allocates
// after construction. Knows nothing of tendons.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "tendril/can/can_port.h"
#include "tendril/canopen/drive_profile.h"
#include "tendril/core/cycle.h"
#include "tendril/core/daemon.h"

namespace tendril::canopen {

/// One line, stored inline so that a cycle may write it. Large enough for every text of the master; the
/// longest, an EMCY with cause and remedy, is checked at compile time.
using EventText = std::array<char, 320>;

/// A bus event, for event messages and the log.
struct BusEvent {
  TimeNs time_ns = 0;
  Status status = Status::kOk;
  int node_id = 0;   // 0: the bus itself
  EventText text{};  // node, step, index:sub, value, abort text
};

/// Frames received and rejected, since construction.
struct FrameFaults {
  std::uint64_t malformed = 0;  // from an identifier of our drives, with invalid length or contents
  std::uint64_t foreign = 0;    // that only the master may send, from another sender
};

/// Worst-case share of the bit rate of a configuration, and the time that its frames need in a cycle.
struct BusBudget {
  double load = 0;  // of the bit rate, 0..
  double cyclic_bits_per_s = 0;
  double other_bits_per_s = 0;  // statuswords, heartbeats, and SDO as `sdo_bits_per_s`
  double sdo_bits_per_s = 0;    // reserved for SDO; the master also uses what remains below max_load
  TimeNs feedback_ns = 0;       // from SYNC until the last feedback, including one other frame in progress
  TimeNs torques_ns = 0;        // for the torques of all drives
  int max_drives_at_this_cycle = 0;
  TimeNs min_cycle_ns_for_these_drives = 0;  // shortest whole-millisecond cycle that fits
  std::string ToString() const;
};
BusBudget ComputeBusBudget(const BusParameters& bus, std::span<const DriveSetup> drives);
/// What is wrong with bus.feedback_deadline_ns, else empty: all feedback must be able to arrive before it,
/// and the torques to reach the drives after it, before the next SYNC.
std::string FeedbackDeadlineProblem(const BusParameters& bus, std::span<const DriveSetup> drives);

class Master {
 public:
  /// Drives in the order of feedback and torques. Throws std::invalid_argument on a budget above
  /// bus.max_load, naming the drive count and cycle that would fit, and on a feedback deadline that the
  /// frames cannot meet.
  Master(const BusParameters& bus, std::span<const DriveSetup> drives, can::CanPort& port);
  ~Master();

  int drives() const noexcept;

  /// Starts (again) from NMT reset; the boot proceeds in Poll.
  void Start(TimeNs now_ns) noexcept;

  // ---- one cycle: BeginCycle, Poll until it returns true or the deadline passed, EndCycle -------

  /// Sends SYNC and the frames due for boot, heartbeats and time-outs.
  void BeginCycle(TimeNs now_ns) noexcept;
  /// Drains the port; true when every configured drive's TPDO of this cycle is in.
  bool Poll(TimeNs now_ns) noexcept;
  /// Feedback of the cycle, age-stamped; valid after Poll.
  const DriveFeedback& feedback(int drive) const noexcept;
  /// Steps the CiA 402 states towards the request and sends torques [per mille of rated]; they act at the
  /// next SYNC. A drive that is not enabled is sent zero torque.
  void EndCycle(TimeNs now_ns, DriveRequest request, std::span<const std::int16_t> torque_permille) noexcept;

  /// Fault reset of the drives that are in fault, or a new boot where a node was lost; on operator's clear
  /// only.
  void ClearFaults(TimeNs now_ns) noexcept;
  /// Disables the drives, ends their monitoring of our heartbeat and stops them; call once per cycle until
  /// true, at most 0.6 s.
  bool Shutdown(TimeNs now_ns) noexcept;

  bool bus_ok() const noexcept;
  /// True when the bus is not ok because its interface is down or gone, rather than bus-off.
  bool interface_down() const noexcept;
  /// The drive's serial number (0x1018:04); 0 until read.
  std::uint32_t serial(int drive) const noexcept;
  /// Oldest event not yet taken; false when there is none. Events beyond the ring's capacity are counted and
  /// dropped.
  bool PopEvent(BusEvent* event) noexcept;
  std::uint64_t events_lost() const noexcept;
  const FrameFaults& frame_faults() const noexcept;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace tendril::canopen
