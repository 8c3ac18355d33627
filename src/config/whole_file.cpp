// Written beside the file, then renamed.
#include "tendril/config/whole_file.h"

#include <fmt/core.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <random>
#include <sstream>
#include <stdexcept>
#include <system_error>

namespace tendril::config {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void Refuse(const fs::path& file, const std::string& reason) {
  throw std::runtime_error(
      fmt::format("cannot write {}: {}; choose a folder with free space and write permission, or run as a "
                  "user who has it",
                  file.string(), reason));
}

std::string Reason() { return std::strerror(errno != 0 ? errno : EIO); }

/// The file that a name refers to, through links.
fs::path Target(const fs::path& file) {
  std::error_code error;
  if (!fs::exists(file, error)) return file;
  const fs::path target = fs::canonical(file, error);
  if (error) Refuse(file, error.message());
  return target;
}

fs::path Beside(const fs::path& target) {
  return fmt::format("{}.new-{:x}", target.string(), std::random_device{}());
}

/// A device or a pipe receives the text and stays what it is.
bool TakesText(const fs::path& target) {
  std::error_code none;
  return fs::exists(target, none) && !fs::is_regular_file(target, none);
}

void Write(const fs::path& file, const fs::path& place, const std::string& text) {
  errno = 0;
  std::ofstream out(place, std::ios::binary);
  out << text;
  out.close();
  if (out) return;
  const std::string reason = Reason();
  std::error_code none;
  if (!TakesText(place)) fs::remove(place, none);
  Refuse(file, reason);
}

}  // namespace

void WriteWhole(const fs::path& file, const std::string& text) {
  const fs::path target = Target(file);
  if (TakesText(target)) return Write(file, target, text);
  const fs::path temporary = Beside(target);
  Write(file, temporary, text);
  std::error_code error, none;
  if (fs::exists(target, none)) fs::permissions(temporary, fs::status(target, none).permissions(), none);
  fs::rename(temporary, target, error);
  if (!error) return;
  fs::remove(temporary, none);
  Refuse(file, error.message());
}

void CheckMayWrite(const fs::path& file) {
  const fs::path target = Target(file);
  if (TakesText(target)) {
    std::error_code none;
    if (fs::is_fifo(target, none)) return;  // without a reader, opening it would block
    errno = 0;
    if (!std::ofstream(target, std::ios::app)) Refuse(file, Reason());
    return;
  }
  const fs::path temporary = Beside(target);
  Write(file, temporary, "");
  std::error_code none;
  fs::remove(temporary, none);
}

std::string ReadWhole(const fs::path& file) {
  const auto refuse = [&file](const std::string& reason) {
    throw std::runtime_error(
        fmt::format("cannot read {}: {}; name a file that exists and may be read", file.string(), reason));
  };
  std::error_code none;
  if (fs::is_directory(file, none)) refuse("it is a folder");
  errno = 0;
  std::ifstream in(file, std::ios::binary);
  if (!in) refuse(Reason());
  std::stringstream text;
  text << in.rdbuf();
  if (!in) refuse(Reason());
  return text.str();
}

}  // namespace tendril::config
