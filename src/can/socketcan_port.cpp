// SocketCAN raw socket: kernel errors become counters or one clear text. Knows nothing of what the frames
// mean.
#include "tendril/can/socketcan_port.h"

#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/netlink.h>
#include <linux/can/raw.h>
#include <linux/if_link.h>
#include <linux/rtnetlink.h>
#include <net/if.h>
#include <net/if_arp.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <optional>
#include <system_error>

namespace tendril::can {
namespace {

static_assert(kErrorBusOff == CAN_ERR_BUSOFF && kErrorRestarted == CAN_ERR_RESTARTED);

constexpr can_filter kOnly11Bit{.can_id = 0, .can_mask = CAN_EFF_FLAG};
constexpr int kBatch = 64;                       // frames per recvmmsg or sendmmsg call
constexpr TimeNs kLinkCheckNs = 100 * kNsPerMs;  // polling period for a lost interface
constexpr TimeNs kOldestStampNs = 10 * kNsPerS;  // older kernel stamps mean that the wall clock jumped
constexpr TimeNs kTrustStampNs = 10 * kNsPerMs;  // validity of the difference between the two clocks

TimeNs ReadClock(clockid_t id) noexcept {
  timespec t{};
  clock_gettime(id, &t);
  return static_cast<TimeNs>(t.tv_sec) * kNsPerS + t.tv_nsec;
}

[[noreturn]] void Fail(int error, const std::string& text) {
  throw std::system_error(error, std::generic_category(), text);
}

ifreq RequestFor(const std::string& interface) {
  ifreq request{};
  std::memcpy(request.ifr_name, interface.data(), std::min<std::size_t>(interface.size(), IFNAMSIZ - 1));
  return request;
}

can_frame RawFrame(const CanFrame& frame) noexcept {
  can_frame raw{};
  raw.can_id = frame.id;
  if (frame.remote) raw.can_id |= CAN_RTR_FLAG;
  if (frame.error) raw.can_id |= CAN_ERR_FLAG;
  raw.can_dlc = std::min<std::uint8_t>(frame.size, 8);
  std::copy_n(frame.data.begin(), 8, raw.data);
  return raw;
}

/// Kernel stamps (wall clock) as times of the monotonic clock. Both clocks are read at most once per batch
/// and less often under load, because a clock read can cost as much as the frame.
class StampClock {
 public:
  void BeginBatch() noexcept { fresh_ = false; }
  TimeNs Monotonic(TimeNs wall_ns) noexcept {
    if (!fresh_ && (wall_ns < wall_read_ns_ || wall_ns > wall_read_ns_ + kTrustStampNs)) Read();
    TimeNs age_ns = wall_read_ns_ - wall_ns;
    if (fresh_ && (age_ns < 0 || age_ns > kOldestStampNs)) age_ns = 0;  // a step of the wall clock
    return monotonic_read_ns_ - age_ns;
  }
  TimeNs Now() noexcept {
    if (!fresh_) Read();
    return monotonic_read_ns_;
  }

 private:
  void Read() noexcept {
    fresh_ = true;
    wall_read_ns_ = ReadClock(CLOCK_REALTIME);
    monotonic_read_ns_ = ReadClock(CLOCK_MONOTONIC);
  }

