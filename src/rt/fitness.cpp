#include "tendril/rt/fitness.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdint>

namespace tendril::rt {
namespace {

// A cycle's bus and computing time are budgeted to the cycle; what the wake-up may take of it is this.
constexpr double kTypicalShare = 0.05;        // 99.9 % of the cycles
constexpr double kWorstShare = 0.20;          // every one
constexpr std::uint64_t kLeastCycles = 2000;  // that say anything of one in a thousand

double Us(TimeNs t_ns) { return static_cast<double>(t_ns) * 1e-3; }

}  // namespace

Judgement Judge(TimeNs cycle_ns, const LoopComparison& measured, const std::vector<HostSetting>& settings) {
  Judgement j;
  const auto against = [&j](const std::string& reason) {
    j.fit = false;
    j.reasons.push_back(reason);
  };
  const auto period_us = Us(cycle_ns);
  if (!measured.problems.empty()) {
    against("measured without real-time rights, so valid for an ordinary program only: " + measured.problems);
  }
  for (const HostSetting& s : settings) {
    if (s.verdict == Verdict::kBad) against(s.name + ": " + s.value);
  }
  const double typical_us = Us(measured.loop.Percentile(0.999)), worst_us = Us(measured.loop.max_ns());
  if (measured.loop_missed > 0) against(fmt::format("{} cycles were missed", measured.loop_missed));
  if (const std::uint64_t cycles = measured.loop.count(); cycles < kLeastCycles) {
    const double half_s = static_cast<double>(kLeastCycles) * 1e-6 * period_us;
    j.limit =
        fmt::format("{} cycles are too few to judge one in a thousand; measure for --seconds {:.0f} or more",
                    cycles, std::ceil(2 * half_s));
  } else if (typical_us > kTypicalShare * period_us) {
    against(
        fmt::format("one wake-up in a thousand is late by {:.0f} us or more; {:.0f} us ({:.0f} % of the "
                    "cycle) are acceptable",
                    typical_us, kTypicalShare * period_us, 100 * kTypicalShare));
  }
  if (worst_us > kWorstShare * period_us) {
    against(fmt::format(
        "the latest wake-up came {:.0f} us late; {:.0f} us ({:.0f} % of the cycle) are acceptable", worst_us,
        kWorstShare * period_us, 100 * kWorstShare));
  }
  return j;
}

const char* VerdictText(Verdict v) {
  switch (v) {
    case Verdict::kGood:
      return "good";
    case Verdict::kUnknown:
      return "unknown";
    case Verdict::kBetter:
      return "could be better";
    case Verdict::kBad:
      return "bad";
  }
  return "";
}

}  // namespace tendril::rt
