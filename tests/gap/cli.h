// `tendril gap ...` run as a user runs it: exit code, what it said, files of a folder of its own.
// Knows nothing of what the commands do.
#pragma once

#include <fmt/core.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "support/own_folder.h"

namespace tendril {

namespace fs = std::filesystem;

inline const std::string kRig = TENDRIL_SOURCE_DIR "/config/robots/rig_90mm.yaml";

using test::ReadText;

inline void WriteText(const fs::path& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

class CommandTest : public test::OwnFolder {
 protected:
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

  std::string out_, error_;
};

}  // namespace tendril
