// A YAML file edited as by hand: numbers in place, lines added and removed, comments and order kept. Knows
// nothing of robots.
#pragma once

#include <yaml-cpp/yaml.h>

#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "leaves.h"

namespace tendril::robot_file {

std::vector<std::string> LinesOf(const std::string& text);

class Editor {
 public:
  Editor(const std::string& text, std::string path);

  YAML::Node At(const Path& path) const { return Find(root_, path); }
  /// The number there; of `{value: 2.3e10, within: 10 %}` its value, so that a new one keeps the rest.
  YAML::Node NumberAt(const Path& path) const;

  /// Replaces a number in the file; the old one stays as a comment.
  void Replace(const YAML::Node& node, const std::string& value);

  /// Writes what an empty list in flow style, `[]`, holds from now on; `text` has the brackets too.
  void Fill(const YAML::Node& list, const std::string& text);

  /// Inserts a missing key as the first of its map.
  void Insert(const YAML::Node& map, const std::string& text);

  /// Appends lines below the last key of a block, indented as its keys.
  void Append(const YAML::Node& map, const std::vector<std::string>& lines);

  /// Removes a key with its value from the file.
  void Remove(const YAML::Node& map, const std::string& key);

  const YAML::Node& root() const { return root_; }

  std::string Text(const std::vector<std::string>& heading) const;

 private:
  struct Edit {
    std::size_t column;
    std::string old, value;
  };

  static std::string Heading(const std::vector<std::string>& heading, bool apart);

  // Last line of the entry that begins at `line` with its key at `column`; with `siblings`, of the whole
  // block of keys in that column. Trailing blank and comment lines are excluded.
  std::size_t LastLineOf(std::size_t line, std::size_t column, bool siblings = false) const;

  std::string Edited(std::size_t i) const;

  std::string path_;
  YAML::Node root_;
  std::vector<std::string> lines_;
  std::map<std::size_t, std::vector<Edit>> edits_;
  std::vector<std::vector<std::string>> above_;
  std::map<std::size_t, std::vector<std::string>> below_;
  std::vector<std::size_t> removed_;
};

}  // namespace tendril::robot_file
