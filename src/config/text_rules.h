// Accepted forms of the texts in the configuration, and their descriptions. Knows nothing of files.
#pragma once

#include <algorithm>
#include <cctype>
#include <string_view>

#include "reader.h"
#include "tendril/core/daemon.h"

namespace tendril::config {

inline bool IsWord(std::string_view text, std::size_t longest) {
  return !text.empty() && text.size() <= longest &&
         std::all_of(text.begin(), text.end(),
                     [](unsigned char c) { return std::isalnum(c) || c == '_' || c == '-' || c == '.'; });
}

inline constexpr TextRule kNameRule{[](std::string_view t) { return IsWord(t, 64); },
                                    "1 .. 64 letters, digits, '_', '-' or '.'", "^[A-Za-z0-9_.-]{1,64}$"};
/// One of several equal parts of a robot.
inline constexpr TextRule kPlaceRule{
    [](std::string_view t) {
      const auto colon = t.find(':');
      const std::string_view digits = colon < t.size() ? t.substr(colon + 1) : "";
      return IsWord(t.substr(0, colon), 64) &&
             (colon == t.npos || (IsWord(digits, 4) && digits.find_first_not_of("0123456789") == t.npos));
    },
    "all, or one of several as in tendon:2, from 1", "^[A-Za-z0-9_.-]{1,64}(:[0-9]{1,4})?$"};
inline constexpr TextRule kInterfaceRule{
    [](std::string_view t) { return IsWord(t, 15); },
    "a network interface, 1 .. 15 letters, digits, '_', '-' or '.', e.g. can0", "^[A-Za-z0-9_.-]{1,15}$"};
inline constexpr TextRule kPrefixRule{&IsChannelPrefix, kChannelPrefixRule, "^[A-Za-z0-9_]{1,40}$"};
inline constexpr TextRule kPathRule{
    [](std::string_view t) {
      return !t.empty() && std::none_of(t.begin(), t.end(), [](unsigned char c) { return std::iscntrl(c); });
    },
    "the path of a robot file, absolute or relative to this file", "^[^\\x00-\\x1f\\x7f]+$"};
inline constexpr TextRule kEdsRule{kPathRule.ok, "the path of an EDS file, absolute or relative to this file",
                                   kPathRule.pattern};
inline constexpr TextRule kKeyRule{kPathRule.ok, "the path of a key file, absolute or relative to this file",
                                   kPathRule.pattern};
inline constexpr TextRule kObjectRule{[](std::string_view t) {
                                        constexpr std::string_view kHex = "0123456789ABCDEFabcdef";
                                        return t.size() == 9 && t.starts_with("0x") && t[6] == ':' &&
                                               t.substr(2, 4).find_first_not_of(kHex) == t.npos &&
                                               t.substr(7).find_first_not_of(kHex) == t.npos;
                                      },
                                      "an object's index and sub-index, e.g. 0x6401:01",
                                      "^0x[0-9A-Fa-f]{4}:[0-9A-Fa-f]{2}$"};
inline constexpr TextRule kFolderRule{
    [](std::string_view t) {
      return t.starts_with('/') &&
             std::none_of(t.begin(), t.end(), [](unsigned char c) { return std::iscntrl(c); });
    },
    "the absolute path of a folder, e.g. /var/lib/tendrild", "^/[^\\x00-\\x1f\\x7f]*$"};
inline constexpr TextRule kUrlRule{
    &IsLcmUrl, kLcmUrlRule,
    "^((memq|tcpq)://[^\\x00-\\x20\\x7f]*|udpm://2(2[4-9]|3[0-9])(\\.[0-9]{1,3}){3}:[0-9]"
    "{1,5}(\\?((ttl|recv_buf_size)=[0-9]+&?)*)?)$"};

}  // namespace tendril::config
