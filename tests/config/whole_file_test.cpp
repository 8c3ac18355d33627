// Files that are there whole or not at all.
#include "tendril/config/whole_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>

namespace tendril::config {
namespace {

namespace fs = std::filesystem;

class WholeFile : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() /
              (std::string("tendril_") + testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  static std::string Read(const fs::path& path) {
    std::ifstream in(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  }
  std::ptrdiff_t Files() const {
    return std::distance(fs::directory_iterator(folder_), fs::directory_iterator());
  }
  fs::path folder_;
};

TEST_F(WholeFile, ReplacesTheOldOneAndKeepsItsPermissionsAndLinks) {
  const fs::path file = folder_ / "file", link = folder_ / "link";
  WriteWhole(file, "one");
  fs::permissions(file, fs::perms::owner_read | fs::perms::owner_write);
  fs::create_symlink("file", link);
  WriteWhole(link, "two");
  EXPECT_EQ(Read(file), "two");
  EXPECT_TRUE(fs::is_symlink(link));
  EXPECT_EQ(fs::status(file).permissions(), fs::perms::owner_read | fs::perms::owner_write);
  EXPECT_EQ(Files(), 2);
}

TEST_F(WholeFile, LeavesTheOldOneWhereTheNewOneDoesNotFit) {
  const fs::path file = folder_ / "file";
  WriteWhole(file, "old");
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  rlimit small = before;
  small.rlim_cur = 1000;
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  std::string told;
  try {
    WriteWhole(file, std::string(100000, 'x'));
  } catch (const std::runtime_error& e) {
    told = e.what();
  }
  setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, handler);
  EXPECT_THAT(told, testing::StartsWith("cannot write " + file.string() + ": File too large"));
  EXPECT_EQ(Read(file), "old");
  EXPECT_EQ(Files(), 1) << "what was begun is removed";
}

TEST_F(WholeFile, SaysWhyItCannot) {
  const auto told = [](auto&& write) -> std::string {
    try {
      write();
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return "";
  };
  const fs::path nowhere = folder_ / "nowhere" / "file";
  for (const std::string& line :
       {told([&] { WriteWhole(nowhere, "text"); }), told([&] { CheckMayWrite(nowhere); })})
    EXPECT_THAT(
        line, testing::HasSubstr("nowhere/file: No such file or directory; choose a folder with free space"));
  EXPECT_THAT(told([&] { WriteWhole(folder_, "text"); }), testing::HasSubstr("Is a directory"));
  EXPECT_THAT(told([&] { CheckMayWrite(folder_); }), testing::HasSubstr("Is a directory"));
  EXPECT_TRUE(fs::is_directory(folder_));
}

TEST_F(WholeFile, ACheckLeavesWhatIsThere) {
  const fs::path file = folder_ / "file";
  CheckMayWrite(file);
  EXPECT_EQ(Files(), 0);
  WriteWhole(file, "one");
  CheckMayWrite(file);
  EXPECT_EQ(Read(file), "one");
  EXPECT_EQ(Files(), 1);
}

TEST_F(WholeFile, DevicesAndPipesStayWhatTheyAre) {
  WriteWhole("/dev/null", "text");
  EXPECT_TRUE(fs::is_character_file("/dev/null"));
}

TEST_F(WholeFile, ReadsEveryByteOfAFileAndNoFolder) {
  const std::string bytes("a\r\n\0\xff b", 7);
  WriteWhole(folder_ / "file", bytes);
  EXPECT_EQ(ReadWhole(folder_ / "file"), bytes);
  WriteWhole(folder_ / "empty", "");
  EXPECT_EQ(ReadWhole(folder_ / "empty"), "");
  const auto refusal = [](const fs::path& file) -> std::string {
    try {
      ReadWhole(file);
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_EQ(refusal(folder_),
            "cannot read " + folder_.string() + ": it is a folder; name a file that exists and may be read");
  EXPECT_EQ(refusal(folder_ / "none"),
            "cannot read " + (folder_ / "none").string() +
                ": No such file or directory; name a file that exists and may be read");
}

}  // namespace
}  // namespace tendril::config
