// The registry of effects: names and targets, settings checked and folded into a robot's numbers, laws
// gathered. Knows no effect by itself; they are listed in effects/list.inc.
#include "tendril/sim/effects.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <sstream>
#include <stdexcept>

#include "laws.h"
#include "tendril/config/config.h"

namespace tendril::sim {

#define TENDRIL_EFFECT(Name) Effect Name();
#include "effects/list.inc"
#undef TENDRIL_EFFECT

namespace {

std::invalid_argument Wrong(std::string_view what, std::string_view accepted, std::string_view remedy) {
  return std::invalid_argument(fmt::format("{}; accepted: {}; {}", what, accepted, remedy));
}

int CountOf(Scope scope, const RobotParameters& robot) {
  switch (scope) {
    case Scope::kTendon:
      return robot.body.tendons();
    case Scope::kUnit:
      return robot.body.units();
    case Scope::kSection:
      return static_cast<int>(robot.body.sections.size());
    case Scope::kRobot:
      break;
  }
  return 0;
}

Place PlaceOf(Scope scope, Target target, const RobotParameters& robot) {
  if (!target || scope == Scope::kRobot) return {};
  if (scope == Scope::kTendon) return {.tendon = *target};
  if (scope == Scope::kSection) return {.section = *target};
  int section = 0;
  for (int end = 0; section + 1 < static_cast<int>(robot.body.sections.size()); ++section) {
    end += robot.body.sections[static_cast<std::size_t>(section)].units;
    if (*target < end) break;
  }
  return {.section = section};
}

double ThreeDigits(double value) { return std::strtod(fmt::format("{:.3g}", value).c_str(), nullptr); }

void Resize(EffectParameter& p, const Measure& over_reference) {
  if (p.of == Yardstick::kNone) return;
  const auto resize = [](double& value, double ratio) { value = ThreeDigits(value * ratio); };
  for (double* value : {&p.nominal, &p.lower, &p.upper}) resize(*value, over_reference.bound);
  for (double& start : p.starts) resize(start, p.shape ? over_reference.bound : over_reference.visible);
  resize(p.typical, over_reference.visible);
  p.typical = std::min(p.typical, p.upper - p.nominal);
}

bool ReadNumber(std::string_view text, double& value) {
  if (text.starts_with('+')) text.remove_prefix(1);
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size() && std::isfinite(value);
}

const Effect& Known(std::string_view name) {
  if (const Effect* effect = FindEffect(name)) return *effect;
  std::vector<std::string_view> names;
  for (const Effect& effect : Effects()) names.push_back(effect.name);
  throw Wrong(fmt::format("there is no effect '{}'", name), fmt::format("{}", fmt::join(names, ", ")),
              "correct the name");
}

// A robot whose effects are being folded into its numbers has other scales than the one on which they were
// checked, so bounds are checked only on input from text or a file.
enum class Bounds { kChecked, kKnown };

void CheckValue(const Effect& effect, const std::vector<EffectParameter>& all, std::string_view name,
                double value, Bounds bounds) {
  const auto p = std::find_if(all.begin(), all.end(), [&](const auto& q) { return q.name == name; });
  if (p == all.end()) {
    std::vector<std::string_view> names;
    for (const EffectParameter& q : all) names.push_back(q.name);
    throw Wrong(fmt::format("{} has no parameter '{}'", effect.name, name),
                fmt::format("{}", fmt::join(names, ", ")), "correct the name");
  }
  if (bounds == Bounds::kKnown && std::isfinite(value)) return;
  if (!(value >= p->lower && value <= p->upper)) {
    throw Wrong(fmt::format("{}.{} = {}", effect.name, name, value),
                fmt::format("{} .. {}", p->lower, p->upper), "correct the value");
  }
}

struct Resolved {
  const Effect* effect = nullptr;
  Target target;
};

Resolved Resolve(const EffectSetting& setting, const RobotParameters& robot, Bounds bounds) {
  const Effect& effect = Known(setting.name);
  const Target target = ParseTarget(effect, setting.where, robot);
  if (effect.stage != Stage::kBody && !robot.actuation) {
    throw Wrong(fmt::format("{}: robot '{}' has no actuation", effect.name, robot.name),
                "effects of the body", "use a robot file with an 'actuation' section");
  }
  const std::vector<EffectParameter> parameters = ParametersOf(effect, target, robot);
  std::vector<std::string_view> primary, given;
  for (const EffectParameter& p : parameters) {
    if (!p.shape) primary.push_back(p.name);
  }
  bool any = false;
  for (const auto& [name, value] : setting.values) {
    CheckValue(effect, parameters, name, value, bounds);
    if (std::find(given.begin(), given.end(), name) != given.end()) {
      throw Wrong(fmt::format("{}.{} twice", effect.name, name), "each parameter once", "remove one");
    }
    given.push_back(name);
    any = any || std::find(primary.begin(), primary.end(), name) != primary.end();
  }
  if (!any) {
    throw Wrong(fmt::format("{} without {}", effect.name, fmt::join(primary, ", ")),
                primary.size() > 1 ? "at least one of them" : "a value of it", "add it");
  }
  return {&effect, target};
}

/// Resolves all of a robot's settings; a refusal names the entry of the list.
std::vector<Resolved> ResolveAll(const RobotParameters& robot, Bounds bounds) {
  std::vector<Resolved> all;
  for (std::size_t i = 0; i < robot.effects.size(); ++i) {
    try {
      all.push_back(Resolve(robot.effects[i], robot, bounds));
      for (std::size_t k = 0; k < i; ++k) {
        if (all[k].effect == all[i].effect && all[k].target == all[i].target) {
          throw Wrong(
              fmt::format("{} on {} twice", all[i].effect->name, TargetText(*all[i].effect, all[i].target)),
              "each effect once a place", "remove one");
        }
      }
    } catch (const std::invalid_argument& e) {
      throw EffectError(static_cast<int>(i + 1), e.what());
    }
  }
  return all;
}

}  // namespace

EffectError::EffectError(int entry, const std::string& text)
    : std::invalid_argument(fmt::format("effects[{}]: {}", entry, text)), entry_(entry), text_(text) {}

std::string_view CutName(Cut cut) {
  constexpr std::string_view kNames[kCuts] = {"C0", "C1", "C2", "C3", "C4", "C5", "C6"};
  return kNames[static_cast<int>(cut)];
}

std::string_view StageName(Stage stage) {
  constexpr std::string_view kNames[] = {"drive", "transmission", "body", "sensors"};
  return kNames[static_cast<int>(stage)];
}

std::string_view ScopeName(Scope scope) {
  constexpr std::string_view kNames[] = {"robot", "tendon", "unit", "section"};
  return kNames[static_cast<int>(scope)];
}

std::span<const Effect> Effects() {
  static const std::vector<Effect> all{
#define TENDRIL_EFFECT(Name) Name(),
#include "effects/list.inc"
#undef TENDRIL_EFFECT
  };
  return all;
}

const Effect* FindEffect(std::string_view name) {
  for (const Effect& effect : Effects()) {
    if (effect.name == name) return &effect;
  }
  return nullptr;
}

const Effect* FindEffectOfNumber(std::string_view key) {
  const auto its = std::find_if(Effects().begin(), Effects().end(),
                                [&](const Effect& effect) { return !key.empty() && effect.number == key; });
  return its == Effects().end() ? nullptr : &*its;
}

std::vector<EffectParameter> ParametersOf(const Effect& effect, Target target, const RobotParameters& robot) {
  std::vector<EffectParameter> all = effect.parameters;
  const Place place = PlaceOf(effect.scope, target, robot);
  for (EffectParameter& p : all) Resize(p, OverReference(p.of, robot, place));
  if (target) return all;
  for (std::size_t k = 0; k < effect.parameters.size(); ++k) {
    const EffectParameter p = all[k];
    if (p.each.empty()) continue;
    for (int i = 2; i <= CountOf(effect.scope, robot); ++i) {
      all.push_back({.name = fmt::format(fmt::runtime(p.each), i),
                     .nominal = 0,
                     .lower = p.lower,
                     .upper = p.upper,
                     .typical = p.typical,
                     .shape = true});
    }
  }
  return all;
}

namespace {

// A pair's second tendon has no drive whose current, friction or sensors could be wrong.
void RequireDrive(const Effect& effect, int target, const RobotParameters& robot) {
  const bool of_drive = effect.stage == Stage::kDrive || effect.stage == Stage::kSensor;
  if (effect.scope != Scope::kTendon || !of_drive || !robot.actuation) return;
  if (robot.actuation->HasDrive(target)) return;
  const int first = robot.actuation->PairOf(target)->first;
  throw Wrong(fmt::format("{}: tendon {} has no motor of its own", effect.name, target + 1),
              fmt::format("tendon:{}, the first of its pair", first + 1), "name that one");
}

}  // namespace

Target ParseTarget(const Effect& effect, std::string_view where, const RobotParameters& robot) {
  if (where == "all" && effect.on_all) return std::nullopt;
  const std::string_view scope = ScopeName(effect.scope);
  const int count = CountOf(effect.scope, robot);
  if (effect.on_one && where.starts_with(scope) && where.substr(scope.size()).starts_with(':')) {
    const std::string_view digits = where.substr(scope.size() + 1);
    int number = 0;
    const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), number);
    if (error == std::errc() && end == digits.data() + digits.size() && number >= 1 && number <= count) {
      RequireDrive(effect, number - 1, robot);
      return number - 1;
    }
  }
  std::string accepted = effect.on_all ? "all" : "";
  if (effect.on_one) {
    accepted += fmt::format("{}{}:1 .. {}:{}", effect.on_all ? ", " : "", scope, scope, count);
  }
  throw Wrong(fmt::format("{}: where = '{}'", effect.name, where), accepted, "name one of these places");
}

