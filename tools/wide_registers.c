// Floating-point registers for a user-mode Linux kernel, preloaded into it. Where the processor has more of them than
// such a kernel knows (AMX), it reads a part and writes that back, which the machine's kernel refuses: all or nothing.
// What it does not know stays as it is.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <errno.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>

long ptrace(enum __ptrace_request request, ...) {
  static long (*original)(enum __ptrace_request, ...);
  if (!original) original = (long (*)(enum __ptrace_request, ...))dlsym(RTLD_NEXT, "ptrace");
  va_list arguments;
  va_start(arguments, request);
  const pid_t process = va_arg(arguments, pid_t);
  void* const address = va_arg(arguments, void*);
  void* const data = va_arg(arguments, void*);
  va_end(arguments);

  const long result = original(request, process, address, data);
  if (result >= 0 || request != PTRACE_SETREGSET || address != (void*)NT_X86_XSTATE || errno != EFAULT) return result;
  static char registers[1 << 16];
  struct iovec all = {.iov_base = registers, .iov_len = sizeof registers};
  if (original(PTRACE_GETREGSET, process, address, &all) < 0) return -1;
  const struct iovec* known = data;
  if (known->iov_len > all.iov_len) {
    errno = EFAULT;
    return -1;
  }
  memcpy(registers, known->iov_base, known->iov_len);
  return original(PTRACE_SETREGSET, process, address, &all);
}
