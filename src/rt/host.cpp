// Settings of the machine, read from /proc and /sys; see the header.
#include "tendril/rt/host.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <sstream>
#include <string_view>
#include <system_error>

namespace tendril::rt {
namespace {

namespace fs = std::filesystem;

// A C-state with a longer exit latency disturbs a loop of a millisecond.
constexpr int kSlowExit_us = 20;
// A transmit queue much longer than a cycle's frames holds frames of cycles long past.
constexpr int kLongestQueue = 100;
constexpr int kCapIpcLock = 14, kCapSysNice = 23;

// First line without its end; nothing when it cannot be read.
std::optional<std::string> ReadLine(const fs::path& file) {
  std::ifstream in(file);
  std::string line;
  if (!std::getline(in, line)) return std::nullopt;
  return line;
}

std::optional<long long> Number(std::string_view text) {
  long long value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end == text.data()) return std::nullopt;
  return value;
}

std::vector<fs::path> Folders(const fs::path& in) {
  std::vector<fs::path> found;
  std::error_code error;
  for (fs::directory_iterator i(in, error), end; !error && i != end; i.increment(error)) found.push_back(*i);
  std::sort(found.begin(), found.end());
  return found;
}

// "0-3,8" has 2.
bool ListHas(const std::string& list, int cpu) {
  std::istringstream parts(list);
  for (std::string part; std::getline(parts, part, ',');) {
    const auto dash = part.find('-');
    const auto first = Number(part);
    const auto last = dash == part.npos ? first : Number(std::string_view(part).substr(dash + 1));
    if (first && last && *first <= cpu && cpu <= *last) return true;
  }
  return false;
}

// The CPUs that the loop may run on, as folders of /sys/devices/system/cpu.
std::vector<fs::path> LoopCpus(const fs::path& root, int cpu) {
  std::vector<fs::path> cpus;
  for (const fs::path& folder : Folders(root / "sys/devices/system/cpu")) {
    const std::string name = folder.filename();
    if (!name.starts_with("cpu") || name.size() < 4 || std::isdigit(static_cast<unsigned char>(name[3])) == 0)
      continue;
    if (cpu < 0 || Number(std::string_view(name).substr(3)) == cpu) cpus.push_back(folder);
  }
  return cpus;
}

HostSetting Kernel(const fs::path& root) {
  HostSetting s{.name = "kernel", .value = {}, .remedy = {}};
  const std::string version = ReadLine(root / "proc/sys/kernel/version").value_or("");
  const std::string release = ReadLine(root / "proc/sys/kernel/osrelease").value_or("");
  const char* real_time_kernel = "install a real-time kernel (Debian: apt install linux-image-rt-amd64)";
  if (ReadLine(root / "sys/kernel/realtime").value_or("") == "1" ||
      version.find("PREEMPT_RT") != version.npos) {
    s.verdict = Verdict::kGood;
    s.value = release + ", fully preemptible (PREEMPT_RT)";
  } else if (version.find("PREEMPT_DYNAMIC") != version.npos) {
    // "none voluntary (full) lazy": readable with debugfs mounted, by root.
    const std::string modes = ReadLine(root / "sys/kernel/debug/sched/preempt").value_or("");
    const std::string command_line = ReadLine(root / "proc/cmdline").value_or("");
    const bool full = modes.find("(full)") != modes.npos || command_line.find("preempt=full") != modes.npos;
    s.verdict = Verdict::kBetter;
    s.value = release + (full ? ", preempt=full" : ", preemption chosen at boot (PREEMPT_DYNAMIC)");
    s.remedy =
        full ? real_time_kernel : std::string(real_time_kernel) + ", or at least boot with preempt=full";
  } else if (version.find("PREEMPT") != version.npos) {
    s.verdict = Verdict::kBetter;
    s.value = release + ", preemptible (PREEMPT)";
    s.remedy = real_time_kernel;
  } else if (!version.empty()) {
    s.verdict = Verdict::kBad;
    s.value = release + ", not preemptible";
    s.remedy = real_time_kernel;
  }
  return s;
}

HostSetting Governor(const fs::path& root, int cpu) {
  HostSetting s{.name = "governor", .value = {}, .remedy = {}};
  std::string slow;
  for (const fs::path& folder : LoopCpus(root, cpu)) {
    const auto governor = ReadLine(folder / "cpufreq/scaling_governor");
    if (!governor) continue;
    if (*governor != "performance") slow = *governor;
    s.value = slow.empty() ? *governor : slow;
  }
  if (s.value.empty()) {
    s.value = "no frequency scaling found";
    return s;
  }
  s.verdict = slow.empty() ? Verdict::kGood : Verdict::kBetter;
  if (!slow.empty()) s.remedy = "cpupower frequency-set --governor performance";
  return s;
}

HostSetting IdleStates(const fs::path& root, int cpu) {
  HostSetting s{.name = "C-states", .value = {}, .remedy = {}};
  bool any = false;
  long long slowest_us = 0;
  std::string slowest;
  for (const fs::path& folder : LoopCpus(root, cpu)) {
    for (const fs::path& state : Folders(folder / "cpuidle")) {
      const auto latency_us = Number(ReadLine(state / "latency").value_or(""));
      if (!latency_us) continue;
      any = true;
      const bool disabled = ReadLine(state / "disable").value_or("0") == "1";
      if (disabled || *latency_us <= slowest_us) continue;
      slowest_us = *latency_us;
      slowest = ReadLine(state / "name").value_or(state.filename().string());
    }
  }
  if (!any) {
    s.value = "none found";
    return s;
  }
  const bool slow = slowest_us > kSlowExit_us;
  s.verdict = slow ? Verdict::kBetter : Verdict::kGood;
  s.value = slowest.empty() ? "no C-state with an exit latency"
                            : slowest + " takes " + std::to_string(slowest_us) + " us to leave";
  if (slow) {
    s.remedy =
        "tendrild disables them while it runs if it may write /dev/cpu_dma_latency; else cpupower "
        "idle-set --disable-by-latency " +
        std::to_string(kSlowExit_us);
  }
  return s;
}

HostSetting Isolation(const fs::path& root, int cpu) {
  HostSetting s{.name = "isolated CPU", .value = {}, .remedy = {}};
  const auto isolated = ReadLine(root / "sys/devices/system/cpu/isolated");
  if (!isolated && !fs::exists(root / "sys/devices/system/cpu")) return s;
  const std::string list = isolated.value_or("");
  if (cpu >= 0 && ListHas(list, cpu)) {
    s.verdict = Verdict::kGood;
    s.value = "the loop's CPU " + std::to_string(cpu) + " is kept free (" + list + ")";
    return s;
  }
  s.verdict = Verdict::kBetter;
  s.value = (cpu < 0 ? std::string("the loop is bound to no CPU")
                     : "CPU " + std::to_string(cpu) + " also runs everything else") +
            "; isolated: " + (list.empty() ? "none" : list);
  const std::string which = cpu >= 0 ? std::to_string(cpu) : list.empty() ? "N" : list;
  s.remedy = (cpu >= 0       ? std::string()
              : list.empty() ? std::string("choose a CPU N, set realtime.cpu to it and ")
                             : "set realtime.cpu to one of " + list + " and ") +
             "boot with isolcpus=" + which + " nohz_full=" + which + " rcu_nocbs=" + which;
  return s;
}

HostSetting Interrupts(const fs::path& root, int cpu) {
  HostSetting s{.name = "IRQ affinity", .value = {}, .remedy = {}};
  int all = 0, here = 0;
  std::string numbers;
  for (const fs::path& irq : Folders(root / "proc/irq")) {
    const auto affinity = ReadLine(irq / "effective_affinity_list");
    const auto configured = ReadLine(irq / "smp_affinity_list");
    const auto& list = affinity && !affinity->empty() ? affinity : configured;
    if (!list) continue;
    ++all;
    if (cpu < 0 || !ListHas(*list, cpu)) continue;
    ++here;
    if (here <= 8) numbers += " " + irq.filename().string();
  }
  if (all == 0) return s;
  if (cpu < 0) {
    s.value = std::to_string(all) + " interrupts, the loop is bound to no CPU";
    return s;
  }
  s.verdict = here == 0 ? Verdict::kGood : Verdict::kBetter;
  s.value = here == 0
                ? "none of " + std::to_string(all) + " interrupts is served on CPU " + std::to_string(cpu)
                : std::to_string(here) + " of " + std::to_string(all) + " interrupts are served on CPU " +
                      std::to_string(cpu) + ":" + numbers + (here > 8 ? " ..." : "");
  if (here > 0) {
    s.remedy =
        "give them other CPUs: echo LIST > /proc/irq/N/smp_affinity_list (irqbalance: "
        "IRQBALANCE_BANNED_CPULIST=" +
        std::to_string(cpu) + ")";
  }
  return s;
}

bool HasCapability(const fs::path& root, int capability) {
  std::ifstream in(root / "proc/self/status");
  for (std::string line; std::getline(in, line);) {
    if (!line.starts_with("CapEff:")) continue;
    std::uint64_t mask = 0;
    const auto digits = line.find_first_not_of(" \t", 7);
    if (digits == line.npos) return false;
    std::from_chars(line.data() + digits, line.data() + line.size(), mask, 16);
    return (mask >> capability & 1U) != 0;
  }
  return false;
}

// The soft limit, "unlimited" or a number; nothing when there is no such line.
std::optional<std::string> Limit(const fs::path& root, std::string_view name) {
  std::ifstream in(root / "proc/self/limits");
  for (std::string line; std::getline(in, line);) {
    if (!line.starts_with(name)) continue;
    std::istringstream rest(line.substr(name.size()));
    std::string soft;
    if (rest >> soft) return soft;
  }
  return std::nullopt;
}

HostSetting PriorityLimit(const fs::path& root, int priority) {
  HostSetting s{.name = "rtprio limit", .value = {}, .remedy = {}};
  const std::string n = std::to_string(std::max(priority, 1));
  const auto limit = Limit(root, "Max realtime priority");
  if (priority <= 0) {
    s.verdict = Verdict::kBetter;
    s.value = "realtime.priority is 0: ordinary scheduling";
    s.remedy = "set realtime.priority, for example to 80";
  } else if (HasCapability(root, kCapSysNice)) {
    s.verdict = Verdict::kGood;
    s.value = "CAP_SYS_NICE: any priority";
  } else if (limit) {
    const bool enough = *limit == "unlimited" || Number(*limit).value_or(0) >= priority;
    s.verdict = enough ? Verdict::kGood : Verdict::kBad;
    s.value = *limit + ", priority " + n + " is requested";
    if (!enough) {
      s.remedy = "LimitRTPRIO=" + n + " in the service; for a shell '@realtime - rtprio " + n +
                 "' in /etc/security/limits.d/tendril.conf, and log in again";
    }
  }
  return s;
}

HostSetting MemoryLimit(const fs::path& root, bool lock_memory) {
  HostSetting s{.name = "memlock limit", .value = {}, .remedy = {}};
  const auto limit = Limit(root, "Max locked memory");
  if (!lock_memory) {
    s.verdict = Verdict::kBetter;
    s.value = "realtime.lock_memory is false: page faults may occur inside the loop";
    s.remedy = "set realtime.lock_memory to true";
  } else if (HasCapability(root, kCapIpcLock)) {
    s.verdict = Verdict::kGood;
    s.value = "CAP_IPC_LOCK: no limit";
  } else if (limit) {
    // Program, libraries, stacks and black box together need less than half a gigabyte.
    const bool enough = *limit == "unlimited" || Number(*limit).value_or(0) >= (512LL << 20);
    s.verdict = enough ? Verdict::kGood : Verdict::kBad;
    s.value = *limit == "unlimited" ? *limit : *limit + " bytes";
    if (!enough) {
      s.remedy =
          "LimitMEMLOCK=infinity in the service; for a shell '@realtime - memlock unlimited' in "
          "/etc/security/limits.d/tendril.conf, and log in again";
    }
  }
  return s;
}

HostSetting Throttling(const fs::path& root) {
  HostSetting s{.name = "RT throttling", .value = {}, .remedy = {}};
  const auto runtime_us = Number(ReadLine(root / "proc/sys/kernel/sched_rt_runtime_us").value_or(""));
  const auto period_us = Number(ReadLine(root / "proc/sys/kernel/sched_rt_period_us").value_or(""));
  if (!runtime_us || !period_us || *period_us <= 0) return s;
  // A reserve is useful: it leaves the operator a machine on which to stop an endless loop.
  const bool enough = *runtime_us < 0 || *runtime_us * 10 >= *period_us * 9;
  s.verdict = enough ? Verdict::kGood : Verdict::kBad;
  s.value = *runtime_us < 0 ? "off"
                            : std::to_string(*runtime_us) + " us of every " + std::to_string(*period_us) +
                                  " us may be real time";
  if (!enough) s.remedy = "sysctl -w kernel.sched_rt_runtime_us=" + std::to_string(*period_us * 95 / 100);
  return s;
}

HostSetting ClockSource(const fs::path& root) {
  HostSetting s{.name = "clock source", .value = {}, .remedy = {}};
  const auto source = ReadLine(root / "sys/devices/system/clocksource/clocksource0/current_clocksource");
  if (!source) return s;
  const bool slow = *source == "hpet" || *source == "acpi_pm" || *source == "jiffies";
  s.verdict = slow ? Verdict::kBetter : Verdict::kGood;
  s.value = *source;
  if (slow)
    s.remedy = "each read of this clock takes microseconds: boot with clocksource=tsc if the CPU allows";
  return s;
}

HostSetting TransmitQueue(const fs::path& root, const std::string& interface, int drives) {
  HostSetting s{.name = "txqueuelen", .value = {}, .remedy = {}};
  const auto length = Number(ReadLine(root / "sys/class/net" / interface / "tx_queue_len").value_or(""));
  if (!length) {
    s.value = "there is no interface " + interface;
    return s;
  }
  // As kTransmitQueue, for the actual number of drives.
  const int least = 2 * (drives + 3);
  const bool good = least <= *length && *length <= kLongestQueue;
  s.verdict = *length < least ? Verdict::kBad : good ? Verdict::kGood : Verdict::kBetter;
  s.value = std::to_string(*length) + " frames on " + interface;
  if (!good) {
    s.remedy =
        "ip link set " + interface + " txqueuelen " + std::to_string(kTransmitQueue) +
        (*length < least ? " (frames of one cycle are refused)" : " (outdated torques may wait in it)");
  }
  return s;
}

}  // namespace

std::vector<HostSetting> ReadHost(const std::string& root, const RealtimeParameters& p,
                                  const std::string& interface, int drives) {
  const fs::path at = root.empty() ? fs::path("/") : fs::path(root);
  std::vector<HostSetting> settings{Kernel(at),
                                    Governor(at, p.cpu),
                                    IdleStates(at, p.cpu),
                                    Isolation(at, p.cpu),
                                    Interrupts(at, p.cpu),
                                    PriorityLimit(at, p.priority),
                                    MemoryLimit(at, p.lock_memory),
                                    Throttling(at),
                                    ClockSource(at)};
  if (!interface.empty()) settings.push_back(TransmitQueue(at, interface, drives));
  return settings;
}

}  // namespace tendril::rt
