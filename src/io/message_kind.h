// The types of lcm_types by the fingerprint with which LCM begins every message.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

namespace tendril::io {

struct MessageKind {
  std::string_view name;  // "state_t"
  std::int64_t fingerprint = 0;
  bool (*decodes)(std::span<const std::uint8_t> data) noexcept = nullptr;  // as exactly one message
};

/// The type whose fingerprint the bytes begin with; null: none of this version. Its message may be damaged
/// all the same.
const MessageKind* KindOf(std::span<const std::uint8_t> data) noexcept;

}  // namespace tendril::io
