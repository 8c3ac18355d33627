// The bus cycle of three drives over a real vcan0 compared with bare SocketCAN programs that move the same
// frames, in alternating blocks of one run. Prints times and their ratios; run it under tools/vcan-run.
//
// Two bare programs: one that waits for each frame until a deadline, as every control loop must (clock,
// ppoll, read), and one that blocks in read() for ever, which no control loop may do but which nothing can
// undercut. All processes have the same real-time priority where that is allowed, so that none preempts
// another.
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <stdexcept>
#include <string>
#include <system_error>
#include <vector>

#include "tendril/can/socketcan_port.h"
#include "tendril/canopen/master.h"
#include "tendril/emulator/drive_rack.h"

namespace {

using namespace tendril;

constexpr int kDrives = 3, kBlocks = 12, kCycles = 1000, kWarmUp = 100;
constexpr TimeNs kCycle_ns = kNsPerMs, kDeadline_ns = kNsPerS;
constexpr const char* kInterface = "vcan0";

struct Times {
  std::vector<TimeNs> echo_ns;   // SYNC about to be sent .. the last drive's feedback in hand
  std::vector<TimeNs> cycle_ns;  // ... and the torques sent

  void Add(TimeNs begin_ns, TimeNs answered_ns, TimeNs end_ns) {
    echo_ns.push_back(answered_ns - begin_ns);
    cycle_ns.push_back(end_ns - begin_ns);
  }
  void Append(const Times& other) {
    echo_ns.insert(echo_ns.end(), other.echo_ns.begin(), other.echo_ns.end());
    cycle_ns.insert(cycle_ns.end(), other.cycle_ns.begin(), other.cycle_ns.end());
  }
};

double Quantile_us(std::vector<TimeNs> times, double q) {
  const auto at = static_cast<std::ptrdiff_t>(q * static_cast<double>(times.size() - 1));
  std::nth_element(times.begin(), times.begin() + at, times.end());
  return 1e-3 * static_cast<double>(times[static_cast<std::size_t>(at)]);
}

/// Runs `work` in a child process that ends with this one or when asked to.
template <class Work>
class Child {
 public:
  explicit Child(Work work) : pid_(fork()) {
    if (pid_ < 0) throw std::system_error(errno, std::generic_category(), "fork");
    if (pid_ != 0) return;
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    try {
      work();
    } catch (const std::exception& e) {
      std::fprintf(stderr, "%s\n", e.what());
    }
    _exit(1);
  }
  ~Child() {
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

 private:
  pid_t pid_;
};

void SleepUntil(TimeNs t_ns) {
  const timespec t{.tv_sec = t_ns / kNsPerS, .tv_nsec = t_ns % kNsPerS};
  clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr);
}

// ---- bare SocketCAN
// -----------------------------------------------------------------------------

enum class Bare { kBlocking, kDeadline };

int OpenBare() {
  const int fd = socket(PF_CAN, SOCK_RAW, CAN_RAW);
  ifreq request{};
  std::strncpy(request.ifr_name, kInterface, IFNAMSIZ - 1);
  if (fd < 0 || ioctl(fd, SIOCGIFINDEX, &request) < 0) {
    throw std::runtime_error("no vcan0 here: run under tools/vcan-run");
  }
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = request.ifr_ifindex;
  if (bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) < 0) {
    throw std::system_error(errno, std::generic_category(), "bind");
  }
  return fd;
}

void WriteBare(int fd, canid_t id, __u8 size) {
  can_frame frame{};
  frame.can_id = id;
  frame.can_dlc = size;
  if (write(fd, &frame, sizeof(frame)) != sizeof(frame)) {
    throw std::system_error(errno, std::generic_category(), "write");
  }
}

can_frame ReadBare(int fd) {
  can_frame frame{};
  if (read(fd, &frame, sizeof(frame)) != sizeof(frame)) {
    throw std::system_error(errno, std::generic_category(), "read");
  }
  return frame;
}

/// Waits for one frame until `deadline_ns`; false when none came.
bool ReadBareUntil(int fd, TimeNs deadline_ns, const Clock& clock, can_frame* frame) {
  const TimeNs left_ns = std::max<TimeNs>(0, deadline_ns - clock.Now());
  const timespec timeout{.tv_sec = left_ns / kNsPerS, .tv_nsec = left_ns % kNsPerS};
  pollfd poll_fd{.fd = fd, .events = POLLIN, .revents = 0};
  if (ppoll(&poll_fd, 1, &timeout, nullptr) <= 0) return false;
  *frame = ReadBare(fd);
  return true;
}

