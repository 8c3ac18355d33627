// Time for a user-mode Linux kernel under test, preloaded into it: computing takes (almost) none, and waiting is skipped.
// A bus with real-time programs on it then behaves the same on a slow or busy machine. Knows the four clock calls that
// such a kernel makes, nothing of what runs in it.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdint.h>
#include <time.h>

// While something computes, time passes this much slower than outside. Not standing still: what never asks for the time
// must be interrupted some day, too.
enum { kSlower = 1000 };
// From the kernel's first idling on; before that it counts its own ticks, computing.
static _Atomic int slower = 1;

// Signal handlers of the kernel ask for the time, too, at any moment: single atomic values, never going back.
static _Atomic int64_t virtual_ns, outside_ns, deadline_ns, interval_ns;

static int64_t ToNs(struct timespec t) { return t.tv_sec * INT64_C(1000000000) + t.tv_nsec; }
static struct timespec ToTimespec(int64_t ns) {
  return (struct timespec){.tv_sec = ns / 1000000000, .tv_nsec = ns % 1000000000};
}

static void* Original(const char* name) { return dlsym(RTLD_NEXT, name); }

static int64_t Outside(void) {
  static int (*original)(clockid_t, struct timespec*);
  if (!original) original = (int (*)(clockid_t, struct timespec*))Original("clock_gettime");
  struct timespec t;
  original(CLOCK_MONOTONIC, &t);
  return ToNs(t);
}

static int64_t Now(void) {
  const int64_t outside = Outside();
  int64_t before = atomic_exchange(&outside_ns, outside);
  if (before == 0 || before > outside) before = outside;
  return atomic_fetch_add(&virtual_ns, (outside - before) / slower + 1) + 1;
}

int clock_gettime(clockid_t clock, struct timespec* t) {
  if (clock != CLOCK_MONOTONIC) {
    static int (*original)(clockid_t, struct timespec*);
    if (!original) original = (int (*)(clockid_t, struct timespec*))Original("clock_gettime");
    return original(clock, t);
  }
  *t = ToTimespec(Now());
  return 0;
}

// The kernel's one timer for its next event, always relative.
int timer_settime(timer_t timer, int flags, const struct itimerspec* wanted, struct itimerspec* before) {
  static int (*original)(timer_t, int, const struct itimerspec*, struct itimerspec*);
  if (!original) {
    original = (int (*)(timer_t, int, const struct itimerspec*, struct itimerspec*))Original("timer_settime");
  }
  const int64_t value = ToNs(wanted->it_value), interval = ToNs(wanted->it_interval);
  atomic_store(&interval_ns, interval);
  atomic_store(&deadline_ns, value ? Now() + value : 0);
  const struct itimerspec outside = {.it_value = ToTimespec(value * slower),
                                    .it_interval = ToTimespec(interval * slower)};
  return original(timer, flags, &outside, before);
}

// The kernel asks this only when it has nothing to do, before it waits for the timer's signal: the wait is over at once.
int timer_gettime(timer_t timer, struct itimerspec* remaining) {
  (void)timer;
  atomic_store(&slower, kSlower);
  const int64_t deadline = atomic_load(&deadline_ns), interval = atomic_load(&interval_ns);
  *remaining = (struct itimerspec){0};
  if (deadline == 0) return 0;
  int64_t now = atomic_load(&virtual_ns);
  while (now < deadline && !atomic_compare_exchange_weak(&virtual_ns, &now, deadline)) {
  }
  atomic_store(&deadline_ns, interval ? deadline + interval : 0);
  remaining->it_value = ToTimespec(1);
  raise(SIGALRM);
  return 0;
}
