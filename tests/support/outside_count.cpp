// Each function is interposed with a count before the original; no header that declares them is read here.
#include "support/outside_count.h"

#include <dlfcn.h>

#include <cstddef>

namespace {
thread_local std::uint64_t count = 0;
}  // namespace

// A plain pointer: what guards a static object may be one of these functions itself.
#define TENDRIL_COUNTED(result, name, parameters, arguments)                           \
  extern "C" result name parameters {                                                  \
    static result(*next) parameters = nullptr;                                         \
    ++count;                                                                           \
    if (!next) next = reinterpret_cast<result(*) parameters>(dlsym(RTLD_NEXT, #name)); \
    return next arguments;                                                             \
  }

TENDRIL_COUNTED(int, pthread_mutex_lock, (void* m), (m))
TENDRIL_COUNTED(int, pthread_rwlock_rdlock, (void* l), (l))
TENDRIL_COUNTED(int, pthread_rwlock_wrlock, (void* l), (l))
TENDRIL_COUNTED(long, write, (int fd, const void* data, std::size_t size), (fd, data, size))
TENDRIL_COUNTED(long, writev, (int fd, const void* parts, int n), (fd, parts, n))
TENDRIL_COUNTED(long, send, (int fd, const void* data, std::size_t size, int flags), (fd, data, size, flags))
TENDRIL_COUNTED(long, sendto,
                (int fd, const void* data, std::size_t size, int flags, const void* to, unsigned n),
                (fd, data, size, flags, to, n))
TENDRIL_COUNTED(long, sendmsg, (int fd, const void* message, int flags), (fd, message, flags))
TENDRIL_COUNTED(std::size_t, fwrite, (const void* data, std::size_t size, std::size_t n, void* file),
                (data, size, n, file))
TENDRIL_COUNTED(int, fflush, (void* file), (file))

namespace tendril::test {
std::uint64_t OutsideCount() noexcept { return count; }
}  // namespace tendril::test
