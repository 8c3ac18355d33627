// libFuzzer's entry; which target is chosen when compiling.
#include "fuzz_targets.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  tendril::canopen::test::TENDRIL_FUZZ_TARGET({data, size});
  return 0;
}
