// Compares resolved robots leaf by leaf and carries the differences into the text.
// Knows robot files only as trees of keys.
#include "tendril/robot_file/robot_patch.h"

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <stdexcept>
#include <utility>

#include "tendril/config/config.h"
#include "tendril/sim/effects.h"

namespace tendril::robot_file {
namespace {

using Path = std::vector<std::string>;
using Leaves = std::map<Path, std::string>;

constexpr double kSame = 1e-9;

void Flatten(const YAML::Node& node, Path& path, Leaves& leaves) {
  if (node.IsMap()) {
    for (const auto& entry : node) {
      path.push_back(entry.first.Scalar());
      Flatten(entry.second, path, leaves);
      path.pop_back();
    }
  } else if (node.IsSequence()) {
    for (std::size_t i = 0; i < node.size(); ++i) {
      path.push_back(fmt::format("[{}]", i));
      Flatten(node[i], path, leaves);
      path.pop_back();
    }
  } else {
    leaves[path] = node.Scalar();
  }
}

Leaves LeavesOf(const YAML::Node& node) {
  Leaves leaves;
  Path path;
  Flatten(node, path, leaves);
  return leaves;
}

std::optional<double> AsNumber(const std::string& text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return {};
  return value;
}

// Short form of a number: 1.955e10, not 19550000000. The same digits, so the same value.
std::string Written(const std::string& number) {
  const auto value = AsNumber(number);
  if (!value || *value == 0 || (std::abs(*value) < 1e6 && std::abs(*value) >= 1e-4)) return number;
  std::array<char, 40> text;
  const auto end =
      std::to_chars(text.data(), text.data() + text.size(), *value, std::chars_format::scientific).ptr;
  std::string written(text.data(), end);
  const std::size_t exponent = written.find('e') + 1;
  if (written[exponent] == '+') written.erase(exponent, 1);
  const std::size_t digits = exponent + (written[exponent] == '-');
  while (written[digits] == '0' && digits + 1 < written.size()) written.erase(digits, 1);
  return written;
}

bool Same(const std::string& a, const std::string& b) {
  const auto x = AsNumber(a), y = AsNumber(b);
  if (!x || !y) return a == b;
  return *x == *y || std::abs(*x - *y) <= 1e-12 * std::max(std::abs(*x), std::abs(*y));
}

YAML::Node Resolved(const RobotParameters& robot) { return YAML::Load(config::ToYaml(robot)); }

// All leaves of one tendon's drivetrain, resolved.
Leaves TendonLeaves(RobotParameters robot, std::size_t tendon) {
  if (!robot.actuation) return {};
  std::swap(robot.actuation->tendons[0], robot.actuation->tendons[tendon]);
  YAML::Node blocks = Resolved(robot)["actuation"];
  for (const char* key : {"nodes", "per_tendon", "tracker"}) blocks.remove(key);
  return LeavesOf(blocks);
}

// All other leaves.
Leaves OtherLeaves(const RobotParameters& robot) {
  YAML::Node root = Resolved(robot);
  root.remove("effects");
  if (root["actuation"]) {
    YAML::Node rest;
    if (root["actuation"]["tracker"]) rest["tracker"] = root["actuation"]["tracker"];
    root.remove("actuation");
    if (rest.IsMap()) root["actuation"] = rest;
  }
  return LeavesOf(root);
}

YAML::Node Find(YAML::Node node, const Path& path) {
  for (const std::string& key : path) {
    if (key.front() == '[') {
      const auto index = static_cast<std::size_t>(std::stoul(key.substr(1)));
      if (!node.IsSequence() || index >= node.size()) return YAML::Node(YAML::NodeType::Undefined);
      node.reset(node[index]);
    } else {
      if (!node.IsMap() || !node[key]) return YAML::Node(YAML::NodeType::Undefined);
      node.reset(node[key]);
    }
  }
  return node;
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

class Editor {
 public:
  Editor(const std::string& text, std::string path) : path_(std::move(path)), root_(YAML::Load(text)) {
    for (std::size_t from = 0; from < text.size();) {
      const std::size_t end = std::min(text.find('\n', from), text.size());
      lines_.push_back(text.substr(from, end - from));
      from = end + 1;
    }
    above_.resize(lines_.size() + 1);
  }

  YAML::Node At(const Path& path) const { return Find(root_, path); }

  /// Replaces a number in the file; the old one stays as a comment.
  void Replace(const YAML::Node& node, const std::string& value) {
    const auto line = static_cast<std::size_t>(node.Mark().line),
               column = static_cast<std::size_t>(node.Mark().column);
    const std::string& old = node.Scalar();
    if (line >= lines_.size() || lines_[line].compare(column, old.size(), old) != 0) {
      throw std::runtime_error(
          fmt::format("{}:{}: cannot be edited in place; write a plain number", path_, line + 1));
    }
    edits_[line].push_back({column, old, value});
  }

  /// Inserts a missing key as the first of its map.
  void Insert(const YAML::Node& map, const std::string& text) {
    const YAML::Node first = map.begin()->first;
    const auto line = static_cast<std::size_t>(first.Mark().line),
               column = static_cast<std::size_t>(first.Mark().column);
    if (map.Style() == YAML::EmitterStyle::Flow) {
      edits_[line].push_back({column, "", text + ", "});
    } else if (lines_[line].find_first_not_of(' ') != column) {
      // The first key of a list's entry follows its dash; the new one goes below it.
      below_[LastLineOf(line, column)].push_back(std::string(column, ' ') + text);
    } else {
      above_[line].push_back(std::string(column, ' ') + text);
    }
  }

  /// Appends lines to a block that begins at `line` with keys at `column`.
  void Append(const YAML::Node& map, const std::vector<std::string>& lines) {
    const YAML::Node first = map.begin()->first;
    const auto column = static_cast<std::size_t>(first.Mark().column);
    const std::size_t last = LastLineOf(static_cast<std::size_t>(first.Mark().line), column, true);
    for (const std::string& line : lines) below_[last].push_back(std::string(column, ' ') + line);
  }

  /// Removes a key with its value from the file.
  void Remove(const YAML::Node& map, const std::string& key) {
    for (const auto& entry : map) {
      if (entry.first.Scalar() != key) continue;
      const auto line = static_cast<std::size_t>(entry.first.Mark().line);
      const std::size_t last = LastLineOf(line, static_cast<std::size_t>(entry.first.Mark().column));
      for (std::size_t i = line; i <= last; ++i) removed_.push_back(i);
    }
  }

  const YAML::Node& root() const { return root_; }

  std::string Text(const std::vector<std::string>& heading) const {
    std::string text;
    // Below the file's first comment.
    std::size_t start = 0;
    while (start < lines_.size() && !lines_[start].empty() && lines_[start].front() == '#') ++start;
    for (std::size_t i = 0; i < lines_.size(); ++i) {
      if (i == start) text += Heading(heading, start > 0);
      for (const std::string& added : above_[i]) text += added + "\n";
      if (std::find(removed_.begin(), removed_.end(), i) == removed_.end()) text += Edited(i) + "\n";
      if (const auto added = below_.find(i); added != below_.end()) {
        for (const std::string& line : added->second) text += line + "\n";
      }
    }
    return text;
  }

 private:
  struct Edit {
    std::size_t column;
    std::string old, value;
  };

  static std::string Heading(const std::vector<std::string>& heading, bool apart) {
    std::string text = apart && !heading.empty() ? "#\n" : "";
    for (const std::string& line : heading) text += "# " + line + "\n";
    return text;
  }

  // Last line of the entry that begins at `line` with its key at `column`; with `siblings`, of the whole
  // block of keys in that column. Trailing blank and comment lines are excluded.
  std::size_t LastLineOf(std::size_t line, std::size_t column, bool siblings = false) const {
    std::size_t last = line;
    for (std::size_t i = line + 1; i < lines_.size(); ++i) {
      const std::size_t indent = lines_[i].find_first_not_of(' ');
      if (indent == std::string::npos || lines_[i][indent] == '#') continue;
      // A list may have the indentation of its key.
      const bool item = lines_[i][indent] == '-' && indent == column && !siblings;
      if (indent < column || (indent == column && !siblings && !item)) break;
      last = i;
    }
    return last;
  }

  std::string Edited(std::size_t i) const {
    std::string line = lines_[i];
    const auto found = edits_.find(i);
    if (found == edits_.end()) return line;
    std::vector<Edit> edits = found->second;
    std::sort(edits.begin(), edits.end(), [](const Edit& a, const Edit& b) { return a.column > b.column; });
    std::string was;
    for (const Edit& edit : edits) {
      line.replace(edit.column, edit.old.size(), edit.value);
      if (!edit.old.empty()) was = edit.old + (was.empty() ? "" : ", " + was);
    }
    if (was.empty()) return line;
    // A comment begins at the first '#' after a blank; quoted texts in robot files contain none.
    const std::size_t comment = line.find(" #");
    if (comment == std::string::npos) return line + "  # was " + was;
    const std::size_t words = line.find_first_not_of("# ", comment);
    return line.substr(0, comment) + " # was " + was +
           (words == std::string::npos ? "" : "; " + line.substr(words));
  }

  std::string path_;
  YAML::Node root_;
  std::vector<std::string> lines_;
  std::map<std::size_t, std::vector<Edit>> edits_;
  std::vector<std::vector<std::string>> above_;
  std::map<std::size_t, std::vector<std::string>> below_;
  std::vector<std::size_t> removed_;
};

std::vector<Path> Changed(const Leaves& before, const Leaves& after) {
  std::vector<Path> changed;
  for (const auto& [path, value] : after) {
    const auto old = before.find(path);
    if (old == before.end() || !Same(old->second, value)) changed.push_back(path);
  }
  return changed;
}

Path Join(const Path& a, const Path& b) {
  Path joined = a;
  joined.insert(joined.end(), b.begin(), b.end());
  return joined;
}

// Carries one leaf outside the tendons' blocks, or in their common part.
void Carry(Editor& editor, const Path& path, const YAML::Node& resolved, const Path& resolved_path) {
  if (const YAML::Node there = editor.At(path); there.IsDefined() && there.IsScalar()) {
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

void CarryOthers(Editor& editor, const RobotParameters& before, const RobotParameters& after) {
  const YAML::Node resolved = Resolved(after);
  std::vector<Path> whole;  // lists and vectors that are inserted whole
  for (const Path& path : Changed(OtherLeaves(before), OtherLeaves(after))) {
    if (path.size() > 1 && path[1] == "unit_deviations") {
      const Path list{"body", "unit_deviations"};
      if (std::find(whole.begin(), whole.end(), list) != whole.end()) continue;
      whole.push_back(list);
      const YAML::Node body = editor.At({"body"});
      if (editor.At(list).IsDefined()) editor.Remove(body, "unit_deviations");
      std::vector<std::string> lines{"unit_deviations:"};
      for (const auto& unit : resolved["body"]["unit_deviations"]) lines.push_back("  - " + Flow(unit));
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
  std::map<std::size_t, std::vector<Path>> apart;  // keys specific to a tendon
  for (const auto& [path, by_tendon] : changes) {
    std::vector<std::size_t> sharing;
    for (std::size_t j = 0; j < tendons; ++j) {
      const bool has_own = editor.At(Join(own(j), list_of(path))).IsDefined();
      if (!has_own) {
        sharing.push_back(j);
        continue;
      }
      if (const auto change = by_tendon.find(j); change != by_tendon.end()) {
        editor.Replace(editor.At(Join(own(j), path)), Written(change->second));
      }
    }
    const bool alike = !sharing.empty() && std::all_of(sharing.begin(), sharing.end(), [&](std::size_t j) {
      return by_tendon.count(j) && Same(by_tendon.at(j), by_tendon.at(sharing.front()));
    });
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

std::vector<std::string> LinesOf(const std::string& text) {
  std::vector<std::string> lines;
  for (std::size_t from = 0; from < text.size();) {
    const std::size_t end = std::min(text.find('\n', from), text.size());
    lines.push_back(text.substr(from, end - from));
    from = end + 1;
  }
  return lines;
}

}  // namespace

double RobotDifference(const RobotParameters& a, const RobotParameters& b) {
  const RobotParameters x = sim::FoldEffects(a), y = sim::FoldEffects(b);
  Leaves left = OtherLeaves(x), right = OtherLeaves(y);
  const auto tendons = [](const RobotParameters& r) { return r.actuation ? r.actuation->tendons.size() : 0; };
  constexpr double kOther = std::numeric_limits<double>::infinity();
  if (tendons(x) != tendons(y) || x.effects.size() != y.effects.size()) return kOther;
  for (std::size_t j = 0; j < tendons(x); ++j) {
    for (const auto& [path, value] : TendonLeaves(x, j))
      left[Join({"tendon", std::to_string(j)}, path)] = value;
    for (const auto& [path, value] : TendonLeaves(y, j))
      right[Join({"tendon", std::to_string(j)}, path)] = value;
  }
  if (left.size() != right.size()) return kOther;
  double largest = 0;
  for (const auto& [path, value] : left) {
    const auto other = right.find(path);
    if (other == right.end()) return kOther;
    if (value == other->second) continue;
    const auto p = AsNumber(value), q = AsNumber(other->second);
    if (!p || !q) return kOther;
    largest = std::max(largest, std::abs(*p - *q) / std::max(std::abs(*p), std::abs(*q)));
  }
  for (const EffectSetting& effect : x.effects) {
    if (std::find(y.effects.begin(), y.effects.end(), effect) == y.effects.end()) return kOther;
  }
  return largest;
}

std::optional<KeyDifference> FirstDifference(const RobotParameters& left, const RobotParameters& right) {
  const auto leaves_of = [](const RobotParameters& robot) {
    std::map<std::string, std::string> leaves;
    const auto named = [](const Path& path) {
      std::string key;
      for (const std::string& part : path) key += (key.empty() || part.front() == '[' ? "" : ".") + part;
      return key;
    };
    for (const auto& [path, value] : OtherLeaves(robot)) leaves[named(path)] = value;
    leaves.erase("name");
    const std::size_t tendons = robot.actuation ? robot.actuation->tendons.size() : 0;
    for (std::size_t j = 0; j < tendons; ++j) {
      for (const auto& [path, value] : TendonLeaves(robot, j))
        leaves[fmt::format("actuation.{} of tendon {}", named(path), j + 1)] = value;
    }
    for (std::size_t i = 0; i < robot.effects.size(); ++i) {
      const EffectSetting& e = robot.effects[i];
      std::string text = fmt::format("{} where={}", e.name, e.where);
      for (const auto& [name, value] : e.values) text += fmt::format(" {}={}", name, value);
      leaves[fmt::format("effects[{}]", i)] = text;
    }
    return leaves;
  };
  const auto same = [](const std::string& a, const std::string& b) {
    const auto x = AsNumber(a), y = AsNumber(b);
    return a == b || (x && y && std::abs(*x - *y) <= kSame * std::max(std::abs(*x), std::abs(*y)));
  };
  const auto a = leaves_of(left), b = leaves_of(right);
  constexpr const char* kNothing = "nothing";
  for (const auto& [key, value] : a) {
    const auto other = b.find(key);
    if (other == b.end()) return KeyDifference{key, value, kNothing};
    if (!same(value, other->second)) return KeyDifference{key, value, other->second};
  }
  for (const auto& [key, value] : b) {
    if (!a.contains(key)) return KeyDifference{key, kNothing, value};
  }
  return {};
}

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
  RobotPatch patch{.text = editor.Text(heading), .robot = {}};
  patch.robot = config::ParseRobot(patch.text, path + " with the effects");
  if (const double difference = RobotDifference(patch.robot, expected); !(difference <= kSame)) {
    throw std::runtime_error(
        fmt::format("{}: the effects could not be written in this file's layout (a number would differ by "
                    "{:.1g}); write every key on its own line, as `tendril config check` prints it",
                    path, difference));
  }
  return patch;
}

std::string DiffLines(const std::string& before, const std::string& after) {
  const std::vector<std::string> a = LinesOf(before), b = LinesOf(after);
  // Longest common subsequence, from the end.
  std::vector<std::vector<int>> common(a.size() + 1, std::vector<int>(b.size() + 1, 0));
  for (std::size_t i = a.size(); i-- > 0;) {
    for (std::size_t j = b.size(); j-- > 0;) {
      common[i][j] = a[i] == b[j] ? common[i + 1][j + 1] + 1 : std::max(common[i + 1][j], common[i][j + 1]);
    }
  }
  std::vector<std::pair<char, std::string>> lines;
  for (std::size_t i = 0, j = 0; i < a.size() || j < b.size();) {
    if (i < a.size() && j < b.size() && a[i] == b[j]) {
      lines.push_back({' ', a[i++]});
      ++j;
    } else if (i < a.size() && (j == b.size() || common[i + 1][j] >= common[i][j + 1])) {
      lines.push_back({'-', a[i++]});
    } else {
      lines.push_back({'+', b[j++]});
    }
  }
  constexpr std::size_t kAround = 1;
  std::string text;
  bool gap = false;
  for (std::size_t i = 0; i < lines.size(); ++i) {
    bool near = false;
    for (std::size_t k = i >= kAround ? i - kAround : 0; k <= std::min(lines.size() - 1, i + kAround); ++k)
      near = near || lines[k].first != ' ';
    if (!near) {
      gap = true;
      continue;
    }
    if (gap && !text.empty()) text += "  ...\n";
    gap = false;
    text += fmt::format("{} {}\n", lines[i].first, lines[i].second);
  }
  return text;
}

}  // namespace tendril::robot_file
