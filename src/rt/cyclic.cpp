// The deadline grid, the loop on it, real-time set-up and latency histograms; see the header.
#include "tendril/rt/cyclic.h"

#include <fcntl.h>
#include <link.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <ctime>

namespace tendril::rt {
namespace {

constexpr std::size_t kPrefaultedStack = 256 * 1024;
constexpr std::uintptr_t kPage = 4096;  // at most as large as any page
constexpr int kSubBinBits = 3;          // eight bins per octave
constexpr std::uint64_t kSubBins = 1U << kSubBinBits;

// A stack page first touched inside a cycle would be a page fault there.
[[gnu::noinline]] void PrefaultStack() {
  volatile unsigned char stack[kPrefaultedStack];
  for (std::size_t i = 0; i < kPrefaultedStack; i += 1024) stack[i] = 0;
  (void)stack[0];
}

// Code and constants of the program and its libraries. Without the right to lock they are loaded on first
// use, and user-mode Linux counts a fault even for the first touch of a locked page.
[[gnu::no_sanitize("address", "thread")]] int TouchSegments(dl_phdr_info* object, std::size_t, void*) {
  for (int i = 0; i < object->dlpi_phnum; ++i) {
    const ElfW(Phdr)& segment = object->dlpi_phdr[i];
    if (segment.p_type != PT_LOAD || (segment.p_flags & PF_R) == 0) continue;
    const std::uintptr_t begin = object->dlpi_addr + segment.p_vaddr;
    for (std::uintptr_t at = begin; at < begin + segment.p_memsz; at = (at | (kPage - 1)) + 1) {
      (void)*reinterpret_cast<const volatile unsigned char*>(at);
    }
  }
  return 0;
}

// While this file is held open with a zero in it, no CPU enters a sleep state with a wake-up latency. Held
// until the process ends; without write access, wake-ups take longer and nothing else changes.
void KeepCpusAwake() {
  static const int file = [] {
    const int fd = open("/dev/cpu_dma_latency", O_WRONLY | O_CLOEXEC);
    const std::int32_t allowed_us = 0;
    if (fd >= 0 && write(fd, &allowed_us, sizeof allowed_us) != sizeof allowed_us) {
      close(fd);
      return -1;
    }
    return fd;
  }();
  (void)file;
}

void Append(std::string& text, const std::string& more) {
  if (!text.empty()) text += "; ";
  text += more;
}

timespec ToTimespec(TimeNs t_ns) {
  timespec t{};
  t.tv_sec = t_ns / kNsPerS;
  t.tv_nsec = t_ns % kNsPerS;
  return t;
}

std::uint64_t BinOf(std::uint64_t value) {
  if (value < kSubBins) return value;
  const int octave = std::bit_width(value) - (kSubBinBits + 1);
  return (static_cast<std::uint64_t>(octave) + 1) * kSubBins + ((value >> octave) & (kSubBins - 1));
}

// Greatest value of a bin.
std::uint64_t EdgeOf(std::uint64_t bin) {
  if (bin < kSubBins) return bin;
  const std::uint64_t octave = bin / kSubBins - 1;
  return ((kSubBins + bin % kSubBins + 1) << octave) - 1;
}

}  // namespace

std::string EnterRealtime(const RealtimeParameters& p) {
  std::string problems;
  if (p.lock_memory && mlockall(MCL_CURRENT | MCL_FUTURE) != 0) {
    Append(problems,
           std::string("memory is not locked (") + std::strerror(errno) +
               "): raise the memlock limit ('ulimit -l unlimited', LimitMEMLOCK=infinity for a service)");
  }
  PrefaultStack();
  dl_iterate_phdr(TouchSegments, nullptr);
  // The kernel delays ordinary threads by up to 50 us to save wake-ups.
  prctl(PR_SET_TIMERSLACK, 1UL, 0UL, 0UL, 0UL);
  if (p.priority > 0) {
    KeepCpusAwake();
    sched_param priority{};
    priority.sched_priority = p.priority;
    if (const int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &priority); error != 0) {
      const std::string n = std::to_string(p.priority);
      Append(problems, "priority " + n + " is not set (" + std::strerror(error) +
                           "): raise the rtprio limit ('ulimit -r " + n + "', LimitRTPRIO=" + n +
                           " for a service) or grant CAP_SYS_NICE");
    }
  }
  if (p.cpu >= 0) {
    cpu_set_t cpus;
    CPU_ZERO(&cpus);
    const bool representable = p.cpu < CPU_SETSIZE;
    if (representable) CPU_SET(static_cast<std::size_t>(p.cpu), &cpus);
    const int error = representable ? pthread_setaffinity_np(pthread_self(), sizeof(cpus), &cpus) : EINVAL;
    if (error != 0) {
      Append(problems, "not bound to cpu " + std::to_string(p.cpu) + " (" + std::strerror(error) +
                           "): this machine has cpus 0 to " +
                           std::to_string(sysconf(_SC_NPROCESSORS_CONF) - 1) +
                           ", and a service may be limited to some (CPUAffinity, cpuset)");
    }
  }
  return problems;
}