[[noreturn]] void EchoBare(int fd, Bare way) {
  const MonotonicClock clock;
  can_frame frame{};
  while (true) {
    if (way == Bare::kBlocking) {
      frame = ReadBare(fd);
    } else if (!ReadBareUntil(fd, clock.Now() + 10 * kNsPerMs, clock, &frame)) {
      continue;
    }
    if (frame.can_id != 0x080) continue;
    for (canid_t i = 1; i <= kDrives; ++i) WriteBare(fd, 0x180 + i, 8);
  }
}

Times RunBare(Bare way) {
  const int echo_fd = OpenBare();  // bound before the first SYNC
  const Child child([&] { EchoBare(echo_fd, way); });
  close(echo_fd);
  const int fd = OpenBare();
  const MonotonicClock clock;
  Times times;
  TimeNs next_ns = clock.Now();
  for (int i = -kWarmUp; i < kCycles; ++i) {
    SleepUntil(next_ns += kCycle_ns);
    const TimeNs begin_ns = clock.Now();
    WriteBare(fd, 0x080, 0);
    for (int k = 0; k < kDrives; ++k) {
      can_frame frame{};
      if (way == Bare::kBlocking) {
        ReadBare(fd);
      } else if (!ReadBareUntil(fd, begin_ns + kDeadline_ns, clock, &frame)) {
        throw std::runtime_error("the bare echo did not answer");
      }
    }
    const TimeNs answered_ns = clock.Now();
    for (canid_t k = 1; k <= kDrives; ++k) WriteBare(fd, 0x200 + k, 4);
    const TimeNs end_ns = clock.Now();
    if (i >= 0) times.Add(begin_ns, answered_ns, end_ns);
    next_ns = std::max(next_ns, end_ns - kCycle_ns);
  }
  close(fd);
  return times;
}

// ---- master and emulated drives
// -----------------------------------------------------------------

[[noreturn]] void RunDrives(can::CanPort& port) {
  std::vector<emulator::EmulatedDriveParameters> drives(kDrives);
  for (int i = 0; i < kDrives; ++i) {
    drives[static_cast<std::size_t>(i)].node_id = i + 1;
    drives[static_cast<std::size_t>(i)].nominal_current_mA = 360;
    drives[static_cast<std::size_t>(i)].torque_constant_uNmpA = 19600;
  }
  emulator::DriveRack rack(drives, port);
  const MonotonicClock clock;
  while (true) {
    const TimeNs now_ns = clock.Now();
    rack.Poll(now_ns);
    port.WaitUntil(now_ns + 10 * kNsPerMs);
  }
}

BusParameters Bus() {
  BusParameters bus;
  bus.bitrate_bps = 1'000'000;
  bus.cycle_ns = kCycle_ns;
  bus.feedback_deadline_ns = 600'000;
  bus.heartbeat_ms = 100;
  bus.heartbeat_timeout_ms = 2000;  // the machine may be busy: this is no test of losses
  bus.sdo_timeout_ms = 500;
  bus.boot_timeout_ms = 20'000;
  bus.abort_connection_option = 2;
  bus.max_load = 0.8;
  bus.identity = {
      .vendor_id = 0xFB, .product_codes = {0x60500000}, .min_revision = 0, .max_revision = 0xFFFFFFFF};
  for (int i = 1; i <= kDrives; ++i) bus.nodes.push_back({i, i});
  return bus;
}

