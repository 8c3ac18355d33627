// The fuzz targets with made-up bytes, the same on every run: short enough for each build.
// libFuzzer goes further (see CMakeLists.txt).
#include <gtest/gtest.h>

#include <random>
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

TEST(Fuzz, SdoClient) { RunTarget(FuzzSdoClient, 300, 2000); }
TEST(Fuzz, Decoders) { RunTarget(FuzzDecoders, 300, 2000); }
TEST(Fuzz, Master) { RunTarget(FuzzMaster, 40, 4000); }

}  // namespace
}  // namespace tendril::canopen::test
