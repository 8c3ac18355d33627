// tendril-reference: writes the pages of the reference into a folder, for tools/docs. Part of the build, not
// installed.
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

}  // namespace
}  // namespace tendril::reference

int main(int argc, char** argv) {
  std::string folder, source = TENDRIL_SOURCE_DIR;
  CLI::App app{"tendril-reference: writes the generated pages of the documentation (tools/docs calls it)",
               "tendril-reference"};
  app.set_version_flag("--version", fmt::format("tendril-reference {}", tendril::Version()));
  app.add_option("folder", folder, "folder for the pages; made if it is not there")->required();
  app.add_option("--source", source, "the repository")->capture_default_str();
  tendril::config::SettleCommandLine(app);
  try {
    app.parse(argc, argv);
    tendril::reference::Write(source, folder);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  } catch (const std::exception& e) {
    fmt::print(stderr, "tendril-reference: {}\n", e.what());
    return 1;
  }
  return 0;
}
