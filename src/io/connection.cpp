// Opening and draining LCM connections; see the header.
#include "tendril/io/connection.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
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

// LCM only prints a hint and waits for its own packets; querying the kernel for a route beforehand is
// immediate.
void RequireMulticastRoute(const std::string& url) {
  const std::string address = url.substr(kUdpm.size(), url.find(':', kUdpm.size()) - kUdpm.size());
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(7667);
  inet_pton(AF_INET, address.c_str(), &to.sin_addr);
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
  // LCM would print its own line for an unknown address, or ignore it.
  if (!IsLcmUrl(address)) {
    throw std::runtime_error("LCM address '" + address +
                             "' cannot be opened; accepted: " + std::string(kLcmUrlRule) + "; correct it");
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
