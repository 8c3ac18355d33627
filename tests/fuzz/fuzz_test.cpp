// The fuzz targets without a fuzzer, in each test run: the kept corpus, and inputs made of it, the same ones
// every time. tests/fuzz/run goes further.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include "targets.h"

namespace tendril::fuzz {
namespace {

using Bytes = std::vector<std::uint8_t>;

/// What libFuzzer found worth keeping: each file reaches something that the others do not.
std::vector<Bytes> Corpus(std::string_view name) {
  std::vector<std::filesystem::path> paths;
  const std::string folder = TENDRIL_SOURCE_DIR "/tests/fuzz/corpus/" + std::string(name);
  for (const auto& entry : std::filesystem::directory_iterator(folder)) paths.push_back(entry.path());
  std::sort(paths.begin(), paths.end());
  std::vector<Bytes> corpus;
  for (const auto& path : paths) {
    std::ifstream file(path, std::ios::binary);
    corpus.emplace_back(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
  }
  return corpus;
}

class Mutator {
 public:
  explicit Mutator(const std::vector<Bytes>& corpus) : corpus_(corpus) {}

  Bytes Next() {
    Bytes bytes = Any();
    for (std::size_t i = 0, n = 1 + Below(8); i < n; ++i) Change(bytes);
    return bytes;
  }

 private:
  std::size_t Below(std::size_t n) { return static_cast<std::size_t>(random_() % n); }
  const Bytes& Any() { return corpus_[Below(corpus_.size())]; }
  std::ptrdiff_t Place(const Bytes& bytes) { return static_cast<std::ptrdiff_t>(Below(bytes.size() + 1)); }

  void Change(Bytes& bytes) {
    switch (Below(5)) {
      case 0:  // a bit
        if (!bytes.empty()) bytes[Below(bytes.size())] ^= static_cast<std::uint8_t>(1u << Below(8));
        return;
      case 1:  // a byte
        if (!bytes.empty()) bytes[Below(bytes.size())] = static_cast<std::uint8_t>(random_());
        return;
      case 2:  // something more
        bytes.insert(bytes.begin() + Place(bytes), 1 + Below(10), static_cast<std::uint8_t>(random_()));
        return;
      case 3: {  // something less
        const std::ptrdiff_t at = Place(bytes);
        const auto left = static_cast<std::size_t>(bytes.end() - bytes.begin() - at);
        bytes.erase(bytes.begin() + at, bytes.begin() + at + static_cast<std::ptrdiff_t>(Below(left + 1)));
        return;
      }
      default: {  // one after the other
        const Bytes& other = Any();
        bytes.insert(bytes.begin() + Place(bytes), other.begin(), other.end());
        return;
      }
    }
  }

  const std::vector<Bytes>& corpus_;
  std::mt19937_64 random_{4711};  // NOLINT: the same on every run
};

class Fuzz : public ::testing::TestWithParam<Target> {};

TEST_P(Fuzz, KeptCorpusAndMutations) {
  const std::vector<Bytes> corpus = Corpus(GetParam().name);
  ASSERT_GE(corpus.size(), 1u);
  long long frames = 0;
  for (const Bytes& bytes : corpus) frames += GetParam().run(bytes);
  Mutator mutator(corpus);
  // As many as go into a second: the last two boot three drives for each input.
  const bool heavy = GetParam().name == "Master" || GetParam().name == "Drive";
  for (int i = 0; i < (heavy ? 400 : 5000); ++i) frames += GetParam().run(mutator.Next());
  EXPECT_GT(frames, 5000) << "hardly anything was sent";
  RecordProperty("frames", std::to_string(frames));
}

INSTANTIATE_TEST_SUITE_P(Targets, Fuzz, ::testing::ValuesIn(Targets().begin(), Targets().end()),
                         [](const auto& test) { return std::string(test.param.name); });

}  // namespace
}  // namespace tendril::fuzz
