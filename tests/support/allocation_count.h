// Counts heap allocations of the calling thread, so that a test can show that code allocates nothing.
#pragma once

#include <cstdint>

namespace tendril::test {

/// Allocations (malloc, calloc, realloc, aligned_alloc; operator new ends there) of this thread since it
/// started.
std::uint64_t AllocationCount() noexcept;

}  // namespace tendril::test
