#include "dashboard.h"

#include <fmt/format.h>
#include <unistd.h>

#include <string>
#include <vector>

#include "number_option.h"
#include "python_program.h"
#include "tendril/core/usage_error.h"

namespace tendril::tools {
namespace {

/// Those that were given, each followed by its value.
std::vector<std::string> Words(const DashboardOptions& o) {
  std::vector<std::string> words;
  const auto add = [&](const char* name, const std::optional<double>& value) {
    if (value) words.insert(words.end(), {name, fmt::format("{}", *value)});
  };
  add("--tip-speed", o.tip_speed_mmps);
  add("--bend-speed", o.bend_speed_radps);
  add("--release", o.release_ms);
  return words;
}

}  // namespace

void AddDashboardOptions(CLI::App& app, DashboardOptions& o) {
  app.add_option(
         "--tip-speed", o.tip_speed_mmps,
         "of the dashboard: limit of the jog of the tip [mm/s] (default: a fifth of the robot's length "
         "per second)")
      ->check(NumberFrom(0.1, 100, "give mm/s"));
  app.add_option("--bend-speed", o.bend_speed_radps,
                 "of the dashboard: limit of the jog of a bend [rad/s] (default: the daemon's "
                 "trajectory.default_speed_radps)")
      ->check(NumberFrom(0.01, 2, "give rad/s"));
  app.add_option("--release", o.release_ms,
                 "of the dashboard: how long one event of a jog key permits motion [ms]; longer than the "
                 "keyboard's repeat, shorter than its delay (default: 150)")
      ->check(NumberFrom(60, 300, "give ms"));
}

void BecomeDashboard(const LcmOptions& lcm, const DashboardOptions& options) {
  const std::vector<std::string> needs{"tendril.dashboard", "textual"};
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
    if (isatty(stream) == 0) return;
  }
  std::vector<std::string> words = Words(options);
  words.insert(words.end(), {"--lcm", lcm.url, "--prefix", lcm.prefix});
  RunPythonIfThere("tendril.dashboard", words, needs);
}

void RefuseDashboardOptions(const DashboardOptions& options) {
  const std::vector<std::string> given = Words(options);
  if (given.empty()) return;
  throw UsageError(
      given.front() +
      " is for the dashboard; give it with --watch on a terminal, without --plain and --json, and "
      "with the Python package (pip install './python[dashboard]' in the checkout)");
}

}  // namespace tendril::tools