std::string TargetText(const Effect& effect, Target target) {
  return target ? fmt::format("{}:{}", ScopeName(effect.scope), *target + 1) : "all";
}

std::string WhereText(const Effect& effect) {
  if (effect.scope == Scope::kRobot) return "all";
  const std::string one = fmt::format("{}:NUMBER", ScopeName(effect.scope));
  return effect.on_all && effect.on_one ? "all or " + one : effect.on_one ? one : "all";
}

EffectSetting ParseEffect(std::string_view text, const RobotParameters& robot) {
  constexpr std::string_view kForm =
      "an effect, its place and its parameters, as in 'backlash where=tendon:2 rad=0.05'";
  std::istringstream words{std::string(text)};
  EffectSetting setting;
  if (!(words >> setting.name)) throw Wrong("an effect without a name", kForm, "name one");
  for (std::string word; words >> word;) {
    const auto equals = word.find('=');
    if (equals == std::string::npos) {
      throw Wrong(fmt::format("'{}' is not key=value", word), kForm, "correct it");
    }
    const std::string key = word.substr(0, equals), value = word.substr(equals + 1);
    if (key == "where") {
      setting.where = value;
      continue;
    }
    double number = 0;
    if (!ReadNumber(value, number)) {
      throw Wrong(fmt::format("{}.{} = '{}'", setting.name, key, value), "a finite number", "correct it");
    }
    setting.values.emplace_back(key, number);
  }
  Resolve(setting, robot, Bounds::kChecked);
  return setting;
}

