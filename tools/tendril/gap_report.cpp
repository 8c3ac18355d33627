// tendril gap report: the page of a diagnosis made again from its report.json. Knows nothing of the diagnosis
// itself.
#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>

#include "commands.h"
#include "output.h"
#include "tendril/gap/report.h"

namespace tendril::tools {
namespace {

struct Options {
  std::string report, out = "out/gap";
};

void Run(const Options& options) {
  const gap::Diagnosis diagnosis = gap::ReadReport(options.report);
  const auto folder = MakeOutputFolder(options.out);
  gap::WriteReport(diagnosis, folder);
  fmt::print("{}", gap::Summary(diagnosis, folder / "report.html", isatty(STDOUT_FILENO) != 0));
}

}  // namespace

void AddGapReportCommand(CLI::App& app) {
  auto options = std::make_shared<Options>();
  CLI::App* command = GapCommand(app).add_subcommand(
      "report", "Write the report's page and print its summary again, from its report.json");
  command->add_option("file", options->report, "report.json of tendril gap diagnose")->required();
  command->add_option("--out", options->out, "folder for report.html and report.json")->capture_default_str();
  command->callback([options] { Run(*options); });
}

}  // namespace tendril::tools
