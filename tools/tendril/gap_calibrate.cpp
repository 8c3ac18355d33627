// `tendril gap calibrate`: runs of a robot as it is in, a robot file with the numbers that explain them out.
// Arguments and the way to the files.
#include <fmt/format.h>

#include <memory>
#include <string>

#include "commands.h"
#include "gap_options.h"
#include "progress.h"
#include "seed_option.h"
#include "tendril/config/whole_file.h"
#include "tendril/gap/calibrate.h"
#include "tendril/gap/calibration_text.h"
#include "tendril/robot_file/robot_patch.h"

namespace tendril::tools {
namespace {

struct CalibrateCommand {
  experiment::DiagnosedLogs logs;
  std::string out, json;
  bool overwrite = false;
  gap::CalibrateOptions calibrate;
};

void Run(CalibrateCommand options) {
  CheckNewRobotFile(options.out, options.logs.robot, options.overwrite, "give another name");
  Progress progress;
  progress("reading the logs", 0);
  const gap::DataSet set = experiment::LoadDiagnosedLogs(options.logs);
  const std::string text = config::ReadWhole(options.logs.robot);
  options.calibrate.progress = [&](const std::string& stage, double share) { progress(stage, share); };
  const gap::Calibration found = gap::Calibrate(set, options.calibrate);
  progress.Finish();
  fmt::print("{}", gap::CalibrationText(found));
  if (!options.json.empty()) config::WriteWhole(options.json, gap::CalibrationJson(found));
  const robot_file::RobotPatch patch =
      robot_file::PatchNumbers(text, options.logs.robot, found.robot, gap::CalibrationHeading(found));
  config::WriteWhole(options.out, patch.text);
  fmt::print("\nWritten: {}\n", options.out);
}

}  // namespace

void AddGapCalibrateCommand(CLI::App& app) {
  auto options = std::make_shared<CalibrateCommand>();
  CLI::App* command = GapCommand(app).add_subcommand(
      "calibrate", "Infer the numbers of a robot file from runs of the robot as it is");
  command->add_option("--robot", options->logs.robot, "robot file, with what is known of its numbers")
      ->required();
  AddLogOptions(*command, options->logs);
  command->add_option("--out", options->out, "the new robot file")->required();
  command->add_option("--json", options->json, "the same as the printed table, for programs");
  command->add_flag("--overwrite", options->overwrite, "replace the file of --out");
  command->add_option("--seed", options->calibrate.seed, "of alternative readings of the sensors")
      ->check(Seed())
      ->capture_default_str();
  AddThreadsOption(*command, options->calibrate.threads);
  command->callback([options] { Run(*options); });
}

}  // namespace tendril::tools
