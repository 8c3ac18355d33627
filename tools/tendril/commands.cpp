// tendril's command line as a whole. Knows the commands by their names only.
#include "commands.h"

#include <fmt/core.h>

#include "tendril/config/command_line.h"
#include "tendril/core/version.h"

namespace tendril::tools {

std::unique_ptr<CLI::App> MakeApp() {
  auto app = std::make_unique<CLI::App>("Tendril: run, simulate and compute tendon-driven continuum robots",
                                        "tendril");
  app->set_version_flag("--version", fmt::format("tendril {} ({})", Version(), GitRevision()));
  app->require_subcommand(1);
  AddCapstanCommand(*app);
  AddCommissionCommand(*app);
  AddCompareCommand(*app);
  AddConfigCommand(*app);
  AddDemoCommand(*app);
  AddExciteCommand(*app);
  AddFaultCommand(*app);
  AddFollowCommand(*app);
  AddGapAcceptCommand(*app);
  AddGapApplyCommand(*app);
  AddGapCalibrateCommand(*app);
  AddGapDiagnoseCommand(*app);
  AddGapExplainCommand(*app);
  AddGapHistoryCommand(*app);
  AddGapImportCommand(*app);
  AddGapReportCommand(*app);
  AddGapSimulateCommand(*app);
  AddGapWatchCommand(*app);
  AddHomeCommand(*app);
  AddInitCommand(*app);
  AddLogCutCommand(*app);
  AddLogExportCommand(*app);
  AddLogInfoCommand(*app);
  AddLogServeCommand(*app);
  AddModelCommand(*app);
  AddReplayCommand(*app);
  AddReproduceCommand(*app);
  AddRtCheckCommand(*app);
  AddSendCommand(*app);
  AddSimCommand(*app);
  AddStatusCommand(*app);
  AddViewCommand(*app);
  config::SettleCommandLine(*app);
  return app;
}

}  // namespace tendril::tools
