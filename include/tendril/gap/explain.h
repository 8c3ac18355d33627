// What the registry of effects says, for people and as JSON. Knows nothing of logs or fits.
#pragma once

#include <string>
#include <vector>

#include "tendril/core/robot.h"
#include "tendril/sim/effects.h"

namespace tendril::gap {

/// A line for each effect, by stage in chain order, and what the cuts are.
std::string EffectsTable();

/// One effect in detail, at most 100 columns but for its parameters: where it shows, its parameters with
/// bounds and a plainly visible deviation (of `robot`, or without one of the reference rig), physics,
/// signature, experiment, confusable effects, and a command that tries it.
std::string EffectText(const sim::Effect& effect, const RobotParameters* robot);

/// The same as a JSON object, or an array of them; with a robot also `first_cut` there, and `places`: every
/// `where` that the effect may have on it.
std::string EffectJson(const sim::Effect& effect, const RobotParameters* robot);
std::string EffectsJson(const std::vector<const sim::Effect*>& effects, const RobotParameters* robot);

/// The effect whose name this is, in any case and with blanks or hyphens for underscores; else every effect
/// that has to do with the word: by name, summary, law or signature, or as confusable, in this order. Empty
/// when none has.
std::vector<const sim::Effect*> EffectsAbout(const std::string& word);
/// A line for each of these effects, under what it has to do with the word.
std::string TopicText(const std::string& word, const std::vector<const sim::Effect*>& hits);

}  // namespace tendril::gap
