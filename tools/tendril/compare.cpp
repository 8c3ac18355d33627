// `tendril compare`: control laws on simulated plants, or robot files on one plant. The runs are
// experiment's.
#include "tendril/experiment/compare.h"

#include <fmt/format.h>

#include <memory>

#include "commands.h"
#include "output.h"
#include "paths.h"
#include "seed_option.h"
#include "stop_signals.h"
#include "tendril/config/whole_file.h"

namespace tendril::tools {
namespace {

namespace fs = std::filesystem;

struct CompareOptions {
  std::vector<std::string> robots, laws, plants;
  std::string plant, trajectory = "all", out = "tendril-compare";
  std::uint64_t seed = 1;
  bool json = false, plots = true;
};

void Finish(const CompareOptions& options, const fs::path& out, const experiment::Comparison& comparison) {
  const auto& [json, lines] = comparison;
  config::WriteWhole(out / "compare.json", json.dump(1) + "\n");
  if (options.plots) RunPlotScript("plot_compare.py", {out}, "the plot");
  if (options.json) {
    fmt::print("{}\n", json.dump(1));
    return;
  }
  for (const std::string& line : lines) fmt::print("{}\n", line);
  fmt::print("\n  {}: compare.json, samples{}\n", fs::absolute(out).lexically_normal().string(),
             options.plots ? " and compare.png, .svg, .pdf" : "");
}

void RunCompare(const CompareOptions& options) {
  const fs::path out = MakeOutputFolder(options.out);
  const experiment::CompareSetup setup{
      .config_file = ConfigFile, .folder = out, .seed = options.seed, .stop = &CatchStopSignals()};
  const bool laws = options.robots.empty();
  std::vector<std::string> trajectories{"circle", "planar"};
  if (laws) trajectories.insert(trajectories.end(), {"fast_circle", "square", "spiral"});
  if (options.trajectory != "all") trajectories = {options.trajectory};
  Finish(options, out,
         laws ? experiment::CompareLaws(options.laws, options.plants, trajectories, setup)
              : experiment::CompareRobots(options.robots, options.plant, trajectories, setup));
}

}  // namespace

void AddCompareCommand(CLI::App& app) {
  auto options = std::make_shared<CompareOptions>();
  CLI::App* command = app.add_subcommand(
      "compare",
      "Tracking error: control laws on simulated plants; or, with --robot, robot files on one plant");
  command
      ->add_option("--robot", options->robots,
                   "robot file of the controller; may be repeated, the nominal one first")
      ->allow_extra_args(false);
  command->add_option("--plant", options->plant,
                      "with --robot: the plant's file, with the real robot's deviations");
  command->add_option("--law", options->laws, "without --robot: these laws only (repeat)")
      ->check(CLI::IsMember(experiment::ComparedLaws()))
      ->allow_extra_args(false);
  command->add_option("--on", options->plants, "without --robot: these plants only (repeat)")
      ->check(CLI::IsMember(experiment::ComparedPlants()))
      ->allow_extra_args(false);
  command->add_option("--trajectory", options->trajectory, "what to follow")
      ->check(CLI::IsMember({"circle", "planar", "fast_circle", "square", "spiral", "all"}))
      ->capture_default_str();
  command->add_option("--out", options->out, "folder for compare.json, samples and the plot")
      ->capture_default_str();
  command->add_option("--seed", options->seed, "of the sensor noise")->check(Seed())->capture_default_str();
  command->add_flag("--json", options->json, "print the JSON instead of the table");
  command->add_flag("!--no-plots", options->plots, "leave out the plot");
  command->callback([options] {
    if (options->robots.empty() != options->plant.empty())
      throw UsageError("--robot and --plant belong together; without both, the control laws are compared");
    if (!options->robots.empty() && !(options->laws.empty() && options->plants.empty()))
      throw UsageError("--law and --on go without --robot: they compare laws on the shipped rigs");
    RunCompare(*options);
  });
}

}  // namespace tendril::tools
