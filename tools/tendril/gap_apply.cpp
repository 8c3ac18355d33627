// `tendril gap apply`: writes what a diagnosis found into a new robot file. Knows nothing of how it was
// found.
#include <fmt/format.h>

#include <memory>

#include "commands.h"
#include "effect_name.h"
#include "gap_options.h"
#include "tendril/config/config.h"
#include "tendril/config/whole_file.h"
#include "tendril/core/version.h"
#include "tendril/gap/found_effects.h"
#include "tendril/gap/report.h"
#include "tendril/robot_file/robot_patch.h"
#include "tendril/sim/effects.h"

namespace tendril::tools {
namespace {

struct ApplyOptions {
  std::string robot, report, out;
  std::vector<std::string> effects;
  bool force = false, anyway = false, in_place = false, overwrite = false;
};

/// Why a report does not belong to this robot file; empty when it does. What it found counts from the file
/// that it was made with, and on any other, its own result included, would count twice or for nothing.
std::string Misfit(const gap::Diagnosis& d, const ApplyOptions& options, const RobotParameters& robot) {
  if (d.robot_yaml.empty())
    return fmt::format("{} does not contain the robot file it was made with", options.report);
  RobotParameters its;
  try {
    its = config::ParseRobot(d.robot_yaml, "robot_yaml of " + options.report);
  } catch (const std::exception& e) {
    return fmt::format("the robot file it was made with cannot be read: {}", e.what());
  }
  const auto difference = robot_file::FirstDifference(its, robot);
  if (!difference) return {};
  return fmt::format("{} was made with another robot file: {} is {} there and {} in {}", options.report,
                     difference->key, difference->left, difference->right, options.robot);
}

/// Where the result goes.
std::string Target(const ApplyOptions& options) {
  if (options.report.empty() && options.effects.empty()) {
    throw UsageError("nothing to apply: give the report.json of `tendril gap diagnose`, or --effect");
  }
  if (options.out.empty() == !options.in_place) {
    throw UsageError("give either --out FILE, or --in-place to change the robot file itself");
  }
  if (options.in_place) return options.robot;
  CheckNewRobotFile(options.out, options.robot, options.overwrite, "give another name, or --in-place");
  return options.out;
}

/// The report; throws unless it has something to apply to this robot.
gap::Diagnosis ReadFitting(const ApplyOptions& options, const RobotParameters& robot) {
  gap::Diagnosis d = gap::ReadReport(options.report);
  const bool numbers_alone = d.verdict == gap::Verdict::kNoGap && !d.learned.empty();
  if (d.verdict == gap::Verdict::kNoGap && !numbers_alone)
    throw std::runtime_error(options.report + ": the verdict is no_gap: there is nothing to apply");
  if (d.verdict != gap::Verdict::kAttributed && !numbers_alone && !options.force) {
    throw std::runtime_error(fmt::format(
        "{}: the verdict is {}, so no cause is established; run the next experiment that the report names "
        "and diagnose again, or give --force to apply the accepted causes nevertheless",
        options.report, gap::VerdictName(d.verdict)));
  }
  if (d.accepted.empty() && !numbers_alone)
    throw std::runtime_error(options.report + ": it accepted no cause: there is nothing to apply");
  if (const std::string misfit = Misfit(d, options, robot); !misfit.empty()) {
    if (!options.anyway) {
      throw std::runtime_error(
          misfit +
          "; name the file that was diagnosed, or diagnose this one; --anyway applies it nevertheless");
    }
    fmt::print(stderr, "warning: {}\n", misfit);
  }
  if (d.robot_name != robot.name) {
    fmt::print(stderr, "note: the report is about robot '{}', {} is '{}'\n", d.robot_name, options.robot,
               robot.name);
  }
  return d;
}

void RunApply(const ApplyOptions& options) {
  const std::string out = Target(options);
  const RobotParameters robot = sim::LoadRobot(options.robot);
  std::string text = config::ReadWhole(options.robot);
  // A byte order mark belongs to no line.
  const std::string mark = text.starts_with("\xEF\xBB\xBF") ? text.substr(0, 3) : "";
  text.erase(0, mark.size());

  std::vector<EffectSetting> effects;
  std::vector<std::string> heading;
  std::string with_numbers = text;
  if (!options.report.empty()) {
    const gap::Diagnosis d = ReadFitting(options, robot);
    effects = gap::FoundEffects(d);
    heading = gap::Provenance(d, options.report);
    if (!d.learned.empty()) {
      with_numbers =
          robot_file::PatchNumbers(text, options.robot, gap::WithLearnedNumbers(robot, d), {}).text;
      fmt::print("{} numbers fitted to the runs\n", d.learned.size());
    }
  }
  for (const std::string& given : options.effects) {
    effects.push_back(ReadFor("--effect", [&] {
      CheckEffectNamed(given);
      return sim::ParseEffect(given, robot);
    }));
    heading.push_back(fmt::format("{} by `tendril gap apply` ({}): {}",
                                  heading.empty() ? "Patched" : "and by hand,", Version(), given));
  }
  const robot_file::RobotPatch patch = robot_file::PatchRobot(with_numbers, options.robot, effects, heading);
  fmt::print("{}", robot_file::DiffLines(text, patch.text));

  config::WriteWhole(out, mark + patch.text);
  std::size_t laws = 0;
  for (const EffectSetting& e : effects) laws += sim::FindEffect(e.name)->edit == nullptr;
  fmt::print(
      "{}: {} applied to its numbers (used by the controller), {} added as laws (used by the simulator "
      "only)\n",
      out, effects.size() - laws, laws);
}

}  // namespace

void AddGapApplyCommand(CLI::App& app) {
  auto options = std::make_shared<ApplyOptions>();
  CLI::App* command =
      GapCommand(app).add_subcommand("apply", "Write what a diagnosis found into a new robot file");
  command->add_option("--robot", options->robot, "the robot file that was diagnosed")->required();
  command->add_option("report", options->report, "report.json of `tendril gap diagnose`");
  command
      ->add_option("--effect", options->effects,
                   "a further effect by hand, e.g. \"bending_stiffness scale=0.9\"")
      ->allow_extra_args(false);
  command->add_option("--out", options->out, "the new robot file");
  command->add_flag("--overwrite", options->overwrite, "replace the file of --out");
  command->add_flag("--force", options->force, "even if the verdict is not 'attributed'");
  command->add_flag("--anyway", options->anyway, "even if the report was made with another robot file");
  command->add_flag("--in-place", options->in_place, "change the robot file itself");
  command->callback([options] { RunApply(*options); });
}

}  // namespace tendril::tools
