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
  fs::path target = file;
  if (fs::exists(file, ignored)) {
    // A device or a pipe takes the text and stays what it is.
    if (!fs::is_regular_file(file, ignored)) {
      std::ofstream out(file, std::ios::binary);
      out << text;
      out.close();
      if (!out) throw std::runtime_error(fmt::format("cannot write {}: no regular file", file.string()));
      return;
    }
    target = fs::canonical(file, error);
    if (error) throw std::runtime_error(fmt::format("cannot write {}: {}", file.string(), error.message()));
  }
  const fs::path temporary = fmt::format("{}.new-{:x}", target.string(), std::random_device{}());
  errno = 0;
  std::ofstream out(temporary, std::ios::binary);
  out << text;
  out.close();
  std::string reason = out ? "" : std::strerror(errno != 0 ? errno : EIO);
  if (reason.empty()) {
    if (fs::exists(target, ignored))
      fs::permissions(temporary, fs::status(target, ignored).permissions(), ignored);
    fs::rename(temporary, target, error);
    if (error) reason = error.message();
  }
  if (reason.empty()) return;
  fs::remove(temporary, ignored);
  throw std::runtime_error(fmt::format("cannot write {}: {}", file.string(), reason));
}

}  // namespace tendril::config
