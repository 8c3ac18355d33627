// Emergency messages: frame codec, and what a drive's table of codes says of each: cause, remedy, reaction.
// The tables are in the profiles, for master and emulator; knows no node's state.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "tendril/can/can_port.h"

namespace tendril::canopen {

/// Bits of the error register 0x1001.
namespace error_register {
inline constexpr std::uint8_t kGeneric = 0x01, kCurrent = 0x02, kVoltage = 0x04, kTemperature = 0x08,
                              kCommunication = 0x10, kProfile = 0x20, kMotion = 0x80;
}

/// The drive's own reaction.
enum class EmcyReaction : std::uint8_t {
  kNone,             // 0000: error cleared
  kDisable,          // always disables
  kFaultOption,      // per 0x605E
  kAbortConnection,  // per 0x6007
};

struct EmcyInfo {
  std::uint16_t first = 0, last = 0;  // codes covered
  std::uint8_t register_bit = 0;
  EmcyReaction reaction = EmcyReaction::kDisable;
  const char* text = "";
  const char* cause = "";
  const char* remedy = "";
};

/// The first entry of a drive's table that covers the code; the last entry of every table covers all codes.
const EmcyInfo& FindEmcy(std::span<const EmcyInfo> table, std::uint16_t code) noexcept;

struct EmcyMessage {
  int node_id = 0;
  std::uint16_t code = 0;
  std::uint8_t error_register = 0;
  std::array<std::uint8_t, 5> vendor{};
};
can::CanFrame EmcyFrame(const EmcyMessage& message) noexcept;
/// Empty for any other frame (SYNC shares the function code) and for fewer than 8 bytes.
std::optional<EmcyMessage> ParseEmcy(const can::CanFrame& frame) noexcept;

}  // namespace tendril::canopen
