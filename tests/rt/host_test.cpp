// What is said about a machine, on made-up ones: a tree of files for each, the good one and one spoilt
// setting at a time.
#include "tendril/rt/host.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <map>

#include "tendril/rt/compare.h"

namespace tendril::rt {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

// A well-prepared robot PC: the loop on CPU 3.
const std::map<std::string, std::string> kGoodTree{
    {"proc/sys/kernel/version", "#1 SMP PREEMPT_RT Debian 6.1.119-1"},
    {"proc/sys/kernel/osrelease", "6.1.0-28-rt-amd64"},
    {"sys/kernel/realtime", "1"},
    {"proc/cmdline", "root=/dev/sda1 isolcpus=3"},
    {"sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "powersave"},
    {"sys/devices/system/cpu/cpu3/cpufreq/scaling_governor", "performance"},
    {"sys/devices/system/cpu/cpu3/cpuidle/state0/name", "POLL"},
    {"sys/devices/system/cpu/cpu3/cpuidle/state0/latency", "0"},
    {"sys/devices/system/cpu/cpu3/cpuidle/state1/name", "C1E"},
    {"sys/devices/system/cpu/cpu3/cpuidle/state1/latency", "10"},
    {"sys/devices/system/cpu/cpu3/cpuidle/state2/name", "C6"},
    {"sys/devices/system/cpu/cpu3/cpuidle/state2/latency", "133"},
    {"sys/devices/system/cpu/cpu3/cpuidle/state2/disable", "1"},
    {"sys/devices/system/cpu/isolated", "2-3"},
    {"proc/irq/1/smp_affinity_list", "0-3"},
    {"proc/irq/1/effective_affinity_list", "0"},
    {"proc/irq/40/smp_affinity_list", "0-2"},
    {"proc/self/limits",
     "Limit                     Soft Limit           Hard Limit           Units     \n"
     "Max locked memory         unlimited            unlimited            bytes     \n"
     "Max realtime priority     95                   95                   "},
    {"proc/self/status", "Name:\ttendril\nCapEff:\t0000000000000000\n"},
    {"proc/sys/kernel/sched_rt_runtime_us", "950000"},
    {"proc/sys/kernel/sched_rt_period_us", "1000000"},
    {"sys/devices/system/clocksource/clocksource0/current_clocksource", "tsc"},
    {"sys/class/net/can0/tx_queue_len", "16"},
};

RealtimeParameters Wanted() {
  RealtimeParameters p;
  p.priority = 80;
  p.cpu = 3;
  return p;
}

struct Machine {
  explicit Machine(const std::map<std::string, std::string>& changes) {
    auto files = kGoodTree;
    for (const auto& [file, text] : changes) files[file] = text;
    for (const auto& [file, text] : files) {
      fs::create_directories((root / file).parent_path());
      std::ofstream(root / file) << text << "\n";
    }
  }
  ~Machine() { fs::remove_all(root); }
  HostSetting Read(const std::string& name, const RealtimeParameters& p = Wanted()) const {
    for (const HostSetting& s : ReadHost(root.string(), p, "can0", 3)) {
      if (s.name == name) return s;
    }
    ADD_FAILURE() << "nothing is said about " << name;
    return {};
  }
  fs::path root = fs::temp_directory_path() / ("tendril_host_" + std::to_string(getpid()));
};

TEST(Host, AWellPreparedMachineHasNothingToChange) {
  const Machine machine({});
  for (const HostSetting& s : ReadHost(machine.root.string(), Wanted(), "can0", 3)) {
    EXPECT_EQ(s.verdict, Verdict::kGood) << s.name << ": " << s.value;
    EXPECT_EQ(s.remedy, "") << s.name;
    EXPECT_NE(s.value, "") << s.name;
  }
}

struct Spoilt {
  const char* name;  // of the test
  const char* setting;
  std::map<std::string, std::string> files;
  Verdict verdict;
  const char* value;   // is in what was read
  const char* remedy;  // is in what to do
};
class HostSpoilt : public testing::TestWithParam<Spoilt> {};

TEST_P(HostSpoilt, IsNamedWithItsRemedyAndTheOthersStayGood) {
  const Spoilt& c = GetParam();
  const Machine machine(c.files);
  for (const HostSetting& s : ReadHost(machine.root.string(), Wanted(), "can0", 3)) {
    if (s.name != c.setting) {
      EXPECT_EQ(s.verdict, Verdict::kGood) << s.name << ": " << s.value;
      continue;
    }
    EXPECT_EQ(s.verdict, c.verdict);
    EXPECT_THAT(s.value, HasSubstr(c.value));
    EXPECT_THAT(s.remedy, HasSubstr(c.remedy));
  }
}

constexpr const char* kLimits =
    "Max locked memory         8388608              8388608              bytes     \n"
    "Max realtime priority     0                    0                    ";

INSTANTIATE_TEST_SUITE_P(
    All, HostSpoilt,
    testing::Values(Spoilt{"NotPreemptible",
                           "kernel",
                           {{"proc/sys/kernel/version", "#1 SMP Debian"}, {"sys/kernel/realtime", "0"}},
                           Verdict::kBad,
                           "not preemptible",
                           "linux-image-rt-amd64"},
                    Spoilt{"PreemptDynamic",
                           "kernel",
                           {{"proc/sys/kernel/version", "#1 SMP PREEMPT_DYNAMIC Debian"},
                            {"sys/kernel/realtime", "0"}},
                           Verdict::kBetter,
                           "PREEMPT_DYNAMIC",
                           "preempt=full"},
                    Spoilt{"PreemptFull",
                           "kernel",
                           {{"proc/sys/kernel/version", "#1 SMP PREEMPT_DYNAMIC Debian"},
                            {"sys/kernel/realtime", "0"},
                            {"sys/kernel/debug/sched/preempt", "none voluntary (full)"}},
                           Verdict::kBetter,
                           "preempt=full",
                           "linux-image-rt-amd64"},
                    Spoilt{"Powersave",
                           "governor",
                           {{"sys/devices/system/cpu/cpu3/cpufreq/scaling_governor", "powersave"}},
                           Verdict::kBetter,
                           "powersave",
                           "performance"},
                    Spoilt{"DeepSleep",
                           "C-states",
                           {{"sys/devices/system/cpu/cpu3/cpuidle/state2/disable", "0"}},
                           Verdict::kBetter,
                           "C6 takes 133 us",
                           "/dev/cpu_dma_latency"},
                    Spoilt{"NotIsolated",
                           "isolated CPU",
                           {{"sys/devices/system/cpu/isolated", "0-2"}},
                           Verdict::kBetter,
                           "CPU 3 also runs everything else",
                           "isolcpus=3"},
                    Spoilt{"InterruptHere",
                           "IRQ affinity",
                           {{"proc/irq/40/smp_affinity_list", "0-3"}},
                           Verdict::kBetter,
                           "1 of 2 interrupts are served on CPU 3: 40",
                           "smp_affinity_list"},
                    Spoilt{"NoPriority",
                           "rtprio limit",
                           {{"proc/self/limits", std::string(kLimits).replace(26, 7, "unlimited")}},
                           Verdict::kBad,
                           "0, priority 80",
                           "LimitRTPRIO=80"},
                    Spoilt{"NoLocking",
                           "memlock limit",
                           {{"proc/self/limits",
                             std::string(kLimits).replace(std::string(kLimits).rfind(" 0  ") - 21, 2, "99")}},
                           Verdict::kBad,
                           "8388608",
                           "LimitMEMLOCK=infinity"},
                    Spoilt{"Throttled",
                           "RT throttling",
                           {{"proc/sys/kernel/sched_rt_runtime_us", "500000"}},
                           Verdict::kBad,
                           "500000 us of every 1000000",
                           "sched_rt_runtime_us=950000"},
                    Spoilt{"SlowClock",
                           "clock source",
                           {{"sys/devices/system/clocksource/clocksource0/current_clocksource", "hpet"}},
                           Verdict::kBetter,
                           "hpet",
                           "clocksource=tsc"},
                    Spoilt{"ShortQueue",
                           "txqueuelen",
                           {{"sys/class/net/can0/tx_queue_len", "4"}},
                           Verdict::kBad,
                           "4 frames",
                           "txqueuelen 38"},
                    Spoilt{"LongQueue",
                           "txqueuelen",
                           {{"sys/class/net/can0/tx_queue_len", "1000"}},
                           Verdict::kBetter,
                           "1000 frames",
                           "txqueuelen 38"}),
    [](const auto& c) { return std::string(c.param.name); });

// One number for every robot, wherever it is told.
TEST(Host, TheQueueThatGuideAndPackageGiveIsGoodForEveryRobot) {
  const auto told = [](const std::string& file, const std::string& before) {
    std::ifstream in(TENDRIL_SOURCE_DIR "/" + file);
    const std::string text{std::istreambuf_iterator<char>(in), {}};
    const auto at = text.find(before);
    return at == text.npos ? std::string() : std::to_string(std::atoi(text.c_str() + at + before.size()));
  };
  const std::string length = told("docs/guides/first-robot.md", "txqueuelen ");
  EXPECT_EQ(length, std::to_string(kTransmitQueue));
  EXPECT_EQ(told("config/systemd/networkd/80-can0.link", "TransmitQueueLength="), length);
  const Machine machine({{"sys/class/net/can0/tx_queue_len", length}});
  for (int drives = 1; drives <= kMaxTendons; ++drives) {
    const auto settings = ReadHost(machine.root.string(), Wanted(), "can0", drives);
    EXPECT_EQ(settings.back().verdict, Verdict::kGood) << drives << " drives, " << settings.back().name;
  }
}

TEST(Host, CapabilitiesStandForLimits) {
  const Machine machine({{"proc/self/limits", kLimits}, {"proc/self/status", "CapEff:\t000001ffffffffff"}});
  EXPECT_EQ(machine.Read("rtprio limit").verdict, Verdict::kGood);
  EXPECT_EQ(machine.Read("memlock limit").verdict, Verdict::kGood);
}

TEST(Host, ALoopBoundToNoCpuIsToldToChooseOne) {
  const Machine machine({});
  RealtimeParameters p = Wanted();
  p.cpu = -1;
  EXPECT_THAT(machine.Read("isolated CPU", p).remedy, HasSubstr("set realtime.cpu to one of 2-3"));
  EXPECT_EQ(machine.Read("governor", p).verdict, Verdict::kBetter)
      << "CPU 0 saves power, and the loop may be there";
}

TEST(Host, AnEmptyTreeIsUnknownAndNothingIsClaimed) {
  const fs::path root = fs::temp_directory_path() / ("tendril_host_empty_" + std::to_string(getpid()));
  fs::create_directories(root);
  for (const HostSetting& s : ReadHost(root.string(), Wanted(), "can0", 3)) {
    EXPECT_EQ(s.verdict, Verdict::kUnknown) << s.name;
  }
  fs::remove_all(root);
}

TEST(CompareLoops, BothLoopsHaveTheSameTurnsAndEndWhenTold) {
  RealtimeParameters p;
  p.lock_memory = false;
  const LoopComparison m = CompareLoops(p, kNsPerMs, 3600 * kNsPerS, [] { return true; });
  EXPECT_EQ(m.loop.count(), 250U);
  EXPECT_EQ(m.timer.count(), 250U);
  EXPECT_GT(m.timer.max_ns(), 0);
  EXPECT_EQ(m.problems, "");
}

TEST(CompareLoops, MissingRightsAreToldAndItMeasuresAllTheSame) {
  RealtimeParameters p;
  p.lock_memory = false;
  p.cpu = 100'000;
  const LoopComparison m = CompareLoops(p, kNsPerMs, 1, [] { return false; });
  EXPECT_THAT(m.problems, HasSubstr("not bound to cpu 100000"));
  EXPECT_EQ(m.loop.count(), 250U);
}

}  // namespace
}  // namespace tendril::rt
