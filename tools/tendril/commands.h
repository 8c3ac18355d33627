// One function a subcommand: adds itself to the app. A command's work throws std::exception with one clear
// line (exit 1); UsageError means wrong use (exit 2).
#pragma once

#include <CLI/CLI.hpp>
#include <memory>

#include "tendril/core/usage_error.h"

namespace tendril::tools {

/// The program's whole command line, ready to be parsed.
std::unique_ptr<CLI::App> MakeApp();

/// `tendril gap`, whose subcommands add themselves to it.
inline CLI::App& GapCommand(CLI::App& app) {
  const auto there = app.get_subcommands([](const CLI::App* sub) { return sub->get_name() == "gap"; });
  if (!there.empty()) return *there.front();
  CLI::App* gap =
      app.add_subcommand("gap", "The sim-to-real gap: where it lies, what causes it, how far it shrinks");
  gap->require_subcommand(1);
  return *gap;
}

/// `tendril log`, as GapCommand.
inline CLI::App& LogCommand(CLI::App& app) {
  const auto there = app.get_subcommands([](const CLI::App* sub) { return sub->get_name() == "log"; });
  if (!there.empty()) return *there.front();
  CLI::App* log =
      app.add_subcommand("log", "Logs for other programs, what they hold, a part of one, a live bridge");
  log->require_subcommand(1);
  return *log;
}

void AddCapstanCommand(CLI::App& app);
void AddCommissionCommand(CLI::App& app);
void AddCompareCommand(CLI::App& app);
void AddConfigCommand(CLI::App& app);
void AddDemoCommand(CLI::App& app);
void AddExciteCommand(CLI::App& app);
void AddFaultCommand(CLI::App& app);
void AddFollowCommand(CLI::App& app);
void AddGapAcceptCommand(CLI::App& app);
void AddGapApplyCommand(CLI::App& app);
void AddGapCalibrateCommand(CLI::App& app);
void AddGapDiagnoseCommand(CLI::App& app);
void AddGapExplainCommand(CLI::App& app);
void AddGapHistoryCommand(CLI::App& app);
void AddGapImportCommand(CLI::App& app);
void AddGapReportCommand(CLI::App& app);
void AddGapSimulateCommand(CLI::App& app);
void AddGapWatchCommand(CLI::App& app);
void AddHomeCommand(CLI::App& app);
void AddInitCommand(CLI::App& app);
void AddLogCutCommand(CLI::App& app);
void AddLogExportCommand(CLI::App& app);
void AddLogInfoCommand(CLI::App& app);
void AddLogServeCommand(CLI::App& app);
void AddModelCommand(CLI::App& app);
void AddReplayCommand(CLI::App& app);
void AddReproduceCommand(CLI::App& app);
void AddRtCheckCommand(CLI::App& app);
void AddSendCommand(CLI::App& app);
void AddSimCommand(CLI::App& app);
void AddStatusCommand(CLI::App& app);
void AddViewCommand(CLI::App& app);

}  // namespace tendril::tools
