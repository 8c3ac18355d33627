// Files that are there whole or not at all, whatever stops the program or fills the disk.
#pragma once

#include <filesystem>
#include <string>

namespace tendril::config {

/// Replaces `file`, with the permissions of the one that is there; of a link, what it points to. Throws
/// std::runtime_error "cannot write FILE: REASON" and leaves the old one.
void WriteWhole(const std::filesystem::path& file, const std::string& text);

}  // namespace tendril::config
