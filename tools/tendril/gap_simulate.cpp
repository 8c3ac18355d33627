// `tendril gap simulate`: data sets from the simulator with given effects, noise and experiments. Knows
// nothing of how they are diagnosed.
#include <fmt/format.h>
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>

#include "commands.h"
#include "experiment_run.h"
#include "output.h"
#include "paths.h"
#include "set_progress.h"
#include "tendril/config/config.h"
#include "tendril/gap/data_set.h"
#include "tendril/sim/effects.h"

namespace tendril::tools {
namespace {

struct SimulateOptions {
  std::string robot, set = "standard", plan, out, truth, noise = "on", load_cell, tracker = "on";
  std::vector<std::string> effects;
  std::uint64_t seed = 1;
  int repeats = -1, jobs = 2;
};

std::atomic<bool> stop = false;

void RunSimulate(const SimulateOptions& options) {
  RobotParameters nominal = sim::LoadRobot(options.robot);
  if (!nominal.actuation) {
    throw UsageError(options.robot +
                     " has no actuation (motors, drives, tendons); use a rig file such as rig_90mm.yaml");
  }
  if (!options.load_cell.empty()) {
    const LoadCellPlace place = options.load_cell == "motor_side"   ? LoadCellPlace::kMotorSide
                                : options.load_cell == "robot_side" ? LoadCellPlace::kRobotSide
                                                                    : LoadCellPlace::kNone;
    for (auto& tendon : nominal.actuation->tendons) {
      if (place != LoadCellPlace::kNone && !(tendon.load_cell.gain_VpN > 0)) {
        throw UsageError(options.robot + " has no load cell whose place could be changed");
      }
      tendon.load_cell.place = place;
    }
  }
  if (options.tracker == "off") nominal.actuation->tracker.reset();

  RobotParameters plant = nominal;
  try {
    for (const std::string& text : options.effects) plant.effects.push_back(sim::ParseEffect(text, nominal));
    sim::CheckEffects(plant);
  } catch (const std::invalid_argument& e) {
    throw UsageError(std::string("--effect: ") + e.what());
  }

  Plan plan = options.plan.empty() ? NamedPlan(options.set) : LoadPlan(options.plan);
  if (options.repeats >= 0) {
    for (PlannedRun& run : plan.runs) run.repeats = options.repeats;
  }
  ExperimentOptions experiment{.controller_robot = nominal,
                               .plant_robot = plant,
                               .daemon = ForExperiments(config::LoadDaemon(ConfigFile("tendrild.yaml"))),
                               .seed = options.seed,
                               .sensor_noise = options.noise == "on",
                               .threads = options.jobs};
  const std::filesystem::path out = MakeSetFolder(MakeOutputFolder(options.out));

  SetProgressLine line(NameRuns(plan));
  ExperimentSet set =
      RunSet(plan, experiment, &stop,
             [&](std::size_t run, double share, const Experiment* done) { line.Show(run, share, done); });
  if (set.data.runs.empty()) throw std::runtime_error("nothing was recorded: " + set.trouble);
  gap::WriteDataSet(set.data, out);
  if (!options.truth.empty()) {
    std::ofstream truth(options.truth);
    truth << "seed: " << options.seed << "\neffects:";
    for (const EffectSetting& e : plant.effects) {
      truth << "\n  - {name: " << e.name << ", where: \"" << e.where << "\"";
      for (const auto& [name, value] : e.values) truth << fmt::format(", {}: {}", name, value);
      truth << "}";
    }
    truth << (plant.effects.empty() ? " []\n" : "\n");
    if (!truth.flush()) throw std::runtime_error("cannot write " + options.truth);
  }
  fmt::print("{} runs, {:.1f} s of data in {:.1f} s ({:.1f} x real time): {}\n", set.data.runs.size(),
             set.simulated_s, set.wall_s, set.simulated_s / set.wall_s,
             std::filesystem::absolute(out).lexically_normal().string());
  if (!set.trouble.empty()) throw std::runtime_error("the set is not complete: " + set.trouble);
}

}  // namespace

void AddGapSimulateCommand(CLI::App& app) {
  auto options = std::make_shared<SimulateOptions>();
  CLI::App* command = GapCommand(app).add_subcommand(
      "simulate",
      "A data set from the simulated robot with given effects, the controller knowing the nominal one");
  command->add_option("--robot", options->robot, "nominal robot file (a rig)")->required();
  command
      ->add_option("--effect", options->effects,
                   "what the plant has beyond it, e.g. \"backlash where=tendon:2 rad=0.05\"; may be repeated")
      ->allow_extra_args(false);
  auto* set = command->add_option("--set", options->set, "experiments")
                  ->check(CLI::IsMember({"standard", "quick"}))
                  ->capture_default_str();
  command->add_option("--plan", options->plan, "experiments from a plan file")->excludes(set);
  command->add_option("--out", options->out, "folder for robot.yaml, runs.yaml and a CSV a run")->required();
  command->add_option("--seed", options->seed, "of the sensors' noise")->capture_default_str();
  command
      ->add_option("--repeats", options->repeats, "identical repetitions of every run instead of the plan's")
      ->check(CLI::Range(0, 20));
  command->add_option("--noise", options->noise, "of the sensors")
      ->check(CLI::IsMember({"on", "off"}))
      ->capture_default_str();
  command->add_option("--load-cell", options->load_cell, "its place, if not the file's")
      ->check(CLI::IsMember({"motor_side", "robot_side", "none"}));
  command->add_option("--tracker", options->tracker, "whether the tip is tracked")
      ->check(CLI::IsMember({"on", "off"}))
      ->capture_default_str();
  command->add_option("--truth", options->truth,
                      "file that says which effects there were; keep it out of the folder");
  command->add_option("--jobs", options->jobs, "runs at a time")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  command->callback([options] {
    std::signal(SIGINT, [](int) { stop = true; });
    std::signal(SIGTERM, [](int) { stop = true; });
    RunSimulate(*options);
  });
}

}  // namespace tendril::tools
