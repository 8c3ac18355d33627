// The inverse of reader.h: the same descriptions, every value written out. Doubles get enough digits to be
// read back bit for bit. Knows nothing of robots.
#pragma once

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <concepts>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "reader.h"

namespace tendril::config {

class Writer {
 public:
  static constexpr bool kReading = false, kListing = false;

  Writer() { out_ << YAML::BeginMap; }

  void Number(std::string_view key, double& value, Range, std::string_view) { Put(key, Shortest(value)); }
  template <std::integral T>
  void Integer(std::string_view key, T& value, Range, std::string_view) {
    Put(key, fmt::format("{}", value));
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

  template <class T>
  void Block(std::string_view key, T& value, std::string_view) {
    out_ << YAML::Key << std::string(key) << YAML::Value;
    Map(value);
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
    for (T& value : values) Map(value);
    out_ << YAML::EndSeq;
  }
  void Check(bool, std::string_view, const std::string&) {}

  void BeginBlock(const std::string& key) { out_ << YAML::Key << key << YAML::Value << YAML::BeginMap; }
  void EndBlock() { out_ << YAML::EndMap; }

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
  void Map(T& value) {
    out_ << YAML::BeginMap;
    Describe(*this, value);
    out_ << YAML::EndMap;
  }
  void Put(std::string_view key, const std::string& text) {
    out_ << YAML::Key << std::string(key) << YAML::Value << text;
  }
  template <class T, class F>
  void PutAll(std::string_view key, const std::vector<T>& values, F text) {
    out_ << YAML::Key << std::string(key) << YAML::Value << YAML::Flow << YAML::BeginSeq;
    for (const T& value : values) out_ << text(value);
    out_ << YAML::EndSeq;
  }

  YAML::Emitter out_;
};

}  // namespace tendril::config
