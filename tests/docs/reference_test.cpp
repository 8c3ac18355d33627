// Every key, command, code, message, effect and field that the programs know stands on its page of the
// reference, with what a reader needs of it. Compared with the registries and files themselves, not with what
// made the pages of them.
#include "reference.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <fstream>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <sstream>

#include "commands.h"
#include "gap/report_examples.h"
#include "markdown.h"
#include "tendril/canopen/drive_profile.h"
#include "tendril/config/config.h"
#include "tendril/config/keys.h"
#include "tendril/control/guard_table.h"
#include "tendril/control/supervisor.h"
#include "tendril/gap/data_set.h"
#include "tendril/gap/import.h"
#include "tendril/gap/report.h"
#include "tendril/sim/effects.h"

namespace tendril::reference {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

const fs::path kSource = TENDRIL_SOURCE_DIR;

std::string Read(const fs::path& file) {
  std::ifstream in(file);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

const std::string& TextOf(const std::string& file) {
  static const std::vector<Page> pages = AllPages(kSource);
  for (const Page& page : pages) {
    if (page.file == file) return page.markdown;
  }
  throw std::runtime_error("no page " + file);
}

/// What stands beside the target of this anchor; empty where there is none.
std::string RowOf(const std::string& page, const std::string& name) {
  const std::string target = "{ #" + Anchor(name) + " }";
  std::istringstream lines(page);
  for (std::string line; std::getline(lines, line);) {
    if (line.find(target) != line.npos) return line;
  }
  return "";
}

/// The keys of a YAML text as it is written out: "bus.nodes[].tendon".
void KeysOfYaml(const std::string& yaml, std::set<std::string>& keys) {
  std::vector<std::pair<std::size_t, std::string>> open;  // indentation, name
  std::istringstream lines(yaml);
  for (std::string line; std::getline(lines, line);) {
    std::size_t indent = line.find_first_not_of(' ');
    if (indent == line.npos) continue;
    const bool entry = line.compare(indent, 2, "- ") == 0;
    while (!open.empty() && (open.back().first > indent || (open.back().first == indent && !entry)))
      open.pop_back();
    if (entry) {
      if (!open.empty() && !open.back().second.ends_with("[]")) open.back().second += "[]";
      indent += 2;
    }
    const std::size_t colon = line.find(':', indent);
    if (colon == line.npos) continue;
    std::string path;
    for (const auto& [at, name] : open) path += name + ".";
    const std::string name = line.substr(indent, colon - indent);
    keys.insert(path + name);
    open.emplace_back(indent, name);
  }
}

TEST(Reference, EveryKeyThatAFileIsWrittenWithHasItsMeaning) {
  std::set<std::string> robot, daemon;
  KeysOfYaml(config::ToYaml(config::LoadRobot((kSource / "config/robots/rig_60mm.yaml").string())), robot);
  KeysOfYaml(config::ToYaml(config::LoadDaemon((kSource / "config/tendrild.yaml").string())), daemon);
  EXPECT_GT(robot.size(), 50u);
  EXPECT_GT(daemon.size(), 60u);
  for (const std::string& key : robot)
    EXPECT_THAT(RowOf(TextOf("robot-file.md"), key), HasSubstr(" ")) << key;
  for (const std::string& key : daemon)
    EXPECT_THAT(RowOf(TextOf("daemon-file.md"), key), HasSubstr(" ")) << key;
}

TEST(Reference, AKeyTellsMeaningRangeUnitAndWhatHoldsWithoutIt) {
  for (const auto& keys : {config::RobotFileKeys(), config::DaemonFileKeys()}) {
    for (const config::Key& key : keys) {
      EXPECT_TRUE(key.meaning.ends_with(".")) << key.path << ": " << key.meaning;
      EXPECT_EQ(key.accepted.empty(), key.kind == config::Key::Kind::kBlock) << key.path;
    }
  }
  const std::string row = RowOf(TextOf("daemon-file.md"), "controller.guards.max_torque_error_N");
  EXPECT_THAT(row, HasSubstr("0.001 .. 1000 N"));
  EXPECT_THAT(row, HasSubstr("default: 1"));
  EXPECT_THAT(RowOf(TextOf("daemon-file.md"), "controller.law"), HasSubstr("paper, equilibrium"));
  EXPECT_THAT(RowOf(TextOf("daemon-file.md"), "controller.take_up.pull_N"),
              HasSubstr("without the block `2`"));
  EXPECT_THAT(RowOf(TextOf("robot-file.md"), "actuation.motor.torque_scale"), HasSubstr("default: 1"));
  EXPECT_THAT(RowOf(TextOf("robot-file.md"), "actuation.gear.ratio"), HasSubstr("`rig_60mm`: `19.0`"));
}

// The description says what may be left out; the reader must agree.
TEST(Reference, AKeyWithoutADefaultIsRequired) {
  const std::string file = config::ToYaml(config::LoadDaemon((kSource / "config/tendrild.yaml").string()));
  int required = 0;
  for (const config::Key& key : config::DaemonFileKeys()) {
    const bool top = key.path.find('.') == key.path.npos;
    if (!top || key.kind != config::Key::Kind::kValue) continue;
    const std::string without = std::regex_replace(file, std::regex("(^|\n)" + key.path + ":[^\n]*"), "$1");
    ASSERT_NE(without, file) << key.path;
    required += key.otherwise ? 0 : 1;
    if (key.otherwise) {
      EXPECT_NO_THROW(config::ParseDaemon(without, "file")) << key.path;
    } else {
      EXPECT_THROW(config::ParseDaemon(without, "file"), config::ConfigError) << key.path;
    }
  }
  EXPECT_GT(required, 0);
}

TEST(Reference, EveryFaultIsDescribedWithItsKeys) {
  for (const config::FaultKeys& fault : config::KeysOfFaults()) {
    EXPECT_THAT(TextOf("faults.md"), HasSubstr("{ #" + fault.name + " }"));
    std::string order = fault.name;
    for (const config::Key& key : fault.keys) {
      if (key.path == "fault") continue;
      EXPECT_NE(RowOf(TextOf("faults.md"), fault.name + "." + key.path), "") << key.path;
      if (!key.otherwise) order += fmt::format(" {}={}", key.path, key.path == "sensor" ? "encoder" : "1");
    }
    // What is said to be required suffices.
    EXPECT_NO_THROW(config::ParseFault(order, "fault")) << order;
  }
}

void ExpectCommand(const CLI::App& app, const std::string& command) {
  const std::string& page = TextOf("command-line.md");
  EXPECT_THAT(page, HasSubstr("{ #" + Anchor(command) + " }"));
  for (const CLI::Option* option : app.get_options([](const CLI::Option*) { return true; })) {
    const bool positional = option->get_positional(), hidden = option->get_group().empty();
    if (hidden) continue;
    const std::string name = option->get_name(positional, !positional);
    const std::string row = RowOf(page, command + "." + name.substr(0, name.find('{')));
    EXPECT_NE(row, "") << command << " " << option->get_name();
    EXPECT_FALSE(option->get_description().empty()) << command << " " << option->get_name();
  }
  for (const CLI::App* sub : app.get_subcommands([](const CLI::App*) { return true; }))
    ExpectCommand(*sub, command + " " + sub->get_name());
}

TEST(Reference, EveryCommandAndOptionIsListed) {
  ExpectCommand(*tools::MakeApp(), "tendril");
  for (const char* program : {"tendrild.--config", "tendrild.--simulated", "tendril-plant.--robot"})
    EXPECT_NE(RowOf(TextOf("command-line.md"), program), "") << program;
}

// By every line of the files that ends in a semicolon, not by the parser that makes the page.
TEST(Reference, EveryFieldOfEveryMessageIsDescribed) {
  int files = 0, fields = 0;
  for (const auto& entry : fs::directory_iterator(kSource / "lcm_types")) {
    if (entry.path().extension() != ".lcm") continue;
    ++files;
    const std::string message = entry.path().stem().string();
    std::istringstream lines(Read(entry.path()));
    const std::regex field(R"(^  (?:const )?\w+\s+(\w+)(?:\[\w+\])?(?: = \d+)?;.*)");
    for (std::string line; std::getline(lines, line);) {
      std::smatch match;
      if (!std::regex_match(line, match, field)) continue;
      ++fields;
      const std::string row = RowOf(TextOf("messages.md"), message + "." + match[1].str());
      EXPECT_NE(row, "") << message << ": " << line;
      // A constant may be self-explanatory; a field has its unit, frame or meaning in a comment.
      EXPECT_TRUE(line.find("const ") != line.npos || line.find("// ") != line.npos)
          << message << ": " << line;
      // A comment behind it, as far as its first word that Markdown leaves alone.
      const std::size_t comment = line.find("// ");
      std::smatch word;
      const std::string text = comment == line.npos ? "" : line.substr(comment);
      if (std::regex_search(text, word, std::regex("[a-z]{4,}")) && text.find('_') == text.npos) {
        EXPECT_THAT(row, HasSubstr(word.str())) << line;
      }
    }
  }
  EXPECT_GT(files, 8);
  EXPECT_GT(fields, 150);
}

TEST(Reference, EveryStatusStandsInItsBlockWithTextAndRemedy) {
  std::set<int> numbers;
#define TENDRIL_STATUS_NUMBER(name, number, text, remedy) numbers.insert(number);
  TENDRIL_STATUS_LIST(TENDRIL_STATUS_NUMBER)
#undef TENDRIL_STATUS_NUMBER
  EXPECT_EQ(numbers.size(), Statuses().size());
  for (const int number : numbers) {
    const auto status = static_cast<Status>(number);
    const std::string row = RowOf(TextOf("status-codes.md"), std::to_string(number));
    EXPECT_THAT(row, HasSubstr(Sentence(StatusText(status)))) << number;
    if (!StatusRemedy(status).empty()) {
      EXPECT_THAT(row, HasSubstr(Sentence(StatusRemedy(status)))) << number;
    }
  }
}

TEST(Reference, EveryFaultAndEveryThresholdBelongsToAGuard) {
  std::set<Status> guarded;
  std::string keys;
  for (const control::GuardEntry& guard : control::GuardTable()) {
    guarded.insert(guard.status);
    keys += std::string(guard.keys) + " ";
    EXPECT_FALSE(guard.reaction.empty()) << guard.what;
  }
  for (const StatusEntry& entry : Statuses()) {
    if (IsFault(entry.status)) {
      EXPECT_TRUE(guarded.contains(entry.status)) << entry.name;
    }
  }
  std::set<std::string> known;
  for (const auto& file : {config::RobotFileKeys(), config::DaemonFileKeys()}) {
    for (const config::Key& key : file) known.insert(key.path);
  }
  for (const std::string& key : known) {
    if (key.starts_with("controller.guards.")) {
      EXPECT_THAT(keys, HasSubstr(key + " "));
    }
  }
  std::istringstream words(keys);
  for (std::string key; words >> key;) EXPECT_TRUE(known.contains(key)) << key;
}

// A key that a status names must be a guard's where the status is one.
TEST(Reference, AGuardNamesTheThresholdsThatItsStatusNames) {
  for (const control::GuardEntry& guard : control::GuardTable()) {
    const std::string text(StatusText(guard.status));
    std::smatch key;
    if (std::regex_search(text, key, std::regex(R"((guards\.\w+))"))) {
      EXPECT_THAT(std::string(guard.keys), HasSubstr(key[1].str())) << guard.what;
    }
  }
}

TEST(Reference, EveryModeAndTransitionIsListed) {
  const std::string& page = TextOf("modes.md");
  for (const control::Transition& t : control::Supervisor::Table()) {
    const std::size_t section = page.find("{ #" + Anchor(ModeText(t.from)) + " }");
    ASSERT_NE(section, page.npos) << ModeText(t.from);
    const std::string text = page.substr(section, page.find("\n## ", section) - section);
    EXPECT_THAT(text, HasSubstr(Prose(control::EventText(t.event))));
    EXPECT_THAT(text, HasSubstr("#" + Anchor(ModeText(t.to)))) << ModeText(t.from);
  }
  EXPECT_EQ(ModeMeaning(static_cast<Mode>(static_cast<int>(kLastMode) + 1)), "");
  EXPECT_NE(ModeMeaning(kLastMode), "");
}

TEST(Reference, EveryEffectHasLawParametersBoundsAndLookAlikes) {
  const std::string& page = TextOf("effects.md");
  for (const sim::Effect& effect : sim::Effects()) {
    const std::size_t section = page.find("### `" + std::string(effect.name) + "`");
    ASSERT_NE(section, page.npos) << effect.name;
    const std::string text = page.substr(section, page.find("\n### ", section + 1) - section);
    EXPECT_THAT(text, HasSubstr(Prose(effect.physics)));
    for (const sim::EffectParameter& p : effect.parameters) {
      const std::string row = RowOf(text, fmt::format("{}.{}", effect.name, p.name));
      EXPECT_THAT(row, HasSubstr(fmt::format("{:.4g} .. {:.4g}", p.lower, p.upper))) << effect.name;
    }
    for (const std::string_view alike : effect.confusable)
      EXPECT_THAT(text, HasSubstr(fmt::format("(#{})", alike)));
  }
}

TEST(Reference, AnotherMakersDriveSaysWhatItNeeds) {
  const std::string& page = TextOf("drive-objects.md");
  const std::string text = page.substr(page.find("Another maker's drive, at start-up"));
  const auto row = [&text](const char* object) {
    const std::size_t at = text.find(std::string("`") + object + "`");
    return at == text.npos ? std::string() : text.substr(at, text.find("\n", at) - at);
  };
  const auto optional = HasSubstr("where the drive has it");
  for (const char* object : {"0x6071:00", "0x6076:00", "0x1016:01", "0x6007:00", "0x1A00:01"})
    EXPECT_THAT(row(object), AllOf(HasSubstr("</"), ::testing::Not(optional))) << object;
  for (const char* object : {"0x605E:00", "0x6072:00", "0x60C2:01", "0x6502:00"})
    EXPECT_THAT(row(object), optional) << object;
}

TEST(Reference, EveryObjectOfTheDriveIsListed) {
  for (const canopen::ObjectEntry& entry : canopen::Epos4Profile()->objects.entries()) {
    const std::string name = fmt::format("0x{:04X}:{:02X}", entry.index, entry.sub);
    EXPECT_THAT(RowOf(TextOf("drive-objects.md"), name), HasSubstr(entry.name));
  }
}

/// "causes[].parameters.NAME.ci" of every value in the report.
void PathsOf(const nlohmann::ordered_json& json, const std::string& at, std::set<std::string>& paths) {
  if (json.is_object()) {
    for (const auto& [key, value] : json.items()) PathsOf(value, at.empty() ? key : at + "." + key, paths);
  } else if (json.is_array() && !json.empty() && json.front().is_object()) {
    for (const auto& item : json) PathsOf(item, at + "[]", paths);
  } else {
    paths.insert(at);
  }
}

/// Names that the data choose, as the page has them; what an estimate or a pair consists of is said by its
/// type.
std::string AsListed(std::string path) {
  path = std::regex_replace(
      path,
      std::regex(
          R"((parameters|channels)\.(.*)\.(word|unit|text|value|ci|before|after|ceiling|floor|cut|channel)$)"),
      "$1.NAME.$3");
  path = std::regex_replace(path, std::regex(R"(^(shown_units)\..*)"), "$1.UNIT");
  path = std::regex_replace(path, std::regex(R"((parameters\.NAME)\..*)"), "$1");
  return std::regex_replace(path, std::regex(R"((\[\])?\.(name|value|ci)$)"), "");
}

TEST(Reference, EveryFieldThatAReportHoldsIsDescribed) {
  const std::string& page = TextOf("report-json.md");
  std::set<std::string> paths;
  for (const auto verdict : {gap::Verdict::kNoGap, gap::Verdict::kAttributed, gap::Verdict::kAmbiguousGroup,
                             gap::Verdict::kUnexplained, gap::Verdict::kInsufficientData}) {
    PathsOf(nlohmann::ordered_json::parse(gap::ReportJson(gap::ExampleDiagnosis(verdict))), "", paths);
  }
  EXPECT_GT(paths.size(), 100u);
  for (const std::string& path : paths) {
    const std::string exact = RowOf(page, path), listed = RowOf(page, AsListed(path));
    EXPECT_NE(exact + listed, "") << path << " as " << AsListed(path);
  }
  for (const gap::ReportField& field : gap::ReportFields()) {
    const std::string row = RowOf(page, field.path);
    EXPECT_TRUE(std::regex_search(row, std::regex(R"(\}( \| )[A-Za-z0-9`"\\])")))
        << field.path << ": " << row;
  }
}

TEST(Reference, EveryColumnOfATableIsDescribed) {
  std::string columns;
  for (const gap::ColumnText& column : gap::RunColumns()) {
    EXPECT_THAT(RowOf(TextOf("data-set.md"), std::string(column.name)), HasSubstr(Prose(column.meaning)));
    columns += std::string(column.name) + " ";
  }
  // The example is the writer's own: its columns must be among them.
  const std::string& page = TextOf("data-set.md");
  const std::size_t head = page.find("\nt_s,");
  ASSERT_NE(head, page.npos);
  std::istringstream names(page.substr(head + 1, page.find('\n', head + 1) - head - 1));
  for (std::string name; std::getline(names, name, ',');) {
    EXPECT_THAT(columns, HasSubstr(std::regex_replace(name, std::regex("_[0-9]+$"), "_j") + " "));
  }
}

// Compared with the keys that the reader's own error messages list.
TEST(Reference, EveryKeyAndChoiceOfAColumnMapIsDescribed) {
  const RobotParameters robot = config::LoadRobot((kSource / "config/robots/rig_60mm.yaml").string());
  const fs::path folder = fs::path(testing::TempDir()) / "column_map";
  fs::create_directories(folder);
  // The list after "accepted:" in the error on refusing a map.
  const auto accepted = [&](std::string map) {
    if (map.find("time:") == map.npos) map += "time: {column: t}\n";
    if (map.find("columns:") == map.npos) map += "columns: {tip: {names: [x, y, z]}}\n";
    std::ofstream(folder / "map.yaml") << map;
    std::ofstream(folder / "table.csv") << "t,x,y,z\n0,0,0,0\n1,0,0,0\n";
    try {
      gap::ImportTables((folder / "map.yaml").string(), {(folder / "table.csv").string()}, robot);
    } catch (const std::runtime_error& e) {
      const std::string text = e.what(), mark = "accepted: ";
      const std::size_t from = text.find(mark);
      EXPECT_NE(from, text.npos) << text;
      return text.substr(from + mark.size(), text.find("; correct", from) - from - mark.size());
    }
    ADD_FAILURE() << "not refused: " << map;
    return std::string();
  };
  const auto words = [](const std::string& list) {
    std::vector<std::string> found;
    std::istringstream in(list);
    for (std::string word; std::getline(in, word, ',');)
      found.push_back(word.substr(word.find_first_not_of(' ')));
    return found;
  };
  const std::string& page = TextOf("import-map.md");
  const auto expect_keys = [&](const std::string& block, const std::string& map) {
    for (const std::string& key : words(accepted(map))) {
      const bool everywhere = key == "names" || key == "scale" || key == "offset" || key == "sign";
      const std::string at = everywhere ? "columns.torque_target" : block;
      EXPECT_NE(RowOf(page, (at.empty() ? "" : at + ".") + key), "") << block << ": " << key;
    }
  };
  expect_keys("", "odd: 1\n");
  expect_keys("table", "table: {odd: 1}\n");
  expect_keys("time", "time: {column: t, odd: 1}\n");
  expect_keys("runs", "runs: {odd: 1}\n");
  expect_keys("runs.by", "runs: {by: {column: t, odd: 1}}\n");
  expect_keys("columns", "columns: {odd: 1}\n");
  expect_keys("frame", "frame: {odd: 1}\n");
  const std::pair<const char*, const char*> channels[] = {
      {"torque_target", "names: [a, b, c]"},
      {"torque_actual", "names: [a, b, c]"},
      {"motor_position", "names: [a, b, c]"},
      {"tension", "names: [a, b, c]"},
      {"tip", "names: [a, b, c]"},
      {"orientation", "names: [a, b, c, d]"},
      {"orientation", "kind: euler, names: [a, b, c], order: ZYX"},
      {"bending", "names: [a, b]"}};
  for (const auto& [channel, keys] : channels) {
    expect_keys(std::string("columns.") + channel,
                fmt::format("columns: {{{}: {{{}, odd: 1}}}}\n", channel, keys));
  }
  const std::pair<const char*, const char*> choices[] = {
      {"table.delimiter", "table: {delimiter: odd}\n"},
      {"table.decimal", "table: {decimal: odd}\n"},
      {"table.header", "table: {header: odd}\n"},
      {"time.unit", "time: {column: t, unit: odd}\n"},
      {"runs.load_cell", "runs: {load_cell: odd}\n"},
      {"columns.torque_target.unit", "columns: {torque_target: {names: [a, b, c], unit: odd}}\n"},
      {"columns.torque_actual.unit", "columns: {torque_actual: {names: [a, b, c], unit: odd}}\n"},
      {"columns.motor_position.unit", "columns: {motor_position: {names: [a, b, c], unit: odd}}\n"},
      {"columns.motor_position.at", "columns: {motor_position: {names: [a, b, c], at: odd}}\n"},
      {"columns.tension.unit", "columns: {tension: {names: [a, b, c], unit: odd}}\n"},
      {"columns.tip.unit", "columns: {tip: {names: [a, b, c], unit: odd}}\n"},
      {"columns.orientation.kind", "columns: {orientation: {names: [a, b, c, d], kind: odd}}\n"},
      {"columns.orientation.unit", "columns: {orientation: {names: [a, b, c], kind: euler, unit: odd}}\n"},
      {"columns.bending.kind", "columns: {bending: {names: [a, b], kind: odd}}\n"},
      {"columns.bending.unit", "columns: {bending: {names: [a, b], unit: odd}}\n"},
      {"frame.origin", "frame: {origin: odd}\n"}};
  for (const auto& [key, map] : choices) {
    for (const std::string& choice : words(accepted(map))) {
      EXPECT_THAT(RowOf(page, key), testing::ContainsRegex("[^a-zA-Z]" + choice + "[^a-zA-Z]")) << key;
    }
  }
}

}  // namespace
}  // namespace tendril::reference
