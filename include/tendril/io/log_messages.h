// The messages of an LCM log in the order of the file, each whole and with its type. For logs of any length.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>

namespace tendril::io {

/// The type of lcm_types ("state_t") that these bytes are exactly one message of; empty: none of this
/// version.
std::string_view TypeOfMessage(std::span<const std::uint8_t> data) noexcept;

/// Whether a channel is named as Tendril names its own ("TENDRIL_STATE", "TENDRIL_COMMAND_TIP").
bool IsChannelOfTendril(std::string_view channel);

struct LogMessage {
  std::string channel;
  std::int64_t stamp_us = 0;  // when it was recorded, on the clock of the log
  std::span<const std::uint8_t> data;
  std::string_view type;  // as TypeOfMessage; empty: of another program, or of another version of this one
};

class LogMessages {
 public:
  /// Throws std::runtime_error naming the path when it cannot be read.
  explicit LogMessages(const std::string& path);
  ~LogMessages();

  /// Advances to the next message, past damage and past messages that no Tendril writes though they bear its
  /// type; false at the end.
  bool Next();
  /// The data are valid until the next Next().
  const LogMessage& message() const;
  /// Bytes of the file, and of what is read of it.
  std::uint64_t size() const;
  std::uint64_t position() const;
  /// Empty, or one line: the damaged places with their offsets, and how much of the log is read.
  std::string Damage() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace tendril::io
