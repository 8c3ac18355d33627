// Opening and draining LCM connections; see the header.
#include "tendril/io/connection.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <lcm/lcm-cpp.hpp>
#include <stdexcept>
#include <string_view>
#include <system_error>

#include "tendril/core/clock.h"
#include "tendril/core/daemon.h"

namespace tendril::io {
namespace {

constexpr std::string_view kUdpm = "udpm://";
constexpr int kMaxAtOnce = 10'000;

// LCM itself only prints a hint and waits for its own packets; asking the kernel for a route beforehand is
// immediate.
void RequireMulticastRoute(const std::string& url) {
  std::string address = "239.255.76.67";
  std::string target = url.substr(kUdpm.size());
  target = target.substr(0, target.find('?'));
  if (const std::string host = target.substr(0, target.find(':')); !host.empty()) address = host;
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(7667);
  if (inet_pton(AF_INET, address.c_str(), &to.sin_addr) != 1 || !IN_MULTICAST(ntohl(to.sin_addr.s_addr))) {
    throw std::runtime_error("LCM address '" + url + "': " + address +
                             " is not a multicast address; use 224.0.0.0 to 239.255.255.255, for example "
                             "udpm://239.255.76.67:7667?ttl=0");
  }
  const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) throw std::runtime_error("LCM address '" + url + "': no socket: " + std::strerror(errno));
  sockaddr any{};
  static_assert(sizeof(any) == sizeof(to));
  std::memcpy(&any, &to, sizeof(any));
  const int error = connect(fd, &any, sizeof(any)) == 0 ? 0 : errno;
  close(fd);
  if (error != 0) {
    throw std::system_error(
        error, std::generic_category(),
        "LCM address '" + url + "': no multicast route to " + address +
            "; add one: 'ip link set lo multicast on && ip route add 224.0.0.0/4 dev lo' as root, or "
            "do the same inside 'unshare --net' after 'ip link set lo up'");
  }
}

}  // namespace

std::unique_ptr<lcm::LCM> OpenLcm(const std::string& url) {
  std::string address = url;
  if (address.empty()) {
    const char* variable = std::getenv("LCM_DEFAULT_URL");
    address = variable != nullptr && *variable != '\0' ? variable : "udpm://239.255.76.67:7667?ttl=0";
  }
  // LCM would print a line of its own about an unknown kind.
  constexpr std::array<std::string_view, 5> kKinds = {kUdpm, "mpudpm://", "memq://", "tcpq://", "file://"};
  if (std::none_of(kKinds.begin(), kKinds.end(),
                   [&](std::string_view k) { return address.starts_with(k); })) {
    throw std::runtime_error(
        "LCM address '" + address +
        "' cannot be opened: it must begin with udpm://, mpudpm://, memq://, tcpq:// or file://; "
        "use for example udpm://239.255.76.67:7667?ttl=0");
  }
  if (address.starts_with(kUdpm)) RequireMulticastRoute(address);
  auto lcm = std::make_unique<lcm::LCM>(address);
  if (!lcm->good()) {
    throw std::runtime_error(
        "LCM address '" + address +
        "' cannot be opened; use for example udpm://239.255.76.67:7667?ttl=0, and on a machine "
        "without network 'ip link set lo multicast on && ip route add 224.0.0.0/4 dev lo'");
  }
  return lcm;
}

std::string ChannelName(const std::string& prefix, const std::string& name) {
  if (!IsChannelPrefix(prefix)) {
    throw std::runtime_error("LCM channel prefix '" + prefix + "': use " + std::string(kChannelPrefixRule));
  }
  return prefix + "_" + name;
}

int HandleWaiting(lcm::LCM& lcm, int timeout_ms) {
  const MonotonicClock clock;
  const TimeNs end_ns = clock.Now() + timeout_ms * kNsPerMs;
  int handled = 0;
  while (handled < kMaxAtOnce && lcm.handleTimeout(handled == 0 ? timeout_ms : 0) > 0) {
    ++handled;
    if (timeout_ms > 0 && clock.Now() > end_ns) break;
  }
  return handled;
}

}  // namespace tendril::io
