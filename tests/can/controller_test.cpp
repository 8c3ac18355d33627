// Bus-off as a real controller's driver of the kernel has it (label "vcan"): a serial-line CAN adapter whose
// other end is this test, which says that the bus went off. Where the user-mode kernel with its modules runs;
// skips elsewhere, and never loads a module into a machine's own kernel.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/utsname.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <thread>

#include "tendril/can/socketcan_port.h"

namespace tendril::can {
namespace {

constexpr const char* kInterface = "can0";

bool Shell(const std::string& command) { return std::system((command + " >/dev/null 2>&1").c_str()) == 0; }

class ControllerTest : public ::testing::Test {
 protected:
  void SetUp() override {
    utsname name{};
    uname(&name);
    const std::string module =
        std::string("/usr/lib/uml/modules/") + name.release + "/kernel/drivers/net/can/slcan/slcan.ko";
    if (!std::filesystem::exists(module))
      GTEST_SKIP() << "no user-mode kernel here: run under tools/vcan-run";
    if (!Shell("grep -q ^slcan /proc/modules") && !Shell("insmod " + module)) GTEST_SKIP() << "no slcan here";
    adapter_ = posix_openpt(O_RDWR | O_NOCTTY);
    ASSERT_GE(adapter_, 0);
    ASSERT_EQ(grantpt(adapter_), 0);
    ASSERT_EQ(unlockpt(adapter_), 0);
    line_ = open(ptsname(adapter_), O_RDWR | O_NOCTTY);
    ASSERT_GE(line_, 0);
    termios raw{};
    cfmakeraw(&raw);
    raw.c_cflag |= CREAD | CS8;
    ASSERT_EQ(tcsetattr(line_, TCSANOW, &raw), 0);
    const int slcan_discipline = 17;
    ASSERT_EQ(ioctl(line_, TIOCSETD, &slcan_discipline), 0);
    reader_ = std::thread([fd = adapter_] {  // the driver waits until its commands are taken
      char bytes[256];
      while (read(fd, bytes, sizeof(bytes)) > 0) {
      }
    });
    ASSERT_TRUE(Shell("ip link set can0 type can bitrate 1000000") && Shell("ip link set can0 up"));
  }
  void TearDown() override {
    if (line_ >= 0) close(line_);  // ends the reader, whose side hangs up
    if (reader_.joinable()) reader_.join();
    if (adapter_ >= 0) close(adapter_);
  }
  /// As the adapter says it.
  void Say(const std::string& line) {
    ASSERT_EQ(write(adapter_, line.data(), line.size()), static_cast<ssize_t>(line.size()));
  }
  static bool Becomes(SocketCanPort& port, bool up) {
    std::array<StampedFrame, 4> got;
    for (int i = 0; i < 200 && port.up() != up; ++i) {
      port.Receive(got);
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return port.up() == up;
  }
  static bool Running() { return Shell(std::string("ip link show ") + kInterface + " | grep -q LOWER_UP"); }

  int adapter_ = -1, line_ = -1;
  std::thread reader_;
};

TEST_F(ControllerTest, AControllerThatIsOffIsNotTakenForRunning) {
  SocketCanPort port(kInterface);
  std::array<StampedFrame, 4> got;
  Say("t12321122\r");
  for (int i = 0; i < 100 && port.counters().received == 0; ++i) {
    port.Receive(got);
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  EXPECT_EQ(port.counters().received, 1u) << "the adapter's frames arrive";

  Say("sb128128\r");
  ASSERT_TRUE(Becomes(port, false));
  EXPECT_TRUE(port.bus_off());
  EXPECT_EQ(port.counters().bus_off, 1u);
  // The interface's flags follow the carrier within a second, which is why a restart is not asked for at
  // once.
  std::this_thread::sleep_for(std::chrono::milliseconds(1200));
  ASSERT_FALSE(Running());
  port.Restart();  // this driver knows no restart
  EXPECT_TRUE(port.bus_off());
  EXPECT_FALSE(port.up());

  ASSERT_TRUE(Shell("ip link set can0 down") && Shell("ip link set can0 up"));
  EXPECT_TRUE(Becomes(port, true)) << "a controller that was started afresh is back";
  EXPECT_FALSE(port.bus_off());
}

}  // namespace
}  // namespace tendril::can
