// tendril gap import: tables of other programs as a folder of runs, or as a log like the daemon's. Knows the
// command line; what a map may say is the gap room's business.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <set>

#include "commands.h"
#include "counted.h"
#include "tendril/gap/cuts.h"
#include "tendril/gap/health.h"
#include "tendril/gap/health_lines.h"
#include "tendril/gap/import.h"
#include "tendril/gap/run_log.h"
#include "tendril/gap/set_folder.h"
#include "tendril/sim/effects.h"

namespace tendril::tools {
namespace {

namespace fs = std::filesystem;

struct ImportOptions {
  std::string robot, map, out, log;
  std::vector<std::string> tables;
  bool overwrite = false;
};

/// Reports what the log cannot hold.
void LeaveLog(const gap::DataSet& set, const std::string& path) {
  const gap::LostInLog lost = gap::WhatALogLoses(set);
  if (lost.start_position) {
    fmt::print(stderr,
               "tendril: {}: in a log the motors' zero is that of the initial rest of a run; a folder "
               "(--out) keeps positions that begin elsewhere\n",
               path);
  }
  const gap::WrittenLog log = gap::WriteLog(set, path);
  fmt::print("{}: {}, {}\n", path, Counted(set.runs.size(), "run"), Counted(log.events, "event"));
  if (!lost.channels.empty()) {
    fmt::print(stderr,
               "tendril: {}: a log cannot mark a channel as not measured; it contains zeros for {}; a folder "
               "(--out) can\n",
               path, fmt::join(lost.channels, ", "));
  }
  if (log.clipped > 0) {
    fmt::print(stderr,
               "tendril: {}: {} values exceed the range of the drives' units and were clipped; check the "
               "robot file's rated torque and load cell\n",
               path, log.clipped);
  }
}

/// What would lose a file is found before anything is read. Returns where the set goes, if anywhere.
std::optional<gap::SetFolder> CheckPlaces(const ImportOptions& options) {
  std::vector<std::string> inputs{options.robot, options.map};
  inputs.insert(inputs.end(), options.tables.begin(), options.tables.end());
  if (!options.log.empty()) {
    gap::RefuseToReplace(options.log, "--log", inputs);
    gap::CheckWritable(options.log);
  }
  std::error_code ignored;
  for (const std::string& table : options.tables) {
    if (options.out.empty() || !fs::equivalent(fs::absolute(table).parent_path(), options.out, ignored))
      continue;
    throw UsageError(fmt::format(
        "--out {} is the folder of {}, which a run with that name would replace; give another --out",
        options.out, table));
  }
  if (options.out.empty()) return {};
  return gap::SetFolder(options.out, options.overwrite, inputs);
}

void RunImport(const ImportOptions& options) {
  if (options.out.empty() && options.log.empty()) {
    throw UsageError("gap import: no destination; give a folder by --out or a log by --log");
  }
  const std::optional<gap::SetFolder> folder = CheckPlaces(options);
  const RobotParameters robot = sim::LoadRobot(options.robot);
  if (!options.log.empty() && !robot.actuation) {
    throw std::runtime_error(
        "a log needs a robot file with actuation (drives, encoders, load cells); use --out");
  }
  const gap::DataSet set = gap::ImportTables(options.map, options.tables, robot);
  if (folder) {
    folder->Write(set);
    fmt::print("{}: {}\n", fs::absolute(options.out).lexically_normal().string(),
               Counted(set.runs.size(), "run"));
  }
  if (!options.log.empty()) LeaveLog(set, options.log);

  std::set<std::string> families;
  std::size_t rows = 0, repeats = 0;
  for (const gap::Run& run : set.runs) {
    families.insert(run.family);
    rows += static_cast<std::size_t>(run.time_s.size());
    repeats += !run.repeat_of.empty();
  }
  fmt::print("{}, {}, {}\n", Counted(rows, "row"), Counted(families.size(), "family", "families"),
             Counted(repeats, "repetition"));
  for (const std::string& line : gap::FindingLines(gap::CheckHealth(set)))
    fmt::print(stderr, "tendril: {}\n", line);
  const std::vector<gap::CutOfSet> cuts = gap::CutsOf(set);
  fmt::print("{}\n", gap::CutsLine(cuts));
  std::fflush(stdout);
  const auto left_out = std::count_if(set.notes.begin(), set.notes.end(),
                                      [](const std::string& note) { return note.starts_with("left out: "); });
  // A script that calls this would continue with less data than intended.
  if (left_out > 0) {
    throw std::runtime_error(fmt::format("{} of {} left out (above); the others were written",
                                         left_out == 1 ? "one" : std::to_string(left_out),
                                         Counted(options.tables.size(), "table")));
  }
  if (!gap::AnyCut(cuts)) {
    throw std::runtime_error(
        "these runs cannot be compared with a simulation; accepted: load cells or motor positions of every "
        "tendon, and a second channel to compare with (torque, tension, or the body's shape); map more "
        "columns");
  }
}

}  // namespace

void AddGapImportCommand(CLI::App& app) {
  auto options = std::make_shared<ImportOptions>();
  CLI::App* command = GapCommand(app).add_subcommand(
      "import",
      "Import tables of any robot and program as a folder of runs (or a log), through a column map");
  command->add_option("--robot", options->robot, "nominal robot file of the robot that was measured")
      ->required();
  command
      ->add_option("--map", options->map,
                   "YAML that describes the columns; config/import has examples with every key")
      ->required();
  command->add_option("tables", options->tables, "text files with one row per sample")->required();
  command->add_option("--out", options->out, "folder for robot.yaml, runs.yaml and one CSV per run");
  command->add_flag("--overwrite", options->overwrite, "replace the folder's data set");
  command->add_option("--log", options->log, "LCM log in the daemon's format, in its drives' units");
  command->callback([options] { RunImport(*options); });
}

}  // namespace tendril::tools
