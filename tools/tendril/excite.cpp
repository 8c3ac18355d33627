// `tendril excite`: the identification experiments, on the plant in this process or on a running daemon,
// written as a data-set folder. Knows nothing of what the data will be used for.
#include <fmt/format.h>

#include <atomic>
#include <filesystem>
#include <memory>

#include "commands.h"
#include "counted.h"
#include "lcm_options.h"
#include "paths.h"
#include "seed_option.h"
#include "set_progress.h"
#include "stop_signals.h"
#include "tendril/experiment/experiment_live.h"
#include "tendril/experiment/experiment_run.h"
#include "tendril/experiment/planted_set.h"
#include "tendril/experiment/set_output.h"
#include "tendril/gap/data_set.h"
#include "tendril/sim/effects.h"

namespace tendril::tools {
namespace {

struct ExciteOptions {
  std::string set = "standard", plan, print_plan, robot, plant, daemon, out = "tendril-excite";
  LcmOptions lcm;
  bool live = false, arm = false, overwrite = false;
  std::uint64_t seed = 1;
  int repeats = -1, jobs = 2;
};

experiment::ExperimentSet RunInProcess(const experiment::Plan& plan, const ExciteOptions& options,
                                       const std::atomic<bool>& stop,
                                       const experiment::SetProgress& progress) {
  const std::string robot_file = options.robot.empty() ? ConfigFile("robots/rig_90mm.yaml") : options.robot;
  RobotParameters nominal = sim::LoadRobot(robot_file);
  const experiment::ExperimentOptions experiment{
      .controller_robot = nominal,
      .plant_robot = sim::LoadRobot(options.plant.empty() ? robot_file : options.plant),
      .daemon = experiment::DaemonOfExperiments(options.daemon),
      .seed = options.seed,
      .threads = options.jobs};
  return experiment::RunSet(plan, experiment, &stop, progress);
}

void RunExcite(const ExciteOptions& options) {
  if (!options.print_plan.empty()) {
    fmt::print("{}", ToYaml(experiment::NamedPlan(options.print_plan)));
    return;
  }
  if (options.live && !options.plant.empty()) {
    throw UsageError("--plant is for the plant in this process; with --live the daemon's robot moves");
  }
  if (options.live && !options.daemon.empty())
    throw UsageError(
        "--daemon is for the controller in this process; with --live the daemon has its own file");
  if (options.arm && !options.live)
    throw UsageError("--arm goes with --live; in process there is nothing to arm");
  experiment::Plan plan =
      options.plan.empty() ? experiment::NamedPlan(options.set) : experiment::LoadPlan(options.plan);
  if (options.repeats >= 0) experiment::RepeatEach(plan, options.repeats);
  const gap::SetFolder folder(options.out, options.overwrite,
                              {options.robot, options.plant, options.plan, options.daemon});
  folder.CheckNames(experiment::FileNames(plan));
  const std::atomic<bool>& stop = CatchStopSignals();
  SetProgressLine line(experiment::NameRuns(plan));
  const auto progress = [&line](std::size_t run, double share, const experiment::Experiment* done) {
    line.Show(run, share, done);
  };
  experiment::ExperimentSet set;
  if (options.live) {
    experiment::LiveOptions live{
        .lcm_url = options.lcm.url, .channel_prefix = options.lcm.prefix, .robot = {}, .arm = options.arm};
    if (!options.robot.empty()) live.robot = sim::LoadRobot(options.robot);
    set = experiment::RunLiveSet(
        plan, live, &stop,
        [](const std::string& remark) {
          if (!remark.empty()) fmt::print(stderr, "note: {}\n", remark);
        },
        progress);
  } else {
    set = RunInProcess(plan, options, stop, progress);
  }
  // Unlike simulated runs, measurements cannot be made again.
  const std::filesystem::path out = experiment::WriteSet(set, folder, options.live);
  fmt::print("{}, {:.1f} s of data in {:.1f} s: {}\n", Counted(set.data.runs.size(), "run"), set.simulated_s,
             set.wall_s, std::filesystem::absolute(out).lexically_normal().string());
  if (!set.trouble.empty()) throw std::runtime_error("the set is not complete: " + set.trouble);
}

}  // namespace

void AddExciteCommand(CLI::App& app) {
  auto options = std::make_shared<ExciteOptions>();
  CLI::App* command = app.add_subcommand(
      "excite", "Run the identification experiments and write a data set for `tendril gap diagnose`");
  auto* set = command->add_option("--set", options->set, "of experiments: about 145 s or 60 s of data")
                  ->check(CLI::IsMember({"standard", "quick"}))
                  ->capture_default_str();
  command->add_option("--plan", options->plan, "experiments from a plan file")->excludes(set);
  command->add_option("--print-plan", options->print_plan, "print a set as a plan file to edit, and exit")
      ->check(CLI::IsMember({"standard", "quick"}));
  command->add_option("--robot", options->robot,
                      "the nominal robot file (default: rig_90mm, with --live the daemon's own)");
  command->add_option("--plant", options->plant, "the plant's robot file (default: the nominal one)");
  command->add_option(
      "--daemon", options->daemon,
      "daemon file whose controller runs them in process (default: that of tendrild.yaml, built in)");
  command->add_option("--out", options->out, "folder for robot.yaml, runs.yaml and one CSV per run")
      ->capture_default_str();
  command->add_flag("--overwrite", options->overwrite,
                    "replace the folder's data set once the new one is complete");
  command->add_option("--seed", options->seed, "of the plant's sensor noise")
      ->check(Seed())
      ->capture_default_str();
  command
      ->add_option("--repeats", options->repeats,
                   "identical repetitions of every run, instead of those in the plan")
      ->check(CLI::Range(0, 20));
  command->add_option("--jobs", options->jobs, "runs at a time, in process")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  command->add_flag("--live", options->live, "on a running daemon instead of the plant in this process");
  command->add_flag("--arm", options->arm, "with --live: arm before every run, disarm after the last");
  AddOperatorOptions(*command, options->lcm);
  command->callback([options] { RunExcite(*options); });
}

}  // namespace tendril::tools
