// daemon_jitter SECONDS PRIORITY: the whole daemon for that long, with emulated drives on a bus in memory and
// LCM within the process; prints the wake latencies of its loop, a line "below_ns count" a bin and the
// percentiles. tests/bench/jitter_ratio runs it by turns with cyclictest.
#include <cstdio>
#include <cstdlib>
#include <optional>

#include "daemon/emulated_drives.h"
#include "tendril/daemon/daemon.h"
#include "tendril/io/client.h"
#include "tendril_lcm/statistics_t.hpp"

int main(int argc, char** argv) {
  using namespace tendril;
  if (argc != 3 || std::atof(argv[1]) < 2 || std::atoi(argv[2]) < 1) {
    std::fprintf(stderr, "daemon_jitter SECONDS (2 or more) PRIORITY (1 or more)\n");
    return 2;
  }
  daemon::DaemonOptions options{daemon::RigDaemon(), daemon::RigRobot(), ""};
  options.parameters.realtime.priority = std::atoi(argv[2]);
  options.parameters.realtime.required = true;
  // What the machine's other work takes away from the other thread is not what is measured.
  options.parameters.bus.heartbeat_timeout_ms = 5000;
  const MonotonicClock clock;
  daemon::EmulatedDrives drives(options.robot, options.parameters, clock);
  std::optional<tendril_lcm::statistics_t> last;
  try {
    daemon::Daemon d(options, drives.port());
    io::Client client(d.gateway().lcm(), options.parameters.lcm.channel_prefix);
    client.OnStatistics([&](const tendril_lcm::statistics_t& s) { last = s; });
    const TimeNs end_ns = clock.Now() + static_cast<TimeNs>(std::atof(argv[1]) * 1e9);
    d.Run([&] { return clock.Now() >= end_ns; });
  } catch (const std::exception& e) {
    std::fprintf(stderr, "daemon_jitter: %s\n", e.what());
    return 1;
  }
  if (!last) return 1;
  std::printf("cycles %lld missed %lld voluntary %lld minor_faults %lld\n",
              static_cast<long long>(last->cycles), static_cast<long long>(last->deadline_misses),
              static_cast<long long>(last->voluntary_switches), static_cast<long long>(last->minor_faults));
  std::printf("median %lld p99 %lld p999 %lld max %lld\n", static_cast<long long>(last->wake_latency_ns[0]),
              static_cast<long long>(last->wake_latency_ns[1]),
              static_cast<long long>(last->wake_latency_ns[2]),
              static_cast<long long>(last->wake_latency_ns[3]));
  return 0;
}
