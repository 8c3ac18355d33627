// Conversion between structs and LCM messages in both directions, with untrusted bytes checked before
// decoding. Knows the messages of lcm_types and nothing of connections or files.
#pragma once

#include <cstdint>
#include <exception>
#include <string>

#include "tendril/core/cycle.h"
#include "tendril/core/statistics.h"
#include "tendril/io/gateway.h"
#include "tendril/io/signature.h"
#include "tendril_lcm/command_bending_t.hpp"
#include "tendril_lcm/command_mode_t.hpp"
#include "tendril_lcm/command_tension_t.hpp"
#include "tendril_lcm/command_tip_t.hpp"
#include "tendril_lcm/cycle_t.hpp"
#include "tendril_lcm/event_t.hpp"
#include "tendril_lcm/run_t.hpp"
#include "tendril_lcm/snapshot_t.hpp"
#include "tendril_lcm/state_t.hpp"
#include "tendril_lcm/statistics_t.hpp"
#include "tendril_lcm/tracker_t.hpp"

namespace tendril::io {

/// Number of counts with which messages with arrays begin.
template <class Message>
inline constexpr int kLeadingCounts = 0;
template <>
inline constexpr int kLeadingCounts<tendril_lcm::command_bending_t> = 2;
template <>
inline constexpr int kLeadingCounts<tendril_lcm::command_tension_t> = 1;
template <>
inline constexpr int kLeadingCounts<tendril_lcm::state_t> = 4;
template <>
inline constexpr int kLeadingCounts<tendril_lcm::cycle_t> = 6;
template <>
inline constexpr int kLeadingCounts<tendril_lcm::snapshot_t> = 1;
template <>
inline constexpr int kLeadingCounts<tendril_lcm::statistics_t> = 3;

/// True when the first `counts` numbers of an encoded message are not negative and fit into its size
/// together, so that decoding cannot be made to reserve more memory than the message has.
bool CountsPlausible(const void* data, int size, int counts) noexcept;

/// False when the bytes are not exactly one message of this type. Never throws, whatever the bytes.
template <class Message>
bool Decode(const void* data, int size, Message& message) noexcept {
  if (!CountsPlausible(data, size, kLeadingCounts<Message>)) return false;
  try {
    const auto message_size = static_cast<int>(UnsignedSize(data, static_cast<std::size_t>(size)));
    return message.decode(data, 0, message_size) == message_size;
  } catch (const std::exception&) {
    return false;
  }
}

/// Offset in microseconds from a clock to the epoch: for this machine's clock the present one, for any other
/// (simulated) clock zero.
std::int64_t EpochOffsetUs(const Clock& clock);

/// `message` is reused: filling it again does not allocate. Stage vectors without the robot's size (before
/// the first cycle) are written as NaN.
void ToMessage(const CycleRecord& record, const RobotShape& shape, std::int64_t utime,
               tendril_lcm::cycle_t& message);
/// False when a count is beyond the capacities of core/limits.h. Restores bit for bit all that ToMessage
/// wrote.
bool FromMessage(const tendril_lcm::cycle_t& message, CycleRecord& record) noexcept;

void ToMessage(const CycleRecord& record, const RobotShape& shape, std::int64_t utime,
               tendril_lcm::state_t& message);

void ToMessage(const LoopStatistics& statistics, std::int64_t utime, tendril_lcm::statistics_t& message);

/// RunInfo::daemon is stored as a comment at the head of daemon_yaml and restored from there.
void ToMessage(const RunInfo& run, const RobotShape& shape, std::int64_t utime, tendril_lcm::run_t& message);
void FromMessage(const tendril_lcm::run_t& message, RunInfo& run);

/// The command of a message, except received_ns. Returns empty text, or why it cannot be represented (too
/// many values, an unknown request). Values are not checked here; the controller's gate does that.
std::string FromMessage(const tendril_lcm::command_tip_t& message, Command& command);
std::string FromMessage(const tendril_lcm::command_bending_t& message, Command& command);
std::string FromMessage(const tendril_lcm::command_tension_t& message, Command& command);
std::string FromMessage(const tendril_lcm::command_mode_t& message, Command& command);

}  // namespace tendril::io
