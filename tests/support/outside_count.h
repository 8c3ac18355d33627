// Counts what a thread does that may wait for others or reaches outside the process, so that a test can show
// that code does neither.
#pragma once

#include <cstdint>

namespace tendril::test {

/// Calls of this thread since it started: locks of mutexes and read-write locks, and everything that writes
/// to a file, terminal, pipe or socket. Waiting for a time is none of them.
std::uint64_t OutsideCount() noexcept;

}  // namespace tendril::test
