// tendril gap explain: what the registry knows of an effect, for people and as JSON. Knows nothing of logs or
// fits.
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <numeric>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "commands.h"
#include "effect_name.h"
#include "tendril/gap/report.h"
#include "tendril/sim/effects.h"

namespace tendril::tools {
namespace {

using Json = nlohmann::ordered_json;
using sim::Effect;

struct ExplainOptions {
  std::string effect, robot;
  bool json = false;
};

std::string UnitOf(const sim::EffectParameter& p) { return gap::TextOf(p.name).unit; }

/// Every `where` that the effect may have on this robot.
std::vector<std::string> Places(const Effect& e, const RobotParameters& robot) {
  std::vector<std::string> places;
  if (e.on_all || e.scope == sim::Scope::kRobot) places.push_back("all");
  if (!e.on_one) return places;
  const int count = e.scope == sim::Scope::kTendon    ? robot.body.tendons()
                    : e.scope == sim::Scope::kUnit    ? robot.body.units()
                    : e.scope == sim::Scope::kSection ? static_cast<int>(robot.body.sections.size())
                                                      : 0;
  for (int i = 0; i < count; ++i) places.push_back(sim::TargetText(e, i));
  return places;
}

/// On all of it, or where it is on one, on the first; without a robot, those of the reference rig.
std::vector<sim::EffectParameter> ParametersOn(const Effect& e, const RobotParameters* robot) {
  if (robot == nullptr) return e.parameters;
  auto parameters = sim::ParametersOf(e, e.on_all ? sim::Target{} : sim::Target{0}, *robot);
  parameters.resize(e.parameters.size());
  return parameters;
}

Json ToJson(const Effect& e, const RobotParameters* robot) {
  Json parameters = Json::array();
  for (const sim::EffectParameter& p : ParametersOn(e, robot)) {
    parameters.push_back({{"name", p.name},
                          {"unit", UnitOf(p)},
                          {"nominal", p.nominal},
                          {"lower", p.lower},
                          {"upper", p.upper},
                          {"typical", p.typical},
                          {"in_proportion_to", sim::TextOf(p.of)},
                          {"shape", p.shape},
                          {"each", p.each}});
  }
  Json json{{"effect", e.name},
            {"stage", sim::StageName(e.stage)},
            {"cut", sim::CutName(e.cut)},
            {"cut_robot_side", sim::CutName(e.cut_robot_side)},
            {"scope", sim::ScopeName(e.scope)},
            {"on_all", e.on_all},
            {"on_one", e.on_one},
            {"nuisance", e.nuisance},
            {"controller_can_use_it", e.edit != nullptr},
            {"parameters", std::move(parameters)},
            {"summary", e.summary},
            {"physics", e.physics},
            {"signature", e.signature},
            {"experiment", e.experiment},
            {"confusable", e.confusable}};
  if (robot != nullptr) {
    const bool robot_side =
        robot->actuation && robot->actuation->tendons[0].load_cell.place == LoadCellPlace::kRobotSide;
    json["first_cut"] = sim::CutName(robot_side ? e.cut_robot_side : e.cut);
    json["places"] = Places(e, *robot);
  }
  return json;
}

void PrintTable() {
  int stage = -1;
  for (const Effect& e : sim::Effects()) {
    if (stage != static_cast<int>(e.stage)) {
      stage = static_cast<int>(e.stage);
      fmt::print("{}{}\n", e.name == sim::Effects().front().name ? "" : "\n", sim::StageName(e.stage));
    }
    fmt::print("  {:<20} {}  {}\n", e.name, sim::CutName(e.cut), e.summary);
  }
  fmt::print("\nC0 to C6: where in the chain it shows first");
  for (int i = 0; i < sim::kCuts; ++i) {
    const auto cut = static_cast<sim::Cut>(i);
    const gap::CutText& text = gap::TextOf(cut);
    fmt::print("{}{} {} ({} -> {})", i % 2 == 0 ? "\n  " : ", ", sim::CutName(cut), text.title, text.from,
               text.to);
  }
  fmt::print("\ntendril gap explain EFFECT describes one in detail.\n");
}

/// What the numbers above are in proportion to, once each.
void PrintYardsticks(const std::vector<sim::EffectParameter>& parameters, const RobotParameters* robot) {
  std::string named;
  std::set<sim::Yardstick> seen{sim::Yardstick::kNone};
  for (const sim::EffectParameter& p : parameters) {
    if (seen.insert(p.of).second) named += fmt::format("{}{}", named.empty() ? "" : "; ", sim::TextOf(p.of));
  }
  if (named.empty()) return;
  fmt::print(
      "\n{}",
      gap::Wrapped(
          robot ? fmt::format("On {}; in proportion to: {}.", robot->name, named)
                : fmt::format("For the 90 mm rig; for another robot (--robot FILE) they scale with: {}.",
                              named),
          2));
}

void PrintOne(const Effect& e, const RobotParameters* robot) {
  const auto parameters = ParametersOn(e, robot);
  const gap::CutText& cut = gap::TextOf(e.cut);
  fmt::print("{}: {}\n\n", e.name, e.summary);
  fmt::print("  part of        {}\n", sim::StageName(e.stage));
  fmt::print("  shows first at {} {} ({} -> {})", sim::CutName(e.cut), cut.title, cut.from, cut.to);
  if (e.cut_robot_side != e.cut) {
    fmt::print("; at {} with a load cell on the robot's side", sim::CutName(e.cut_robot_side));
  }
  fmt::print("\n  where          {}\n", sim::WhereText(e));
  fmt::print("  controller     {}\n", e.edit ? "can use it: it is a number of the robot file"
                                             : "does not know it: only the simulator has this law");
  if (e.nuisance)
    fmt::print("  nuisance       unknown beforehand: not named as a cause while it is immaterial\n");
  fmt::print("\n  parameter         nominal        from          to  plainly visible\n");
  for (const sim::EffectParameter& p : parameters) {
    fmt::print("  {:<14} {:>10.4g} {:>11.4g} {:>11.4g}  {:.3g}{}{}\n", p.name, p.nominal, p.lower, p.upper,
               p.typical, UnitOf(p).empty() ? "" : " " + UnitOf(p), p.shape ? "  (shape of the law)" : "");
    if (!p.each.empty()) {
      fmt::print("  {:<14} where=all: the value of {}s 2, 3, ... less that of the first\n",
                 fmt::format(fmt::runtime(p.each), 2) + ", ...", sim::ScopeName(e.scope));
    }
  }
  PrintYardsticks(parameters, robot);
  const auto paragraph = [](const char* title, std::string_view text) {
    fmt::print("\n{}\n{}", title, gap::Wrapped(text, 2));
  };
  paragraph("What happens", e.physics);
  paragraph("How it looks in the data", e.signature);
  paragraph("What shows it", e.experiment);
  if (!e.confusable.empty()) paragraph("Looks like", fmt::format("{}", fmt::join(e.confusable, ", ")));
  std::string values;
  for (const sim::EffectParameter& p : parameters) {
    values += fmt::format(
        " {}={:.4g}", p.name,
        p.shape || p.nominal == 0 ? std::min(p.upper, p.nominal + p.typical) : p.nominal + p.typical);
  }
  const std::string where = e.on_all ? "" : fmt::format(" where={}:1", sim::ScopeName(e.scope));
  fmt::print("\nTry it\n  tendril gap simulate --effect \"{}{}{}\" ...\n", e.name, where, values);
}

const Effect* Find(const std::string& name) {
  std::string wanted = name;
  std::replace_if(
      wanted.begin(), wanted.end(), [](char c) { return c == ' ' || c == '-'; }, '_');
  for (char& c : wanted) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return sim::FindEffect(wanted);
}

/// Small letters, and blanks for what joins the words of a name.
std::string Plain(std::string_view text) {
  std::string plain(text);
  for (char& c : plain)
    c = c == '_' || c == '-' ? ' ' : static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return plain;
}

/// What an effect has to do with a word, the nearest first.
enum class Relation { kName, kSummary, kLaw, kLooksLike, kNone };
constexpr const char* kRelations[] = {"by name", "by summary", "by law or signature in the data",
                                      "easily confused with an effect of that name"};

Relation RelationOf(const Effect& e, const std::string& topic) {
  const auto in = [&](std::string_view text) { return Plain(text).find(topic) != std::string::npos; };
  if (in(e.name)) return Relation::kName;
  if (in(e.summary)) return Relation::kSummary;
  if (in(e.physics) || in(e.signature) || in(e.experiment)) return Relation::kLaw;
  const auto& alike = e.confusable;
  return std::any_of(alike.begin(), alike.end(), in) ? Relation::kLooksLike : Relation::kNone;
}

/// Every effect that has to do with the word, the nearest first. Throws UsageError with a likely name when
/// none has.
std::vector<const Effect*> About(const std::string& word) {
  if (const Effect* named = Find(word)) return {named};
  const std::string topic = Plain(word);
  std::vector<const Effect*> hits;
  for (const Effect& e : sim::Effects())
    if (RelationOf(e, topic) != Relation::kNone) hits.push_back(&e);
  std::stable_sort(hits.begin(), hits.end(), [&](const Effect* a, const Effect* b) {
    return RelationOf(*a, topic) < RelationOf(*b, topic);
  });
  if (hits.empty()) EffectNamed(word);  // throws
  return hits;
}

void PrintTopic(const std::string& word, const std::vector<const Effect*>& hits) {
  fmt::print("{} effects match '{}'\n", hits.size(), word);
  Relation last = Relation::kNone;
  for (const Effect* e : hits) {
    const Relation relation = RelationOf(*e, Plain(word));
    if (relation != last) fmt::print("\n{}\n", kRelations[static_cast<int>(relation)]);
    last = relation;
    fmt::print("  {:<20} {}  {}\n", e->name, sim::CutName(e->cut), e->summary);
  }
  fmt::print("\ntendril gap explain EFFECT describes one in detail.\n");
}

void Run(const ExplainOptions& options) {
  if (!options.robot.empty() && !options.json && options.effect.empty()) {
    throw UsageError("--robot goes with an effect, whose bounds on that robot it shows, or with --json");
  }
  std::optional<RobotParameters> robot;
  if (!options.robot.empty()) robot = sim::LoadRobot(options.robot);
  const RobotParameters* on = robot ? &*robot : nullptr;
  if (options.json) {
    Json json = Json::array();
    if (!options.effect.empty()) {
      const auto hits = About(options.effect);
      for (const Effect* e : hits) json.push_back(ToJson(*e, on));
      if (hits.size() == 1) json = Json(json.front());
    } else {
      for (const Effect& e : sim::Effects()) json.push_back(ToJson(e, on));
    }
    fmt::print("{}\n", json.dump(2));
  } else if (options.effect.empty()) {
    PrintTable();
  } else {
    const auto hits = About(options.effect);
    if (hits.size() == 1) {
      PrintOne(*hits.front(), on);
    } else {
      PrintTopic(options.effect, hits);
    }
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
