// Shared by the command lines of all programs: an error is one line that suggests the probable name, and
// values must not be empty. Knows no option.
#pragma once

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <numeric>
#include <string>
#include <string_view>
#include <vector>

namespace tendril::config {

/// An empty value, for instance from an unset shell variable, would look like an omitted option.
inline void RefuseEmptyValues(CLI::App& app) {
  const CLI::Validator given(
      [](std::string& value) {
        return value.empty() ? std::string("is empty; accepted: a value; give one, or leave the option out")
                             : std::string();
      },
      "");
  for (CLI::Option* option : app.get_options([](const CLI::Option*) { return true; })) option->check(given);
  for (CLI::App* sub : app.get_subcommands([](const CLI::App*) { return true; })) RefuseEmptyValues(*sub);
}

/// Edit distance of two words, ignoring case.
inline std::size_t LettersApart(std::string_view a, std::string_view b) {
  const auto same = [](char x, char y) {
    return std::tolower(static_cast<unsigned char>(x)) == std::tolower(static_cast<unsigned char>(y));
  };
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), 0u);
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t changed = diagonal + (same(a[i - 1], b[j - 1]) ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({changed, row[j] + 1, row[j - 1] + 1});
    }
  }
  return row.back();
}

/// The name that `word` was probably meant to be: one that it begins, or one that differs in at most a third
/// of its letters (at least two, for exchanged letters); empty where none is close enough.
inline std::string Nearest(std::string_view word, const std::vector<std::string>& names) {
  std::string best;
  std::size_t least = std::max<std::size_t>(2, word.size() / 3) + 1;
  for (const std::string& name : names) {
    const bool begun = word.size() >= 2 && name.starts_with(word);
    const std::size_t apart = begun ? 1 : LettersApart(word, name);
    if (apart >= least || apart >= word.size()) continue;
    least = apart;
    best = name;
  }
  return best;
}

inline std::vector<std::string> CommandNames(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* sub : app.get_subcommands([](const CLI::App*) { return true; }))
    if (!sub->get_name().empty() && !sub->get_group().empty()) names.push_back(sub->get_name());
  return names;
}

inline std::vector<std::string> OptionNames(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* at = &app; at != nullptr; at = at->get_parent()) {
    for (const CLI::Option* option : at->get_options([](const CLI::Option*) { return true; }))
      for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
    if (!at->get_fallthrough()) break;
  }
  return names;
}

/// "; commands: capstan, commission, ..."; empty where there are none.
inline std::string CommandList(const CLI::App& app) {
  std::string list;
  for (const std::string& name : CommandNames(app)) list += (list.empty() ? "; commands: " : ", ") + name;
  return list;
}

/// "'demoo' is not known here (did you mean demo?)", followed by the commands where a command is expected.
inline std::string NotKnown(const CLI::App& app, const std::string& word) {
  std::string text = "'" + word + "' is not known here";
  const bool option = word.starts_with("-");
  const std::string meant =
      Nearest(word.substr(0, word.find('=')), option ? OptionNames(app) : CommandNames(app));
  if (!meant.empty()) text += " (did you mean " + meant + "?)";
  return option ? text : text + CommandList(app);
}

/// "tendril: --timeout: nan is not a number from 0 to 3600; ...; see tendril send --help".
inline std::string WrongUse(const CLI::App& app, const CLI::Error& error) {
  const std::string program = app.get_name();
  std::string command = program, what = error.what();
  for (const CLI::App* at = &app; at != nullptr;) {
    const auto next = at->get_subcommands();
    // CLI11 reports a missing subcommand for a wrong one, so the wrong word is named here.
    if (const auto rest = at->remaining(); !rest.empty()) {
      what = NotKnown(*at, rest.front());
    } else if (error.get_name() == "RequiredError" && next.empty() && at->get_require_subcommand_min() > 0) {
      what = "a command is needed" + CommandList(*at);
    }
    at = next.empty() ? nullptr : next.front();
    if (at != nullptr) command += " " + at->get_name();
  }
  std::replace(what.begin(), what.end(), '\n', ' ');
  return program + ": " + what + "; see " + command + " --help\n";
}

/// `help` in the place of a command, as in `tendril help`, `tendril help gap` or `tendril gap help`, means
/// --help of the command around it or, if one follows, of that. The first of `words` is the program.
inline std::vector<std::string> HelpAsOption(const CLI::App& app, std::vector<std::string> words) {
  const CLI::App* at = &app;
  bool help = false, known = true;
  for (std::size_t i = 1; i < words.size() && at != nullptr;) {
    const auto named = [&](const CLI::App* sub) { return sub->get_name() == words[i]; };
    const auto subs = at->get_subcommands(named);
    if (!help && subs.empty() && words[i] == "help" && !CommandNames(*at).empty()) {
      words.erase(words.begin() + static_cast<std::ptrdiff_t>(i));
      help = true;
      continue;
    }
    // What is no command is left to the parser, which names it.
    known = !subs.empty() || words[i].starts_with("-") || CommandNames(*at).empty();
    at = subs.empty() ? nullptr : subs.front();
    ++i;
  }
  if (help && known) words.push_back("--help");
  return words;
}

/// To be called after all options are added; `app` has the program's name.
inline void SettleCommandLine(CLI::App& app) {
  RefuseEmptyValues(app);
  app.failure_message([](const CLI::App* at, const CLI::Error& error) { return WrongUse(*at, error); });
}

}  // namespace tendril::config
