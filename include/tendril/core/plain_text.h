// Text from outside the program, such as names from a network or a file, for a terminal or a line of a log.
#pragma once

#include <string>
#include <string_view>

namespace tendril {

/// Printable ASCII, shortened to `most` characters; everything else becomes '?', since control characters
/// would steer a terminal.
inline std::string PlainText(std::string_view text, std::size_t most = std::string_view::npos) {
  std::string plain(text.substr(0, most));
  for (char& c : plain) c = c < ' ' || c > '~' ? '?' : c;
  return text.size() > most ? plain + "..." : plain;
}

}  // namespace tendril