  bool fresh_ = false;  // read within this batch
  TimeNs wall_read_ns_ = 0, monotonic_read_ns_ = 0;
};

class Descriptor {
 public:
  explicit Descriptor(int fd) : fd_(fd) {}
  ~Descriptor() {
    if (fd_ >= 0) close(fd_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  int get() const { return fd_; }

 private:
  int fd_;
};

int OpenSocket(const std::string& interface) {
  const int fd = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
  if (fd >= 0) return fd;
  const int error = errno;
  if (error == EAFNOSUPPORT || error == EPROTONOSUPPORT) {
    Fail(error, "cannot open CAN interface '" + interface +
                    "': this kernel has no CAN; run under tools/vcan-run, or load it: modprobe can-raw");
  }
  Fail(error, "cannot open a CAN socket for interface '" + interface + "'");
}

/// What `ip link set NAME type can restart` sends.
class RestartRequest {
 public:
  explicit RestartRequest(int interface_index) noexcept {
    header_.nlmsg_type = RTM_NEWLINK;
    header_.nlmsg_flags = NLM_F_REQUEST;
    ifinfomsg link{};
    link.ifi_index = interface_index;
    Put(&header_, sizeof(header_));
    Put(&link, sizeof(link));
    const std::size_t info = Open(IFLA_LINKINFO);
    const std::size_t kind = Open(IFLA_INFO_KIND);
    Put("can", 3);
    Close(kind);
    const std::size_t data = Open(IFLA_INFO_DATA);
    const std::size_t restart = Open(IFLA_CAN_RESTART);
    const std::uint32_t yes = 1;
    Put(&yes, sizeof(yes));
    Close(restart);
    Close(data);
    Close(info);
    header_.nlmsg_len = static_cast<std::uint32_t>(size_);
    std::memcpy(bytes_.data(), &header_, sizeof(header_));
  }
  void Send() const noexcept {
    const Descriptor fd(socket(AF_NETLINK, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, NETLINK_ROUTE));
    sockaddr_nl kernel{};
    kernel.nl_family = AF_NETLINK;
    // The interface's state shows whether it was granted.
    if (fd.get() >= 0) {
      (void)sendto(fd.get(), bytes_.data(), size_, MSG_DONTWAIT, reinterpret_cast<const sockaddr*>(&kernel),
                   sizeof(kernel));
    }
  }

 private:
  void Put(const void* from, std::size_t size) noexcept {
    std::memcpy(bytes_.data() + size_, from, size);
    size_ += NLMSG_ALIGN(size);
  }
  std::size_t Open(std::uint16_t type) noexcept {
    const std::size_t at = size_;
    const rtattr attribute{.rta_len = 0, .rta_type = type};
    Put(&attribute, sizeof(attribute));
    return at;
  }
  void Close(std::size_t at) noexcept {
    const auto length = static_cast<std::uint16_t>(size_ - at);
    std::memcpy(bytes_.data() + at, &length, sizeof(length));
  }

  nlmsghdr header_{};
  alignas(nlmsghdr) std::array<char, 128> bytes_{};
  std::size_t size_ = 0;
};

}  // namespace

struct SocketCanPort::State {
  explicit State(const std::string& name) : interface(name), fd(OpenSocket(name)) {
    for (std::size_t i = 0; i < kBatch; ++i) {
      slots[i].part = {&slots[i].frame, sizeof(can_frame)};
      headers[i].msg_hdr.msg_iov = &slots[i].part;
      headers[i].msg_hdr.msg_iovlen = 1;
      headers[i].msg_hdr.msg_control = slots[i].control;
      headers[i].msg_hdr.msg_controllen = sizeof(slots[i].control);
      out_parts[i] = {&out_frames[i], sizeof(can_frame)};
      out_headers[i].msg_hdr.msg_iov = &out_parts[i];
      out_headers[i].msg_hdr.msg_iovlen = 1;
    }
  }

  void Bind();
  void SizeReceiveBuffer(int bytes) const;
  template <typename T>
  void SetOption(int level, int option, const T& value, const char* what) const;
  int ReceiveBatch(std::span<StampedFrame> frames) noexcept;
  void NoteFrame(StampedFrame* out, const can_frame& raw, TimeNs time_ns) noexcept;
  TimeNs NoteControl(msghdr* header) noexcept;
  void NoteSent(const CanFrame& frame) noexcept;
  void NoteError(int error) noexcept;
  void LookForLink() noexcept;

  std::string interface;
  Descriptor fd;
  int index = 0;
  bool bus_off = false;
  bool link_down = false;
  TimeNs next_link_check_ns = 0;
  std::uint32_t kernel_drops = 0;  // running count of the socket, wraps
  CanCounters counters;

