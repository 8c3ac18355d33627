// `tendril gap watch`: a day of a robot beside its accepted state, by the Python package.
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "commands.h"
#include "lcm_options.h"
#include "number_option.h"
#include "watch_options.h"

namespace tendril::tools {
namespace {

struct WatchOptions {
  EntryOptions entry;
  std::string page, out = "out/watch";
  bool each = false, json = false, no_cause = false, event = false;
  double false_alarms = 0.5;
  LcmOptions lcm;
};

void Watch(const WatchOptions& o) {
  Words words;
  o.entry.AddTo(words);
  words.Add("--page", o.page);
  words.Add("--out", o.out);
  words.Add("--false-alarms", o.false_alarms);
  words.Add("--lcm", o.lcm.url);
  words.Add("--prefix", o.lcm.prefix);
  words.AddFlag("--each", o.each);
  words.AddFlag("--json", o.json);
  words.AddFlag("--no-cause", o.no_cause);
  words.AddFlag("--event", o.event);
  HandToWatch("watch", std::move(words), o.entry.data,
              o.event ? std::vector<std::string>{"numpy", "lcm"} : std::vector<std::string>{"numpy"});
}

}  // namespace

void AddGapWatchCommand(CLI::App& app) {
  auto o = std::make_shared<WatchOptions>();
  CLI::App* command =
      GapCommand(app).add_subcommand("watch",
                                     "Enter a day's runs and compare them, with the days before, with the "
                                     "accepted state; exit status 3 and the "
                                     "cause where something changed beyond materiality, 0 where nothing did");
  AddEntryOptions(*command, o->entry, "the day's runs: data-set folders, CSV files or LCM logs");
  command->add_flag(
      "--each", o->each,
      "data are folders of which each item is a day; those not entered yet are, in order of time");
  AddPage(*command, o->page);
  command
      ->add_option(
          "--out", o->out,
          "folder for the diagnosis of an alarm, of a position-controlled robot also of an unsure day")
      ->capture_default_str();
  command->add_flag("--json", o->json, "a line of JSON an entry, instead of the text");
  command->add_flag(
      "--no-cause", o->no_cause,
      "do not diagnose an alarm; of a position-controlled robot, whose days are diagnosed in any "
      "case, keep no report");
  command->add_option("--false-alarms", o->false_alarms, "at most so many in 365 entries without a change")
      ->check(Positive())
      ->capture_default_str();
  command->add_flag("--event", o->event, "publish an alarm as an event over LCM (PREFIX_EVENT)");
  AddLcmOptions(*command, o->lcm);
  command->callback([o] { Watch(*o); });
}

}  // namespace tendril::tools
