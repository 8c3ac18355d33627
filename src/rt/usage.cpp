// Resource usage of a thread; see the header.
#include "tendril/rt/usage.h"

#include <sys/resource.h>

namespace tendril::rt {

ThreadUsage ReadThreadUsage() noexcept {
  rusage usage{};
  getrusage(RUSAGE_THREAD, &usage);
  return {static_cast<std::uint64_t>(usage.ru_nvcsw), static_cast<std::uint64_t>(usage.ru_nivcsw),
          static_cast<std::uint64_t>(usage.ru_minflt), static_cast<std::uint64_t>(usage.ru_majflt)};
}

void UsageMeter::End() noexcept {
  const ThreadUsage now = ReadThreadUsage();
  sum_.voluntary_switches += now.voluntary_switches - from_.voluntary_switches;
  sum_.involuntary_switches += now.involuntary_switches - from_.involuntary_switches;
  sum_.minor_faults += now.minor_faults - from_.minor_faults;
  sum_.major_faults += now.major_faults - from_.major_faults;
}

}  // namespace tendril::rt
