// What the user reads when a CAN interface cannot be opened. Runs on any kernel: each case says which kernel
// it needs. Knows only the CAN room.
#include "tendril/can/socketcan_port.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>

namespace tendril::can {
namespace {

using ::testing::HasSubstr;

bool KernelHasCan() {
  const int fd = socket(PF_CAN, SOCK_RAW, CAN_RAW);
  if (fd < 0) return false;
  close(fd);
  return true;
}

std::system_error OpenError(const std::string& interface) {
  try {
    SocketCanPort port(interface);
  } catch (const std::system_error& e) {
    return e;
  }
  ADD_FAILURE() << "opening '" << interface << "' should have failed";
  return std::system_error(0, std::generic_category());
}

TEST(SocketCanPortErrors, AKernelWithoutCanIsNamedWithTheRemedy) {
  if (KernelHasCan()) GTEST_SKIP() << "this kernel has CAN";
  const std::system_error e = OpenError("can0");
  EXPECT_EQ(e.code().value(), EAFNOSUPPORT);
  EXPECT_THAT(e.what(), HasSubstr("'can0'"));
  EXPECT_THAT(e.what(), HasSubstr("this kernel has no CAN; run under tools/vcan-run"));
  EXPECT_THAT(e.what(), HasSubstr("can-raw"));
}

TEST(SocketCanPortErrors, AMissingInterfaceIsNamedWithTheRemedy) {
  if (!KernelHasCan()) GTEST_SKIP() << "needs a kernel with CAN: run under tools/vcan-run";
  const std::system_error e = OpenError("nocan7");
  EXPECT_EQ(e.code().value(), ENODEV);
  EXPECT_THAT(e.what(), HasSubstr("'nocan7' does not exist"));
  EXPECT_THAT(e.what(), HasSubstr("ip link add nocan7 type vcan"));
}

TEST(SocketCanPortErrors, AnInterfaceThatIsNoCanIsRefused) {
  if (!KernelHasCan()) GTEST_SKIP() << "needs a kernel with CAN: run under tools/vcan-run";
  EXPECT_THAT(OpenError("lo").what(), HasSubstr("'lo' is not a CAN interface"));
  EXPECT_THAT(OpenError("a_name_too_long_for_linux").what(), HasSubstr("1 to 15 characters"));
  EXPECT_THAT(OpenError("").what(), HasSubstr("1 to 15 characters"));
}

}  // namespace
}  // namespace tendril::can
