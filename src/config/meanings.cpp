// Comments above the keys of a file that ToYaml wrote: block style, an indentation a level, no comments yet.
#include <fmt/format.h>

#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "tendril/config/answer.h"

namespace tendril::config {
namespace {

constexpr std::size_t kWidth = 118;

struct Level {
  std::size_t indent;
  std::string path;  // "body.sections[]."
};

std::string Wrapped(const std::string& text, std::size_t indent) {
  const std::string lead = std::string(indent, ' ') + "#";
  std::string lines, line = lead;
  std::istringstream words(text);
  for (std::string word; words >> word;) {
    if (line.size() + 1 + word.size() > kWidth) {
      lines += line + "\n";
      line = lead;
    }
    line += " " + word;
  }
  return lines + line + "\n";
}

std::string MeaningAndRange(const Key& key) {
  if (key.kind != Key::Kind::kValue || key.accepted.empty()) return key.meaning;
  return fmt::format("{} Accepted: {}{}.", key.meaning, key.accepted, key.unit.empty() ? "" : " " + key.unit);
}

}  // namespace

std::string WithMeanings(const std::string& yaml, const std::vector<Key>& keys) {
  std::string text;
  std::set<std::string> seen;
  std::vector<Level> levels{{0, ""}};
  std::istringstream lines(yaml);
  for (std::string line; std::getline(lines, line);) {
    const std::size_t first = line.find_first_not_of(" -"), colon = line.find(':');
    const std::size_t indent = line.find_first_not_of(' ');
    if (first == line.npos || colon == line.npos) {
      text += line + "\n";
      continue;
    }
    while (levels.back().indent > first) levels.pop_back();
    const std::string path = levels.back().path + line.substr(first, colon - first);
    for (const Key& key : keys) {
      if (key.path != path || !seen.insert(path).second) continue;
      if (first == 0 && !text.empty()) text += "\n";
      text += Wrapped(MeaningAndRange(key), indent);
    }
    text += line + "\n";
    if (colon + 1 == line.size()) {  // a block or a list follows, deeper
      for (const Key& key : keys) {
        if (key.path == path)
          levels.push_back({first + 1, path + (key.kind == Key::Kind::kList ? "[]." : ".")});
      }
    }
  }
  return text;
}

}  // namespace tendril::config
