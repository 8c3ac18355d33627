// tendril-plant's command line. Knows nothing of what is done with it.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace tendril::tools {

struct PlantOptions {
  std::string robot, drives, interface = "vcan0", lcm_url, scenario, extra_nodes;
  std::vector<std::string> faults;
  std::uint64_t seed = 1;
};

/// The program's whole command line, which fills `options` when it is parsed.
std::unique_ptr<CLI::App> MakePlantApp(PlantOptions& options);

}  // namespace tendril::tools
