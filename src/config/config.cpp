// Reads files into structs and writes the resolved configuration back as text. Knows the kinds of file; their
// keys are in describe_robot.h, describe_daemon.h and describe_fault.h.
#include "tendril/config/config.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <sstream>
#include <type_traits>

#include "describe_daemon.h"
#include "describe_fault.h"
#include "describe_robot.h"
#include "document.h"
#include "writer.h"

namespace tendril::config {

/// Common blocks are those of the first tendon; tendons that differ, or whose numbers are known in another
/// way, are written below `per_tendon`.
void WriteActuation(Writer& out, ActuationParameters& p);

namespace {

constexpr std::string_view kRobotKeys =
    "a robot file with name, body, limits and, for a driven robot, actuation";
constexpr std::string_view kDaemonKeys = "a daemon file with robot, controller, bus, realtime and lcm";
constexpr std::string_view kAnyKeys =
    "a robot file (name, body, limits) or a daemon file (robot, controller, bus)";

constexpr std::string_view kScenarioKeys = "a scenario file with faults";

// Upper limit for the release of tensions after a fault.
constexpr double kLongestRamp_s = 30;

enum class Kind { kRobot, kDaemon, kScenario, kUnknown };

Kind KindOfMap(const YAML::Node& map) {
  for (const auto& entry : map) {
    if (!entry.first.IsScalar()) continue;
    const std::string& key = entry.first.Scalar();
    if (key == "body" || key == "limits" || key == "actuation") return Kind::kRobot;
    if (key == "bus" || key == "controller" || key == "realtime" || key == "lcm" || key == "robot")
      return Kind::kDaemon;
    if (key == "faults") return Kind::kScenario;
  }
  return Kind::kUnknown;
}

std::string_view KindText(Kind kind) {
  switch (kind) {
    case Kind::kRobot:
      return "robot";
    case Kind::kDaemon:
      return "daemon";
    case Kind::kScenario:
      return "scenario";
    case Kind::kUnknown:
      break;
  }
  return "other";
}

std::string ReadFile(const std::string& path) {
  namespace fs = std::filesystem;
  constexpr std::uintmax_t kLargest = 1 << 20;
  const auto refuse = [&](std::string_view why, std::string_view remedy) {
    throw ConfigError(fmt::format("{}: {}; accepted: a readable YAML file; {}", path, why, remedy));
  };
  std::error_code error;
  const auto status = fs::status(path, error);
  if (!fs::exists(status)) {
    refuse(error ? error.message() : std::string("no such file"), "check the path");
  }
  if (fs::is_directory(status)) refuse("is a directory", "name a file in it");
  if (!fs::is_regular_file(status)) refuse("is not an ordinary file", "name one");
  if (fs::file_size(path, error) > kLargest) refuse("is larger than 1 MiB", "check that it is the right one");
  errno = 0;
  std::ifstream in(path, std::ios::binary);
  if (!in) refuse(fmt::format("cannot be read: {}", std::strerror(errno)), "check its permissions");
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

template <class T>
T Parse(const std::string& yaml, const Source& source, Kind expected, std::string_view keys) {
  Layer document = ParseDocument(yaml, source, keys);
  const Kind kind = KindOfMap(document.map);
  if (kind != expected && kind != Kind::kUnknown) {
    throw ConfigError(fmt::format("{}:{}: this is a {} file; accepted: {}; name the other file", source.name,
                                  document.line, KindText(kind), keys));
  }
  T value;
  Source known = source;
  if constexpr (std::is_same_v<T, RobotParameters>) known.uncertain = &value.uncertain;
  Reader reader(known, {std::move(document)});
  Describe(reader, value);
  reader.Finish();
  return value;
}

template <class T>
std::string BlocksOf(T value, const std::map<std::string, Uncertainty>* uncertain = nullptr) {
  Writer out(uncertain);
  Describe(out, value);
  return out.Finish();
}

}  // namespace

ConfigError ErrorAt(const std::string& path, std::string_view key, const std::string& text) {
  const Source source{path};
  try {
    Reader(source, {ParseDocument(ReadFile(path), source, kAnyKeys)}).Refuse(key, text);
  } catch (const ConfigError& e) {
    // If the file can no longer be read, this error is still the one to report.
    const std::string line = e.what();
    return line.ends_with(text) ? e : ConfigError(fmt::format("{}: {}: {}", path, key, text));
  }
}

void WriteActuation(Writer& out, ActuationParameters& p) {
  out.BeginBlock("actuation");
  if (!p.tendons.empty()) {
    std::vector<long long> nodes;
    for (std::size_t j = 0; j < p.tendons.size(); ++j) {
      if (p.HasDrive(static_cast<int>(j))) nodes.push_back(p.tendons[j].node_id);
    }
    out.Integers("nodes", nodes, {}, {}, {});
    if (!p.pairs.empty()) DescribePairs(out, p.pairs);
    Describe(out, p.tendons.front());
    const std::string common = BlocksOf(p.tendons.front());
    bool open = false;
    for (std::size_t j = 0; j < p.tendons.size(); ++j) {
      const std::string own = fmt::format("actuation.per_tendon.{}.", j + 1);
      if (!out.HasUncertainty(own) && BlocksOf(p.tendons[j]) == common) continue;
      if (!open) out.BeginBlock("per_tendon");
      open = true;
      out.Block(std::to_string(j + 1), p.tendons[j], {});
    }
    if (open) out.EndBlock();
  }
  DescribeTracker(out, p.tracker);
  out.EndBlock();
}

RobotParameters ParseRobot(const std::string& yaml, const std::string& name_for_errors) {
  return Parse<RobotParameters>(yaml, {name_for_errors}, Kind::kRobot, kRobotKeys);
}

RobotParameters LoadRobot(const std::string& path) { return ParseRobot(ReadFile(path), path); }

DaemonParameters ParseDaemon(const std::string& yaml, const std::string& name_for_errors) {
  return Parse<DaemonParameters>(yaml, {name_for_errors}, Kind::kDaemon, kDaemonKeys);
}

DaemonParameters LoadDaemon(const std::string& path) {
  DaemonParameters daemon = ParseDaemon(ReadFile(path), path);
  namespace fs = std::filesystem;
  const auto beside = [&path](const std::string& file) {
    return fs::absolute(fs::absolute(path).parent_path() / file).lexically_normal();
  };
  const fs::path robot = beside(daemon.robot_file);
  std::error_code error;
  if (!fs::exists(robot, error)) {
    throw ErrorAt(
        path, "robot",
        fmt::format("no such file: {}; accepted: {}; correct the path", robot.string(), kPathRule.accepted));
  }
  daemon.robot_file = robot.string();
  if (!daemon.lcm.key_file.empty()) daemon.lcm.key_file = beside(daemon.lcm.key_file).string();
  for (NodeParameters& node : daemon.bus.nodes) {
    if (node.eds_file.empty()) continue;
    const fs::path eds = beside(node.eds_file);
    if (!fs::exists(eds, error)) {
      throw ErrorAt(path, "bus.nodes",
                    fmt::format("node {} has eds: {}: no such file; accepted: {}; correct the path",
                                node.node_id, eds.string(), kEdsRule.accepted));
    }
    node.eds_file = eds.string();
  }
  return daemon;
}

std::vector<FaultParameters> LoadScenario(const std::string& path) {
  return Parse<Scenario>(ReadFile(path), {path}, Kind::kScenario, kScenarioKeys).faults;
}

FaultParameters ParseFault(const std::string& text, const std::string& name_for_errors) {
  constexpr std::string_view kForm = "a kind, then key=value, e.g. drop node=2 probability=0.1 for_s=5";
  // Rewritten as the YAML of one scenario entry, so that keys and errors are the same.
  std::string yaml;
  std::istringstream words(text.substr(0, 1000));
  for (std::string word; words >> word;) {
    const auto equals = word.find('=');
    const bool plain = std::all_of(word.begin(), word.end(), [](unsigned char c) {
      return std::isalnum(c) || c == '_' || c == '=' || c == '.' || c == '-' || c == '+';
    });
    if (!plain || (equals == std::string::npos) != yaml.empty()) {
      throw ConfigError(fmt::format("{}: '{}' is not understood; accepted: {}; correct it", name_for_errors,
                                    plain ? word : "a character", kForm));
    }
    yaml += yaml.empty() ? "{fault: " + word
                         : fmt::format(", {}: {}", word.substr(0, equals), word.substr(equals + 1));
  }
  if (yaml.empty())
    throw ConfigError(fmt::format("{}: is empty; accepted: {}; write one", name_for_errors, kForm));
  try {
    return Parse<FaultParameters>(yaml + "}", {name_for_errors}, Kind::kUnknown, kForm);
  } catch (const ConfigError& e) {  // a single line has no line number
    const std::string line = e.what(), lead = name_for_errors + ":1";
    throw line.starts_with(lead) ? ConfigError(name_for_errors + line.substr(lead.size())) : e;
  }
}

std::string ToYaml(const RobotParameters& robot) { return BlocksOf(robot, &robot.uncertain); }
std::string ToYaml(const DaemonParameters& daemon) { return BlocksOf(daemon); }

namespace {

// Each tendon is pulled by one node, whose drive reads what the robot file says is wired to it.
void CheckNodes(const DaemonParameters& daemon, const RobotParameters& robot,
                const std::string& daemon_path) {
  const int tendons = robot.body.tendons();
  for (const NodeParameters& node : daemon.bus.nodes) {
    if (node.tendon < 1 || node.tendon > tendons) {
      throw ErrorAt(
          daemon_path, "bus.nodes",
          fmt::format(
              "node {} pulls tendon {}, which {} does not have; accepted: tendons 1 .. {}; remove it or "
              "name another robot",
              node.node_id, node.tendon, robot.name, tendons));
    }
  }
  for (const NodeParameters& node : daemon.bus.nodes) {
    const TendonPair* pair = robot.actuation->PairOf(node.tendon - 1);
    if (robot.actuation->HasDrive(node.tendon - 1)) continue;
    throw ErrorAt(
        daemon_path, "bus.nodes",
        fmt::format(
            "node {} pulls tendon {} of {}, whose motor is that of tendon {}; accepted: one "
            "node for a pair, at its first tendon; write tendon: {} if it is the pair's, or remove it",
            node.node_id, node.tendon, robot.name, pair->first + 1, pair->first + 1));
  }
  for (int tendon = 1; tendon <= tendons; ++tendon) {
    if (!robot.actuation->HasDrive(tendon - 1)) continue;
    const auto pulls = [&](const NodeParameters& node) { return node.tendon == tendon; };
    const auto count = std::count_if(daemon.bus.nodes.begin(), daemon.bus.nodes.end(), pulls);
    if (count != 1) {
      throw ErrorAt(
          daemon_path, "bus.nodes",
          fmt::format(
              "tendon {} of {} has {} nodes; accepted: every tendon 1 .. {} exactly once, of a pair the "
              "first; correct the list",
              tendon, robot.name, count, tendons));
    }
  }
  for (const NodeParameters& node : daemon.bus.nodes) {
    const auto& drive = robot.actuation->tendons[static_cast<std::size_t>(node.tendon - 1)];
    if (node.profile == DriveKind::kEpos4 || !node.analog_input.empty() ||
        drive.load_cell.place == LoadCellPlace::kNone) {
      continue;
    }
    throw ErrorAt(
        daemon_path, "bus.nodes",
        fmt::format("node {} pulls tendon {}, which has a load cell in {}, and names no object that "
                    "reads it; accepted: analog_input: OBJECT beside its eds, or load_cell.place: "
                    "none in the robot file; correct the one or the other",
                    node.node_id, node.tendon, robot.name));
  }
  std::set<int> ids;
  for (const NodeParameters& node : daemon.bus.nodes) {
    if (!ids.insert(node.node_id).second) {
      throw ErrorAt(
          daemon_path, "bus.nodes",
          fmt::format("node_id {} twice; accepted: 1 .. 126, all different; correct one", node.node_id));
    }
  }
}

// Values of the controller that this robot cannot bear or lacks the sensor for.
void CheckController(const DaemonParameters& daemon, const RobotParameters& robot,
                     const std::string& daemon_path) {
  if (daemon.controller.guards.slack_tension_N >= robot.limits.min_tension_N) {
    throw ErrorAt(
        daemon_path, "controller.guards.slack_tension_N",
        fmt::format(
            "{} is not below the pretension of {}; accepted: below limits.min_tension_N, {} N; lower it",
            daemon.controller.guards.slack_tension_N, robot.name, robot.limits.min_tension_N));
  }
  const double slowest_Nps = robot.limits.max_tension_base_N / kLongestRamp_s;
  if (daemon.controller.pretension_ramp_Nps < slowest_Nps) {
    throw ErrorAt(
        daemon_path, "controller.pretension_ramp_Nps",
        fmt::format("{:g} N/s would take {} down from its {:g} N in {:.0f} s; accepted: {:.3g} N/s or more, "
                    "which takes {:g} s; raise it",
                    daemon.controller.pretension_ramp_Nps, robot.name, robot.limits.max_tension_base_N,
                    robot.limits.max_tension_base_N / daemon.controller.pretension_ramp_Nps, slowest_Nps,
                    kLongestRamp_s));
  }
  if (daemon.controller.tip_feedback && !robot.actuation->tracker) {
    throw ErrorAt(daemon_path, "controller.tip_feedback",
                  fmt::format("on, but {} has no tracker; accepted: off, or a robot file with the block "
                              "actuation.tracker; correct the one or the other",
                              robot.name));
  }
  if (daemon.controller.take_up.pull_N > robot.limits.max_tension_motor_N) {
    throw ErrorAt(
        daemon_path, "controller.take_up.pull_N",
        fmt::format(
            "{} N is more than {} can bear; accepted: limits.max_tension_motor_N, {} N, or less; lower it",
            daemon.controller.take_up.pull_N, robot.name, robot.limits.max_tension_motor_N));
  }
}

}  // namespace

void CheckTogether(const DaemonParameters& daemon, const RobotParameters& robot,
                   const std::string& daemon_path) {
  if (!robot.actuation) {
    throw ErrorAt(
        daemon_path, "robot",
        fmt::format(
            "{} has no actuation, so there is nothing to drive; accepted: a robot file with the block "
            "actuation; name another one",
            robot.name));
  }
  CheckNodes(daemon, robot, daemon_path);
  CheckController(daemon, robot, daemon_path);
}

void RequireBendingOnly(const BodyParameters& body, const std::string& robot_path, std::string_view what) {
  for (std::size_t k = 0; k < body.sections.size(); ++k) {
    const SectionParameters& s = body.sections[k];
    const std::string section = fmt::format("body.sections[{}]", k + 1);
    std::vector<std::string_view> others;
    if (s.torsion) others.emplace_back("torsion");
    if (s.extension) others.emplace_back("extension");
    if (s.shear) others.emplace_back("shear");
    if (!others.empty()) {
      throw ErrorAt(robot_path, section + ".strains",
                    fmt::format("{}: {} knows bending alone; accepted: [bending]; remove the "
                                "others and their keys in a copy of the file",
                                fmt::join(others, ", "), what));
    }
    if (s.units_per_disk != 1) {
      throw ErrorAt(robot_path, section + ".units_per_disk",
                    fmt::format("{}: {} knows one unit a disk; accepted: 1; use as many units as "
                                "disks in a copy of the file",
                                s.units_per_disk, what));
    }
  }
}

std::string KindOf(const std::string& path) {
  const Source source{path};
  const Layer document = ParseDocument(ReadFile(path), source, kAnyKeys);
  const Kind kind = KindOfMap(document.map);
  if (kind != Kind::kUnknown) return std::string(KindText(kind));
  throw ConfigError(fmt::format("{}:{}: neither a robot nor a daemon file; accepted: {}; name another file",
                                path, document.line, kAnyKeys));
}

}  // namespace tendril::config
