// Robot file, daemon file and the plant's faults, from the configuration's descriptions of their keys.
#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include "markdown.h"
#include "reference.h"
#include "tendril/config/keys.h"
#include "tendril/core/uncertainty.h"

namespace tendril::reference {
namespace {

using config::Key;

/// A file that is shipped, for the values that its keys have there.
struct Shipped {
  std::string name;  // "rig_60mm"
  YAML::Node root;
  bool uncertain = false;  // its numbers may say how well they are known
};

/// The value at "body.sections[].units", of a list its first entry; empty where there is none, or no single
/// one.
std::string ValueAt(const YAML::Node& root, std::string path) {
  YAML::Node at = YAML::Clone(root);
  while (!path.empty()) {
    const std::size_t dot = path.find('.');
    std::string key = path.substr(0, dot);
    path = dot == path.npos ? "" : path.substr(dot + 1);
    const bool list = key.ends_with("[]");
    if (list) key.resize(key.size() - 2);
    if (!at.IsMap() || !at[key]) return "";
    at.reset(at[key]);
    if (!list) continue;
    if (!at.IsSequence() || at.size() == 0) return "";
    at.reset(at[0]);
  }
  if (at.IsScalar()) return at.Scalar();
  if (!at.IsSequence()) return "";
  std::string items;
  for (const YAML::Node& item : at) {
    if (!item.IsScalar()) return "";
    items += (items.empty() ? "" : ", ") + item.Scalar();
  }
  return "[" + items + "]";
}

/// "15 %", "0.035 rad" where the file does not say it; empty for what is taken as known.
std::string UsualOf(const Key& key) {
  const bool number = key.type == Key::Type::kNumber || key.type == Key::Type::kInteger;
  if (key.kind != Key::Kind::kValue || !number) return "";
  const Uncertainty usual = UsualUncertainty(key.path);
  if (usual.kind == Uncertainty::Kind::kKnown) return "";
  if (usual.kind != Uncertainty::Kind::kAbsolute) return UncertaintyText(usual);
  return fmt::format("{:.2g} {}", usual.deviation, key.unit);
}

std::string Facts(const Key& key, const Shipped* shipped) {
  std::string facts = Escaped(key.accepted);
  if (!key.unit.empty()) facts += " " + Escaped(key.unit);
  const auto add = [&](const std::string& fact) { facts += (facts.empty() ? "" : " · ") + fact; };
  if (key.otherwise) {
    add("default: " + Prose(*key.otherwise));
  } else {
    add(key.without_block.empty() ? "required"
                                  : "required in its block; without the block " + Code(key.without_block));
  }
  const std::string value = shipped == nullptr ? "" : ValueAt(shipped->root, key.path);
  if (!value.empty()) add(fmt::format("{}: {}", Code(shipped->name), Code(value)));
  const std::string usual = shipped == nullptr || !shipped->uncertain ? "" : UsualOf(key);
  if (!usual.empty()) add("usually known within " + Escaped(usual));
  return facts;
}

std::string LastName(const std::string& path) { return path.substr(path.rfind('.') + 1); }
std::string ParentOf(const std::string& path) {
  const std::size_t dot = path.rfind('.');
  return dot == path.npos ? "" : path.substr(0, dot);
}

/// The keys right below `parent`, then those of its blocks and lists, each under a heading.
std::string Block(const std::vector<Key>& keys, const std::string& parent, const Shipped& shipped) {
  Table table({"Key", "Meaning"});
  std::string below;
  for (const Key& key : keys) {
    if (ParentOf(key.path) != parent) continue;
    const bool opens = key.kind == Key::Kind::kBlock || key.kind == Key::Kind::kList;
    const std::string inside = key.path + (key.kind == Key::Kind::kList ? "[]" : "");
    table.Row({opens ? Link(LastName(key.path), "", key.path) : Target(LastName(key.path), key.path),
               Prose(key.meaning) + Below(Facts(key, &shipped))});
    if (!opens) continue;
    below += Heading(2, Code(inside), key.path) + Prose(key.meaning) + "\n\n" + Block(keys, inside, shipped);
  }
  return table.Text() + below;
}

Page FilePage(const char* file, const char* title, const char* introduction, const char* source,
              const std::vector<Key>& keys, const Shipped& shipped) {
  return {file, Head(title, introduction, {source}) + Block(keys, "", shipped)};
}

}  // namespace

Page RobotFilePage(const std::filesystem::path& source) {
  return FilePage(
      "robot-file.md", "Robot file",
      "One robot as numbers, in SI units: the end of a key names its unit. Every key is required unless it "
      "has a default; unknown keys are refused with file, line and the accepted range. "
      "`tendril config check FILE` prints the resolved file.\n\n"
      "Any number may say how well it is known before any run is looked at: "
      "`youngs_modulus_Pa: {value: 2.3e10, within: 10 %}`. `within` is one standard deviation: a share of "
      "the value "
      "with a percent sign, a number in the key's own unit (`within: 2e9`), or `known` (exact) or `unknown` "
      "(its order "
      "of magnitude only). In a list, each number may: `[0, 0, {value: -9.81, within: 0.02}]`. What is said "
      "of "
      "all tendons holds for a tendon's own value under `per_tendon` too, unless it says its own; what is "
      "said of "
      "`disk_diameter_m` counts twice for both inertias. It changes no motion and no simulation. Where the "
      "file "
      "does not say it, what is usual for the kind of number holds, below as *usually known within*; a "
      "number "
      "without that is taken as known.",
      "src/config/describe_robot.h", config::RobotFileKeys(),
      {"rig_60mm", YAML::LoadFile((source / "config/robots/rig_60mm.yaml").string()), true});
}

Page DaemonFilePage(const std::filesystem::path& source) {
  return FilePage(
      "daemon-file.md", "Daemon file",
      "How `tendrild` runs one robot: control law, guards, bus, scheduling and messages. Every key is "
      "required unless it has a default. `tendril config check FILE` prints the resolved file and the share "
      "of the bus that it needs.",
      "src/config/describe_daemon.h", config::DaemonFileKeys(),
      {"tendrild.yaml", YAML::LoadFile((source / "config/tendrild.yaml").string())});
}

Page FaultsPage() {
  std::string text =
      Head("Faults of the plant",
           "What `tendril-plant --fault`, `tendril fault` and a scenario file (a list `faults`) can make "
           "the emulated drives and their bus do, for tests. On a command line a fault is its kind and "
           "its keys: `drop node=2 probability=0.1 for_s=5`.",
           {"src/config/describe_fault.h"});
  for (const config::FaultKeys& fault : config::KeysOfFaults()) {
    text += Heading(2, Code(fault.name), fault.name) + Prose(fault.meaning) + "\n\n";
    Table table({"Key", "Meaning"});
    for (const Key& key : fault.keys) {
      if (key.path != "fault")
        table.Row(
            {Target(key.path, fault.name + "." + key.path), Prose(key.meaning) + Below(Facts(key, nullptr))});
    }
    text += table.Text();
  }
  return {"faults.md", text};
}

}  // namespace tendril::reference