  struct Slot {
    can_frame frame;
    iovec part;
    alignas(cmsghdr) char control[CMSG_SPACE(sizeof(timespec)) + CMSG_SPACE(sizeof(std::uint32_t))];
  };
  std::array<Slot, kBatch> slots{};
  std::array<mmsghdr, kBatch> headers{};  // ready to receive, always
  StampClock stamps;
  std::array<can_frame, kBatch> out_frames{};
  std::array<iovec, kBatch> out_parts{};
  std::array<mmsghdr, kBatch> out_headers{};
};

void SocketCanPort::State::Bind() {
  if (interface.empty() || interface.size() >= IFNAMSIZ) {
    Fail(ENODEV, "CAN interface name '" + interface + "' must have 1 to 15 characters, for example can0");
  }
  ifreq request = RequestFor(interface);
  if (ioctl(fd.get(), SIOCGIFINDEX, &request) < 0) {
    Fail(errno, "CAN interface '" + interface +
                    "' does not exist; plug in the adapter, or create a virtual one: ip link add " +
                    interface + " type vcan");
  }
  index = request.ifr_ifindex;
  if (ioctl(fd.get(), SIOCGIFHWADDR, &request) < 0) Fail(errno, "cannot query interface '" + interface + "'");
  if (request.ifr_hwaddr.sa_family != ARPHRD_CAN) {
    Fail(ENODEV, "interface '" + interface + "' is not a CAN interface; see: ip -details link show type can");
  }
  if (ioctl(fd.get(), SIOCGIFFLAGS, &request) < 0) Fail(errno, "cannot query interface '" + interface + "'");
  if (!(request.ifr_flags & IFF_UP)) {
    Fail(ENETDOWN, "CAN interface '" + interface + "' is down; bring it up: ip link set " + interface +
                       " up type can bitrate 1000000 restart-ms 100 (a virtual one without 'type …')");
  }
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = index;
  if (bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) < 0) {
    Fail(errno, "cannot bind to CAN interface '" + interface + "'");
  }
}

void SocketCanPort::State::SizeReceiveBuffer(int bytes) const {
  // The forced form may exceed net.core.rmem_max but needs CAP_NET_ADMIN; the plain one is clipped silently.
  if (setsockopt(fd.get(), SOL_SOCKET, SO_RCVBUFFORCE, &bytes, sizeof(bytes)) == 0) return;
  SetOption(SOL_SOCKET, SO_RCVBUF, bytes, "the receive buffer size");
}

template <typename T>
void SocketCanPort::State::SetOption(int level, int option, const T& value, const char* what) const {
  if (setsockopt(fd.get(), level, option, &value, sizeof(value)) < 0) {
    Fail(errno, "cannot set " + std::string(what) + " on CAN interface '" + interface + "'");
  }
}

void SocketCanPort::State::NoteError(int error) noexcept {
  if (error == ENETDOWN || error == ENODEV || error == ENXIO) link_down = true;
}

void SocketCanPort::State::NoteSent(const CanFrame& frame) noexcept {
  ++counters.sent;
  counters.bits += static_cast<std::uint64_t>(WorstCaseBits(frame));
}

/// Reads the drop counter; returns the frame's arrival by the monotonic clock.
TimeNs SocketCanPort::State::NoteControl(msghdr* header) noexcept {
  std::optional<TimeNs> wall_ns;
  for (cmsghdr* c = CMSG_FIRSTHDR(header); c != nullptr; c = CMSG_NXTHDR(header, c)) {
    if (c->cmsg_level != SOL_SOCKET) continue;
    if (c->cmsg_type == SO_TIMESTAMPNS) {
      timespec t{};
      std::memcpy(&t, CMSG_DATA(c), sizeof(t));
      wall_ns = static_cast<TimeNs>(t.tv_sec) * kNsPerS + t.tv_nsec;
    } else if (c->cmsg_type == SO_RXQ_OVFL) {
      std::uint32_t drops = 0;
      std::memcpy(&drops, CMSG_DATA(c), sizeof(drops));
      counters.receive_dropped += static_cast<std::uint32_t>(drops - kernel_drops);
      kernel_drops = drops;
    }
  }
  return wall_ns ? stamps.Monotonic(*wall_ns) : stamps.Now();
}

void SocketCanPort::State::NoteFrame(StampedFrame* out, const can_frame& raw, TimeNs time_ns) noexcept {
  CanFrame& frame = out->frame;
  frame.error = (raw.can_id & CAN_ERR_FLAG) != 0;
  frame.remote = !frame.error && (raw.can_id & CAN_RTR_FLAG) != 0;
  frame.id = raw.can_id & (frame.error ? CAN_ERR_MASK : CAN_SFF_MASK);
  frame.size = std::min<std::uint8_t>(raw.can_dlc, 8);
  std::copy_n(raw.data, 8, frame.data.begin());
  out->time_ns = time_ns;
  if (frame.error) {
    ++counters.error_frames;
    if (frame.id & kErrorBusOff) {
      ++counters.bus_off;
      bus_off = true;
    }
    if (frame.id & kErrorRestarted) bus_off = false;
  } else {
    ++counters.received;
    counters.bits += static_cast<std::uint64_t>(WorstCaseBits(frame));
  }
}

int SocketCanPort::State::ReceiveBatch(std::span<StampedFrame> frames) noexcept {
  const auto requested = static_cast<unsigned>(std::min<std::size_t>(frames.size(), kBatch));
  const int n = recvmmsg(fd.get(), headers.data(), requested, MSG_DONTWAIT, nullptr);
  if (n <= 0) {
    if (n < 0) NoteError(errno);
    return 0;
  }
  stamps.BeginBatch();
  std::size_t kept = 0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(n); ++i) {
    const TimeNs time_ns = NoteControl(&headers[i].msg_hdr);
    // The kernel overwrote it with the length used.
    headers[i].msg_hdr.msg_controllen = sizeof(slots[i].control);
    if (headers[i].msg_len == CAN_MTU) NoteFrame(&frames[kept++], slots[i].frame, time_ns);
  }
  return static_cast<int>(kept);
}

void SocketCanPort::State::LookForLink() noexcept {
  const TimeNs now_ns = ReadClock(CLOCK_MONOTONIC);
  if (now_ns < next_link_check_ns) return;
  next_link_check_ns = now_ns + kLinkCheckNs;
  ifreq request = RequestFor(interface);
  if (ioctl(fd.get(), SIOCGIFFLAGS, &request) < 0 || !(request.ifr_flags & IFF_UP)) return;
  if (ioctl(fd.get(), SIOCGIFINDEX, &request) < 0) return;
  if (request.ifr_ifindex != index) {
    // An adapter plugged in again is a new device under the old name; the kernel dropped the filter with the
    // old one.
    if (setsockopt(fd.get(), SOL_CAN_RAW, CAN_RAW_FILTER, &kOnly11Bit, sizeof(kOnly11Bit)) < 0) return;
    sockaddr_can address{};
    address.can_family = AF_CAN;
    address.can_ifindex = request.ifr_ifindex;
    if (bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) < 0) return;
    index = request.ifr_ifindex;
  }
  link_down = false;
  bus_off = false;  // bringing an interface up restarts its controller
}

