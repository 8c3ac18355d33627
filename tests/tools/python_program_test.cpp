// Handing over to the Python package: by stand-ins for an interpreter, because the package need not be
// installed.
#include "python_program.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>

namespace tendril::tools {
namespace {

namespace fs = std::filesystem;

class PythonProgram : public testing::Test {
 protected:
  PythonProgram() { fs::create_directories(folder_); }
  ~PythonProgram() override {
    unsetenv("TENDRIL_PYTHON");
    fs::remove_all(folder_);
  }

  /// A script in place of the interpreter that TENDRIL_PYTHON names.
  void StandIn(const std::string& script) {
    const fs::path path = folder_ / "python";
    std::ofstream(path) << "#!/bin/sh\n" << script << "\n";
    chmod(path.c_str(), 0755);
    setenv("TENDRIL_PYTHON", path.c_str(), 1);
  }

  const fs::path folder_ = fs::temp_directory_path() / ("tendril-python-" + std::to_string(getpid()));
};

TEST_F(PythonProgram, OneThatHasThePackageIsFound) {
  StandIn("exit 0");
  EXPECT_EQ(FindPython({"textual"}), (folder_ / "python").string());
}

TEST_F(PythonProgram, WithoutThePackageTheLineSaysHowToInstallIt) {
  StandIn("exit 1");
  EXPECT_EQ(FindPython(), "");
  try {
    RunPython("tendril.view", {}, {"viser"});
    FAIL();
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), testing::HasSubstr("tendril.view"));
    EXPECT_THAT(e.what(), testing::HasSubstr("viser"));
    EXPECT_THAT(e.what(), testing::HasSubstr("pip install './python[view]'"));
    EXPECT_THAT(e.what(), testing::HasSubstr("TENDRIL_PYTHON"));
  }
}

TEST_F(PythonProgram, AnInterpreterThatIsNotThereIsNone) {
  setenv("TENDRIL_PYTHON", (folder_ / "none").c_str(), 1);
  EXPECT_EQ(FindPython(), "");
}

TEST_F(PythonProgram, TheProcessBecomesTheModuleWithItsArguments) {
  StandIn(R"([ "$1" = -c ] && exit 0; for word in "$@"; do echo "<$word>" >&2; done; exit 7)");
  EXPECT_EXIT(RunPython("tendril.view", {"--port", "a b"}), testing::ExitedWithCode(7),
              "<-m>\n<tendril.view>\n<--port>\n<a b>");
}

}  // namespace
}  // namespace tendril::tools