void CheckEffects(const RobotParameters& robot) {
  ResolveAll(robot, Bounds::kChecked);
  if (robot.actuation && !robot.actuation->pairs.empty()) PlantLaws::Of(robot);
}

RobotParameters LoadRobot(const std::string& path) {
  RobotParameters robot = config::LoadRobot(path);
  try {
    CheckEffects(robot);
  } catch (const EffectError& e) {
    throw config::ErrorAt(path, fmt::format("effects[{}]", e.entry()), e.text());
  }
  return robot;
}

std::vector<double> ValuesOf(const EffectSetting& setting, const RobotParameters& robot) {
  const Effect& effect = Known(setting.name);
  std::vector<double> values;
  for (const EffectParameter& p : ParametersOf(effect, ParseTarget(effect, setting.where, robot), robot)) {
    const auto is_it = [&](const auto& value) { return value.first == p.name; };
    const auto at = std::find_if(setting.values.begin(), setting.values.end(), is_it);
    values.push_back(at == setting.values.end() ? p.nominal : at->second);
  }
  return values;
}

std::optional<std::size_t> FindLaw(const RobotParameters& robot, const Effect& effect, Target target) {
  for (std::size_t i = 0; i < robot.effects.size() && !effect.edit; ++i) {
    const EffectSetting& setting = robot.effects[i];
    if (setting.name == effect.name && ParseTarget(effect, setting.where, robot) == target) return i;
  }
  return std::nullopt;
}

