// `tendril gap ...` run as a user runs it: exit code, what it said, files of a folder of its own.
// Knows nothing of what the commands do.
#pragma once

#include <fmt/core.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

namespace tendril {

namespace fs = std::filesystem;

inline const std::string kRig = TENDRIL_SOURCE_DIR "/config/robots/rig_90mm.yaml";

inline std::string ReadText(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}

inline void WriteText(const fs::path& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

class CommandTest : public testing::Test {
 protected:
  void SetUp() override {
    const auto* test = testing::UnitTest::GetInstance()->current_test_info();
    folder_ = fs::temp_directory_path() /
              fmt::format("tendril_{}_{}_{}", test->test_suite_name(), test->name(), getpid());
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  /// Runs `tendril ARGUMENTS` (or another program) in the test's folder, from which its relative paths count.
  int Run(const std::string& arguments, const std::string& program = TENDRIL_BINARY) {
    const fs::path out = folder_ / "stdout", error = folder_ / "stderr";
    const int status =
        std::system(fmt::format("cd {} && timeout 100 {} {} >{} 2>{} </dev/null", folder_.string(), program,
                                arguments, out.string(), error.string())
                        .c_str());
    out_ = ReadText(out);
    error_ = ReadText(error);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  /// One line that names what is wrong, and no more.
  testing::AssertionResult OneLine() const {
    if (error_.ends_with('\n') && error_.find('\n') == error_.size() - 1) return testing::AssertionSuccess();
    return testing::AssertionFailure() << "not one line: " << error_;
  }

  fs::path folder_;
  std::string out_, error_;
};

}  // namespace tendril
