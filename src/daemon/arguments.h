// tendrild's command line. Knows nothing of what is done with it.
#pragma once

#include <CLI/CLI.hpp>
#include <memory>
#include <string>

namespace tendril::daemon {

struct Arguments {
  std::string config, can, lcm, log, black_box;
  bool simulated = false, wait = false;
};

/// The program's whole command line, which fills `arguments` when it is parsed.
std::unique_ptr<CLI::App> MakeApp(Arguments& arguments);

}  // namespace tendril::daemon
