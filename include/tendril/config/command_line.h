// What the command lines of all programs have in common: what is wrong with one is told in one line, and no
// value is empty. Knows no option.
#pragma once

#include <CLI/CLI.hpp>
#include <algorithm>
#include <string>

namespace tendril::config {

/// An empty value, of a variable that is not set say, would pass for an option that was left out.
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

/// "tendril: --timeout: nan is no number from 0 to 3600; ...; see tendril send --help".
inline std::string WrongUse(const CLI::App& app, const CLI::Error& error) {
  const std::string program = app.get_name();
  std::string command = program, what = error.what();
  for (const CLI::App* at = &app; at != nullptr;) {
    // CLI11 asks for a subcommand where a wrong one was given: name the wrong word.
    if (const auto rest = at->remaining(); !rest.empty()) what = "'" + rest.front() + "' is not known here";
    const auto next = at->get_subcommands();
    at = next.empty() ? nullptr : next.front();
    if (at != nullptr) command += " " + at->get_name();
  }
  std::replace(what.begin(), what.end(), '\n', ' ');
  return program + ": " + what + "; see " + command + " --help\n";
}

/// Call when all options are there; `app` has the program's name.
inline void SettleCommandLine(CLI::App& app) {
  RefuseEmptyValues(app);
  app.failure_message([](const CLI::App* at, const CLI::Error& error) { return WrongUse(*at, error); });
}

}  // namespace tendril::config
