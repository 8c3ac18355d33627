// The two loops in alternation; see the header.
#include "tendril/rt/compare.h"

#include <algorithm>
#include <cerrno>
#include <ctime>
#include <thread>

namespace tendril::rt {
namespace {

constexpr TimeNs kTurn_ns = kNsPerS / 4;

void OwnTurn(TimeNs period_ns, std::uint64_t cycles, LoopComparison& into) {
  RunCyclic(period_ns, [&](const CycleStart& start) {
    into.loop.Add(start.wake_latency_ns);
    into.loop_missed += start.missed;
    return start.cycle + 1 < cycles;
  });
}

void TimerTurn(TimeNs period_ns, std::uint64_t cycles, LoopComparison& into) {
  const MonotonicClock clock;
  TimeNs next_ns = clock.Now() + period_ns;
  for (std::uint64_t i = 0; i < cycles; ++i) {
    timespec wake{};
    wake.tv_sec = next_ns / kNsPerS;
    wake.tv_nsec = next_ns % kNsPerS;
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &wake, nullptr) == EINTR) {
    }
    const TimeNs now_ns = clock.Now();
    into.timer.Add(now_ns - next_ns);
    next_ns += period_ns;
    for (; next_ns < now_ns; next_ns += period_ns) ++into.timer_missed;
  }
}

}  // namespace

LoopComparison CompareLoops(const RealtimeParameters& parameters, TimeNs period_ns, TimeNs duration_ns,
                            const std::function<bool()>& stop) {
  LoopComparison result;
  std::thread([&] {
    result.problems = EnterRealtime(parameters);
    const MonotonicClock clock;
    const TimeNs end_ns = clock.Now() + duration_ns;
    const auto cycles = static_cast<std::uint64_t>(std::max<TimeNs>(kTurn_ns / period_ns, 1));
    do {
      OwnTurn(period_ns, cycles, result);
      TimerTurn(period_ns, cycles, result);
    } while (clock.Now() < end_ns && !stop());
  }).join();
  return result;
}

}  // namespace tendril::rt
