// Plans of experiments: the ones that come with Tendril, and their files, read strictly.
// Knows nothing of robots.
#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <set>
#include <sstream>
#include <stdexcept>

#include "tendril/experiment/excitation.h"

namespace tendril::experiment {
namespace {

PlannedRun Usual(std::string_view family, double duration_s, int repeats = 0) {
  PlannedRun run = UsualRun(family);
  run.duration_s = duration_s;
  run.repeats = repeats;
  return run;
}

constexpr std::size_t kMostRuns = 100, kMostWaypoints = 10000;
constexpr int kMostRepeats = 20;

class PlanReader {
 public:
  explicit PlanReader(std::string name) : name_(std::move(name)) {}

  Plan Read(const std::string& text) {
    YAML::Node root;
    try {
      root = YAML::Load(text);
    } catch (const YAML::Exception& e) {
      throw std::runtime_error(
          fmt::format("{}:{}: not YAML: {}", name_, std::max(0, e.mark.line) + 1, e.msg));
    }
    if (!root.IsMap()) Refuse(root, "the file", "expected the keys name and runs");
    CheckKeys(root, "the file", {"name", "runs"});
    Plan plan;
    plan.name = root["name"] ? Text(root["name"], "name") : "plan";
    const YAML::Node runs = root["runs"];
    if (!runs || !runs.IsSequence() || runs.size() == 0 || runs.size() > kMostRuns) {
      Refuse(runs ? runs : root, "runs", fmt::format("expected a list of 1 to {} runs", kMostRuns));
    }
    for (const YAML::Node& run : runs) plan.runs.push_back(Run(run));
    return plan;
  }

 private:
  [[noreturn]] void Refuse(const YAML::Node& node, const std::string& key, const std::string& text) const {
    throw std::runtime_error(
        fmt::format("{}:{}: {}: {}", name_, std::max(0, node.Mark().line) + 1, key, text));
  }

  void CheckKeys(const YAML::Node& map, const std::string& what, const std::set<std::string>& known) const {
    std::set<std::string> seen;
    for (const auto& entry : map) {
      const std::string key = entry.first.IsScalar() ? entry.first.Scalar() : "";
      if (!known.count(key)) {
        Refuse(entry.first, what,
               fmt::format("there is no key '{}'; accepted: {}", key, fmt::join(known, ", ")));
      }
      if (!seen.insert(key).second)
        Refuse(entry.first, what, fmt::format("'{}' is given twice; keep one", key));
    }
  }
  std::string Text(const YAML::Node& node, const std::string& key) const {
    if (!node.IsScalar() || node.Scalar().empty() || node.Scalar().size() > 40 ||
        node.Scalar().find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789_") != std::string::npos) {
      Refuse(node, key, "expected 1 to 40 of a to z, 0 to 9 and _");
    }
    return node.Scalar();
  }
  double Number(const YAML::Node& node, const std::string& key, double low, double high) const {
    double value = 0;
    if (!node.IsScalar() || !YAML::convert<double>::decode(node, value) || !std::isfinite(value) ||
        value < low || value > high) {
      Refuse(node, key,
             fmt::format("expected a number from {} to {}{}", low, high,
                         node.IsScalar() ? fmt::format(", not '{}'", node.Scalar()) : ""));
    }
    return value;
  }
  template <class Integer>
  Integer Whole(const YAML::Node& node, const std::string& key, Integer most) const {
    Integer value = 0;
    if (!node.IsScalar() || node.Scalar().empty() ||
        node.Scalar().find_first_not_of("0123456789") != std::string::npos ||
        !YAML::convert<Integer>::decode(node, value) || value > most) {
      Refuse(node, key, fmt::format("expected a whole number from 0 to {}", most));
    }
    return value;
  }

  PlannedRun Run(const YAML::Node& node) const {
    if (!node.IsMap()) Refuse(node, "run", "expected keys such as family and duration_s");
    CheckKeys(
        node, "run",
        {"family", "amplitude_rad", "duration_s", "repeats", "seed", "bending_targets", "tension_targets"});
    if (!node["family"]) Refuse(node, "run", "family is missing; it names the experiment");
    const std::string family = Text(node["family"], "family");
    const bool bending = static_cast<bool>(node["bending_targets"]),
               tension = static_cast<bool>(node["tension_targets"]);
    PlannedRun run;
    const std::string where = fmt::format("{}:{}", name_, node.Mark().line + 1);
    if (bending || tension) {
      if (bending && tension)
        Refuse(node, "run", "bending_targets and tension_targets exclude each other; keep one");
      for (const char* key : {"amplitude_rad", "duration_s", "seed"}) {
        if (node[key]) Refuse(node[key], key, "it follows from the given targets; leave it out");
      }
      run.family = family;
      run.targets = bending ? PlannedRun::Targets::kBending : PlannedRun::Targets::kTension;
      run.waypoints =
          Waypoints(node[bending ? "bending_targets" : "tension_targets"],
                    bending ? "bending_targets" : "tension_targets", bending ? "bending_rad" : "tension_N");
    } else {
      const auto known = Families();
      if (std::find(known.begin(), known.end(), family) == known.end()) {
        Refuse(node["family"], "family",
               fmt::format("there is no experiment '{}'; accepted: {}, or any name with bending_targets or "
                           "tension_targets",
                           family, fmt::join(known, ", ")));
      }
      run = UsualRun(family);
      if (node["amplitude_rad"]) run.amplitude_rad = Number(node["amplitude_rad"], "amplitude_rad", 0.01, 12);
      if (node["duration_s"]) run.duration_s = Number(node["duration_s"], "duration_s", 3, 600);
      if (node["seed"]) run.seed = Whole<std::uint64_t>(node["seed"], "seed", UINT64_MAX);
    }
    if (node["repeats"]) run.repeats = Whole<int>(node["repeats"], "repeats", kMostRepeats);
    run.where = where;
    return run;
  }

