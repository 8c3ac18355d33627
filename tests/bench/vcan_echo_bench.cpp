// The bus cycle of three drives over a real vcan0 beside bare SocketCAN programs that move the same frames,
// in alternating blocks of one run. Prints times and their ratio; run it under tools/vcan-run.
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
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

constexpr int kDrives = 3, kBlocks = 8, kCycles = 1500, kWarmUp = 100;
constexpr TimeNs kCycle_ns = kNsPerMs;
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

/// Runs `work` in a child process that ends with this one or when told.
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
// --------------------------------------------------------------------------------------------

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

[[noreturn]] void EchoBare(int fd) {
  while (true) {
    if (ReadBare(fd).can_id != 0x080) continue;
    for (canid_t i = 1; i <= kDrives; ++i) WriteBare(fd, 0x180 + i, 8);
  }
}

Times RunBare() {
  const int echo_fd = OpenBare();  // bound before the first SYNC
  const Child child([&] { EchoBare(echo_fd); });
  close(echo_fd);
  const int fd = OpenBare();
  const MonotonicClock clock;
  Times times;
  TimeNs next_ns = clock.Now();
  for (int i = -kWarmUp; i < kCycles; ++i) {
    SleepUntil(next_ns += kCycle_ns);
    const TimeNs begin_ns = clock.Now();
    WriteBare(fd, 0x080, 0);
    for (int k = 0; k < kDrives; ++k) ReadBare(fd);
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
// --------------------------------------------------------------------------------

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
    rack.Poll(clock.Now());
    port.WaitUntil(clock.Now() + 10 * kNsPerMs);
  }
}

BusParameters Bus() {
  BusParameters bus;
  bus.bitrate_bps = 1'000'000;
  bus.cycle_ns = kCycle_ns;
  bus.feedback_deadline_ns = 900'000;
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
    bool complete = false;
    const TimeNs deadline_ns = begin_ns + (measured < 0 ? kCycle_ns : kNsPerS);
    while (!(complete = master.Poll(clock.Now())) && clock.Now() < deadline_ns) port.WaitUntil(deadline_ns);
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

void Print(const char* what, const std::vector<TimeNs>& bare, const std::vector<TimeNs>& ours) {
  std::printf(
      "%-22s bare: median %6.1f us, 99 %% %6.1f us;  ours: median %6.1f us, 99 %% %6.1f us;  ratio %.2f\n",
      what, Quantile_us(bare, 0.5), Quantile_us(bare, 0.99), Quantile_us(ours, 0.5), Quantile_us(ours, 0.99),
      Quantile_us(ours, 0.5) / Quantile_us(bare, 0.5));
}

}  // namespace

int main() {
  try {
    std::printf("three drives on %s, a cycle each ms, %d blocks of %d cycles each way\n", kInterface, kBlocks,
                kCycles);
    Times bare, ours;
    std::vector<double> ratios;
    for (int block = 0; block < kBlocks; ++block) {
      const Times b = RunBare(), o = RunOurs();
      ratios.push_back(Quantile_us(o.echo_ns, 0.5) / Quantile_us(b.echo_ns, 0.5));
      bare.Append(b);
      ours.Append(o);
    }
    Print("SYNC to last feedback", bare.echo_ns, ours.echo_ns);
    Print("... and torques sent", bare.cycle_ns, ours.cycle_ns);
    std::sort(ratios.begin(), ratios.end());
    std::printf("ratio of the medians of SYNC to last feedback, block by block: %.2f to %.2f, middle %.2f\n",
                ratios.front(), ratios.back(), ratios[ratios.size() / 2]);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "vcan_echo_bench: %s\n", e.what());
    return 1;
  }
  return 0;
}
