// The keys of a column map, from the shipped map that has every key with its comment.
#include <fmt/format.h>

#include <fstream>
#include <regex>

#include "markdown.h"
#include "reference.h"

namespace tendril::reference {
namespace {

constexpr const char* kMap = "config/import/every_key_map.yaml";

/// A line "key: value  # comment", or a comment alone. A key whose place another one takes in the file is
/// written "# key: value  # comment".
struct MapLine {
  std::size_t depth = 0;  // 0: a block of the file
  std::string key{}, value{}, comment{};
};

MapLine ReadMapLine(const std::string& text) {
  static const std::regex kKey(R"(^( *)(?:# )?([a-z_A-Z]+):(?: (.*?))?(?: +# (.*))?$)");
  static const std::regex kComment(R"(^ *# (.*)$)");
  std::smatch match;
  const bool alone = std::regex_match(text, match, kComment);
  const std::string comment = alone ? match[1].str() : "";
  if (std::regex_match(text, match, kKey) && (!alone || match[4].matched))
    return {static_cast<std::size_t>(match.length(1)) / 2, match[2], match[3], match[4]};
  return {.comment = comment};
}

}  // namespace

Page ImportMapPage(const std::filesystem::path& source) {
  std::ifstream in(source / kMap);
  if (!in) throw std::runtime_error(fmt::format("cannot read {}", (source / kMap).string()));
  std::string text, above;
  std::vector<std::string> path;
  Table table({"Key", "Meaning"});
  const auto close = [&] {
    if (!table.empty()) text += table.Text();
    table = Table({"Key", "Meaning"});
  };
  for (std::string written; std::getline(in, written);) {
    const MapLine line = ReadMapLine(written);
    if (line.key.empty()) {
      above = line.comment.empty() ? "" : above + (above.empty() ? "" : " ") + line.comment;
      continue;
    }
    path.resize(line.depth);
    path.push_back(line.key);
    const std::string name = fmt::format("{}", fmt::join(path, ".")),
                      meaning = line.comment.empty() ? above : line.comment;
    above.clear();
    if (line.depth == 0) {
      close();
      text += Heading(2, Code(name), name) + Sentence(meaning) + "\n\n";
    } else {
      table.Row(
          {Target(name, name),
           Prose(meaning) + (line.value.empty() ? "" : Below(fmt::format("example: {}", Code(line.value))))});
    }
  }
  close();
  const std::string head = Head("Import map",
                                "What each column of a foreign table means, for `tendril gap import --map`. "
                                "SI value = unit × sign × (scale × number + offset).",
                                {kMap});
  return {"import-map.md", head + text};
}

}  // namespace tendril::reference
