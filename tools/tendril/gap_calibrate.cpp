// `tendril gap calibrate`: runs of a robot as it is in, a robot file with the numbers that explain them out.
// Arguments and the way to the files.
#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "commands.h"
#include "progress.h"
#include "seed_option.h"
#include "tendril/config/whole_file.h"
#include "tendril/gap/calibrate.h"
#include "tendril/gap/calibration_text.h"
#include "tendril/gap/set_folder.h"
#include "tendril/robot_file/robot_patch.h"

namespace tendril::tools {
namespace {

namespace fs = std::filesystem;

struct CalibrateCommand {
  std::string robot, out, json;
  std::vector<std::string> logs;
  bool overwrite = false, same_robot = false;
  gap::CalibrateOptions calibrate;
};

void Run(CalibrateCommand options) {
  std::error_code none;
  if (fs::equivalent(options.out, options.robot, none))
    throw UsageError("--out is the robot file itself; give another name");
  if (!options.overwrite && fs::exists(options.out, none)) {
    throw UsageError(
        fmt::format("{} already exists; give another --out, or --overwrite to replace it", options.out));
  }
  Progress progress;
  progress("reading the logs", 0);
  const gap::DataSet set = gap::LoadLogs(
      options.logs, options.robot, options.same_robot ? gap::OtherRobot::kNoted : gap::OtherRobot::kRefused);
  const std::string text = config::ReadWhole(options.robot);
  options.calibrate.progress = [&](const std::string& stage, double share) { progress(stage, share); };
  const gap::Calibration found = gap::Calibrate(set, options.calibrate);
  progress.Finish();
  fmt::print("{}", gap::CalibrationText(found));
  const robot_file::RobotPatch patch =
      robot_file::PatchNumbers(text, options.robot, found.robot, gap::CalibrationHeading(found));
  config::WriteWhole(options.out, patch.text);
  if (!options.json.empty()) config::WriteWhole(options.json, gap::CalibrationJson(found));
  fmt::print("\nWritten: {}\n", options.out);
}

}  // namespace

void AddGapCalibrateCommand(CLI::App& app) {
  auto options = std::make_shared<CalibrateCommand>();
  CLI::App* command = GapCommand(app).add_subcommand(
      "calibrate", "Infer the numbers of a robot file from runs of the robot as it is");
  command->add_option("--robot", options->robot, "robot file, with what is known of its numbers")->required();
  command
      ->add_option("logs", options->logs,
                   "data-set folders (robot.yaml, runs.yaml, CSV), CSV files or LCM logs, in any mixture")
      ->required();
  command->add_option("--out", options->out, "the new robot file")->required();
  command->add_option("--json", options->json, "the same as the printed table, for programs");
  command->add_flag("--overwrite", options->overwrite, "replace the file of --out");
  command->add_option("--seed", options->calibrate.seed, "of alternative readings of the sensors")
      ->check(Seed())
      ->capture_default_str();
  command->add_option("--threads", options->calibrate.threads, "threads; 0: all cores")
      ->check(CLI::Range(0, 256))
      ->capture_default_str();
  command->add_flag("--same-robot", options->same_robot,
                    "the runs are of the robot of --robot although their own robot file differs (a wrong "
                    "name, length, number of tendons or encoder counts in one of them)");
  command->callback([options] { Run(*options); });
}

}  // namespace tendril::tools
