// The inverse of reader.h: the same descriptions, every value written out. Doubles get enough digits to be
// read back bit for bit. Knows nothing of robots.
#pragma once

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <yaml-cpp/yaml.h>

#include <concepts>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "reader.h"
#include "tendril/core/uncertainty.h"

namespace tendril::config {

class Writer {
 public:
  static constexpr bool kReading = false, kListing = false;

  /// `uncertain`: how well numbers are known, by key path; null: of none it is said.
  explicit Writer(const std::map<std::string, Uncertainty>* uncertain = nullptr) : uncertain_(uncertain) {
    out_ << YAML::BeginMap;
  }

  void Number(std::string_view key, double& value, Range, std::string_view) {
    PutNumber(key, Shortest(value));
  }
  template <std::integral T>
  void Integer(std::string_view key, T& value, Range, std::string_view) {
    PutNumber(key, fmt::format("{}", value));
  }
  void Identifier(std::string_view key, std::uint32_t& value, std::string_view) { Put(key, Hex(value)); }
  void Flag(std::string_view key, bool& value, std::string_view) { Put(key, value ? "true" : "false"); }
  void Text(std::string_view key, std::string& value, const TextRule&, std::string_view) {
    out_ << YAML::Key << std::string(key) << YAML::Value << YAML::DoubleQuoted << value;
  }
  template <class E>
  void Choice(std::string_view key, E& value, Choices<E> choices, std::string_view) {
    for (const auto& c : choices) {
      if (c.second == value) Put(key, std::string(c.first));
    }
  }
  void Numbers(std::string_view key, std::vector<double>& values, Range, Range, std::string_view) {
    PutAll(key, values, Shortest);
  }
  void Integers(std::string_view key, std::vector<long long>& values, Range, Range, std::string_view) {
    PutAll(key, values, [](long long v) { return fmt::format("{}", v); });
  }
  void Identifiers(std::string_view key, std::vector<std::uint32_t>& values, Range, std::string_view) {
    PutAll(key, values, Hex);
  }

  void Words(std::string_view key, std::vector<std::string>& values, std::initializer_list<std::string_view>,
             std::string_view) {
    out_ << YAML::Key << std::string(key) << YAML::Value << YAML::Flow << values;
  }

  template <class T>
  void Block(std::string_view key, T& value, std::string_view) {
    out_ << YAML::Key << std::string(key) << YAML::Value;
    Map(value, key);
  }
  template <class T>
  void OptionalBlock(std::string_view key, std::optional<T>& value, std::string_view) {
    if (value) Block(key, *value, {});
  }
  template <class T>
  void List(std::string_view key, std::vector<T>& values, Range, std::string_view) {
    out_ << YAML::Key << std::string(key) << YAML::Value;
    if (values.empty()) out_ << YAML::Flow;
    out_ << YAML::BeginSeq;
    for (std::size_t i = 0; i < values.size(); ++i) Map(values[i], fmt::format("{}[{}]", key, i + 1));
    out_ << YAML::EndSeq;
  }
  void Check(bool, std::string_view, const std::string&) {}

  void BeginBlock(const std::string& key) {
    out_ << YAML::Key << key << YAML::Value << YAML::BeginMap;
    path_.push_back(key);
  }
  void EndBlock() {
    out_ << YAML::EndMap;
    path_.pop_back();
  }

  /// Whether it is said of any number below this path ("actuation.per_tendon.2.").
  bool HasUncertainty(const std::string& below) const {
    if (uncertain_ == nullptr) return false;
    const auto first = uncertain_->lower_bound(below);
    return first != uncertain_->end() && first->first.starts_with(below);
  }

  /// The whole text; the writer must not be used afterwards.
  std::string Finish() {
    out_ << YAML::EndMap;
    return std::string(out_.c_str()) + "\n";
  }

 private:
  // fmt's default is the shortest text that reads back as the same double (never more than 17 digits).
  static std::string Shortest(double value) { return fmt::format("{}", value); }
  static std::string Hex(std::uint32_t value) { return fmt::format("0x{:08X}", value); }

  template <class T>
  void Map(T& value, std::string_view name) {
    out_ << YAML::BeginMap;
    path_.emplace_back(name);
    Describe(*this, value);
    path_.pop_back();
    out_ << YAML::EndMap;
  }
  void PutNumber(std::string_view key, const std::string& text) {
    out_ << YAML::Key << std::string(key) << YAML::Value;
    PutUncertain(key, text);
  }
  void PutUncertain(std::string_view key, const std::string& text) {
    if (uncertain_ != nullptr && !uncertain_->empty()) {
      const std::string path = fmt::format("{}{}{}", fmt::join(path_, "."), path_.empty() ? "" : ".", key);
      if (const auto found = uncertain_->find(path); found != uncertain_->end()) {
        out_ << YAML::Flow << YAML::BeginMap << YAML::Key << "value" << YAML::Value << text << YAML::Key
             << "within" << YAML::Value << UncertaintyText(found->second) << YAML::EndMap;
        return;
      }
    }
    out_ << text;
  }
  void Put(std::string_view key, const std::string& text) {
    out_ << YAML::Key << std::string(key) << YAML::Value << text;
  }
  template <class T, class F>
  void PutAll(std::string_view key, const std::vector<T>& values, F text) {
    out_ << YAML::Key << std::string(key) << YAML::Value << YAML::Flow << YAML::BeginSeq;
    for (std::size_t i = 0; i < values.size(); ++i)
      PutUncertain(fmt::format("{}[{}]", key, i + 1), text(values[i]));
    out_ << YAML::EndSeq;
  }

  YAML::Emitter out_;
  const std::map<std::string, Uncertainty>* uncertain_ = nullptr;
  std::vector<std::string> path_;
};

}  // namespace tendril::config
