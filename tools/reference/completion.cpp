// Completions of the shells and the list of commands, from the programs' own command lines.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <utility>

#include "arguments.h"
#include "commands.h"
#include "plant_options.h"
#include "reference.h"

namespace tendril::reference {
namespace {

struct Word {
  std::string text, meaning;
};

/// A program or one of its commands: what may follow, and the values that an option takes.
struct Place {
  std::string command;      // "tendril gap diagnose"
  std::vector<Word> words;  // commands first, then options
  std::vector<std::pair<std::string, std::vector<std::string>>> values;
};

std::string FirstLine(const std::string& text) { return text.substr(0, text.find('\n')); }

/// Of "TEXT:{standard,quick}": standard and quick.
std::vector<std::string> Choices(const CLI::Option& option) {
  const std::string type = option.get_type_name();
  const std::size_t begin = type.find('{'), end = type.find('}', begin);
  if (begin == std::string::npos || end == std::string::npos) return {};
  return CLI::detail::split(type.substr(begin + 1, end - begin - 1), ',');
}

void Collect(const CLI::App& app, const std::string& command, std::vector<Place>& places) {
  Place place{command, {}, {}};
  const auto subs = app.get_subcommands(
      [](const CLI::App* sub) { return !sub->get_name().empty() && !sub->get_group().empty(); });
  for (const CLI::App* sub : subs)
    place.words.push_back({sub->get_name(), FirstLine(sub->get_description())});
  for (const CLI::Option* option : app.get_options([](const CLI::Option*) { return true; })) {
    if (option->get_group().empty()) continue;
    for (const std::string& name : option->get_lnames()) {
      place.words.push_back({"--" + name, FirstLine(option->get_description())});
      if (const auto choices = Choices(*option); !choices.empty())
        place.values.emplace_back("--" + name, choices);
    }
  }
  places.push_back(std::move(place));
  for (const CLI::App* sub : subs) Collect(*sub, command + " " + sub->get_name(), places);
}

std::vector<Place> Places() {
  std::vector<Place> places;
  Collect(*tools::MakeApp(), "tendril", places);
  daemon::Arguments arguments;
  Collect(*daemon::MakeApp(arguments), "tendrild", places);
  tools::PlantOptions options;
  Collect(*tools::MakePlantApp(options), "tendril-plant", places);
  return places;
}

/// For single quotes of a shell.
std::string Quoted(const std::string& text) {
  std::string quoted = "'";
  for (const char c : text) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

/// "'a b' | 'a c'": the shell pattern of all commands below a program.
std::string CommandCases(const std::vector<Place>& places) {
  std::string cases;
  for (const Place& place : places) {
    if (place.command.find(' ') == std::string::npos) continue;
    cases += (cases.empty() ? "" : " | ") + Quoted(place.command);
  }
  return cases;
}

}  // namespace

std::vector<std::string> Commands() {
  std::vector<std::string> commands;
  for (const Place& place : Places()) commands.push_back(place.command);
  return commands;
}

std::string BashCompletion() {
  const std::vector<Place> places = Places();
  std::string values, words;
  for (const Place& place : places) {
    std::string list;
    for (const Word& word : place.words) list += (list.empty() ? "" : " ") + word.text;
    words += fmt::format("    {}) words={} ;;\n", Quoted(place.command), Quoted(list));
    for (const auto& [option, choices] : place.values)
      values += fmt::format("    {}) COMPREPLY=($(compgen -W {} -- \"$current\")); return ;;\n",
                            Quoted(place.command + " " + option),
                            Quoted(fmt::format("{}", fmt::join(choices, " "))));
  }
  return fmt::format(
      "# Completions of tendril, tendrild and tendril-plant for bash; generated from their command lines.\n"
      "_tendril() {{\n"
      "  local current=${{COMP_WORDS[COMP_CWORD]}} before=${{COMP_WORDS[COMP_CWORD - 1]}}\n"
      "  local place=${{COMP_WORDS[0]##*/}} words= word\n"
      "  for word in \"${{COMP_WORDS[@]:1:COMP_CWORD-1}}\"; do\n"
      "    case \"$place $word\" in {}) place=\"$place $word\" ;; esac\n"
      "  done\n"
      "  case \"$place $before\" in\n{}  esac\n"
      "  case $place in\n{}  esac\n"
      "  COMPREPLY=($(compgen -W \"$words\" -- \"$current\"))\n"
      "  [[ $current != -* && ${{#COMPREPLY[@]}} -eq 0 ]] && COMPREPLY=($(compgen -f -- \"$current\"))\n"
      "  return 0\n"
      "}}\n"
      "complete -o filenames -F _tendril tendril tendrild tendril-plant\n",
      CommandCases(places), values, words);
}

std::string ZshCompletion() {
  const std::vector<Place> places = Places();
  std::string values, words;
  for (const Place& place : places) {
    std::string list;
    for (const Word& word : place.words) list += "\n        " + Quoted(word.text + ":" + word.meaning);
    words += fmt::format("    {}) words_of=({}) ;;\n", Quoted(place.command), list);
    for (const auto& [option, choices] : place.values)
      values += fmt::format("    {}) compadd -- {}; return ;;\n", Quoted(place.command + " " + option),
                            fmt::join(choices, " "));
  }
  return fmt::format(
      "#compdef tendril tendrild tendril-plant\n"
      "# Completions of tendril, tendrild and tendril-plant for zsh; generated from their command lines.\n"
      "_tendril() {{\n"
      "  local place=${{words[1]##*/}} word before=${{words[CURRENT-1]}}\n"
      "  local -a words_of\n"
      "  for word in \"${{words[@]:1:$((CURRENT-2))}}\"; do\n"
      "    case \"$place $word\" in ({}) place=\"$place $word\" ;; esac\n"
      "  done\n"
      "  case \"$place $before\" in\n{}  esac\n"
      "  case $place in\n{}  esac\n"
      "  _describe 'tendril' words_of\n"
      "  [[ ${{words[CURRENT]}} == -* ]] || _files\n"
      "}}\n"
      "_tendril \"$@\"\n",
      CommandCases(places), values, words);
}

}  // namespace tendril::reference
