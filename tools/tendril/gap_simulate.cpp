// `tendril gap simulate`: data sets from the simulator with given effects, noise and experiments. Knows
// nothing of how they are diagnosed.
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <numeric>
#include <optional>

#include "commands.h"
#include "counted.h"
#include "effect_name.h"
#include "progress.h"
#include "seed_option.h"
#include "set_progress.h"
#include "tendril/experiment/experiment_run.h"
#include "tendril/experiment/set_output.h"
#include "tendril/experiment/sized_effect.h"
#include "tendril/gap/data_set.h"
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

std::atomic<bool> stop = false;

/// Amounts of the effects that are given by their size, each by itself on the nominal robot.
std::vector<std::optional<experiment::SizedEffect>> FindAmounts(
    const experiment::Plan& plan, experiment::ExperimentOptions experiment,
    const std::vector<std::optional<experiment::RequestedSize>>& requested) {
  std::vector<std::optional<experiment::SizedEffect>> sized(requested.size());
  if (std::none_of(requested.begin(), requested.end(), [](const auto& w) { return w.has_value(); }))
    return sized;
  Progress progress;
  experiment.plant_robot = experiment.controller_robot;
  experiment.sensor_noise = true;  // a floor is what noise makes it, whether or not the data get any
  std::vector<double> shares(experiment::NameRuns(plan).size(), 0.0);
  const experiment::ExperimentSet nominal = experiment::RunSet(
      plan, experiment, &stop, [&](std::size_t run, double share, const experiment::Experiment*) {
        shares[run] = share;
        progress("running the plan without the effects, for their sizes",
                 std::accumulate(shares.begin(), shares.end(), 0.0) / static_cast<double>(shares.size()));
      });
  if (!nominal.trouble.empty())
    throw std::runtime_error("sizes cannot be found, the runs without effects are not complete: " +
                             nominal.trouble);
  const gap::EffectRuler ruler(nominal.data, experiment.threads);
  for (std::size_t i = 0; i < requested.size(); ++i) {
    if (!requested[i]) continue;
    progress("finding the amounts for the requested sizes",
             static_cast<double>(i) / static_cast<double>(requested.size()));
    sized[i] = experiment::AmountFor(*requested[i], [&](const EffectSetting& setting) {
      if (stop) throw std::runtime_error("stopped");
      return ruler.Of(setting);
    });
  }
  progress.Finish();
  if (stop) throw std::runtime_error("stopped while looking for the amounts; nothing is written");
  for (const auto& effect : sized) {
    if (!effect) continue;
    const EffectSetting& e = effect->setting;
    fmt::print("{} where={}", e.name, e.where);
    for (const auto& [name, value] : e.values) fmt::print(" {}={}", name, value);
    fmt::print(": {:.3g} sigma in {}{}\n", effect->size.floors, effect->size.channel,
               effect->limited.empty() ? "" : "; " + effect->limited);
  }
  return sized;
}

void WriteTruth(const SimulateOptions& options, const std::vector<EffectSetting>& effects,
                const std::vector<std::optional<experiment::RequestedSize>>& requested,
                const std::vector<std::optional<experiment::SizedEffect>>& sized) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  // What the robot's own file has comes first; the options' follow.
  const std::size_t own = effects.size() - requested.size();
  for (std::size_t i = 0; i < effects.size(); ++i) {
    nlohmann::ordered_json entry{{"effect", effects[i].name}, {"where", effects[i].where}};
    entry["parameters"] = nlohmann::ordered_json::object();
    for (const auto& [name, value] : effects[i].values) entry["parameters"][name] = value;
    if (i >= own && sized[i - own]) {
      entry["sigma"] = {{"asked", std::abs(requested[i - own]->sigma)},
                        {"reached", sized[i - own]->size.floors},
                        {"channel", sized[i - own]->size.channel},
                        {"limited", sized[i - own]->limited}};
    }
    list.push_back(entry);
  }
  std::ofstream truth(options.truth);
  truth << nlohmann::ordered_json{{"robot", options.robot}, {"seed", options.seed}, {"effects", list}}.dump(2)
        << "\n";
  if (!truth.flush()) throw std::runtime_error("cannot write " + options.truth);
}

void RunSimulate(const SimulateOptions& options) {
  RobotParameters nominal = sim::LoadRobot(options.robot);
  if (!nominal.actuation) {
    throw std::runtime_error(
        options.robot + " has no actuation (motors, drives, tendons); use a rig file such as rig_90mm.yaml");
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
  std::vector<std::optional<experiment::RequestedSize>> requested;
  try {
    for (const std::string& text : options.effects) {
      CheckEffectNamed(text);
      requested.push_back(experiment::ParseRequestedSize(text, nominal));
      plant.effects.push_back(requested.back() ? requested.back()->setting : sim::ParseEffect(text, nominal));
    }
    sim::CheckEffects(plant);
  } catch (const std::invalid_argument& e) {
    throw UsageError(std::string("--effect: ") + e.what());
  } catch (const UsageError& e) {
    throw UsageError(std::string("--effect: ") + e.what());
  }

  experiment::Plan plan =
      options.plan.empty() ? experiment::NamedPlan(options.set) : experiment::LoadPlan(options.plan);
  if (options.repeats >= 0) {
    for (experiment::PlannedRun& run : plan.runs) run.repeats = options.repeats;
  }
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
  const std::vector<std::optional<experiment::SizedEffect>> sized = FindAmounts(plan, experiment, requested);
  auto& planted = experiment.plant_robot.effects;
  for (std::size_t i = 0; i < sized.size(); ++i) {
    if (sized[i]) planted[planted.size() - sized.size() + i] = sized[i]->setting;
  }

  SetProgressLine line(experiment::NameRuns(plan));
  experiment::ExperimentSet set = experiment::RunSet(
      plan, experiment, &stop, [&](std::size_t run, double share, const experiment::Experiment* done) {
        line.Show(run, share, done);
      });
  const std::filesystem::path out = experiment::WriteSet(set, folder, false);
  if (!options.truth.empty()) WriteTruth(options, planted, requested, sized);
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
  command->callback([options] {
    std::signal(SIGINT, [](int) { stop = true; });
    std::signal(SIGTERM, [](int) { stop = true; });
    RunSimulate(*options);
  });
}

}  // namespace tendril::tools
