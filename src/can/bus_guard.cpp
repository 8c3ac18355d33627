// One program of a kind per bus, by an abstract socket name. Knows nothing of what the program does with the
// bus.
#include "tendril/can/bus_guard.h"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <stdexcept>

namespace tendril::can {
namespace {

// An address in the abstract socket name space: no file and no permissions, released with the process, and
// scoped to a network namespace like CAN interfaces.
struct Address {
  Address(const std::string& program, const std::string& interface) {
    const std::string name = program + "/" + interface;
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    const std::size_t length = std::min(name.size(), sizeof(address.sun_path) - 1);
    std::memcpy(address.sun_path + 1, name.data(), length);
    size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + length);
    std::memcpy(&storage, &address, sizeof(address));
  }
  const sockaddr* get() const { return static_cast<const sockaddr*>(static_cast<const void*>(&storage)); }

  sockaddr_storage storage{};
  socklen_t size = 0;
};

// Process id of the holder of the address, 0 when unknown.
pid_t Holder(const Address& address) {
  const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return 0;
  ucred peer{};
  socklen_t size = sizeof(peer);
  const bool known = connect(fd, address.get(), address.size) == 0 &&
                     getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &peer, &size) == 0;
  close(fd);
  return known ? peer.pid : 0;
}

}  // namespace

BusGuard::BusGuard(const std::string& program, const std::string& interface)
    : socket_(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
  const Address address(program, interface);
  if (socket_ >= 0 && bind(socket_, address.get(), address.size) == 0 && listen(socket_, 1) == 0) return;
  const int error = errno;
  if (socket_ >= 0) close(socket_);
  if (error == EADDRINUSE) {
    const pid_t pid = Holder(address);
    throw std::runtime_error("another " + program + " is on " + interface + " already" +
                             (pid > 0 ? " (process " + std::to_string(pid) + ")" : "") +
                             "; stop it first, or choose another interface with --can");
  }
  throw std::runtime_error("cannot reserve interface " + interface + ": " + std::strerror(error));
}

BusGuard::~BusGuard() { close(socket_); }

}  // namespace tendril::can
