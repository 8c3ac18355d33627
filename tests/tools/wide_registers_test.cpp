// Preloaded into user-mode Linux: a tracer that knows fewer registers than the processor has writes those it
// knows.
#include <elf.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <vector>

namespace {

using Registers = std::vector<unsigned char>;

// Every layout begins with the registers up to xmm15 and a header that says which of all are in use.
constexpr std::size_t kXmm0 = 160, kInUse = 512, kFirstPart = 512 + 64;
constexpr unsigned char kX87AndSse = 3;

/// A child that stands with all bits of ymm5 set, of which xmm5 is the half that every tracer knows.
class WideRegisters : public ::testing::Test {
 protected:
  void SetUp() override {
#if defined(__x86_64__)
    if (!__builtin_cpu_supports("avx"))
      GTEST_SKIP() << "this processor has no registers beyond the first part";
    child_ = fork();
    ASSERT_GE(child_, 0);
    if (child_ == 0) {
      ptrace(PTRACE_TRACEME, 0, nullptr, nullptr);
      asm volatile("vcmpps $15, %%ymm5, %%ymm5, %%ymm5\n int3" ::: "xmm5");
      _exit(0);
    }
    int status = 0;
    ASSERT_EQ(waitpid(child_, &status, 0), child_);
    if (!WIFSTOPPED(status)) GTEST_SKIP() << "no process can be traced here";
#else
    GTEST_SKIP() << "this processor has other registers";
#endif
  }
  void TearDown() override {
    if (child_ <= 0) return;
    kill(child_, SIGKILL);
    waitpid(child_, nullptr, 0);
  }
  Registers Read() const {
    Registers registers(1 << 16);
    iovec all{registers.data(), registers.size()};
    EXPECT_EQ(ptrace(PTRACE_GETREGSET, child_, reinterpret_cast<void*>(NT_X86_XSTATE), &all), 0);
    registers.resize(all.iov_len);
    return registers;
  }

  pid_t child_ = -1;
};

TEST_F(WideRegisters, TheKnownPartIsWrittenAndTheRestStays) {
  const Registers before = Read();
  ASSERT_GT(before.size(), kFirstPart);
  ASSERT_TRUE(std::any_of(before.begin() + kFirstPart, before.end(), [](auto byte) { return byte != 0; }));

  Registers known(before.begin(), before.begin() + kFirstPart);
  known[kInUse] |= kX87AndSse;
  for (int k = 0; k < 16; ++k) known[kXmm0 + k] = static_cast<unsigned char>(0xa0 + k);
  iovec part{known.data(), known.size()};
  auto* const kind = reinterpret_cast<void*>(NT_X86_XSTATE);
  if (syscall(SYS_ptrace, PTRACE_SETREGSET, child_, kind, &part) == 0)
    GTEST_SKIP() << "this kernel takes a part of the registers by itself";
  ASSERT_EQ(errno, EFAULT);

  ASSERT_EQ(ptrace(PTRACE_SETREGSET, child_, kind, &part), 0);
  const Registers after = Read();
  EXPECT_TRUE(std::equal(known.begin(), known.end(), after.begin()));
  EXPECT_EQ(Registers(after.begin() + kFirstPart, after.end()),
            Registers(before.begin() + kFirstPart, before.end()));
}

TEST_F(WideRegisters, OtherRequestsAreAsTheyWere) {
  errno = 0;
  EXPECT_EQ(ptrace(PTRACE_PEEKUSER, child_, reinterpret_cast<void*>(1 << 20), nullptr), -1);
  EXPECT_EQ(errno, EIO);
  EXPECT_EQ(ptrace(PTRACE_SETREGSET, child_ + 0x10000000, reinterpret_cast<void*>(NT_X86_XSTATE), nullptr),
            -1);
  EXPECT_EQ(errno, ESRCH);
}

}  // namespace
