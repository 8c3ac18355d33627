// Files as a whole: reads them, and writes them completely or not at all, even if the program stops or the
// disk is full (a program that does not ignore SIGXFSZ is still ended by a limit on file sizes).
#pragma once

#include <filesystem>
#include <string>

namespace tendril::config {

/// Replaces `file` with the same permissions; for a link, the file it points to; writes into a file that is
/// not regular. Throws std::runtime_error "cannot write FILE: REASON; REMEDY" and keeps the old file.
void WriteWhole(const std::filesystem::path& file, const std::string& text);
/// Throws as WriteWhole would where it may not write; changes nothing.
void CheckMayWrite(const std::filesystem::path& file);

/// Every byte. Throws std::runtime_error "cannot read FILE: REASON; REMEDY"; of a folder, too.
std::string ReadWhole(const std::filesystem::path& file);

}  // namespace tendril::config