Times RunOurs() {
  auto drive_port = std::make_unique<can::SocketCanPort>(kInterface);
  const Child child([&] { RunDrives(*drive_port); });
  drive_port.reset();
  can::SocketCanPort port(kInterface);
  std::vector<canopen::DriveSetup> setups;
  for (int i = 1; i <= kDrives; ++i) setups.push_back({i, 360, 720, 19600, 7056});
  canopen::Master master(Bus(), setups, port);

  const MonotonicClock clock;
  Times times;
  std::array<std::int16_t, kDrives> torques{100, -200, 300};
  DriveRequest request = DriveRequest::kDisable;
  const auto all = [&](DriveState state) {
    for (int i = 0; i < kDrives; ++i) {
      if (master.feedback(i).state != state) return false;
    }
    return true;
  };
  TimeNs next_ns = clock.Now();
  const TimeNs give_up_ns = next_ns + 60 * kNsPerS;
  master.Start(next_ns);
  int measured = -1;
  while (measured < kCycles) {
    SleepUntil(next_ns += kCycle_ns);
    const TimeNs begin_ns = clock.Now();
    master.BeginCycle(begin_ns);
    // As the daemon's cycle does it.
    const TimeNs deadline_ns = begin_ns + (measured < 0 ? kCycle_ns : kDeadline_ns);
    TimeNs now_ns = begin_ns;
    bool complete = false;
    while (!complete && now_ns < deadline_ns) {
      port.WaitUntil(deadline_ns);
      now_ns = clock.Now();
      complete = master.Poll(now_ns);
    }
    const TimeNs answered_ns = clock.Now();
    master.EndCycle(answered_ns, request, torques);
    const TimeNs end_ns = clock.Now();
    next_ns = std::max(next_ns, end_ns - kCycle_ns);
    if (measured >= 0) {
      if (!complete) throw std::runtime_error("a drive did not answer");
      times.Add(begin_ns, answered_ns, end_ns);
      ++measured;
      continue;
    }
    if (all(DriveState::kReady)) request = DriveRequest::kEnable;
    if (all(DriveState::kEnabled) && --measured < -kWarmUp) measured = 0;
    if (end_ns > give_up_ns) throw std::runtime_error("the drives cannot be enabled");
  }
  if (!all(DriveState::kEnabled)) throw std::runtime_error("a drive was lost");
  return times;
}

struct Ratio {
  const char* than;
  std::vector<double> of_blocks;

  void Print() {
    std::sort(of_blocks.begin(), of_blocks.end());
    std::printf("  ours to %-34s %.2f (blocks: %.2f to %.2f)\n", than, of_blocks[of_blocks.size() / 2],
                of_blocks.front(), of_blocks.back());
  }
};

void Print(const char* what, const char* who, const std::vector<TimeNs>& times) {
  std::printf("%-22s %-34s median %6.1f us, 99 %% %6.1f us\n", what, who, Quantile_us(times, 0.5),
              Quantile_us(times, 0.99));
}

}  // namespace

int main() {
  try {
    const sched_param parameters{.sched_priority = 1};
    const bool realtime = sched_setscheduler(0, SCHED_FIFO, &parameters) == 0;
    std::printf("three drives on %s, a cycle each ms, %d blocks of %d cycles each way, %s\n", kInterface,
                kBlocks, kCycles,
                realtime ? "all at SCHED_FIFO 1" : "without real-time priority (not allowed here)");
    constexpr const char* kDeadlineBare = "bare, waiting until a deadline";
    constexpr const char* kBlockingBare = "bare, blocking for ever";
    Times deadline, blocking, ours;
    Ratio to_deadline{kDeadlineBare, {}}, to_blocking{kBlockingBare, {}};
    Ratio cycle_to_deadline{kDeadlineBare, {}}, cycle_to_blocking{kBlockingBare, {}};
    for (int block = 0; block < kBlocks; ++block) {
      const Times d = RunBare(Bare::kDeadline), o = RunOurs(), b = RunBare(Bare::kBlocking);
      const double median_us = Quantile_us(o.echo_ns, 0.5);
      to_deadline.of_blocks.push_back(median_us / Quantile_us(d.echo_ns, 0.5));
      to_blocking.of_blocks.push_back(median_us / Quantile_us(b.echo_ns, 0.5));
      const double cycle_us = Quantile_us(o.cycle_ns, 0.5);
      cycle_to_deadline.of_blocks.push_back(cycle_us / Quantile_us(d.cycle_ns, 0.5));
      cycle_to_blocking.of_blocks.push_back(cycle_us / Quantile_us(b.cycle_ns, 0.5));
      deadline.Append(d);
      blocking.Append(b);
      ours.Append(o);
    }
    Print("SYNC to last feedback", kDeadlineBare, deadline.echo_ns);
    Print("", kBlockingBare, blocking.echo_ns);
    Print("", "ours", ours.echo_ns);
    Print("... and torques sent", kDeadlineBare, deadline.cycle_ns);
    Print("", kBlockingBare, blocking.cycle_ns);
    Print("", "ours", ours.cycle_ns);
    std::printf("ratio of the medians of SYNC to last feedback, middle of the blocks:\n");
    to_deadline.Print();
    to_blocking.Print();
    std::printf("the same from SYNC to the torques sent, when the drives may act:\n");
    cycle_to_deadline.Print();
    cycle_to_blocking.Print();
  } catch (const std::exception& e) {
    std::fprintf(stderr, "vcan_echo_bench: %s\n", e.what());
    return 1;
  }
  return 0;
}
