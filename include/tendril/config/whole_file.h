// Files that are there whole or not at all, whatever stops the program or fills the disk (a program that does
// not ignore SIGXFSZ is ended by a limit on file sizes all the same).
#pragma once

#include <filesystem>
#include <string>

namespace tendril::config {

/// Replaces `file`, with the permissions of the one that is there; of a link to a file, that file; writes
/// into what is no regular file. Throws std::runtime_error "cannot write FILE: REASON; REMEDY" and leaves the
/// old one.
void WriteWhole(const std::filesystem::path& file, const std::string& text);
/// Throws as WriteWhole would where it may not write; leaves everything as it is.
void CheckMayWrite(const std::filesystem::path& file);

}  // namespace tendril::config
