#include "leaves.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <utility>

#include "tendril/config/config.h"

namespace tendril::robot_file {
namespace {

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

}  // namespace

Path Join(const Path& a, const Path& b) {
  Path joined = a;
  joined.insert(joined.end(), b.begin(), b.end());
  return joined;
}

std::optional<double> AsNumber(const std::string& text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return {};
  return value;
}

bool Same(const std::string& a, const std::string& b, double relative) {
  if (a == b) return true;
  const auto x = AsNumber(a), y = AsNumber(b);
  return x && y && std::abs(*x - *y) <= relative * std::max(std::abs(*x), std::abs(*y));
}

YAML::Node Resolved(RobotParameters robot) {
  robot.uncertain.clear();
  return YAML::Load(config::ToYaml(robot));
}

Leaves TendonLeaves(RobotParameters robot, std::size_t tendon) {
  if (!robot.actuation) return {};
  std::swap(robot.actuation->tendons[0], robot.actuation->tendons[tendon]);
  YAML::Node blocks = Resolved(robot)["actuation"];
  for (const char* key : {"nodes", "per_tendon", "tracker"}) blocks.remove(key);
  return LeavesOf(blocks);
}

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

}  // namespace tendril::robot_file