SocketCanPort::SocketCanPort(const std::string& interface) : SocketCanPort(interface, Options{}) {}

SocketCanPort::SocketCanPort(const std::string& interface, const Options& options)
    : state_(std::make_unique<State>(interface)) {
  state_->SizeReceiveBuffer(options.receive_buffer_bytes);
  const int on = 1;
  state_->SetOption(SOL_SOCKET, SO_RXQ_OVFL, on, "the drop counter");
  state_->SetOption(SOL_SOCKET, SO_TIMESTAMPNS, on, "time stamps");
  const can_err_mask_t errors = options.error_frames ? CAN_ERR_MASK : 0;
  state_->SetOption(SOL_CAN_RAW, CAN_RAW_ERR_FILTER, errors, "error frames");
  state_->SetOption(SOL_CAN_RAW, CAN_RAW_FILTER, kOnly11Bit, "the frame filter");
  state_->Bind();
}

SocketCanPort::~SocketCanPort() = default;

bool SocketCanPort::Send(const CanFrame& frame) noexcept {
  const can_frame raw = RawFrame(frame);
  if (send(state_->fd.get(), &raw, sizeof(raw), MSG_DONTWAIT) == static_cast<ssize_t>(sizeof(raw))) {
    state_->NoteSent(frame);
    return true;
  }
  state_->NoteError(errno);
  ++state_->counters.send_refused;
  return false;
}

