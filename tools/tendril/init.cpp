// `tendril init`: robot and daemon files of a robot of one's own, from answers at the terminal or options.
// Knows no question.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <iostream>
#include <map>
#include <memory>
#include <stdexcept>

#include "commands.h"
#include "output.h"
#include "paths.h"
#include "tendril/config/config.h"
#include "tendril/config/keys.h"
#include "tendril/daemon/file_check.h"
#include "tendril/first_robot/files.h"
#include "tendril/first_robot/questions.h"

namespace tendril::tools {
namespace {

using first_robot::Item;
using first_robot::Question;

struct InitOptions {
  std::string folder = ".";
  std::map<std::string, std::string> given;  // by item
  bool all = false, defaults = false, force = false;
};

/// "--hole-radius" for hole_radius_m.
std::string OptionOf(const Item& item) {
  std::string name(item.name);
  if (!config::UnitOfKey(name).empty()) name.resize(name.rfind('_'));
  for (char& c : name) c = c == '_' ? '-' : c;
  return "--" + name;
}

/// The range where the key has one: choices and texts say what they accept in their meaning.
std::string Prompt(const Question& q) {
  std::string accepted;
  if (q.key.range && q.item->name != "nodes")
    accepted = fmt::format(" ({:.5g} .. {:.5g})", q.key.range->min, q.key.range->max);
  if (q.item->name != "mount" && !q.key.choices.empty())
    accepted = fmt::format(" ({})", fmt::join(q.key.choices, ", "));
  return fmt::format("{}{} [{}]: ", first_robot::Described(*q.item), accepted, q.suggestion);
}

std::string AskTerminal(const Question& q) {
  fmt::print("{}", Prompt(q));
  std::fflush(stdout);
  std::string line;
  if (!std::getline(std::cin, line))
    throw std::runtime_error("the input ended before the last answer; nothing was written");
  return line.find_first_not_of(' ') == line.npos ? q.suggestion : line;
}

first_robot::Dialogue DialogueOf(const InitOptions& options, bool terminal) {
  const auto given = [&options](const Question& q) {
    return options.given.count(std::string(q.item->name)) > 0;
  };
  const auto asked = [&options, terminal](const Question& q) {
    return terminal && (q.item->usual || options.all);
  };
  return {.answer = [&options, given, asked](const Question& q) -> std::string {
            if (given(q)) return options.given.at(std::string(q.item->name));
            return asked(q) ? AskTerminal(q) : q.suggestion;
          },
          .refused =
              [given, asked](const Question& q, const std::string& line) {
                const std::string what = line.substr(line.find(": ") + 2);
                if (given(q) || !asked(q)) throw UsageError(OptionOf(*q.item) + ": " + what);
                fmt::print("  {}\n", what);
              }};
}

void Init(const InitOptions& options) {
  const bool terminal = isatty(STDIN_FILENO) != 0 && !options.defaults;
  if (!terminal && !options.defaults && options.given.empty()) {
    throw UsageError(
        "no terminal to ask at; give answers as options (tendril init --help), or --defaults for the shipped "
        "rig's");
  }
  if (terminal)
    fmt::print(
        "Enter takes what is in brackets; a unit may follow a number, as in 60 mm, and how well it is known, "
        "as in 60 mm within 1 %.\n");
  first_robot::FilePair files;
  const first_robot::NewRobot made =
      first_robot::Ask(DialogueOf(options, terminal), [&](const std::string& name) {
        files = first_robot::FilesFor(options.folder, name, options.force);
        return files.robot.filename().string();
      });
  MakeOutputFolder(options.folder, "name another folder");
  first_robot::WriteFiles(made, files, {SchemaFile("robot"), SchemaFile("daemon")});
  const std::string robot = files.robot.string(), daemon = files.daemon.string();
  const DaemonParameters checked = config::LoadDaemon(daemon);
  const RobotParameters loaded = config::LoadRobot(robot);
  (void)daemon::CheckedText(checked, loaded, daemon);
  for (const std::string& line : daemon::FileWarnings(checked, loaded, daemon))
    fmt::print(stderr, "warning: {}\n", line);
  fmt::print(
      "{}wrote {} and {}\nnext:\n  tendril config check {} --draw {}.svg\n  tendril demo --robot {}\n"
      "  tendril sim --robot {} --daemon {}\n",
      daemon::FiguresComment(loaded), robot, daemon, robot, made.robot.name, robot, robot, daemon);
}

}  // namespace

void AddInitCommand(CLI::App& app) {
  auto options = std::make_shared<InitOptions>();
  CLI::App* command = app.add_subcommand("init",
                                         "Write commented robot and daemon files of a robot of your own, "
                                         "from answers at the terminal or options");
  command->add_option("FOLDER", options->folder, "for NAME.yaml and NAME_tendrild.yaml")
      ->capture_default_str();
  for (const Item& item : first_robot::Items()) {
    const std::string name(item.name);
    command
        ->add_option_function<std::string>(
            OptionOf(item), [options, name](const std::string& text) { options->given[name] = text; },
            first_robot::Described(item) +
                (item.per_section ? "; one for all sections, or one each, with commas" : ""))
        ->option_text("TEXT");
  }
  command->add_flag("--all", options->all, "ask everything, and not only what matters most");
  command->add_flag("--defaults", options->defaults,
                    "ask nothing: what no option gives is suggested by the shipped rig");
  command->add_flag("--force", options->force, "replace files that exist");
  command->footer(
      "A number may have a unit, --length '60 mm', and may say how well it is known, by one standard "
      "deviation:\n"
      "'60 mm within 1 %', 'nitinol within 10 %'; the file then has {value: 0.015, within: 1 %}. A value out "
      "of\n"
      "range is asked for again, or refused with the accepted range where it was an option. Exit status: 0 "
      "written,\n"
      "1 could not be written, 2 wrong use.");
  command->callback([options] { Init(*options); });
}

}  // namespace tendril::tools
