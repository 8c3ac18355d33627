// runs.yaml: its keys, entries and names.
#include "runs_file.h"

#include <fmt/core.h>
#include <fmt/ranges.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <map>
#include <set>
#include <stdexcept>
#include <string_view>

#include "file_bytes.h"
#include "sources.h"
#include "tendril/core/load_cell_place.h"
#include "text.h"
#include "yaml_block.h"

namespace tendril::gap {
namespace {

namespace fs = std::filesystem;

// A larger list of runs is refused.
constexpr std::size_t kMostList = std::size_t{4} << 20;

constexpr RunsKey kRunsKeys[] = {
    {"runs", false, "a list", "the file itself is the list",
     "The runs; a file's name alone stands for its entry."},
    {"tracker_frame", false, "given, fit", "given",
     "fit: the pose of the tracker's frame relative to the base is unknown, and the diagnosis fits it."},
    {"file", true, "a CSV or LCM log, relative to the folder", "", "Where the run is."},
    {"family", true, "a name", "unknown",
     "Kind of motion. A cause is tested on held-out families, so there should be at least two."},
    {"repeat_of", true, "a file of the list, none", "none",
     "The run that this one repeats unchanged; what differs between them is the noise floor."},
    {"before", true, "a file of the list, none", "none",
     "The run of the same commands from before the robot changed; the diagnosis is then of the change."},
    {"load_cell", true, kLoadCellPlaceWords, "the robot file's", "Where the load cells sit."},
    {"motor_zero", true, "at_pretension, at_rest", "at_pretension",
     "at_rest: motor positions count from where friction had left the robot, not from the straight robot at "
     "pretension."},
};

std::vector<std::string_view> KnownKeys(bool of_a_run) {
  std::vector<std::string_view> names;
  for (const RunsKey& key : kRunsKeys) {
    if (key.of_a_run == of_a_run) names.push_back(key.name);
  }
  return names;
}

bool IsNoName(std::string_view text) {
  const std::string low = LowerCase(Trimmed(text));
  return low.empty() || low == "none" || low == "null" || low == "~";
}

/// The text of a key, trimmed; empty when it is missing, null or not a scalar.
std::string Text(const YAML::Node& entry, const char* key) {
  const YAML::Node node = entry[key];
  return node && node.IsScalar() ? std::string(Trimmed(node.Scalar())) : std::string();
}

/// Keys that have no meaning here, perhaps typing errors.
void NoteUnknown(const YAML::Node& map, const std::vector<std::string_view>& known, const std::string& where,
                 std::vector<std::string>& notes) {
  std::string unknown;
  for (const auto& pair : map) {
    const std::string key = pair.first.IsScalar() ? pair.first.Scalar() : "?";
    if (std::find(known.begin(), known.end(), key) == known.end())
      unknown += (unknown.empty() ? "" : ", ") + Printable(key);
  }
  if (!unknown.empty()) {
    notes.push_back(
        fmt::format("{}: not known and not used: {}; accepted: {}", where, unknown, fmt::join(known, ", ")));
  }
}

ListedRun ReadEntry(const YAML::Node& entry, const std::string& where, std::vector<std::string>& notes) {
  ListedRun listed;
  NoteUnknown(entry, KnownKeys(true), where, notes);
  listed.file = Text(entry, "file");
  if (const std::string family = Text(entry, "family"); !family.empty()) listed.family = family;
  if (const std::string name = Text(entry, "repeat_of"); !IsNoName(name)) listed.repeat_of = RunName(name);
  if (const std::string name = Text(entry, "before"); !IsNoName(name)) listed.before = RunName(name);
  const std::string place = LowerCase(Text(entry, "load_cell"));
  listed.load_cell = FindLoadCellPlace(place);
  if (!place.empty() && !listed.load_cell) {
    notes.push_back(
        fmt::format("{}: load_cell '{}' is not known; accepted: {}; the robot file's value is used", where,
                    Printable(place), kLoadCellPlaceWords));
  }
  const std::string zero = LowerCase(Text(entry, "motor_zero"));
  listed.zero_at_rest = zero == "at_rest";
  if (!zero.empty() && zero != "at_rest" && zero != "at_pretension") {
    notes.push_back(fmt::format(
        "{}: motor_zero '{}' is not known; accepted: at_pretension, at_rest; at_pretension is used", where,
        Printable(zero)));
  }
  return listed;
}

}  // namespace

std::span<const RunsKey> RunsFileKeys() { return kRunsKeys; }

std::vector<ListedRun> ReadList(const fs::path& file, DataSet& set) {
  std::vector<std::string>& notes = set.notes;
  const std::string text = ReadBytes(file);
  if (text.size() > kMostList) throw std::runtime_error(file.string() + ": too large for a list of runs");
  YAML::Node list;
  try {
    list = YAML::Load(text);
    RefuseKeysTwice(list, file.string());
    if (list.IsMap() && list["tracker_frame"]) {
      const std::string frame = LowerCase(Text(list, "tracker_frame"));
      if (frame == "fit") set.fit_frame = true;
      if (frame != "fit" && frame != "given") {
        notes.push_back(
            fmt::format("{}:{}: tracker_frame '{}' is not known; accepted: given, fit; given is used",
                        file.string(), list["tracker_frame"].Mark().line + 1, Printable(frame)));
      }
    }
    if (list.IsMap() && list["runs"]) {
      NoteUnknown(list, KnownKeys(false), file.string(), notes);
      list.reset(list["runs"]);
      if (list.IsNull()) list = YAML::Node(YAML::NodeType::Sequence);
    }
  } catch (const YAML::Exception& e) {
    throw std::runtime_error(fmt::format("{}:{}: not YAML ({})", file.string(), e.mark.line + 1, e.msg));
  }
  if (!list.IsSequence()) {
    throw std::runtime_error(
        file.string() +
        ":1: no list of runs; accepted: a list, or the key 'runs' with a list, of entries "
        "such as {file: circle_1.csv, family: circle, repeat_of: none}");
  }
  std::vector<ListedRun> runs;
  for (const YAML::Node& entry : list) {
    const std::string where = fmt::format("{}:{}", file.string(), entry.Mark().line + 1);
    ListedRun listed;
    if (entry.IsScalar()) {
      listed.file = std::string(Trimmed(entry.Scalar()));
    } else if (entry.IsMap()) {
      listed = ReadEntry(entry, where, notes);
    }
    if (listed.file.empty()) {
      notes.push_back(where + ": an entry without a file is left out; accepted: {file: circle_1.csv, ...}");
      continue;
    }
    runs.push_back(std::move(listed));
  }
  if (list.size() == 0)
    notes.push_back(file.string() +
                    ": its list is empty; every CSV file is taken as a run of unknown family");
  return runs;
}

void SettleNames(std::vector<Run>& runs, std::size_t from, std::vector<std::string>& notes) {
  std::set<std::string> taken;
  for (std::size_t i = 0; i < from; ++i) taken.insert(runs[i].name);
  std::map<std::string, std::string> root;      // by the names that runs.yaml may use for a run
  std::map<std::string, std::string> declared;  // repeat_of by run, as in runs.yaml
  const auto before_of = [&](const std::string& name) {
    const auto run = std::find_if(runs.begin() + static_cast<std::ptrdiff_t>(from), runs.end(),
                                  [&](const Run& r) { return r.name == name; });
    return run->before;
  };
  for (std::size_t i = from; i < runs.size(); ++i) {
    const std::string plain = runs[i].name;
    for (int n = 2; !taken.insert(runs[i].name).second; ++n) runs[i].name = fmt::format("{}#{}", plain, n);
    root.emplace(plain, runs[i].name);
    declared.emplace(runs[i].name, runs[i].repeat_of);
  }
  for (std::size_t i = from; i < runs.size(); ++i) {
    Run& run = runs[i];
    if (run.before.empty()) continue;
    const auto found = root.find(run.before);
    if (found == root.end() || found->second == run.name || !before_of(found->second).empty()) {
      notes.push_back(
          fmt::format("run {}: before: '{}' is {}; the run is compared with the model alone; accepted: "
                      "another run of runs.yaml that has no 'before' itself",
                      Printable(run.name), Printable(run.before),
                      found == root.end() ? "not there" : "not a run from before"));
      run.before.clear();
    } else {
      run.before = found->second;
    }
  }
  std::map<std::string, std::string> stands_in;  // replacement for a missing original
  for (std::size_t i = from; i < runs.size(); ++i) {
    Run& run = runs[i];
    std::string at = run.name, original = run.repeat_of;
    std::set<std::string> seen{at};
    bool circle = false;
    while (!original.empty()) {
      const auto found = root.find(original);
      if (found == root.end()) break;
      at = found->second;
      if (!seen.insert(at).second) {
        circle = true;
        break;
      }
      original = declared[at];
    }
    if (circle) {
      notes.push_back(
          fmt::format("run {}: repeat_of forms a cycle; not taken as a repetition", Printable(run.name)));
      run.repeat_of.clear();
    } else if (!original.empty()) {
      // The original is missing: the first of its repetitions takes its place.
      const auto [place, first] = stands_in.emplace(original, run.name);
      if (first) {
        notes.push_back(fmt::format("run {}: its original '{}' is missing; it stands in for it",
                                    Printable(run.name), Printable(original)));
      }
      run.repeat_of = first ? std::string() : place->second;
    } else {
      run.repeat_of = at == run.name ? std::string() : at;
    }
  }
}

std::string FileOf(const std::string& run) { return RunName(run) + ".csv"; }

std::string ListText(const DataSet& set) {
  YAML::Emitter list;
  list << YAML::BeginMap;
  if (set.fit_frame) list << YAML::Key << "tracker_frame" << YAML::Value << "fit";
  list << YAML::Key << "runs" << YAML::Value << YAML::BeginSeq;
  for (const Run& run : set.runs) {
    list << YAML::BeginMap << YAML::Key << "file" << YAML::Value << FileOf(run.name) << YAML::Key << "family"
         << YAML::Value << (run.family.empty() ? "unknown" : run.family) << YAML::Key << "repeat_of"
         << YAML::Value << (run.repeat_of.empty() ? "none" : FileOf(run.repeat_of));
    if (!run.before.empty()) list << YAML::Key << "before" << YAML::Value << FileOf(run.before);
    list << YAML::Key << "load_cell" << YAML::Value << std::string(LoadCellPlaceText(run.load_cell));
    if (run.zero_at_rest) list << YAML::Key << "motor_zero" << YAML::Value << "at_rest";
    list << YAML::EndMap;
  }
  list << YAML::EndSeq << YAML::EndMap;
  return std::string(list.c_str()) + "\n";
}

}  // namespace tendril::gap
