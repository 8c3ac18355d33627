// udpm:// in a network namespace of its own: without a multicast route it says what to do, and what it says
// works.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <string>
#include <thread>

#include "tendril/io/client.h"
#include "tendril/io/gateway.h"
#include "tendril/io/send_command.h"
#include "tendril_lcm/state_t.hpp"

namespace tendril::io {
namespace {

using testing::HasSubstr;

constexpr const char* kNoNamespace = "no namespace";
constexpr const char* kNoIpTool = "no ip tool";
constexpr const char* kUrl = "udpm://239.255.76.67:7667?ttl=0";

bool EnterNewNetwork() {
  const uid_t user = getuid();
  if (unshare(CLONE_NEWNET) == 0) return true;
  if (unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0) return false;
  std::ofstream("/proc/self/uid_map") << "0 " << user << " 1";
  return true;
}

// The route that the gateway's error names.
bool AddRoute() {
  return std::system("ip link set lo up && ip link set lo multicast on && ip route add 224.0.0.0/4 dev lo") ==
         0;
}

// What `work` returns, run in a process with an empty network.
std::string InEmptyNetwork(const std::function<std::string()>& work) {
  std::array<int, 2> ends{};
  if (pipe(ends.data()) != 0) return kNoNamespace;
  const pid_t child = fork();
  if (child == 0) {
    const std::string text = EnterNewNetwork() ? work() : kNoNamespace;
    _exit(write(ends[1], text.data(), text.size()) == static_cast<ssize_t>(text.size()) ? 0 : 1);
  }
  close(ends[1]);
  std::string text;
  std::array<char, 1000> buffer;
  for (ssize_t n; (n = read(ends[0], buffer.data(), buffer.size())) > 0;) {
    text.append(buffer.data(), static_cast<std::size_t>(n));
  }
  close(ends[0]);
  waitpid(child, nullptr, 0);
  return text;
}

std::string OpenGateway() {
  const MonotonicClock clock;
  try {
    const Gateway gateway({kUrl, "TENDRIL", 1, 1}, {1, 4, 3}, clock);
  } catch (const std::runtime_error& e) {
    return e.what();
  }
  return "opened";
}

TEST(Network, WithoutAMulticastRouteTheRemedyIsNamed) {
  const std::string text = InEmptyNetwork(OpenGateway);
  if (text == kNoNamespace) GTEST_SKIP() << "this machine allows no network namespace";
  EXPECT_THAT(text, HasSubstr("no multicast route to 239.255.76.67"));
  EXPECT_THAT(text, HasSubstr("ip link set lo multicast on && ip route add 224.0.0.0/4 dev lo"));
}

TEST(Network, TheRemedyWorksAndTwoConnectionsHearEachOther) {
  const std::string text = InEmptyNetwork([]() -> std::string {
    if (std::system("command -v ip >/dev/null") != 0) return kNoIpTool;
    if (!AddRoute()) return "the remedy failed";
    const MonotonicClock clock;
    Gateway gateway({kUrl, "TENDRIL", 1, 1}, {1, 4, 3}, clock);
    Client client(std::string(kUrl), "TENDRIL");
    std::int64_t heard = -1;
    client.OnState([&](const tendril_lcm::state_t& s) { heard = s.cycle; });
    CycleRecord record;
    record.input.cycle = 42;
    gateway.PublishState(record);
    for (int i = 0; i < 100 && heard < 0; ++i) client.Handle(20);
    Command command;
    command.kind = CommandKind::kMode;
    command.sequence = 7;
    std::uint32_t seen = 0;
    gateway.OnCommand([&](const Command& c) { seen = c.sequence; });
    client.Send(command, 0);
    for (int i = 0; i < 100 && seen == 0; ++i) gateway.Handle(20);
    return "state " + std::to_string(heard) + ", command " + std::to_string(seen);
  });
  if (text == kNoNamespace || text == kNoIpTool) GTEST_SKIP() << text;
  EXPECT_EQ(text, "state 42, command 7");
}

// A daemon that hears no disarm, only another command whose number lies between those of two repetitions.
TEST(Network, TheAnswerToAnotherCommandIsNoAnswer) {
  const std::string text = InEmptyNetwork([]() -> std::string {
    if (std::system("command -v ip >/dev/null") != 0) return kNoIpTool;
    if (!AddRoute()) return "the route failed";
    const MonotonicClock clock;
    Gateway gateway({kUrl, "TENDRIL", 1, 1}, {1, 4, 3}, clock);
    CycleRecord record;
    int heard = 0;
    gateway.OnCommand([&](const Command& command) {
      if (heard++ > 0) return;
      record.input.command = command;
      ++record.input.command.sequence;
    });
    std::atomic<bool> ended = false;
    std::thread daemon([&] {
      while (!ended) {
        if (heard != 1) gateway.PublishState(record);
        gateway.Handle(20);
      }
    });
    CommandCall call{.url = kUrl, .channel_prefix = "TENDRIL", .command = {}, .timeout_s = 1};
    call.command.kind = CommandKind::kMode;
    call.command.mode = ModeRequest::kDisarm;
    std::string answer;
    try {
      answer = SendCommand(call, {});
    } catch (const std::runtime_error& e) {
      answer = e.what();
    }
    ended = true;
    daemon.join();
    return fmt::format("{} {}", heard > 1 ? "repeated:" : "sent once:", answer);
  });
  if (text == kNoNamespace || text == kNoIpTool) GTEST_SKIP() << text;
  EXPECT_THAT(text, testing::StartsWith("repeated:"));
  EXPECT_THAT(text, HasSubstr("did not receive the command"));
}

}  // namespace
}  // namespace tendril::io