  std::vector<Waypoint> Waypoints(const YAML::Node& list, const std::string& key,
                                  const std::string& values) const {
    if (!list.IsSequence() || list.size() == 0 || list.size() > kMostWaypoints) {
      Refuse(list, key,
             fmt::format("expected a list of 1 to {} of {{t_s: 1.5, {}: [...]}}", kMostWaypoints, values));
    }
    std::vector<Waypoint> waypoints;
    for (const YAML::Node& entry : list) {
      if (!entry.IsMap()) Refuse(entry, key, fmt::format("expected {{t_s: 1.5, {}: [...]}}", values));
      CheckKeys(entry, key, {"t_s", values});
      if (!entry["t_s"] || !entry[values])
        Refuse(entry, key, fmt::format("expected {{t_s: 1.5, {}: [...]}}", values));
      Waypoint w;
      w.t_s = Number(entry["t_s"], "t_s", 0.001, 600);
      if (!waypoints.empty() && w.t_s <= waypoints.back().t_s) {
        Refuse(entry["t_s"], "t_s",
               fmt::format("{} does not come after {}; times increase", w.t_s, waypoints.back().t_s));
      }
      if (!entry[values].IsSequence() || entry[values].size() == 0 || entry[values].size() > 16) {
        Refuse(entry[values], values, "expected a list of numbers");
      }
      for (const YAML::Node& value : entry[values]) w.value.push_back(Number(value, values, -100, 100));
      waypoints.push_back(std::move(w));
    }
    return waypoints;
  }

  std::string name_;
};

}  // namespace

Plan StandardPlan() {
  return {"standard",
          {Usual("triangle", 20, 1), Usual("cocontraction", 20), Usual("circle", 13, 1), Usual("steps", 9),
           Usual("multisine", 12), Usual("ladder", 12), Usual("hold", 22), Usual("sway", 6)}};
}

Plan QuickPlan() {
  return {"quick",
          {Usual("triangle", 10), Usual("cocontraction", 10), Usual("circle", 9), Usual("steps", 6),
           Usual("multisine", 7), Usual("ladder", 6), Usual("hold", 5), Usual("sway", 4, 1)}};
}

Plan NamedPlan(const std::string& name) {
  if (name == "standard") return StandardPlan();
  if (name == "quick") return QuickPlan();
  throw std::invalid_argument("there is no plan '" + name + "'; accepted: standard, quick");
}

Plan ParsePlan(const std::string& yaml, const std::string& name_for_errors) {
  return PlanReader(name_for_errors).Read(yaml);
}

Plan LoadPlan(const std::string& path) {
  std::ifstream in(path);
  std::stringstream text;
  text << in.rdbuf();
  if (!in)
    throw std::runtime_error(
        path + ": cannot be read; `tendril excite --print-plan standard` prints a plan to edit");
  return ParsePlan(text.str(), path);
}

std::string ToYaml(const Plan& plan) {
  std::string text =
      "# Experiments for `tendril excite --plan FILE` and `tendril gap simulate --plan FILE`.\n"
      "# family: " +
      fmt::format("{}", fmt::join(Families(), ", ")) +
      ";\n"
      "#   or any other name with bending_targets: [{t_s: 2, bending_rad: [0.8, 0]}, ...] (us, vs of "
      "each\n"
      "#   section) or tension_targets: [{t_s: 2, tension_N: [1, 1, 1]}, ...] (at the base); straight "
      "between.\n"
      "# amplitude_rad: bend of the whole robot; reduced where the tensions would pass three quarters of the "
      "limit.\n"
      "# duration_s: of the recorded run, with 0.5 s of rest at its start.\n"
      "# repeats: identical repetitions in addition to the run itself, for the noise floor. seed: of "
      "multisine's "
      "phases.\n\n";
  text += fmt::format("name: {}\nruns:\n", plan.name);
  for (const PlannedRun& run : plan.runs) {
    if (run.targets == PlannedRun::Targets::kFamily) {
      text += fmt::format("  - {{family: {}, amplitude_rad: {}, duration_s: {}, repeats: {}, seed: {}}}\n",
                          run.family, run.amplitude_rad, run.duration_s, run.repeats, run.seed);
      continue;
    }
    const bool bending = run.targets == PlannedRun::Targets::kBending;
    text += fmt::format("  - family: {}\n    repeats: {}\n    {}:\n", run.family, run.repeats,
                        bending ? "bending_targets" : "tension_targets");
    for (const Waypoint& w : run.waypoints) {
      text += fmt::format("      - {{t_s: {}, {}: [{}]}}\n", w.t_s, bending ? "bending_rad" : "tension_N",
                          fmt::join(w.value, ", "));
    }
  }
  return text;
}

}  // namespace tendril::experiment
