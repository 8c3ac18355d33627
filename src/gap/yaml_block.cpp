// Readers of one mapping; see the header.
#include "yaml_block.h"

#include <fmt/core.h>

#include <cmath>
#include <stdexcept>
#include <utility>

namespace tendril::gap {

std::string Join(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : ", ") + word;
  return text;
}

void RefuseKeysTwice(const YAML::Node& node, const std::string& file) {
  std::map<std::string, int> lines;
  for (const auto& entry : node) {
    if (!node.IsMap()) {
      RefuseKeysTwice(entry, file);
      continue;
    }
    if (entry.first.IsScalar()) {
      const int line = entry.first.Mark().line + 1;
      const auto [first, is_new] = lines.emplace(entry.first.Scalar(), line);
      if (!is_new)
        throw std::runtime_error(
            fmt::format("{}:{}: {}: given twice (first on line {}); accepted: once; remove one of them", file,
                        line, Printable(first->first), first->second));
    }
    RefuseKeysTwice(entry.second, file);
  }
}

YamlBlock::YamlBlock(const YAML::Node& node, std::string file, std::string key)
    : node_(node), file_(std::move(file)), key_(std::move(key)) {
  if (node_ && !node_.IsMap()) Fail("", "is not a block of keys", "a block such as 'column: t'");
}

bool YamlBlock::Has(const char* key) {
  known_.insert(key);
  return node_ && node_[key];
}

YAML::Node YamlBlock::Get(const char* key) {
  return Has(key) ? node_[key] : YAML::Node(YAML::NodeType::Undefined);
}

YamlBlock YamlBlock::Sub(const char* key) { return {Get(key), file_, key_.empty() ? key : key_ + "." + key}; }

std::string YamlBlock::Text(const char* key, const std::string& otherwise) {
  if (!Has(key)) return otherwise;
  if (!node_[key].IsScalar()) Fail(key, "is not a text", "one word or number");
  return node_[key].Scalar();
}

double YamlBlock::Number(const char* key, double otherwise, double least, double most) {
  if (!Has(key)) return otherwise;
  return NumberOf(node_[key], key, least, most);
}

int YamlBlock::Whole(const char* key, int otherwise, int least, int most) {
  const double number = Number(key, otherwise, least, most);
  if (number != std::floor(number)) Fail(key, fmt::format("{} is not whole", number), "a whole number");
  return static_cast<int>(number);
}

std::vector<std::string> YamlBlock::Texts(const char* key, std::size_t count, const char* what) {
  const YAML::Node list = Get(key);
  if (!list || !list.IsSequence() || list.size() != count) {
    Fail(key,
         list && list.IsSequence() ? fmt::format("has {} entries", list.size()) : "is missing or no list",
         fmt::format("a list of {} column names: {}", count, what));
  }
  std::vector<std::string> texts;
  for (const YAML::Node& entry : list) {
    if (!entry.IsScalar() && !entry.IsNull())
      Fail(key, "holds something other than names", "column names, or null");
    texts.push_back(entry.IsNull() ? std::string() : std::string(Trimmed(entry.Scalar())));
  }
  return texts;
}

std::vector<double> YamlBlock::Numbers(const char* key, std::size_t count, double otherwise) {
  const YAML::Node node = Get(key);
  if (!node) return std::vector<double>(count, otherwise);
  if (node.IsScalar()) return std::vector<double>(count, NumberOf(node, key, -1e12, 1e12));
  if (!node.IsSequence() || node.size() != count)
    Fail(key, "does not fit", fmt::format("a number, or a list of {}", count));
  std::vector<double> numbers;
  for (const YAML::Node& entry : node) numbers.push_back(NumberOf(entry, key, -1e12, 1e12));
  return numbers;
}

Eigen::Vector3d YamlBlock::Vector(const char* key) {
  const std::vector<double> v = Numbers(key, 3, 0);
  return {v[0], v[1], v[2]};
}

void YamlBlock::Close() const {
  if (!node_) return;
  for (const auto& entry : node_) {
    const std::string key = entry.first.IsScalar() ? entry.first.Scalar() : "?";
    if (known_.contains(key)) continue;
    throw std::runtime_error(fmt::format("{}:{}: {}: no such key; accepted: {}; correct or remove it", file_,
                                         entry.first.Mark().line + 1, Path(Printable(key)),
                                         Join({known_.begin(), known_.end()})));
  }
}

void YamlBlock::Fail(const char* key, const std::string& what, const std::string& accepted) const {
  const YAML::Node at = *key != 0 && node_ && node_[key] ? node_[key] : node_;
  const int line = at ? at.Mark().line : -1;
  throw std::runtime_error(fmt::format("{}{}: {}: {}; accepted: {}", file_,
                                       line >= 0 ? fmt::format(":{}", line + 1) : "", Path(key), what,
                                       accepted));
}

std::string YamlBlock::Path(const std::string& key) const {
  return key_.empty() ? key : key.empty() ? key_ : key_ + "." + key;
}

double YamlBlock::NumberOf(const YAML::Node& node, const char* key, double least, double most) const {
  double value = 0;
  if (!node.IsScalar() || !YAML::convert<double>::decode(node, value))
    Fail(key, "is not a number", "a number");
  if (!(value >= least && value <= most))
    Fail(key, fmt::format("{} is out of range", value), fmt::format("{:g} .. {:g}", least, most));
  return value;
}

}  // namespace tendril::gap
