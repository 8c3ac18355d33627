// `tendril gap history`: what was kept of watched robots, by the Python package.
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "commands.h"
#include "watch_options.h"

namespace tendril::tools {
namespace {

struct HistoryOptions {
  std::string db, robot, page;
  bool json = false, csv = false;
};

void History(const HistoryOptions& o) {
  Words words;
  words.Add("--db", o.db);
  words.Add("--robot", o.robot);
  words.Add("--page", o.page);
  words.AddFlag("--json", o.json);
  words.AddFlag("--csv", o.csv);
  HandToWatch("history", std::move(words), {}, {"numpy"});
}

}  // namespace

void AddGapHistoryCommand(CLI::App& app) {
  auto o = std::make_shared<HistoryOptions>();
  CLI::App* command = GapCommand(app).add_subcommand(
      "history", "Print or export what gap watch has: accepted states, days, the course of every number");
  AddDatabase(*command, o->db);
  command->add_option("--robot", o->robot, "name of the robot, where the database has several");
  auto* json = command->add_flag("--json", o->json, "every entry with all its numbers, as JSON");
  command->add_flag("--csv", o->csv, "a row for each number of each entry")->excludes(json);
  AddPage(*command, o->page);
  command->callback([o] { History(*o); });
}

}  // namespace tendril::tools
