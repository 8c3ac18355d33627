// Signed messages on LCM: only who has the key can command, and a recorded message is no command. The
// signature follows the message's bytes, so a reader that does not verify it decodes the message unchanged.
// Knows nothing of what messages say.
//
//   message | "TENDSIG1" | sender, 4 bytes | time, 8 bytes, us since the epoch | HMAC-SHA-256, 32 bytes
//
// numbers big-endian; the HMAC (RFC 2104) is over the channel's name, a zero byte and everything before it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

namespace tendril::io {

inline constexpr std::size_t kSignatureBytes = 8 + 4 + 8 + 32;

/// Bytes of a message without its signature; all of them where it has none.
std::size_t UnsignedSize(const void* data, std::size_t size) noexcept;

/// The key in a file: 32 to 4096 bytes, a line end behind them is not part of it. Throws std::runtime_error
/// with the remedy; also for a file that every user of the machine may read.
std::string LoadKey(const std::string& path);

/// The key in the file that TENDRIL_KEY_FILE names; empty: none. Throws as LoadKey.
std::string KeyOfEnvironment();

class Signer {
 public:
  /// Of a sender of its own, so that several in one process or on one machine differ.
  explicit Signer(std::string key);
  /// Appends the signature. `now_us`: time since the epoch; each signature's is later than the one before.
  void Sign(std::string_view channel, std::int64_t now_us, std::vector<std::uint8_t>& message);

 private:
  std::string key_;
  std::uint32_t sender_;
  std::int64_t last_us_ = 0;
};

class Verifier {
 public:
  /// Messages that were signed before `start_us` are refused: an earlier daemon may have seen them.
  Verifier(std::string key, std::int64_t start_us);
  /// Why a message is refused, with the remedy; empty where it is accepted, which it is only once.
  std::string Refusal(std::string_view channel, const void* data, std::size_t size, std::int64_t now_us);

 private:
  void Forget(std::int64_t now_us);

  std::string key_;
  std::int64_t start_us_;
  std::unordered_map<std::uint32_t, std::int64_t> last_us_;  // by sender, of the last accepted
};

}  // namespace tendril::io
