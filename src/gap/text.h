// Text of files and its display in messages. Knows nothing of tables.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace tendril::gap {

/// Without leading and trailing spaces and control characters.
std::string_view Trimmed(std::string_view text);
std::string LowerCase(std::string_view text);
/// At most `most` characters of arbitrary bytes; those that cannot be printed become '?'.
std::string Printable(std::string_view text, std::size_t most = 40);

}  // namespace tendril::gap
