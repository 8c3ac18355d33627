// Keys that a file leaves to their defaults are named with what stands in.
#include "tendril/config/left_out.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "files.h"
#include "tendril/config/config.h"

namespace tendril::config {
namespace {

using testing::HasSubstr;
using testing::Not;

class LeftOutTest : public testing::Test {
 protected:
  void TearDown() override { std::filesystem::remove(path_); }
  std::string Of(const std::string& yaml) const {
    std::ofstream(path_) << yaml;
    return LeftOut(LoadDaemon(path_), path_);
  }
  const std::string path_ =
      std::filesystem::temp_directory_path() / ("tendril_left_out_" + std::to_string(getpid()) + ".yaml");
};

TEST_F(LeftOutTest, AResolvedFileLeavesNothingOut) {
  EXPECT_EQ(Of(ToYaml(LoadDaemon(ConfigPath("tendrild.yaml")))), "");
}

TEST_F(LeftOutTest, AKeyIsNamedWithItsPathAndWhatStandsIn) {
  const std::string whole = ToYaml(LoadDaemon(ConfigPath("tendrild.yaml")));
  const auto from = whole.find("    look_ahead: "), to = whole.find('\n', from) + 1;
  ASSERT_NE(from, whole.npos);
  EXPECT_EQ(Of(whole.substr(0, from) + whole.substr(to)), "controller.trajectory.look_ahead: on");
}

}  // namespace
}  // namespace tendril::config
