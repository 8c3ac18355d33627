// Writes a report of an invented diagnosis into a folder, for tests of programs that read reports. Knows
// nothing of how diagnoses are made.
#include <exception>
#include <iostream>

#include "report_examples.h"
#include "tendril/gap/report.h"

int main(int argc, char** argv) {
  try {
    if (argc != 2) throw std::runtime_error("usage: gap_report_example FOLDER");
    using namespace tendril::gap;
    WriteReport(ExampleDiagnosis(Verdict::kAttributed), argv[1]);
  } catch (const std::exception& e) {
    std::cerr << e.what() << "\n";
    return 1;
  }
  return 0;
}
