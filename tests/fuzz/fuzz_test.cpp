// The fuzz targets with made-up bytes, the same on every run: short enough for each build.
// libFuzzer goes further (see CMakeLists.txt).
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <vector>

#include "fuzz_targets.h"

namespace tendril::canopen::test {
namespace {

void RunTarget(int (*target)(std::span<const std::uint8_t>), int inputs, std::size_t length) {
  std::mt19937 random(4711);  // NOLINT: the same on every run
  std::vector<std::uint8_t> bytes(length);
  for (int i = 0; i < inputs; ++i) {
    // Few different values: command specifiers, states and nodes meet often that way.
    const bool narrow = i % 2 == 0;
    for (auto& byte : bytes)
      byte = static_cast<std::uint8_t>(narrow ? (random() % 8) << 4 | random() % 4 : random());
    target(bytes);
  }
}

/// What libFuzzer found worth keeping: each file reaches something that the others do not.
void Replay(int (*target)(std::span<const std::uint8_t>), const char* name) {
  int files = 0;
  for (const auto& entry :
       std::filesystem::directory_iterator(std::string(TENDRIL_SOURCE_DIR "/tests/canopen/corpus/") + name)) {
    std::ifstream file(entry.path(), std::ios::binary);
    const std::string text{std::istreambuf_iterator<char>(file), {}};
    const std::vector<std::uint8_t> bytes(text.begin(), text.end());
    target(bytes);
    ++files;
  }
  EXPECT_GT(files, 10);
}

TEST(Fuzz, SdoClient) { RunTarget(FuzzSdoClient, 300, 2000); }
TEST(Fuzz, Decoders) { RunTarget(FuzzDecoders, 300, 2000); }
TEST(Fuzz, Master) { RunTarget(FuzzMaster, 40, 4000); }

TEST(Fuzz, KeptCorpus) {
  Replay(FuzzSdoClient, "SdoClient");
  Replay(FuzzDecoders, "Decoders");
  Replay(FuzzMaster, "Master");
}

}  // namespace
}  // namespace tendril::canopen::test
