#include "reference.h"

#include <fmt/format.h>

#include "markdown.h"

namespace tendril::reference {
namespace {

std::string TitleOf(const Page& page) { return page.markdown.substr(2, page.markdown.find('\n') - 2); }

/// Of the page's introduction.
std::string FirstSentence(const Page& page) {
  const std::size_t begin = page.markdown.find("\n\n") + 2, end = page.markdown.find("\n\n", begin);
  const std::string text = page.markdown.substr(begin, end - begin);
  return text.substr(0, text.find(". ")) + (text.find(". ") == text.npos ? "" : ".");
}

Page Index(const std::vector<Page>& pages) {
  std::string text =
      "# Reference\n\nEvery page is generated from the sources that hold its facts, by `tools/docs`.\n\n";
  Table table({"Page", "What it says"});
  for (const Page& page : pages)
    table.Row({fmt::format("[{}]({})", TitleOf(page), page.file), FirstSentence(page)});
  return {"index.md", text + table.Text()};
}

}  // namespace

std::vector<Page> AllPages(const std::filesystem::path& source) {
  std::vector<Page> pages{RobotFilePage(source),
                          DaemonFilePage(source),
                          CommandLinePage(),
                          MessagesPage(source),
                          StatusCodesPage(),
                          GuardsPage(),
                          ModesPage(),
                          EffectsPage(),
                          ReportPage(source),
                          DataSetPage(source),
                          ImportMapPage(source),
                          DriveObjectsPage(source),
                          FaultsPage()};
  pages.push_back(Index(pages));
  return pages;
}

}  // namespace tendril::reference