std::optional<std::size_t> FindLaw(const RobotParameters& robot, const EffectSetting& setting) {
  const Effect& effect = Known(setting.name);
  return FindLaw(robot, effect, ParseTarget(effect, setting.where, robot));
}

void SetLaw(RobotParameters& robot, const EffectSetting& setting) {
  if (const auto there = FindLaw(robot, setting))
    robot.effects[*there].values = setting.values;
  else
    robot.effects.push_back(setting);
}

// Applied in chain order, so that the result of two effects on one number does not depend on the file's
// order.
RobotParameters FoldEffects(const RobotParameters& robot) {
  const std::vector<Resolved> all = ResolveAll(robot, Bounds::kKnown);
  RobotParameters folded = robot;
  folded.effects.clear();
  for (const Effect& effect : Effects()) {
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (all[i].effect == &effect && effect.edit)
        effect.edit(folded, all[i].target, ValuesOf(robot.effects[i], robot));
    }
  }
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (!all[i].effect->edit) folded.effects.push_back(robot.effects[i]);
  }
  if (folded.effects.size() < robot.effects.size()) {  // by their places in the list, which are others now
    std::erase_if(folded.uncertain, [](const auto& number) { return number.first.starts_with("effects["); });
  }
  return folded;
}

namespace {

// Of a spool that a pair shares neither play nor growth is simulated. `effect`, the entry of that number, has
// just been added.
void RequirePlainSpools(const PlantLaws& laws, const RobotParameters& robot, const Effect& effect,
                        int entry) {
  for (int j = 0; j < static_cast<int>(laws.tendon.size()); ++j) {
    const TendonLaws& its = laws.tendon[static_cast<std::size_t>(j)];
    const bool plain = its.play_rad == 0 && its.spool_growth_mprad == 0;
    if (plain || !robot.actuation || robot.actuation->PairOf(j) == nullptr) continue;
    throw EffectError(entry,
                      fmt::format("{} at tendon {}, whose spool is that of a pair and has neither play nor "
                                  "growth in the simulator; accepted: tendons with a motor of their own; "
                                  "remove it",
                                  effect.name, j + 1));
  }
}

}  // namespace

PlantLaws PlantLaws::Of(const RobotParameters& robot) {
  PlantLaws laws(robot.body.tendons());
  const std::vector<Resolved> all = ResolveAll(robot, Bounds::kKnown);
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (all[i].effect->add) {
      all[i].effect->add(laws, robot, all[i].target, ValuesOf(robot.effects[i], robot));
      RequirePlainSpools(laws, robot, *all[i].effect, static_cast<int>(i) + 1);
    }
  }
  return laws;
}

}  // namespace tendril::sim