int SocketCanPort::SendAll(std::span<const CanFrame> frames) noexcept {
  int queued = 0;
  while (!frames.empty()) {
    const std::size_t n = std::min<std::size_t>(frames.size(), kBatch);
    for (std::size_t i = 0; i < n; ++i) state_->out_frames[i] = RawFrame(frames[i]);
    const int sent =
        sendmmsg(state_->fd.get(), state_->out_headers.data(), static_cast<unsigned>(n), MSG_DONTWAIT);
    if (sent > 0) {
      for (const CanFrame& frame : frames.first(static_cast<std::size_t>(sent))) state_->NoteSent(frame);
      queued += sent;
      frames = frames.subspan(static_cast<std::size_t>(sent));
    } else {  // the first one was refused
      state_->NoteError(errno);
      ++state_->counters.send_refused;
      frames = frames.subspan(1);
    }
  }
  return queued;
}

int SocketCanPort::Receive(std::span<StampedFrame> frames) noexcept {
  if (state_->link_down) state_->LookForLink();
  std::size_t taken = 0;
  while (taken < frames.size()) {
    const int n = state_->ReceiveBatch(frames.subspan(taken));
    taken += static_cast<std::size_t>(n);
    if (n < kBatch) break;
  }
  return static_cast<int>(taken);
}

bool SocketCanPort::WaitUntil(TimeNs deadline_ns) noexcept {
  while (true) {
    const TimeNs left_ns = std::max<TimeNs>(0, deadline_ns - ReadClock(CLOCK_MONOTONIC));
    const timespec timeout{.tv_sec = static_cast<time_t>(left_ns / kNsPerS),
                           .tv_nsec = static_cast<long>(left_ns % kNsPerS)};
    pollfd poll_fd{.fd = state_->fd.get(), .events = POLLIN, .revents = 0};
    const int n = ppoll(&poll_fd, 1, &timeout, nullptr);
    if (n > 0 && (poll_fd.revents & POLLIN)) return true;
    if (n > 0) {  // clear a pending socket error, or ppoll would return at once for ever
      int error = 0;
      socklen_t size = sizeof(error);
      getsockopt(state_->fd.get(), SOL_SOCKET, SO_ERROR, &error, &size);
      state_->NoteError(error);
    }
    if (left_ns == 0) return false;
  }
}

bool SocketCanPort::bus_off() const noexcept { return state_->bus_off && !state_->link_down; }

void SocketCanPort::Restart() noexcept {
  if (!bus_off()) return;
  RestartRequest(state_->index).Send();
  ifreq request = RequestFor(state_->interface);
  if (ioctl(state_->fd.get(), SIOCGIFFLAGS, &request) < 0) return;
  // A controller that is off has no carrier, which clears the running flag within a second.
  constexpr int kRuns = IFF_UP | IFF_RUNNING;
  if ((request.ifr_flags & kRuns) == kRuns) state_->bus_off = false;
}

bool SocketCanPort::up() const noexcept { return !state_->bus_off && !state_->link_down; }

const CanCounters& SocketCanPort::counters() const noexcept { return state_->counters; }

}  // namespace tendril::can
