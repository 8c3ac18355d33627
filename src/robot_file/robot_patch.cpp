// Carries the differences of two resolved robots, leaf by leaf, into the file's text; see the header.
#include "tendril/robot_file/robot_patch.h"

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <map>
#include <set>
#include <stdexcept>
#include <utility>

#include "editor.h"
#include "leaves.h"
#include "tendril/config/config.h"
#include "tendril/sim/effects.h"

namespace tendril::robot_file {
namespace {

// Short form of a number: 1.955e10, not 19550000000, and without the last digits of its arithmetic.
std::string Written(const std::string& number) {
  const auto value = AsNumber(number);
  if (!value || *value == 0) return number;
  std::string written = fmt::format("{:.12g}", *value);
  if (!Same(written, number)) written = number;
  if (std::abs(*value) < 1e6 && std::abs(*value) >= 1e-4) return written;
  std::array<char, 40> text;
  const auto end =
      std::to_chars(text.data(), text.data() + text.size(), *AsNumber(written), std::chars_format::scientific)
          .ptr;
  written.assign(text.data(), end);
  const std::size_t exponent = written.find('e') + 1;
  if (written[exponent] == '+') written.erase(exponent, 1);
  const std::size_t digits = exponent + (written[exponent] == '-');
  while (written[digits] == '0' && digits + 1 < written.size()) written.erase(digits, 1);
  return written;
}

std::string Flow(const YAML::Node& node) {
  YAML::Emitter out;
  out.SetSeqFormat(YAML::Flow);
  out.SetMapFormat(YAML::Flow);
  out << node;
  std::string text = out.c_str();
  std::replace(text.begin(), text.end(), '\n', ' ');
  return text;
}

std::vector<Path> Changed(const Leaves& before, const Leaves& after) {
  std::vector<Path> changed;
  for (const auto& [path, value] : after) {
    const auto old = before.find(path);
    if (old == before.end() || !Same(old->second, value)) changed.push_back(path);
  }
  return changed;
}

// Carries one leaf outside the tendons' blocks, or in their common part.
void Carry(Editor& editor, const Path& path, const YAML::Node& resolved, const Path& resolved_path) {
  if (const YAML::Node there = editor.NumberAt(path); there.IsDefined() && there.IsScalar()) {
    return editor.Replace(there, Written(Find(resolved, resolved_path).Scalar()));
  }
  // Not in the file: inserted whole below the first missing key.
  for (std::size_t depth = path.size(); depth-- > 0;) {
    const Path parent(path.begin(), path.begin() + static_cast<std::ptrdiff_t>(depth));
    const YAML::Node map = editor.At(parent);
    if (!map.IsDefined() || !map.IsMap() || map.size() == 0) continue;
    const Path in_resolved(resolved_path.begin(),
                           resolved_path.end() - static_cast<std::ptrdiff_t>(path.size() - depth - 1));
    editor.Insert(map, path[depth] + ": " + Flow(Find(resolved, in_resolved)));
    return;
  }
  throw std::runtime_error("the robot file has no place for " + fmt::format("{}", fmt::join(path, ".")));
}

/// A unit's entry in flow style; what the old entries say of how well its numbers are known stays.
std::string UnitEntry(const YAML::Node& unit, const YAML::Node& old_entries) {
  YAML::Node entry = YAML::Clone(unit);
  const auto number_of = [](const YAML::Node& given) {
    return given["unit"].IsMap() ? given["unit"]["value"].Scalar() : given["unit"].Scalar();
  };
  for (std::size_t i = 0; old_entries.IsDefined() && i < old_entries.size(); ++i) {
    if (number_of(old_entries[i]) != unit["unit"].Scalar()) continue;
    for (const auto& number : old_entries[i]) {
      const std::string& key = number.first.Scalar();
      if (!number.second.IsMap() || !entry[key]) continue;
      YAML::Node both = YAML::Clone(number.second);
      both["value"] = entry[key].Scalar();
      entry[key] = both;
    }
  }
  return Flow(entry);
}

/// Keys of blocks that the changed robot does not have, as of two that exclude each other.
void RemoveGone(Editor& editor, const Leaves& before, const Leaves& after) {
  for (const auto& [path, value] : before) {
    if (after.count(path) != 0 || path.back().front() == '[' || !editor.At(path).IsDefined()) continue;
    editor.Remove(editor.At(Path(path.begin(), path.end() - 1)), path.back());
  }
}

/// A diameter within which the disk's holes no longer fit gives way to the inertias that it stood for.
void ReplaceSmallDisks(Editor& editor, const RobotParameters& after) {
  for (std::size_t k = 0; k < after.body.sections.size(); ++k) {
    const SectionParameters& section = after.body.sections[k];
    const Path path{"body", "sections", fmt::format("[{}]", k)};
    const YAML::Node map = editor.At(path), diameter = editor.NumberAt(Join(path, {"disk_diameter_m"}));
    if (!diameter.IsDefined() || map.Style() == YAML::EmitterStyle::Flow) continue;
    const auto disk_m = diameter.as<double>();
    double outer_m = 0;
    for (const TendonRoute& route : section.tendons)
      outer_m = std::max({outer_m, route.radius_m, route.end_radius_m.value_or(0)});
    if (disk_m > 2 * outer_m) continue;
    editor.Remove(map, "disk_diameter_m");
    editor.Append(map,
                  {fmt::format("disk_inertia_xx_kgm2: {}   # for disk_diameter_m {}: no room for the holes",
                               section.disk_inertia_xx_kgm2, diameter.Scalar()),
                   fmt::format("disk_inertia_zz_kgm2: {}", section.disk_inertia_zz_kgm2)});
  }
}

void CarryOthers(Editor& editor, const RobotParameters& before, const RobotParameters& after) {
  ReplaceSmallDisks(editor, after);
  RemoveGone(editor, OtherLeaves(before), OtherLeaves(after));
  const YAML::Node resolved = Resolved(after);
  std::vector<Path> whole;  // lists and vectors that are inserted whole
  for (const Path& path : Changed(OtherLeaves(before), OtherLeaves(after))) {
    if (path.size() > 1 && path[1] == "unit_deviations") {
      const Path list{"body", "unit_deviations"};
      if (std::find(whole.begin(), whole.end(), list) != whole.end()) continue;
      whole.push_back(list);
      const YAML::Node body = editor.At({"body"});
      const YAML::Node old = editor.At(list);
      if (old.IsDefined()) editor.Remove(body, "unit_deviations");
      std::vector<std::string> lines{"unit_deviations:"};
      for (const auto& unit : resolved["body"]["unit_deviations"])
        lines.push_back("  - " + UnitEntry(unit, old));
      editor.Append(body, lines);
      continue;
    }
    // A disk given by its diameter derives its inertia from its mass; if that changed it, nothing is written.
    if (path.back().starts_with("disk_inertia")) {
      Path diameter = path;
      diameter.back() = "disk_diameter_m";
      if (editor.At(diameter).IsDefined()) continue;
    }
    Path list = path;
    while (!list.empty() && list.back().front() == '[') list.pop_back();
    if (list != path && !editor.At(list).IsDefined()) {
      if (std::find(whole.begin(), whole.end(), list) != whole.end()) continue;
      whole.push_back(list);
      Carry(editor, list, resolved, list);
      continue;
    }
    Carry(editor, path, resolved, path);
  }
}

void CarryTendons(Editor& editor, const RobotParameters& before, const RobotParameters& after) {
  if (!after.actuation) return;
  const std::size_t tendons = after.actuation->tendons.size();
  const auto own = [](std::size_t j) { return Path{"actuation", "per_tendon", std::to_string(j + 1)}; };
  std::map<Path, std::map<std::size_t, std::string>> changes;  // leaf -> tendon -> value
  std::vector<Leaves> values;
  for (std::size_t j = 0; j < tendons; ++j) {
    values.push_back(TendonLeaves(after, j));
    for (const Path& path : Changed(TendonLeaves(before, j), values.back()))
      changes[path][j] = values.back()[path];
  }
  // A list below a tendon's own keys replaces the whole list.
  const auto list_of = [](Path path) {
    for (std::size_t i = 0; i < path.size(); ++i) {
      if (path[i].front() == '[') {
        path.resize(i);
        break;
      }
    }
    return path;
  };
  // A list that is empty in the file is filled at once, with all that its elements have.
  std::set<Path> filled;
  const auto fill = [&](const Path& above, const Path& path, std::size_t tendon) {
    const Path list = list_of(path), in_file = Join(above, list);
    const YAML::Node there = editor.At(in_file);
    if (list == path || !there.IsDefined() || there.size() > 0) return false;
    if (filled.insert(in_file).second) {
      RobotParameters first = after;
      std::swap(first.actuation->tendons[0], first.actuation->tendons[tendon]);
      editor.Fill(there, Flow(Find(Resolved(first), Join({"actuation"}, list))));
    }
    return true;
  };
  std::map<std::size_t, std::vector<Path>> apart;  // keys specific to a tendon
  for (const auto& [path, by_tendon] : changes) {
    std::vector<std::size_t> sharing;
    for (std::size_t j = 0; j < tendons; ++j) {
      const bool has_own = editor.At(Join(own(j), list_of(path))).IsDefined();
      if (!has_own) {
        sharing.push_back(j);
        continue;
      }
      if (const auto change = by_tendon.find(j); change != by_tendon.end() && !fill(own(j), path, j)) {
        editor.Replace(editor.NumberAt(Join(own(j), path)), Written(change->second));
      }
    }
    const bool alike = !sharing.empty() && std::all_of(sharing.begin(), sharing.end(), [&](std::size_t j) {
      return by_tendon.count(j) && Same(by_tendon.at(j), by_tendon.at(sharing.front()));
    });
    if (alike && fill({"actuation"}, path, sharing.front())) continue;
    if (alike) {
      RobotParameters first = after;
      std::swap(first.actuation->tendons[0], first.actuation->tendons[sharing.front()]);
      Carry(editor, Join({"actuation"}, path), Resolved(first), Join({"actuation"}, path));
      continue;
    }
    for (const std::size_t j : sharing) {
      if (by_tendon.count(j)) apart[j].push_back(list_of(path));
    }
  }
  if (apart.empty()) return;

  YAML::Node block;
  const YAML::Node old = editor.At({"actuation", "per_tendon"});
  if (old.IsDefined()) block = YAML::Clone(old);
  for (auto& [j, paths] : apart) {
    RobotParameters first = after;
    std::swap(first.actuation->tendons[0], first.actuation->tendons[j]);
    const YAML::Node resolved = Resolved(first)["actuation"];
    for (const Path& path : paths) {
      YAML::Node at = block[std::to_string(j + 1)];
      for (std::size_t i = 0; i + 1 < path.size(); ++i) at.reset(at[path[i]]);
      at[path.back()] = YAML::Clone(Find(resolved, path));
    }
  }
  const YAML::Node actuation = editor.At({"actuation"});
  if (old.IsDefined()) editor.Remove(actuation, "per_tendon");
  std::vector<std::string> lines{"per_tendon:"};
  for (const auto& tendon : block) lines.push_back("  " + tendon.first.Scalar() + ": " + Flow(tendon.second));
  editor.Append(actuation, lines);
}

/// `original`: the robot of the file; a law that it has at that place already is rewritten there.
void CarryLaws(Editor& editor, const RobotParameters& original, const std::vector<EffectSetting>& laws) {
  if (laws.empty()) return;
  std::vector<std::string> lines;
  const auto written = [](const EffectSetting& law) {
    std::string line = fmt::format("  - {{effect: {}, where: \"{}\"", law.name, law.where);
    for (const auto& [name, value] : law.values) line += fmt::format(", {}: {}", name, value);
    return line + "}";
  };
  std::map<std::size_t, const EffectSetting*> anew;  // by position in the file's list
  for (const EffectSetting& law : laws) {
    if (const auto there = sim::FindLaw(original, law)) anew[*there] = &law;
  }
  const YAML::Node old = editor.At({"effects"});
  if (old.IsDefined()) {
    editor.Remove(editor.root(), "effects");
    for (std::size_t i = 0; i < old.size(); ++i)
      lines.push_back(anew.contains(i) ? written(*anew[i]) : "  - " + Flow(old[i]));
  }
  for (const EffectSetting& law : laws) {
    if (!sim::FindLaw(original, law)) lines.push_back(written(law));
  }
  lines.insert(lines.begin(), "effects:");
  if (!old.IsDefined()) lines.insert(lines.begin(), "");
  editor.Append(editor.root(), lines);
}

/// The new file, read back and found to be what was meant.
RobotPatch Checked(std::string text, const std::string& path, const RobotParameters& expected) {
  RobotPatch patch{.text = std::move(text), .robot = {}};
  patch.robot = config::ParseRobot(patch.text, path + " with the changes");
  if (const double difference = RobotDifference(patch.robot, expected); !(difference <= kSame)) {
    throw std::runtime_error(
        fmt::format("{}: the changes could not be written in this file's layout (a number would differ by "
                    "{:.1g}); write every key on its own line, as `tendril config check` prints it",
                    path, difference));
  }
  return patch;
}

}  // namespace

RobotPatch PatchRobot(const std::string& text, const std::string& path,
                      const std::vector<EffectSetting>& effects, const std::vector<std::string>& heading) {
  const RobotParameters original = config::ParseRobot(text, path);
  // Effects already listed in the file stay listed; only new ones are folded in.
  RobotParameters before = original;
  before.effects.clear();
  RobotParameters after = before;
  after.effects = effects;
  after = sim::FoldEffects(after);
  RobotParameters expected = sim::FoldEffects(original);
  const std::vector<EffectSetting> laws = std::exchange(expected.effects, effects);
  expected = sim::FoldEffects(expected);
  for (const EffectSetting& law : std::exchange(expected.effects, laws)) sim::SetLaw(expected, law);

  Editor editor(text, path);
  CarryOthers(editor, before, after);
  CarryTendons(editor, before, after);
  CarryLaws(editor, original, after.effects);
  return Checked(editor.Text(heading), path, expected);
}

RobotPatch PatchNumbers(const std::string& text, const std::string& path, const RobotParameters& given,
                        const std::vector<std::string>& heading) {
  RobotParameters before = config::ParseRobot(text, path), after = given;
  const auto of_file = static_cast<std::ptrdiff_t>(before.effects.size());
  const std::vector<EffectSetting> listed = std::exchange(before.effects, {});
  after.effects.erase(after.effects.begin(), after.effects.begin() + of_file);
  after = sim::FoldEffects(after);
  Editor editor(text, path);
  CarryOthers(editor, before, after);
  CarryTendons(editor, before, after);
  after.effects = listed;
  return Checked(editor.Text(heading), path, after);
}

}  // namespace tendril::robot_file
