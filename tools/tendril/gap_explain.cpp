// tendril gap explain: what the registry knows of an effect, for people and as JSON. Knows nothing of logs or
// fits.
#include <fmt/core.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "commands.h"
#include "effect_name.h"
#include "tendril/gap/explain.h"
#include "tendril/sim/effects.h"

namespace tendril::tools {
namespace {

struct ExplainOptions {
  std::string effect, robot;
  bool json = false;
};

/// Without a word all effects. Throws UsageError with a likely name when none has to do with it.
std::vector<const sim::Effect*> Named(const std::string& word) {
  std::vector<const sim::Effect*> effects;
  if (word.empty()) {
    for (const sim::Effect& e : sim::Effects()) effects.push_back(&e);
    return effects;
  }
  effects = gap::EffectsAbout(word);
  if (effects.empty()) EffectNamed(word);  // throws
  return effects;
}

void Run(const ExplainOptions& options) {
  if (!options.robot.empty() && !options.json && options.effect.empty()) {
    throw UsageError("--robot goes with an effect, whose bounds on that robot it shows, or with --json");
  }
  std::optional<RobotParameters> robot;
  if (!options.robot.empty()) robot = sim::LoadRobot(options.robot);
  const RobotParameters* on = robot ? &*robot : nullptr;
  const std::vector<const sim::Effect*> effects = Named(options.effect);
  const bool one = !options.effect.empty() && effects.size() == 1;
  if (options.json) {
    fmt::print("{}\n", one ? gap::EffectJson(*effects.front(), on) : gap::EffectsJson(effects, on));
  } else if (options.effect.empty()) {
    fmt::print("{}", gap::EffectsTable());
  } else {
    fmt::print("{}", one ? gap::EffectText(*effects.front(), on) : gap::TopicText(options.effect, effects));
  }
}

}  // namespace

void AddGapExplainCommand(CLI::App& app) {
  auto options = std::make_shared<ExplainOptions>();
  CLI::App* command =
      GapCommand(app).add_subcommand("explain",
                                     "An effect's physics, its signature in the data, what it is confused "
                                     "with and which experiment shows it; without a name: all");
  command->add_option("effect", options->effect,
                      "name of the effect, such as backlash, or a word to search for, such as friction");
  command->add_flag("--json", options->json, "for programs");
  command->add_option(
      "--robot", options->robot,
      "a robot file: bounds and sizes on that robot, with --json also its places and the cut");
  command->callback([options] { Run(*options); });
}

}  // namespace tendril::tools