std::uint64_t DeadlineGrid::Advance(TimeNs now_ns) noexcept {
  next_ns_ += period_ns_;
  const TimeNs late_ns = now_ns - next_ns_;
  if (late_ns <= 0) return 0;
  const TimeNs missed = (late_ns + period_ns_ - 1) / period_ns_;
  next_ns_ += missed * period_ns_;
  return static_cast<std::uint64_t>(missed);
}

void RunCyclic(TimeNs period_ns, const std::function<bool(const CycleStart&)>& body) {
  const MonotonicClock clock;
  DeadlineGrid grid(clock.Now() + period_ns, period_ns);
  CycleStart start;
  for (;;) {
    const timespec wake = ToTimespec(grid.next_ns());
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &wake, nullptr) == EINTR) {
    }
    start.grid_ns = grid.next_ns();
    start.wake_latency_ns = clock.Now() - start.grid_ns;
    if (!body(start)) return;
    ++start.cycle;
    start.missed = grid.Advance(clock.Now());
  }
}

void Histogram::Add(TimeNs value_ns) noexcept {
  const TimeNs value = std::max<TimeNs>(value_ns, 0);
  ++bin_[std::min<std::uint64_t>(BinOf(static_cast<std::uint64_t>(value)), kBins - 1)];
  ++count_;
  max_ns_ = std::max(max_ns_, value);
}

TimeNs Histogram::Percentile(double share) const noexcept {
  if (count_ == 0) return 0;
  const double target = std::ceil(std::clamp(share, 0.0, 1.0) * static_cast<double>(count_));
  const auto rank = std::max<std::uint64_t>(static_cast<std::uint64_t>(target), 1);
  std::uint64_t seen = 0;
  for (std::uint64_t bin = 0; bin < kBins - 1; ++bin) {
    seen += bin_[bin];
    if (seen >= rank) return std::min(static_cast<TimeNs>(EdgeOf(bin)), max_ns_);
  }
  return max_ns_;
}

LatencyStatistics Histogram::Statistics() const noexcept {
  LatencyStatistics s;
  s.median_ns = Percentile(0.5);
  s.p99_ns = Percentile(0.99);
  s.p999_ns = Percentile(0.999);
  s.max_ns = max_ns_;
  // Octaves end at powers of two, so that no bin crosses the edge of a published one.
  std::size_t to = 0;
  for (std::uint64_t bin = 0; bin < kBins; ++bin) {
    while (static_cast<TimeNs>(EdgeOf(bin)) >= LatencyBinBelow_ns(static_cast<int>(to))) ++to;
    s.counts[to] += bin_[bin];
  }
  return s;
}

Timebase& RealTime() {
  class Machine final : public Timebase {
   public:
    const Clock& clock() const noexcept override { return clock_; }
    std::string Enter(const RealtimeParameters& parameters) override { return EnterRealtime(parameters); }
    void Run(TimeNs period_ns, const std::function<bool(const CycleStart&)>& body) override {
      RunCyclic(period_ns, body);
    }

   private:
    MonotonicClock clock_;
  };
  static Machine machine;
  return machine;
}

}  // namespace tendril::rt
