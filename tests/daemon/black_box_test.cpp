// The folder of black boxes: it does not fill the disk, and nothing in it is touched that is not theirs.
#include "tendril/daemon/black_box.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <set>

#include "emulated_drives.h"

namespace tendril::daemon {
namespace {

namespace fs = std::filesystem;

TEST(BlackBox, KeepsTheNewestLogsAndWhateverIsNotItsOwn) {
  const fs::path folder = fs::temp_directory_path() / ("tendril_black_boxes_" + std::to_string(getpid()));
  fs::create_directories(folder);
  const auto old_log = [](std::size_t i) {
    return "20200101T0000" + std::to_string(10 + i) + ".123Z_406_FeedbackStale.lcmlog";
  };
  for (std::size_t i = 0; i < BlackBox::kLogsKept + 3; ++i) std::ofstream(folder / old_log(i)) << "old";
  const std::set<std::string> others{"notes.txt", "run.lcmlog",
                                     "20200101T000001.123Z_406_FeedbackStale.lcmlog.kept"};
  for (const std::string& name : others) std::ofstream(folder / name) << "mine";

  const RobotParameters robot = RigRobot();
  const DaemonParameters parameters = RigDaemon();
  const control::Controller controller(robot, parameters.controller, parameters.bus.cycle_ns);
  BlackBox black_box({.seconds = 1, .folder = folder}, parameters.lcm, ShapeOf(robot), {},
                     1'700'000'000'000'000, parameters.bus.cycle_ns, controller);
  CycleRecord record;
  record.output.mode = Mode::kFault;
  record.output.status = Status::kBusOff;
  black_box.Add(record, controller);
  const auto outcome = black_box.WriteSome(10);
  ASSERT_TRUE(outcome);
  EXPECT_EQ(outcome->status, Status::kOk) << outcome->text;

  std::set<std::string> logs, left;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename();
    (others.contains(name) ? left : logs).insert(name);
  }
  EXPECT_EQ(left, others);
  ASSERT_EQ(logs.size(), BlackBox::kLogsKept);
  EXPECT_EQ(*logs.begin(), old_log(4)) << "the oldest went";
  EXPECT_TRUE(logs.rbegin()->ends_with("_403_BusOff.lcmlog")) << *logs.rbegin();
  fs::remove_all(folder);
}

}  // namespace
}  // namespace tendril::daemon
