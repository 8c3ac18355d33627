// For schema_test.py: what the loaders say of many small documents, at a fraction of the time of as many
// programs. Each line of the input is a kind, a space and a document; each line of the output is the refusal,
// or empty.
#include <fmt/core.h>

#include <iostream>
#include <string>

#include "tendril/config/config.h"

int main() {
  for (std::string line; std::getline(std::cin, line);) {
    const std::size_t space = line.find(' ');
    const std::string document = line.substr(space + 1);
    try {
      if (line.substr(0, space) == "robot") {
        (void)tendril::config::ParseRobot(document, "file");
      } else {
        (void)tendril::config::ParseDaemon(document, "file");
      }
      fmt::print("\n");
    } catch (const tendril::config::ConfigError& e) {
      fmt::print("{}\n", e.what());
    }
  }
}
