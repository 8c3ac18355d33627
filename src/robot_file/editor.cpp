#include "editor.h"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace tendril::robot_file {

std::vector<std::string> LinesOf(const std::string& text) {
  std::vector<std::string> lines;
  for (std::size_t from = 0; from < text.size();) {
    const std::size_t end = std::min(text.find('\n', from), text.size());
    lines.push_back(text.substr(from, end - from));
    from = end + 1;
  }
  return lines;
}

Editor::Editor(const std::string& text, std::string path)
    : path_(std::move(path)), root_(YAML::Load(text)), lines_(LinesOf(text)), above_(lines_.size() + 1) {}

YAML::Node Editor::NumberAt(const Path& path) const {
  const YAML::Node node = At(path);
  return node.IsDefined() && node.IsMap() && node["value"] ? node["value"] : node;
}

void Editor::Replace(const YAML::Node& node, const std::string& value) {
  const auto line = static_cast<std::size_t>(node.Mark().line),
             column = static_cast<std::size_t>(node.Mark().column);
  const std::string& old = node.Scalar();
  if (line >= lines_.size() || lines_[line].compare(column, old.size(), old) != 0) {
    throw std::runtime_error(
        fmt::format("{}:{}: cannot be edited in place; write a plain number", path_, line + 1));
  }
  edits_[line].push_back({column, old, value});
}

void Editor::Fill(const YAML::Node& list, const std::string& text) {
  const auto line = static_cast<std::size_t>(list.Mark().line),
             column = static_cast<std::size_t>(list.Mark().column);
  const std::size_t end = line < lines_.size() ? lines_[line].find(']', column) : std::string::npos;
  if (end == std::string::npos || lines_[line][column] != '[')
    throw std::runtime_error(fmt::format("{}:{}: cannot be edited in place; write []", path_, line + 1));
  edits_[line].push_back({column, lines_[line].substr(column, end + 1 - column), text});
}

void Editor::Insert(const YAML::Node& map, const std::string& text) {
  const YAML::Node first = map.begin()->first;
  const auto line = static_cast<std::size_t>(first.Mark().line),
             column = static_cast<std::size_t>(first.Mark().column);
  if (map.Style() == YAML::EmitterStyle::Flow) {
    edits_[line].push_back({column, "", text + ", "});
  } else if (lines_[line].find_first_not_of(' ') != column) {
    // The first key of a list's entry follows its dash; the new one goes below it.
    below_[LastLineOf(line, column)].push_back(std::string(column, ' ') + text);
  } else {
    above_[line].push_back(std::string(column, ' ') + text);
  }
}

void Editor::Append(const YAML::Node& map, const std::vector<std::string>& lines) {
  const YAML::Node first = map.begin()->first;
  const auto column = static_cast<std::size_t>(first.Mark().column);
  const std::size_t last = LastLineOf(static_cast<std::size_t>(first.Mark().line), column, true);
  for (const std::string& line : lines) below_[last].push_back(std::string(column, ' ') + line);
}

void Editor::Remove(const YAML::Node& map, const std::string& key) {
  for (const auto& entry : map) {
    if (entry.first.Scalar() != key) continue;
    const auto line = static_cast<std::size_t>(entry.first.Mark().line);
    const std::size_t last = LastLineOf(line, static_cast<std::size_t>(entry.first.Mark().column));
    for (std::size_t i = line; i <= last; ++i) removed_.push_back(i);
  }
}

std::string Editor::Text(const std::vector<std::string>& heading) const {
  std::string text;
  // Below the file's first comment.
  std::size_t start = 0;
  while (start < lines_.size() && !lines_[start].empty() && lines_[start].front() == '#') ++start;
  for (std::size_t i = 0; i < lines_.size(); ++i) {
    if (i == start) text += Heading(heading, start > 0);
    for (const std::string& added : above_[i]) text += added + "\n";
    if (std::find(removed_.begin(), removed_.end(), i) == removed_.end()) text += Edited(i) + "\n";
    if (const auto added = below_.find(i); added != below_.end()) {
      for (const std::string& line : added->second) text += line + "\n";
    }
  }
  return text;
}

std::string Editor::Heading(const std::vector<std::string>& heading, bool apart) {
  std::string text = apart && !heading.empty() ? "#\n" : "";
  for (const std::string& line : heading) text += "# " + line + "\n";
  return text;
}

std::size_t Editor::LastLineOf(std::size_t line, std::size_t column, bool siblings) const {
  std::size_t last = line;
  for (std::size_t i = line + 1; i < lines_.size(); ++i) {
    const std::size_t indent = lines_[i].find_first_not_of(' ');
    if (indent == std::string::npos || lines_[i][indent] == '#') continue;
    // A list may have the indentation of its key.
    const bool item = lines_[i][indent] == '-' && indent == column && !siblings;
    if (indent < column || (indent == column && !siblings && !item)) break;
    last = i;
  }
  return last;
}

std::string Editor::Edited(std::size_t i) const {
  std::string line = lines_[i];
  const auto found = edits_.find(i);
  if (found == edits_.end()) return line;
  std::vector<Edit> edits = found->second;
  std::sort(edits.begin(), edits.end(), [](const Edit& a, const Edit& b) { return a.column > b.column; });
  std::string was;
  for (const Edit& edit : edits) {
    line.replace(edit.column, edit.old.size(), edit.value);
    if (!edit.old.empty()) was = edit.old + (was.empty() ? "" : ", " + was);
  }
  if (was.empty()) return line;
  // A comment begins at the first '#' after a blank; quoted texts in robot files contain none.
  const std::size_t comment = line.find(" #");
  if (comment == std::string::npos) return line + "  # was " + was;
  const std::size_t words = line.find_first_not_of("# ", comment);
  return line.substr(0, comment) + " # was " + was +
         (words == std::string::npos ? "" : "; " + line.substr(words));
}

}  // namespace tendril::robot_file
