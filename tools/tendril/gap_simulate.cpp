// `tendril gap simulate`: data sets from the simulator with given effects, noise and experiments. Knows
// nothing of how they are diagnosed. A third of it is options with their texts.
#include <fmt/format.h>

#include <atomic>
#include <filesystem>
#include <memory>
#include <optional>

#include "commands.h"
#include "counted.h"
#include "effect_name.h"
#include "progress.h"
#include "seed_option.h"
#include "set_progress.h"
#include "stop_signals.h"
#include "tendril/config/whole_file.h"
#include "tendril/experiment/experiment_run.h"
#include "tendril/experiment/planted_set.h"
#include "tendril/experiment/set_output.h"
#include "tendril/gap/set_folder.h"
#include "tendril/sim/effects.h"

namespace tendril::tools {
namespace {

struct SimulateOptions {
  std::string robot, daemon, set = "standard", plan, out, truth, noise = "on", load_cell, tracker = "on";
  std::vector<std::string> effects;
  std::uint64_t seed = 1;
  int repeats = -1, jobs = 2;
  bool overwrite = false;
};

/// The amounts of the effects that are given by their size, and a line for each.
void FindAmounts(experiment::PlantedEffects& effects, const experiment::Plan& plan,
                 experiment::ExperimentOptions& experiment, const std::atomic<bool>& stop) {
  Progress progress;
  experiment::SetAmounts(effects, plan, experiment, &stop,
                         [&](const std::string& stage, double share) { progress(stage, share); });
  progress.Finish();
  for (const auto& effect : effects.sized) {
    if (effect) fmt::print("{}\n", experiment::SizeLine(*effect));
  }
}

/// The robot file with the sensors that the options leave.
RobotParameters Nominal(const SimulateOptions& options) {
  std::optional<LoadCellPlace> cell;
  if (!options.load_cell.empty()) cell = experiment::LoadCellPlaceNamed(options.load_cell);
  return experiment::WithSensors(sim::LoadRobot(options.robot), options.robot, cell, options.tracker == "on");
}

void RunSimulate(const SimulateOptions& options) {
  const std::atomic<bool>& stop = CatchStopSignals();
  const RobotParameters nominal = Nominal(options);
  RobotParameters plant = nominal;
  experiment::PlantedEffects effects;
  ReadFor("--effect", [&] {
    for (const std::string& text : options.effects) CheckEffectNamed(text);
    effects = experiment::Plant(options.effects, nominal, plant);
  });

  experiment::Plan plan =
      options.plan.empty() ? experiment::NamedPlan(options.set) : experiment::LoadPlan(options.plan);
  if (options.repeats >= 0) experiment::RepeatEach(plan, options.repeats);
  experiment::ExperimentOptions experiment{.controller_robot = nominal,
                                           .plant_robot = plant,
                                           .daemon = experiment::DaemonOfExperiments(options.daemon),
                                           .seed = options.seed,
                                           .sensor_noise = options.noise == "on",
                                           .threads = options.jobs};
  const std::vector<std::string> inputs{options.robot, options.plan, options.daemon};
  const gap::SetFolder folder(options.out, options.overwrite, inputs);
  folder.CheckNames(experiment::FileNames(plan));
  if (!options.truth.empty()) {
    gap::RefuseToReplace(options.truth, "--truth", inputs);
    gap::CheckWritable(options.truth);
  }
  FindAmounts(effects, plan, experiment, stop);

  SetProgressLine line(experiment::NameRuns(plan));
  experiment::ExperimentSet set = experiment::RunSet(
      plan, experiment, &stop, [&](std::size_t run, double share, const experiment::Experiment* done) {
        line.Show(run, share, done);
      });
  const std::filesystem::path out = experiment::WriteSet(set, folder, false);
  if (!options.truth.empty()) {
    config::WriteWhole(options.truth,
                       experiment::TruthJson(options.robot, options.seed, experiment.plant_robot.effects,
                                             effects.requested, effects.sized) +
                           "\n");
  }
  fmt::print("{}, {:.1f} s of data in {:.1f} s ({:.1f} x real time): {}\n",
             Counted(set.data.runs.size(), "run"), set.simulated_s, set.wall_s, set.simulated_s / set.wall_s,
             std::filesystem::absolute(out).lexically_normal().string());
  if (!set.trouble.empty()) throw std::runtime_error("the set is not complete: " + set.trouble);
}

}  // namespace

void AddGapSimulateCommand(CLI::App& app) {
  auto options = std::make_shared<SimulateOptions>();
  CLI::App* command = GapCommand(app).add_subcommand(
      "simulate",
      "Make a data set from a simulated robot with given effects, controlled with the nominal robot file");
  command->add_option("--robot", options->robot, "nominal robot file (a rig)")->required();
  command
      ->add_option("--effect", options->effects,
                   "effect of the plant, e.g. \"backlash where=tendon:2 rad=0.05\", or with its size in "
                   "noise floors,  \"backlash sigma=3\"; may be repeated")
      ->allow_extra_args(false);
  command->add_option(
      "--daemon", options->daemon,
      "daemon file whose controller runs the experiments (default: that of tendrild.yaml, built in)");
  auto* set = command->add_option("--set", options->set, "experiments")
                  ->check(CLI::IsMember({"standard", "quick"}))
                  ->capture_default_str();
  command->add_option("--plan", options->plan, "experiments from a plan file")->excludes(set);
  command->add_option("--out", options->out, "folder for robot.yaml, runs.yaml and one CSV per run")
      ->required();
  command->add_flag("--overwrite", options->overwrite,
                    "replace the folder's data set once the new one is complete");
  command->add_option("--seed", options->seed, "of the sensors' noise")->check(Seed())->capture_default_str();
  command
      ->add_option("--repeats", options->repeats,
                   "identical repetitions of every run, instead of those in the plan")
      ->check(CLI::Range(0, 20));
  command->add_option("--noise", options->noise, "of the sensors")
      ->check(CLI::IsMember({"on", "off"}))
      ->capture_default_str();
  command->add_option("--load-cell", options->load_cell, "its place, if not the file's")
      ->check(CLI::IsMember({"motor_side", "robot_side", "none"}));
  command->add_option("--tracker", options->tracker, "whether the tip is tracked")
      ->check(CLI::IsMember({"on", "off"}))
      ->capture_default_str();
  command->add_option("--truth", options->truth, "JSON file for the true effects; keep it out of the folder");
  command->add_option("--jobs", options->jobs, "runs at a time")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  command->callback([options] { RunSimulate(*options); });
}

}  // namespace tendril::tools
