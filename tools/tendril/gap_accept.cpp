// `tendril gap accept`: records the state that later days of a robot are compared with, by the Python
// package.
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "commands.h"
#include "number_option.h"
#include "watch_options.h"

namespace tendril::tools {
namespace {

struct AcceptOptions {
  EntryOptions entry;
  std::string note;
  double delta_N = 0, delta_mm = 0;
};

void Accept(const AcceptOptions& o) {
  Words words;
  o.entry.AddTo(words);
  words.Add("--note", o.note);
  words.Add("--delta-N", o.delta_N);
  words.Add("--delta-mm", o.delta_mm);
  HandToWatch("accept", std::move(words), o.entry.data, {"numpy"});
}

}  // namespace

void AddGapAcceptCommand(CLI::App& app) {
  auto o = std::make_shared<AcceptOptions>();
  CLI::App* command = GapCommand(app).add_subcommand(
      "accept", "Record these runs and this robot file as the state that gap watch compares later days with");
  AddEntryOptions(*command, o->entry, "runs of the robot as it is: data-set folders, CSV files or LCM logs");
  command->add_option("--note", o->note, "why: new tendon, calibrated, ...");
  command
      ->add_option("--delta-N", o->delta_N,
                   "tension difference that does not matter in practice [N]; default from the noise floor")
      ->check(Positive());
  command
      ->add_option("--delta-mm", o->delta_mm,
                   "tip distance that does not matter in practice [mm]; default from the noise floor")
      ->check(Positive());
  command->callback([o] { Accept(*o); });
}

}  // namespace tendril::tools
