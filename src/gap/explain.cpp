#include "tendril/gap/explain.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <iterator>
#include <nlohmann/json.hpp>
#include <set>
#include <string_view>

#include "tendril/gap/report.h"

namespace tendril::gap {
namespace {

using Json = nlohmann::ordered_json;
using sim::Effect;

constexpr const char* kHowToGoOn = "\ntendril gap explain EFFECT describes one in detail.\n";

std::string UnitOf(const sim::EffectParameter& p) { return TextOf(p.name).unit; }

template <class... T>
void Add(std::string& text, fmt::format_string<T...> format, T&&... values) {
  fmt::format_to(std::back_inserter(text), format, std::forward<T>(values)...);
}

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

std::string CutsLegend() {
  std::string text = "\nC0 to C6: where in the chain it shows first";
  for (int i = 0; i < sim::kCuts; ++i) {
    const auto cut = static_cast<sim::Cut>(i);
    const CutText& names = TextOf(cut);
    Add(text, "{}{} {} ({} -> {})", i % 2 == 0 ? "\n  " : ", ", sim::CutName(cut), names.title, names.from,
        names.to);
  }
  return text;
}

/// What the numbers above are in proportion to, once each.
std::string YardsticksText(const std::vector<sim::EffectParameter>& parameters,
                           const RobotParameters* robot) {
  std::string named;
  std::set<sim::Yardstick> seen{sim::Yardstick::kNone};
  for (const sim::EffectParameter& p : parameters) {
    if (seen.insert(p.of).second) named += fmt::format("{}{}", named.empty() ? "" : "; ", sim::TextOf(p.of));
  }
  if (named.empty()) return {};
  const std::string text =
      robot ? fmt::format("On {}; in proportion to: {}.", robot->name, named)
            : fmt::format("For the 90 mm rig; for another robot (--robot FILE) they scale with: {}.", named);
  return fmt::format("\n{}", Wrapped(text, 2));
}

std::string HeadText(const Effect& e) {
  std::string text;
  const CutText& cut = TextOf(e.cut);
  Add(text, "{}: {}\n\n", e.name, e.summary);
  Add(text, "  part of        {}\n", sim::StageName(e.stage));
  Add(text, "  shows first at {} {} ({} -> {})", sim::CutName(e.cut), cut.title, cut.from, cut.to);
  if (e.cut_robot_side != e.cut) {
    Add(text, "; at {} with a load cell on the robot's side", sim::CutName(e.cut_robot_side));
  }
  Add(text, "\n  where          {}\n", sim::WhereText(e));
  Add(text, "  controller     {}\n",
      e.edit ? "can use it: it is a number of the robot file"
             : "does not know it: only the simulator has this law");
  if (e.nuisance)
    Add(text, "  nuisance       unknown beforehand: not named as a cause while it is immaterial\n");
  return text;
}

std::string ParametersText(const Effect& e, const std::vector<sim::EffectParameter>& parameters) {
  std::string text;
  Add(text, "\n  parameter         nominal        from          to  plainly visible\n");
  for (const sim::EffectParameter& p : parameters) {
    Add(text, "  {:<14} {:>10.4g} {:>11.4g} {:>11.4g}  {:.3g}{}{}{}\n", p.name, p.nominal, p.lower, p.upper,
        p.typical, UnitOf(p).empty() ? "" : " ", UnitOf(p), p.shape ? "  (shape of the law)" : "");
    if (!p.each.empty()) {
      Add(text, "  {:<14} where=all: the value of {}s 2, 3, ... less that of the first\n",
          fmt::format(fmt::runtime(p.each), 2) + ", ...", sim::ScopeName(e.scope));
    }
  }
  return text;
}

/// A command that makes the effect plainly visible.
std::string TryIt(const Effect& e, const std::vector<sim::EffectParameter>& parameters) {
  std::string values;
  for (const sim::EffectParameter& p : parameters) {
    values += fmt::format(
        " {}={:.4g}", p.name,
        p.shape || p.nominal == 0 ? std::min(p.upper, p.nominal + p.typical) : p.nominal + p.typical);
  }
  const std::string where = e.on_all ? "" : fmt::format(" where={}:1", sim::ScopeName(e.scope));
  return fmt::format("\nTry it\n  tendril gap simulate --effect \"{}{}{}\" ...\n", e.name, where, values);
}

/// The effect whose name these words are: "Tip payload".
const Effect* Named(const std::string& name) {
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

}  // namespace

std::string EffectsTable() {
  std::string text;
  int stage = -1;
  for (const Effect& e : sim::Effects()) {
    if (stage != static_cast<int>(e.stage)) {
      stage = static_cast<int>(e.stage);
      Add(text, "{}{}\n", e.name == sim::Effects().front().name ? "" : "\n", sim::StageName(e.stage));
    }
    Add(text, "  {:<20} {}  {}\n", e.name, sim::CutName(e.cut), e.summary);
  }
  return text + CutsLegend() + kHowToGoOn;
}

std::string EffectText(const Effect& e, const RobotParameters* robot) {
  const auto parameters = ParametersOn(e, robot);
  const auto paragraph = [](const char* title, std::string_view text) {
    return fmt::format("\n{}\n{}", title, Wrapped(text, 2));
  };
  return HeadText(e) + ParametersText(e, parameters) + YardsticksText(parameters, robot) +
         paragraph("What happens", e.physics) + paragraph("How it looks in the data", e.signature) +
         paragraph("What shows it", e.experiment) +
         (e.confusable.empty() ? ""
                               : paragraph("Looks like", fmt::format("{}", fmt::join(e.confusable, ", ")))) +
         TryIt(e, parameters);
}

std::string EffectJson(const Effect& effect, const RobotParameters* robot) {
  return ToJson(effect, robot).dump(2);
}

std::string EffectsJson(const std::vector<const Effect*>& effects, const RobotParameters* robot) {
  Json json = Json::array();
  for (const Effect* e : effects) json.push_back(ToJson(*e, robot));
  return json.dump(2);
}

std::vector<const Effect*> EffectsAbout(const std::string& word) {
  if (const Effect* named = Named(word)) return {named};
  const std::string topic = Plain(word);
  std::vector<const Effect*> hits;
  for (const Effect& e : sim::Effects())
    if (RelationOf(e, topic) != Relation::kNone) hits.push_back(&e);
  std::stable_sort(hits.begin(), hits.end(), [&](const Effect* a, const Effect* b) {
    return RelationOf(*a, topic) < RelationOf(*b, topic);
  });
  return hits;
}

std::string TopicText(const std::string& word, const std::vector<const Effect*>& hits) {
  std::string text = fmt::format("{} effects match '{}'\n", hits.size(), word);
  Relation last = Relation::kNone;
  for (const Effect* e : hits) {
    const Relation relation = RelationOf(*e, Plain(word));
    if (relation != last) Add(text, "\n{}\n", kRelations[static_cast<int>(relation)]);
    last = relation;
    Add(text, "  {:<20} {}  {}\n", e->name, sim::CutName(e->cut), e->summary);
  }
  return text + kHowToGoOn;
}

}  // namespace tendril::gap
