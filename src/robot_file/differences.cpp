// Two robots or two texts compared; see the header.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "editor.h"
#include "leaves.h"
#include "tendril/robot_file/robot_patch.h"
#include "tendril/sim/effects.h"

namespace tendril::robot_file {

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
  const auto a = leaves_of(left), b = leaves_of(right);
  constexpr const char* kNothing = "nothing";
  for (const auto& [key, value] : a) {
    const auto other = b.find(key);
    if (other == b.end()) return KeyDifference{key, value, kNothing};
    if (!Same(value, other->second, kSame)) return KeyDifference{key, value, other->second};
  }
  for (const auto& [key, value] : b) {
    if (!a.contains(key)) return KeyDifference{key, kNothing, value};
  }
  return {};
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
