// What the configuration's plain numbers and texts are checked by in more than one room.
#include "tendril/core/daemon.h"

#include <algorithm>
#include <charconv>

namespace tendril {
namespace {

/// The whole of a text as a number of digits; what is none of the range is refused.
bool IsWhole(std::string_view text, int least, int most) noexcept {
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size() && text.front() != '-' && value >= least &&
         value <= most;
}

/// Cuts the text before the first `mark`, or all of it, off the front; the mark goes too.
std::string_view Cut(std::string_view& text, char mark) noexcept {
  const std::size_t at = text.find(mark);
  const std::string_view front = text.substr(0, at);
  text = at == text.npos ? std::string_view() : text.substr(at + 1);
  return front;
}

bool IsMulticast(std::string_view address) noexcept {
  for (int i = 0; i < 4; ++i) {
    if (!IsWhole(Cut(address, i < 3 ? '.' : '\0'), i == 0 ? 224 : 0, i == 0 ? 239 : 255)) return false;
  }
  return address.empty();
}

}  // namespace

bool IsLcmUrl(std::string_view url) noexcept {
  constexpr std::string_view kUdpm = "udpm://";
  if (std::any_of(url.begin(), url.end(), [](unsigned char c) { return c <= ' ' || c == 127; })) return false;
  if (!url.starts_with(kUdpm)) return url.starts_with("memq://") || url.starts_with("tcpq://");
  std::string_view options = url.substr(kUdpm.size());
  std::string_view port = Cut(options, '?');
  if (!IsMulticast(Cut(port, ':')) || !IsWhole(port, 1, 65535)) return false;
  while (!options.empty()) {
    std::string_view value = Cut(options, '&');
    const std::string_view key = Cut(value, '=');
    if (key == "ttl" && !IsWhole(value, 0, 255)) return false;
    if (key == "recv_buf_size" && !IsWhole(value, 1, 1 << 30)) return false;
    if (key != "ttl" && key != "recv_buf_size") return false;
  }
  return true;
}

bool IsChannelPrefix(std::string_view prefix) noexcept {
  return !prefix.empty() && prefix.size() <= 40 && std::all_of(prefix.begin(), prefix.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
  });
}

}  // namespace tendril
