// libFuzzer's entry. The environment says which target (TENDRIL_FUZZ_TARGET) and after how many frames to end
// (TENDRIL_FUZZ_FRAMES); tells at the end how many went through.
#include <unistd.h>

#include <cstdio>
#include <cstdlib>

#include "targets.h"

namespace {

const tendril::fuzz::Target* target = nullptr;
long long frames = 0, most_frames = 0;

void Tell() { std::fprintf(stderr, "%s: %lld frames\n", target->name.data(), frames); }

}  // namespace

extern "C" int LLVMFuzzerInitialize(int*, char***) {
  const char* name = std::getenv("TENDRIL_FUZZ_TARGET");
  target = tendril::fuzz::FindTarget(name == nullptr ? "" : name);
  if (target == nullptr) {
    std::fprintf(stderr, "TENDRIL_FUZZ_TARGET is none of the targets; see tests/fuzz/run\n");
    std::exit(2);
  }
  if (const char* most = std::getenv("TENDRIL_FUZZ_FRAMES")) most_frames = std::atoll(most);
  std::atexit(Tell);
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  frames += target->run({data, size});
  if (most_frames > 0 && frames >= most_frames) {
    Tell();
    _exit(0);  // libFuzzer takes an orderly exit for a finding
  }
  return 0;
}
