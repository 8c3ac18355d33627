// What the subcommands of `gap` have in common: options, and the file that a result may become. Knows the
// command line only.
#pragma once

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <string>

#include "tendril/core/usage_error.h"
#include "tendril/experiment/diagnosis_run.h"

namespace tendril::tools {

/// Runs, and whether those of another robot file are taken. Apart from --robot and --before, whose meanings
/// differ.
inline void AddLogOptions(CLI::App& command, experiment::DiagnosedLogs& logs) {
  command
      .add_option("logs", logs.logs,
                  "data-set folders (robot.yaml, runs.yaml, CSV), CSV files or LCM logs, in any mixture")
      ->required();
  command.add_flag("--same-robot", logs.same_robot,
                   "the runs are of the robot of --robot although their own robot file differs (a wrong "
                   "name, length, number of tendons or encoder counts in one of them)");
}

inline void AddThreadsOption(CLI::App& command, int& threads) {
  command.add_option("--threads", threads, "threads; 0: all cores")
      ->check(CLI::Range(0, 256))
      ->capture_default_str();
}

/// Throws UsageError where a new robot file would replace the one that it is made from (`instead` is the
/// remedy), or any other that may not go.
inline void CheckNewRobotFile(const std::string& out, const std::string& robot, bool overwrite,
                              const char* instead) {
  std::error_code none;
  if (std::filesystem::equivalent(out, robot, none))
    throw UsageError(fmt::format("--out is the robot file itself; {}", instead));
  if (!overwrite && std::filesystem::exists(out, none)) {
    throw UsageError(fmt::format("{} already exists; give another --out, or --overwrite to replace it", out));
  }
}

}  // namespace tendril::tools
