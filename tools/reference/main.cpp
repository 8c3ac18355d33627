// tendril-reference: writes the pages of the reference into a folder, for tools/docs, and what the shells and
// man get of the command lines. Part of the build, not installed.
#include <fmt/core.h>

#include <CLI/CLI.hpp>
#include <exception>

#include "reference.h"
#include "tendril/config/command_line.h"
#include "tendril/config/whole_file.h"
#include "tendril/core/version.h"

namespace tendril::reference {
namespace {

void Write(const std::filesystem::path& source, const std::filesystem::path& folder) {
  std::filesystem::create_directories(folder);
  for (const Page& page : AllPages(source)) config::WriteWhole(folder / page.file, page.markdown);
}

void WriteCompletions(const std::filesystem::path& folder) {
  std::filesystem::create_directories(folder);
  config::WriteWhole(folder / "tendril", BashCompletion());
  config::WriteWhole(folder / "_tendril", ZshCompletion());
}

}  // namespace
}  // namespace tendril::reference

int main(int argc, char** argv) {
  std::string folder, completions, source = TENDRIL_SOURCE_DIR;
  bool commands = false;
  CLI::App app{"tendril-reference: writes the generated pages of the documentation (tools/docs calls it)",
               "tendril-reference"};
  app.set_version_flag("--version", fmt::format("tendril-reference {}", tendril::Version()));
  app.add_option("folder", folder, "folder for the pages; made if it is not there");
  app.add_option("--completions", completions, "folder for the completions of bash and zsh");
  app.add_flag("--commands", commands, "print every command line of the programs, one a line");
  app.add_option("--source", source, "the repository")->capture_default_str();
  tendril::config::SettleCommandLine(app);
  try {
    app.parse(argc, argv);
    if (!folder.empty()) tendril::reference::Write(source, folder);
    if (!completions.empty()) tendril::reference::WriteCompletions(completions);
    if (commands) {
      for (const std::string& command : tendril::reference::Commands()) fmt::print("{}\n", command);
    }
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  } catch (const std::exception& e) {
    fmt::print(stderr, "tendril-reference: {}\n", e.what());
    return 1;
  }
  return 0;
}
