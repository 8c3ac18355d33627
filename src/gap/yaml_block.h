// One mapping of a strict YAML file: every key that is read becomes an accepted one, and every refusal names
// file, line, key, what is accepted and the remedy. Knows nothing of what the keys mean.
#pragma once

#include <yaml-cpp/yaml.h>

#include <Eigen/Core>
#include <cstddef>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "text.h"

namespace tendril::gap {

/// "a, b, c".
std::string Join(const std::vector<std::string>& words);

/// The keys of a map as "a, b, c".
template <class Value>
std::string Names(const std::map<std::string, Value>& of) {
  std::vector<std::string> names;
  for (const auto& [name, value] : of) names.push_back(name);
  return Join(names);
}

/// Throws std::runtime_error where a key stands twice in a block of the file, at any depth.
void RefuseKeysTwice(const YAML::Node& node, const std::string& file);

/// All readers throw std::runtime_error for a value that does not fit.
class YamlBlock {
 public:
  /// `key`: path of the block in the file, for messages.
  YamlBlock(const YAML::Node& node, std::string file, std::string key);

  bool Has(const char* key);
  /// Undefined where the key is missing.
  YAML::Node Get(const char* key);
  YamlBlock Sub(const char* key);

  std::string Text(const char* key, const std::string& otherwise);
  double Number(const char* key, double otherwise, double least, double most);
  int Whole(const char* key, int otherwise, int least, int most);
  template <class Value>
  Value Choice(const char* key, const std::map<std::string, Value>& choices, const std::string& otherwise) {
    const std::string text = Text(key, otherwise);
    const auto found = choices.find(text);
    if (found == choices.end()) Fail(key, "'" + Printable(text) + "' is not known", Names(choices));
    return found->second;
  }
  /// A list of `count` texts; `null` is an empty one.
  std::vector<std::string> Texts(const char* key, std::size_t count, const char* what);
  /// A number for all, or a list of one each.
  std::vector<double> Numbers(const char* key, std::size_t count, double otherwise);
  Eigen::Vector3d Vector(const char* key);

  /// To be called after all keys were read: a key that was not read is an error.
  void Close() const;

  [[noreturn]] void Fail(const char* key, const std::string& what, const std::string& accepted) const;

 private:
  std::string Path(const std::string& key) const;
  double NumberOf(const YAML::Node& node, const char* key, double least, double most) const;

  YAML::Node node_;
  std::string file_, key_;
  std::set<std::string> known_;
};

}  // namespace tendril::gap
