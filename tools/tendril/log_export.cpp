// `tendril log export`: a log as MCAP, CSV or Parquet, by the Python package. Knows nothing of these formats.
#include <memory>
#include <string>
#include <vector>

#include "commands.h"
#include "python_program.h"

namespace tendril::tools {
namespace {

struct LogExport {
  std::string log, mcap, csv, parquet, robot;
  bool overwrite = false;
};

void ExportLog(const LogExport& o) {
  std::vector<std::string> words, modules;
  const auto add = [&](const char* option, const std::string& value, const std::vector<std::string>& needs) {
    if (value.empty()) return;
    words.insert(words.end(), {option, value});
    modules.insert(modules.end(), needs.begin(), needs.end());
  };
  add("--mcap", o.mcap, {"mcap", "foxglove_schemas_protobuf"});
  add("--csv", o.csv, {"pyarrow"});
  add("--parquet", o.parquet, {"pyarrow"});
  if (words.empty()) {
    throw UsageError(
        "log export: no destination; give --mcap FILE, --csv FOLDER, --parquet FOLDER or several");
  }
  if (!o.robot.empty()) words.insert(words.end(), {"--robot", o.robot});
  if (o.overwrite) words.emplace_back("--overwrite");
  words.insert(words.end(), {"--", o.log});
  RunPython("tendril.export", words, modules);
}

}  // namespace

void AddLogExportCommand(CLI::App& app) {
  auto o = std::make_shared<LogExport>();
  CLI::App* command = LogCommand(app).add_subcommand(
      "export",
      "A log as MCAP for Foxglove and PlotJuggler, with the robot drawn and a layout for each beside it, as "
      "CSV or as Parquet; every message of every channel");
  command->add_option("LOG", o->log, "LCM log")->required();
  command->add_option("--mcap", o->mcap, "the MCAP file; layouts get its name")->option_text("FILE");
  command->add_option("--csv", o->csv, "folder for CSV, one file a channel")->option_text("FOLDER");
  command->add_option("--parquet", o->parquet, "folder for Parquet, one file a channel")
      ->option_text("FOLDER");
  command->add_option("--robot", o->robot, "robot file that is drawn, instead of the one in the log")
      ->option_text("FILE");
  command->add_flag("--overwrite", o->overwrite, "replace files that exist");
  command->callback([o] { ExportLog(*o); });
}

}  // namespace tendril::tools
