// The bytes of a file as they are, and their fingerprint.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace tendril::gap {

/// The bytes of a file; throws std::runtime_error with the remedy when it cannot be read.
std::string ReadBytes(const std::filesystem::path& file);

/// SHA-256 of bytes, lower-case hex.
std::string Sha256(std::string_view bytes);

}  // namespace tendril::gap
