// `tendril gap diagnose`: logs of a robot and its nominal file in; where the gap lies, what causes it and how
// far it shrinks out, on the terminal, as a page and as JSON.
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "commands.h"
#include "effect_name.h"
#include "output.h"
#include "progress.h"
#include "seed_option.h"
#include "tendril/config/whole_file.h"
#include "tendril/experiment/experiment_run.h"
#include "tendril/gap/diagnose.h"
#include "tendril/gap/health.h"
#include "tendril/gap/report.h"
#include "tendril/sim/effects.h"

namespace tendril::tools {
namespace {

struct DiagnoseCommand {
  std::string robot;
  std::vector<std::string> logs, before;
  std::string out = "out/gap", daemon;
  double delta_mm = 0;
  bool next = true, same_robot = false;
  std::vector<std::string> only;
  gap::DiagnoseOptions diagnose;
};

/// Runs that `tendril excite` knows, simulated in process: what the diagnosis compares rivals on.
gap::ExperimentMenu Menu(const RobotParameters& nominal, const std::string& daemon_file, std::uint64_t seed) {
  gap::ExperimentMenu menu;
  const DaemonParameters daemon = experiment::DaemonOfExperiments(daemon_file);
  for (const std::string_view family : experiment::Families()) menu.families.emplace_back(family);
  menu.simulate = [nominal, daemon, seed](const std::string& family, const RobotParameters& plant) {
    const experiment::ExperimentOptions options{
        .controller_robot = nominal, .plant_robot = plant, .daemon = daemon, .seed = seed};
    experiment::PlannedRun planned = experiment::UsualRun(family);
    const experiment::Program program = experiment::MakeProgram(planned, nominal, daemon.controller);
    experiment::Experiment experiment =
        experiment::RunExperiment(program, family, options, seed, nullptr, {});
    if (!experiment.trouble.empty()) throw std::runtime_error(experiment.trouble);
    return experiment.run;
  };
  menu.plan = [](const std::string& family) {
    experiment::Plan plan;
    plan.name = "next";
    plan.runs.push_back(experiment::UsualRun(family));
    plan.runs.back().repeats = 1;
    return ToYaml(plan);
  };
  return menu;
}

/// What makes the rest of the work doubtful is told before it begins, for it takes a while: one line a
/// channel.
void Warn(const std::vector<gap::HealthFinding>& health) {
  std::vector<const gap::HealthFinding*> first;
  std::map<std::string, int> runs;
  for (const gap::HealthFinding& finding : health) {
    if (finding.severity != gap::HealthFinding::Severity::kError) continue;
    if (runs[finding.channel]++ == 0) first.push_back(&finding);
  }
  for (const gap::HealthFinding* finding : first) {
    const int others = runs[finding->channel] - 1;
    fmt::print(stderr, "warning: {}{}: {} {}\n", finding->run,
               others > 0 ? fmt::format(" and {} more", others) : "", finding->channel, finding->text);
  }
}

/// A word as a shell takes it for one.
std::string Quoted(const std::string& word) {
  const bool plain = !word.empty() && std::all_of(word.begin(), word.end(), [](unsigned char c) {
    return std::isalnum(c) ||
           std::string_view("_@%+=:,./-").find(static_cast<char>(c)) != std::string_view::npos;
  });
  if (plain) return word;
  std::string quoted = "'";
  for (const char c : word) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

/// The whole command as it was given, to be pasted into a shell.
std::string CommandLine() {
  std::ifstream in("/proc/self/cmdline", std::ios::binary);
  std::string line = "tendril", word;
  std::getline(in, word, '\0');  // the program, wherever it is
  while (std::getline(in, word, '\0')) line += " " + Quoted(word);
  return line;
}

/// What to run now: the cause into a robot file, the experiment on the robot that tells rivals apart. `plan`
/// is where the experiment lies.
std::vector<std::string> NextCommands(const gap::Diagnosis& d, const std::string& robot,
                                      const std::filesystem::path& folder,
                                      const std::filesystem::path& plan) {
  std::vector<std::string> commands;
  if (d.verdict == gap::Verdict::kAttributed && !d.accepted.empty()) {
    commands.push_back(fmt::format("tendril gap apply --robot {} {} --out {}", Quoted(robot),
                                   Quoted((folder / "report.json").string()),
                                   Quoted((folder / "better.yaml").string())));
  }
  if (!d.next.yaml.empty()) {
    commands.push_back(fmt::format("tendril excite --live --plan {} --robot {} --out {}",
                                   Quoted(plan.string()), Quoted(robot), Quoted((folder / "next").string())));
  }
  return commands;
}

/// For differences that matter: CLI11's own check would print the largest number there is in full.
CLI::Validator Positive() {
  return CLI::Validator(
      [](std::string& text) -> std::string {
        double value = 0;
        const bool good = CLI::detail::lexical_cast(text, value) && std::isfinite(value) && value > 0;
        return good ? "" : "'" + text + "' is out of range; accepted: a number above 0, such as 0.5";
      },
      "NUMBER > 0");
}

void DiagnoseInto(const std::filesystem::path& folder, DiagnoseCommand options) {
  Progress progress;
  progress("reading the logs", 0);
  const auto other = options.same_robot ? gap::OtherRobot::kNoted : gap::OtherRobot::kRefused;
  gap::DataSet set = gap::LoadLogs(options.logs, options.robot, other);
  if (!options.before.empty())
    gap::CompareWithBefore(set, gap::LoadLogs(options.before, options.robot, other));
  options.diagnose.progress = [&](const std::string& stage, double share) { progress(stage, share); };
  options.diagnose.delta_m = 1e-3 * options.delta_mm;
  if (options.next && set.robot.actuation)
    options.diagnose.menu = Menu(set.robot, options.daemon, options.diagnose.seed);
  progress("checking the data", 0);
  std::vector<gap::HealthFinding> health = gap::CheckHealth(set);
  Warn(health);
  const auto begin = std::chrono::steady_clock::now();
  gap::Diagnosis diagnosis = gap::Diagnose(set, options.diagnose);
  diagnosis.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  diagnosis.health = std::move(health);
  diagnosis.command = CommandLine();
  const std::filesystem::path plan = folder / "next.yaml";
  std::error_code none;  // of an earlier report
  std::filesystem::remove(plan, none);
  if (!diagnosis.next.yaml.empty()) config::WriteWhole(plan, diagnosis.next.yaml);
  diagnosis.next_commands = NextCommands(diagnosis, options.robot, folder, plan);
  gap::WriteReport(diagnosis, folder);
  progress.Finish();
  fmt::print("{}", gap::Summary(diagnosis, folder / "report.html", isatty(STDOUT_FILENO) != 0));
}

void Run(DiagnoseCommand options) {
  const auto check = [](const char* option, const std::vector<std::string>& names) {
    for (const std::string& name : names) {
      try {
        EffectNamed(name);
      } catch (const UsageError& e) {
        throw UsageError(fmt::format("{}: {}", option, e.what()));
      }
    }
  };
  check("--without", options.diagnose.without);
  check("--only", options.only);
  for (const sim::Effect& effect : sim::Effects()) {
    const bool named = std::find(options.only.begin(), options.only.end(), effect.name) != options.only.end();
    if (!options.only.empty() && !named) options.diagnose.without.emplace_back(effect.name);
  }
  const std::set<std::string> without(options.diagnose.without.begin(), options.diagnose.without.end());
  if (without.size() == sim::Effects().size())
    throw UsageError("--only, --without: no effect is left to search for; accepted: at least one");
  const bool there = std::filesystem::exists(options.out);
  const std::filesystem::path folder = MakeOutputFolder(options.out);
  try {
    DiagnoseInto(folder, std::move(options));
  } catch (...) {
    std::error_code ignored;  // of what holds something as well
    if (!there) std::filesystem::remove(folder, ignored);
    throw;
  }
}

}  // namespace

void AddGapDiagnoseCommand(CLI::App& app) {
  auto options = std::make_shared<DiagnoseCommand>();
  CLI::App* command = GapCommand(app).add_subcommand(
      "diagnose",
      "Find where the gap lies, which effect causes it, and how far it shrinks with the effect in the model");
  command->add_option("--robot", options->robot, "nominal robot file, the one the controller used")
      ->required();
  command
      ->add_option("logs", options->logs,
                   "data-set folders (robot.yaml, runs.yaml, CSV), CSV files or LCM logs, in any mixture")
      ->required();
  command
      ->add_option("--before", options->before,
                   "runs of the same commands from before the robot changed: the change is diagnosed, and "
                   "model errors common to both are subtracted; runs are paired by name, or by family if "
                   "there is only one of it")
      ->allow_extra_args(false);
  command
      ->add_option("--out", options->out,
                   "folder for report.html, report.json and next.yaml, the next experiment")
      ->capture_default_str();
  command
      ->add_option("--delta-N", options->diagnose.delta_N,
                   "tension difference that does not matter in practice [N]; default from the noise floor "
                   "and the signal")
      ->check(Positive());
  command
      ->add_option(
          "--delta-mm", options->delta_mm,
          "tip distance that does not matter in practice [mm]; default from the noise floor and the signal")
      ->check(Positive());
  command
      ->add_option("--seed", options->diagnose.seed,
                   "of bootstraps and of alternative readings of the sensors")
      ->check(Seed())
      ->capture_default_str();
  command->add_option("--only", options->only, "search for these effects only, by name, separated by commas")
      ->delimiter(',')
      ->allow_extra_args(false);
  command
      ->add_option("--without", options->diagnose.without,
                   "effects to leave out of the library, by name, separated by commas")
      ->delimiter(',')
      ->allow_extra_args(false);
  command->add_option("--refits", options->diagnose.refits, "candidates refitted in full after the screening")
      ->check(CLI::Range(1, 200))
      ->capture_default_str();
  command->add_option("--threads", options->diagnose.threads, "threads; 0: all cores")
      ->check(CLI::Range(0, 256))
      ->capture_default_str();
  command->add_option("--daemon", options->daemon,
                      "daemon file whose controller would run the next experiment (default: that of "
                      "tendrild.yaml, built in)");
  command->add_flag("--same-robot", options->same_robot,
                    "the runs are of the robot of --robot although their own robot file differs (a wrong "
                    "name, length, number of tendons or encoder counts in one of them)");
  command->add_flag("!--no-next", options->next, "do not look for the next experiment");
  command->callback([options] { Run(*options); });
}

}  // namespace tendril::tools
