// `tendril gap diagnose`: logs of a robot and its nominal file in; where the gap lies, what causes it and how
// far it shrinks out, on the terminal, as a page and as JSON. Half of it is options with their texts.
#include <fmt/format.h>
#include <unistd.h>

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "commands.h"
#include "effect_name.h"
#include "gap_options.h"
#include "number_option.h"
#include "output.h"
#include "progress.h"
#include "seed_option.h"
#include "shell.h"
#include "tendril/experiment/diagnosis_run.h"
#include "tendril/gap/diagnose.h"
#include "tendril/gap/health_lines.h"
#include "tendril/gap/report.h"

namespace tendril::tools {
namespace {

struct DiagnoseCommand {
  experiment::DiagnosedLogs logs;
  std::string out = "out/gap", daemon;
  double delta_mm = 0;
  bool next = true;
  std::vector<std::string> only;
  gap::DiagnoseOptions diagnose;
};

/// What to run now: the cause and the numbers learned into a robot file, the experiment that distinguishes
/// rivals.
std::vector<std::string> NextCommands(const gap::Diagnosis& d, const std::string& robot,
                                      const std::filesystem::path& folder) {
  std::vector<std::string> commands;
  const bool cause = d.verdict == gap::Verdict::kAttributed && !d.accepted.empty();
  const bool numbers = d.verdict == gap::Verdict::kNoGap && !d.learned.empty();
  if (cause || numbers) {
    commands.push_back(fmt::format("tendril gap apply --robot {} {} --out {}", ShellWord(robot),
                                   ShellWord((folder / "report.json").string()),
                                   ShellWord((folder / "better.yaml").string())));
  }
  if (!d.next.yaml.empty()) {
    commands.push_back(fmt::format("tendril excite --live --plan {} --robot {} --out {}",
                                   ShellWord((folder / "next.yaml").string()), ShellWord(robot),
                                   ShellWord((folder / "next").string())));
  }
  return commands;
}

void DiagnoseInto(const std::filesystem::path& folder, DiagnoseCommand options) {
  Progress progress;
  progress("reading the logs", 0);
  const gap::DataSet set = experiment::LoadDiagnosedLogs(options.logs);
  options.diagnose.progress = [&](const std::string& stage, double share) { progress(stage, share); };
  options.diagnose.delta_m = 1e-3 * options.delta_mm;
  // The diagnosis takes a while: what makes it doubtful is reported before it begins.
  const auto warn = [](const std::vector<gap::HealthFinding>& health) {
    for (const std::string& line : gap::ErrorLines(health)) fmt::print(stderr, "warning: {}\n", line);
  };
  gap::Diagnosis diagnosis = experiment::RunDiagnosis(
      set, {.options = options.diagnose, .next = options.next, .daemon = options.daemon, .checked = warn});
  diagnosis.command = CommandAsGiven("tendril");
  experiment::WriteNextPlan(diagnosis, folder / "next.yaml");
  diagnosis.next_commands = NextCommands(diagnosis, options.logs.robot, folder);
  gap::WriteReport(diagnosis, folder);
  progress.Finish();
  fmt::print("{}", gap::Summary(diagnosis, folder / "report.html", isatty(STDOUT_FILENO) != 0));
}

void Run(DiagnoseCommand options) {
  for (const auto& name : options.diagnose.without) ReadFor("--without", [&] { return &EffectNamed(name); });
  for (const auto& name : options.only) ReadFor("--only", [&] { return &EffectNamed(name); });
  options.diagnose.without = ReadFor(
      "--only, --without", [&] { return experiment::LeftOut(options.only, options.diagnose.without); });
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
  command->add_option("--robot", options->logs.robot, "nominal robot file, the one the controller used")
      ->required();
  AddLogOptions(*command, options->logs);
  command
      ->add_option("--before", options->logs.before,
                   "runs of the same commands from before the robot changed: the change is diagnosed, and "
                   "model errors common to both are subtracted; runs are paired by name, or by family if "
                   "there is only one of it; where neither torques nor tensions were recorded, the robot is "
                   "learned from these runs and commands may differ")
      ->allow_extra_args(false);
  command
      ->add_option("--out", options->out,
                   "folder for report.html, report.json and next.yaml, the next experiment")
      ->capture_default_str();
  const auto add_least = [command](const char* option, double& least, const char* meaning) {
    command->add_option(option, least, meaning)->check(Positive());
  };
  add_least(
      "--delta-N", options->diagnose.delta_N,
      "tension difference that does not matter in practice [N]; default from the noise floor and the signal");
  add_least(
      "--delta-mm", options->delta_mm,
      "tip distance that does not matter in practice [mm]; default from the noise floor and the signal");
  command
      ->add_option("--seed", options->diagnose.seed,
                   "of bootstraps and of alternative readings of the sensors")
      ->check(Seed())
      ->capture_default_str();
  const auto add_names = [command](const char* option, std::vector<std::string>& names, const char* meaning) {
    command->add_option(option, names, meaning)->delimiter(',')->allow_extra_args(false);
  };
  add_names("--only", options->only, "search for these effects only, by name, separated by commas");
  add_names("--without", options->diagnose.without,
            "effects to leave out of the library, by name, separated by commas");
  command->add_option("--refits", options->diagnose.refits, "candidates refitted in full after the screening")
      ->check(CLI::Range(1, 200))
      ->capture_default_str();
  AddThreadsOption(*command, options->diagnose.threads);
  command->add_option("--daemon", options->daemon,
                      "daemon file whose controller would run the next experiment (default: that of "
                      "tendrild.yaml, built in)");
  command->add_flag("!--no-next", options->next, "do not look for the next experiment");
  command->callback([options] { Run(*options); });
}

}  // namespace tendril::tools
