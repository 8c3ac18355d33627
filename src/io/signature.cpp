// Signing and verifying; see the header.
#include "tendril/io/signature.h"

#include <fmt/format.h>
#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <openssl/hmac.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <random>
#include <stdexcept>
#include <utility>

namespace tendril::io {
namespace {

constexpr std::string_view kMark = "TENDSIG1";
constexpr std::size_t kMacBytes = 32, kLeastKey = 32, kMostKey = 4096;
// Clocks that NTP keeps differ by far less.
constexpr std::int64_t kFresh_us = 10'000'000;
constexpr std::size_t kMostSenders = 10'000;

using Mac = std::array<std::uint8_t, kMacBytes>;

Mac MacOf(const std::string& key, std::string_view channel, const std::uint8_t* data, std::size_t size) {
  std::vector<std::uint8_t> text(channel.begin(), channel.end());
  text.push_back(0);
  text.insert(text.end(), data, data + size);
  Mac mac{};
  unsigned length = 0;
  if (HMAC(EVP_sha256(), key.data(), static_cast<int>(key.size()), text.data(), text.size(), mac.data(),
           &length) == nullptr ||
      length != mac.size())
    throw std::runtime_error("HMAC-SHA-256 failed");
  return mac;
}

template <class T>
void Put(T value, std::vector<std::uint8_t>& to) {
  for (int shift = 8 * (sizeof(T) - 1); shift >= 0; shift -= 8)
    to.push_back(static_cast<std::uint8_t>(static_cast<std::uint64_t>(value) >> shift));
}

std::uint64_t Get(const std::uint8_t* from, int bytes) {
  std::uint64_t value = 0;
  for (int i = 0; i < bytes; ++i) value = value << 8 | from[i];
  return value;
}

}  // namespace

std::size_t UnsignedSize(const void* data, std::size_t size) noexcept {
  if (size < kSignatureBytes) return size;
  const auto* mark = static_cast<const std::uint8_t*>(data) + size - kSignatureBytes;
  return std::memcmp(mark, kMark.data(), kMark.size()) == 0 ? size - kSignatureBytes : size;
}

std::string LoadKey(const std::string& path) {
  const auto refuse = [&path](const std::string& why) {
    throw std::runtime_error("key file " + path + ": " + why);
  };
  struct stat about {};
  std::ifstream file(path, std::ios::binary);
  if (!file || stat(path.c_str(), &about) != 0)
    refuse(std::string(std::strerror(errno)) + "; make one: (umask 077; openssl rand -hex 32 > FILE)");
  if ((about.st_mode & S_IROTH) != 0) refuse("every user of this machine may read it; chmod o-r it");
  std::string key(kMostKey + 3, '\0');  // more than any key: not all of a file that is no key
  file.read(key.data(), static_cast<std::streamsize>(key.size()));
  key.resize(static_cast<std::size_t>(file.gcount()));
  while (!key.empty() && (key.back() == '\n' || key.back() == '\r')) key.pop_back();
  if (key.size() < kLeastKey || key.size() > kMostKey)
    refuse(fmt::format("{} bytes; accepted: {} to {}; make one: (umask 077; openssl rand -hex 32 > FILE)",
                       key.size(), kLeastKey, kMostKey));
  return key;
}

std::string KeyOfEnvironment() {
  const char* path = std::getenv("TENDRIL_KEY_FILE");
  return path != nullptr && *path != 0 ? LoadKey(path) : "";
}

Signer::Signer(std::string key) : key_(std::move(key)), sender_(std::random_device{}()) {}

void Signer::Sign(std::string_view channel, std::int64_t now_us, std::vector<std::uint8_t>& message) {
  last_us_ = std::max(now_us, last_us_ + 1);
  message.insert(message.end(), kMark.begin(), kMark.end());
  Put(sender_, message);
  Put(last_us_, message);
  const Mac mac = MacOf(key_, channel, message.data(), message.size());
  message.insert(message.end(), mac.begin(), mac.end());
}

Verifier::Verifier(std::string key, std::int64_t start_us) : key_(std::move(key)), start_us_(start_us) {}

std::string Verifier::Refusal(std::string_view channel, const void* data, std::size_t size,
                              std::int64_t now_us) {
  if (UnsignedSize(data, size) == size)
    return "it is not signed, and lcm.key_file asks for that; give its sender the key: TENDRIL_KEY_FILE=FILE";
  const auto* bytes = static_cast<const std::uint8_t*>(data);
  const std::uint8_t* const mac = bytes + size - kMacBytes;
  const Mac wanted = MacOf(key_, channel, bytes, size - kMacBytes);
  if (CRYPTO_memcmp(mac, wanted.data(), wanted.size()) != 0)
    return "it is signed with another key, or was changed; give its sender the key of lcm.key_file";
  const auto sender = static_cast<std::uint32_t>(Get(mac - 12, 4));
  const auto time_us = static_cast<std::int64_t>(Get(mac - 8, 8));
  const std::int64_t age_us = now_us - time_us;
  if (age_us > kFresh_us || age_us < -kFresh_us)
    return fmt::format(
        "it was signed {:.1f} s {} by this machine's clock; accepted: within {} s; set both clocks",
        1e-6 * static_cast<double>(age_us < 0 ? -age_us : age_us), age_us < 0 ? "from now" : "ago",
        kFresh_us / 1'000'000);
  if (time_us < start_us_) return "it was signed before this daemon started; send it again";
  const auto last = last_us_.find(sender);
  if (last != last_us_.end() && time_us <= last->second)
    return "it, or a later one of its sender, was received before; send a new one";
  if (last_us_.size() >= kMostSenders) Forget(now_us);
  last_us_[sender] = time_us;
  return {};
}

// What such a sender sent is too old to be accepted again.
void Verifier::Forget(std::int64_t now_us) {
  std::erase_if(last_us_, [&](const auto& entry) { return now_us - entry.second > kFresh_us; });
}

}  // namespace tendril::io
