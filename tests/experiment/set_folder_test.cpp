// Where data sets are left: what was measured is never lost, whatever goes wrong.
#include "tendril/gap/set_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <map>

#include "support/own_folder.h"
#include "tendril/config/config.h"
#include "tendril/core/usage_error.h"
#include "tendril/experiment/set_output.h"

namespace tendril::experiment {
namespace {

namespace fs = std::filesystem;
using Files = std::map<std::string, std::string>;
using gap::CheckWritable;
using gap::RefuseToReplace;
using gap::SetFolder;
using test::ReadText;
using testing::HasSubstr;

class SetFolderTest : public test::OwnFolder {
 protected:
  static gap::DataSet Set(const std::vector<std::string>& names) {
    gap::DataSet set;
    set.robot = config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_90mm.yaml");
    for (const std::string& name : names) {
      gap::Run run;
      run.name = name;
      run.time_s = Eigen::Vector3d(0, 0.001, 0.002);
      run.tension_N.setConstant(3, 3, static_cast<double>(set.runs.size()));
      set.runs.push_back(run);
    }
    return set;
  }
  Files In(const std::string& name) const {
    Files files;
    for (const auto& entry : fs::directory_iterator(folder_ / name))
      files[entry.path().filename().string()] = ReadText(entry.path());
    return files;
  }
  SetFolder Folder(const std::string& name, bool overwrite = false) const {
    return {folder_ / name, overwrite, {}};
  }
};

TEST_F(SetFolderTest, LookingMakesNothing) {
  const SetFolder folder = Folder("a/b/c");
  EXPECT_FALSE(folder.replaces());
  EXPECT_FALSE(fs::exists(folder_ / "a"));
  folder.Write(Set({"01_circle"}));
  EXPECT_EQ(In("a/b/c").size(), 3u);
  EXPECT_THROW(Folder("a/b/c"), UsageError);
  EXPECT_TRUE(Folder("a/b/c", true).replaces());
}

TEST_F(SetFolderTest, AnIncompleteSetStandsBesideTheEarlierOne) {
  Folder("set").Write(Set({"01_circle", "02_hold"}));
  const Files before = In("set");
  for (const char* name : {"set.incomplete", "set.incomplete-2"}) {
    EXPECT_EQ(Folder("set", true).WriteIncomplete(Set({"01_circle"})), folder_ / name);
    EXPECT_EQ(gap::LoadDataSet(folder_ / name, "").runs.size(), 1u);
  }
  EXPECT_EQ(In("set"), before);
  // Where nothing is in the way there is no need for another place.
  EXPECT_EQ(Folder("new").WriteIncomplete(Set({"01_circle"})), folder_ / "new");
}

// What a program made can be made again; what a robot did cannot.
TEST_F(SetFolderTest, WhatEndedEarlyGivesWayToTheEarlierSetUnlessItWasMeasured) {
  ExperimentSet part;
  part.data = Set({"01_circle"});
  part.trouble = "02_hold: stopped";
  // Nothing is in the way: what there is stays.
  EXPECT_EQ(WriteSet(part, Folder("set"), false), folder_ / "set");
  const Files before = In("set");
  EXPECT_THROW(WriteSet(part, Folder("set", true), false), std::runtime_error);
  EXPECT_FALSE(fs::exists(folder_ / "set.incomplete"));
  EXPECT_EQ(WriteSet(part, Folder("set", true), true), folder_ / "set.incomplete");
  EXPECT_EQ(gap::LoadDataSet(folder_ / "set.incomplete", "").runs.at(0).name, "01_circle");
  EXPECT_EQ(In("set"), before);
  ExperimentSet none;
  none.trouble = "no daemon";
  EXPECT_THROW(WriteSet(none, Folder("set", true), true), std::runtime_error);
  ExperimentSet whole;
  whole.data = Set({"01_hold"});
  EXPECT_EQ(WriteSet(whole, Folder("set", true), true), folder_ / "set");
  EXPECT_FALSE(fs::exists(folder_ / "set/01_circle.csv"));
}

TEST_F(SetFolderTest, ASetThatCannotBeWrittenLeavesTheEarlierOne) {
  Folder("set").Write(Set({"01_circle", "02_hold"}));
  const Files before = In("set");
  EXPECT_THROW(Folder("set", true).Write(Set({"01_circle", "no/name"})), std::runtime_error);
  EXPECT_EQ(In("set"), before) << "nor is anything left of the new one";
  // What is called like a file of the set but is none.
  fs::remove(folder_ / "set/robot.yaml");
  Files rest = In("set");
  fs::create_directories(folder_ / "set/robot.yaml/x");
  EXPECT_THROW(Folder("set", true), UsageError);
  fs::remove_all(folder_ / "set/robot.yaml");
  EXPECT_EQ(In("set"), rest);
}

TEST_F(SetFolderTest, AListThatNamesOtherFilesGivesThemNotAway) {
  Folder("set").Write(Set({"01_circle"}));
  std::ofstream(folder_ / "precious.csv") << "t_s\n";
  std::ofstream(folder_ / "set/thesis.txt") << "mine";
  std::ofstream(folder_ / "set/runs.yaml") << "runs:\n  - {file: ../precious.csv}\n  - {file: thesis.txt}\n"
                                           << "  - " << folder_ / "precious.csv"
                                           << "\n  - 01_circle.csv\n";
  Folder("set", true).Write(Set({"01_hold"}));
  EXPECT_TRUE(fs::exists(folder_ / "precious.csv"));
  EXPECT_EQ(ReadText(folder_ / "set/thesis.txt"), "mine");
  EXPECT_FALSE(fs::exists(folder_ / "set/01_circle.csv"));
  std::ofstream(folder_ / "set/runs.yaml") << "runs: [\n";
  try {
    Folder("set", true);
    FAIL();
  } catch (const UsageError& e) {
    EXPECT_THAT(e.what(), HasSubstr("not YAML"));
  }
}

}  // namespace
}  // namespace tendril::experiment
