// Every command and option, from the programs' own command lines.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>

#include "arguments.h"
#include "commands.h"
#include "markdown.h"
#include "plant_options.h"
#include "reference.h"

namespace tendril::reference {
namespace {

const CLI::Formatter& FormatterOf(const CLI::App& app) {
  return dynamic_cast<const CLI::Formatter&>(*app.get_formatter());
}

/// "usage: tendril send tip [OPTIONS] X Y Z" as --help has it, in one line.
std::string Usage(const CLI::App& app, const std::string& command) {
  std::string usage = FormatterOf(app).make_usage(&app, command);
  usage.erase(0, usage.find(':') + 2);
  while (!usage.empty() && usage.back() == '\n') usage.pop_back();
  return usage;
}

std::string OptionTable(const CLI::App& app, const std::string& command) {
  Table table({"Option", "Meaning"});
  for (const bool positional : {true, false}) {
    for (const CLI::Option* option : app.get_options([](const CLI::Option*) { return true; })) {
      if (option->get_positional() != positional || option->get_group().empty()) continue;
      std::string name = FormatterOf(app).make_option_name(option, positional);
      name.resize(std::min(name.size(), name.find('{')));  // what the flag sets is the program's own business
      const std::string value = FormatterOf(app).make_option_opts(option);
      table.Row({Target(name, command + "." + name) + (value.empty() ? "" : Below(Escaped(value))),
                 Prose(option->get_description())});
    }
  }
  return table.empty() ? "" : table.Text();
}

void Describe(const CLI::App& app, const std::string& command, int level, std::string& text) {
  text += Heading(level, Code(command), command);
  text += Prose(app.get_description()) + "\n\n```text\n" + Usage(app, command) + "\n```\n\n" +
          OptionTable(app, command);
  if (!app.get_footer().empty()) text += Prose(app.get_footer()) + "\n\n";
  for (const CLI::App* sub : app.get_subcommands([](const CLI::App*) { return true; })) {
    if (!sub->get_name().empty() && !sub->get_group().empty())
      Describe(*sub, command + " " + sub->get_name(), level + 1, text);
  }
}

}  // namespace

Page CommandLinePage() {
  std::string text =
      Head("Command line",
           "Every program answers `--help` and `--version`. It exits with 0 when the work is done, 1 when "
           "the work or a file failed, and 2 on wrong use, with one line that names the remedy.",
           {"tools/tendril", "src/daemon/arguments.cpp", "tools/plant/plant_options.cpp"});
  Describe(*tools::MakeApp(), "tendril", 2, text);
  daemon::Arguments arguments;
  Describe(*daemon::MakeApp(arguments), "tendrild", 2, text);
  tools::PlantOptions options;
  Describe(*tools::MakePlantApp(options), "tendril-plant", 2, text);
  return {"command-line.md", text};
}

}  // namespace tendril::reference
