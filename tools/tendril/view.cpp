// `tendril view`: the robot in 3-D in a browser, by the Python package. Knows nothing of how it is drawn.
#include <fmt/format.h>

#include <memory>
#include <optional>

#include "commands.h"
#include "lcm_options.h"
#include "number_option.h"
#include "python_program.h"

namespace tendril::tools {
namespace {

struct ViewOptions {
  std::vector<std::string> sources;
  std::string robot;
  std::optional<double> at_s;
  LcmOptions lcm;
  int port = 8095;
  double duration_s = 0;
  bool no_browser = false;
};

void View(const ViewOptions& o) {
  if (o.sources.empty() && !o.robot.empty()) {
    throw UsageError("--robot is for logs and tables; a running daemon says itself which robot it controls");
  }
  if (o.sources.empty() && o.at_s) {
    throw UsageError("--at is a time of a recording; a live view begins at the present");
  }
  std::vector<std::string> words{"--lcm",      o.lcm.url,
                                 "--prefix",   o.lcm.prefix,
                                 "--port",     fmt::format("{}", o.port),
                                 "--duration", fmt::format("{}", o.duration_s)};
  if (!o.robot.empty()) words.insert(words.end(), {"--robot", o.robot});
  if (o.at_s) words.insert(words.end(), {"--at", fmt::format("{}", *o.at_s)});
  if (o.no_browser) words.emplace_back("--no-browser");
  words.emplace_back("--");
  words.insert(words.end(), o.sources.begin(), o.sources.end());
  RunPython("tendril.view", words, {"viser", "lcm"});
}

}  // namespace

void AddViewCommand(CLI::App& app) {
  auto o = std::make_shared<ViewOptions>();
  CLI::App* view = app.add_subcommand(
      "view",
      "The robot in 3-D in a browser of this machine: live, from a log or a data set, or as a diagnosis with "
      "measured, nominal and corrected robot side by side; sends nothing to a robot");
  view->add_option("source", o->sources,
                   "LCM logs or folders with one, data-set folders, CSV files (with --robot), or the "
                   "report.json of tendril gap diagnose, or its folder, and the runs that it was made from "
                   "(those of its own command line if left out); without any: live");
  view->add_option("--robot", o->robot, "robot file, instead of the one in a log or a data set");
  view->add_option("--at", o->at_s, "begin at rest at this time of the recording [s], instead of playing it")
      ->check(NumberFrom(0, 1e9, "give seconds"));
  AddLcmOptions(*view, o->lcm);
  view->add_option("--port", o->port, "of 127.0.0.1, where alone it is served; 0: any that is free")
      ->capture_default_str()
      ->check(CLI::Range(0, 65535));
  view->add_flag("--no-browser", o->no_browser, "only print the address");
  view->add_option("--duration", o->duration_s, "end this long after a page was first open [s]; 0: on Ctrl-C")
      ->capture_default_str()
      ->check(NumberFrom(0, 1e6, "give seconds"));
  view->callback([o] { View(*o); });
}

}  // namespace tendril::tools
