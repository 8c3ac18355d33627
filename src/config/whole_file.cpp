// Written beside it, then renamed.
#include "tendril/config/whole_file.h"

#include <fmt/core.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <random>
#include <stdexcept>
#include <system_error>

namespace tendril::config {

void WriteWhole(const std::filesystem::path& file, const std::string& text) {
  namespace fs = std::filesystem;
  std::error_code error, ignored;
  const fs::path target = fs::exists(file, ignored) ? fs::canonical(file, ignored) : file;
  const fs::path temporary = fmt::format("{}.new-{:x}", target.string(), std::random_device{}());
  errno = 0;
  std::ofstream out(temporary, std::ios::binary);
  out << text;
  out.close();
  std::string reason = out ? "" : std::strerror(errno != 0 ? errno : EIO);
  if (reason.empty()) {
    if (fs::exists(target, ignored)) fs::permissions(temporary, fs::status(target).permissions(), ignored);
    fs::rename(temporary, target, error);
    if (error) reason = error.message();
  }
  if (reason.empty()) return;
  fs::remove(temporary, ignored);
  throw std::runtime_error(fmt::format("cannot write {}: {}", file.string(), reason));
}

}  // namespace tendril::config
