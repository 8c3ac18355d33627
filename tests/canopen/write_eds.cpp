// Writes the drive's data sheet from the object table: the target write_eds does so in the source tree.
// Knows nothing but the table.
#include <cstdio>
#include <fstream>

#include "tendril/canopen/epos4.h"

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: %s FILE\n", argv[0]);
    return 2;
  }
  std::ofstream file(argv[1]);
  file << tendril::canopen::EdsText() << std::flush;
  if (!file) {
    std::fprintf(stderr, "cannot write %s\n", argv[1]);
    return 1;
  }
  return 0;
}
