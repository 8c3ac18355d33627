// The pages of the reference, each made from the source that already holds its facts. Knows no site
// generator.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace tendril::reference {

struct Page {
  std::string file;      // "daemon-file.md"
  std::string markdown;  // the whole page
};

/// `source`: the repository, whose messages, headers and shipped files some pages are made from.
Page RobotFilePage(const std::filesystem::path& source);
Page DaemonFilePage(const std::filesystem::path& source);
Page FaultsPage();
Page CommandLinePage();
Page MessagesPage(const std::filesystem::path& source);
Page StatusCodesPage();
Page GuardsPage();
Page ModesPage();
Page EffectsPage();
Page DriveObjectsPage(const std::filesystem::path& source);
Page ReportPage(const std::filesystem::path& source);
Page DataSetPage(const std::filesystem::path& source);
Page ImportMapPage(const std::filesystem::path& source);

/// Every command line of the programs: "tendril", "tendril gap diagnose", "tendrild", ...
std::vector<std::string> Commands();
/// Completions of all programs for a shell: commands, options and the values that an option has a list of.
std::string BashCompletion();
std::string ZshCompletion();

/// All of them, and the index that lists them. Throws std::runtime_error when a source cannot be read.
std::vector<Page> AllPages(const std::filesystem::path& source);

}  // namespace tendril::reference
