// libFuzzer's entry; which target is chosen when compiling.
// Tells at the end how many frames went through.
#include <cstdio>
#include <cstdlib>

#include "fuzz_targets.h"

namespace {
long long frames = 0;
}  // namespace

extern "C" int LLVMFuzzerInitialize(int*, char***) {
  std::atexit([] { std::fprintf(stderr, "%lld frames\n", frames); });
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  frames += tendril::canopen::test::TENDRIL_FUZZ_TARGET({data, size});
  return 0;
}
