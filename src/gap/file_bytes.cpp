// One read of the whole file; a pipe has no size and is read until its end.
#include "file_bytes.h"

#include <fmt/core.h>
#include <openssl/evp.h>

#include <array>
#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <memory>
#include <stdexcept>

namespace tendril::gap {
namespace {

// A larger file, or one without end, is not a run.
constexpr std::size_t kMostBytes = std::size_t{4} << 30;

struct FileCloser {
  void operator()(std::FILE* file) const noexcept { std::fclose(file); }
};

}  // namespace

std::string ReadBytes(const std::filesystem::path& file) {
  std::error_code error;
  if (std::filesystem::is_directory(file, error)) {
    throw std::runtime_error("cannot read " + file.string() + ": it is a folder; name a file");
  }
  const std::unique_ptr<std::FILE, FileCloser> in(std::fopen(file.c_str(), "rb"));
  if (!in) {
    throw std::runtime_error("cannot read " + file.string() + ": " + std::strerror(errno) +
                             "; name a file that exists and may be read");
  }
  std::string bytes;
  const std::uintmax_t size = std::filesystem::file_size(file, error);
  const auto check = [&](std::uintmax_t bytes_so_far) {
    if (bytes_so_far > kMostBytes) {
      throw std::runtime_error(file.string() + ": more than 4 GiB; accepted: one run a file; split it");
    }
  };
  if (!error) {
    check(size);
    bytes.resize(size);
  }
  bytes.resize(std::fread(bytes.data(), 1, bytes.size(), in.get()));
  // Data appended meanwhile, or a file without a size (a pipe).
  std::array<char, 65536> more;
  while (const std::size_t n = std::fread(more.data(), 1, more.size(), in.get())) {
    bytes.append(more.data(), n);
    check(bytes.size());
  }
  if (std::ferror(in.get()))
    throw std::runtime_error("cannot read " + file.string() + ": " + std::strerror(errno));
  return bytes;
}

std::string Sha256(std::string_view bytes) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest;
  unsigned size = 0;
  if (EVP_Digest(bytes.data(), bytes.size(), digest.data(), &size, EVP_sha256(), nullptr) != 1) {
    throw std::runtime_error("libcrypto on this machine has no SHA-256");
  }
  std::string hex;
  for (unsigned i = 0; i < size; ++i) hex += fmt::format("{:02x}", digest[i]);
  return hex;
}

}  // namespace tendril::gap
