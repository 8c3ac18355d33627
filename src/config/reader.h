// Reads one YAML mapping strictly into a struct: every key that is looked up is known, all others are
// refused. Knows keys, types, ranges and lines, nothing of robots.
#pragma once

#include <yaml-cpp/yaml.h>

#include <concepts>
#include <initializer_list>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "tendril/config/config.h"
#include "tendril/config/keys.h"
#include "tendril/core/uncertainty.h"

namespace tendril::config {

template <class E>
using Choices = std::initializer_list<std::pair<std::string_view, E>>;

/// The accepted form of a text: a check and its description.
struct TextRule {
  bool (*ok)(std::string_view text);
  std::string_view accepted;
  std::string_view pattern;  // the same as a regular expression (ECMAScript), for editors
};

/// The file under the reader, for messages.
struct Source {
  std::string name;  // as given on the command line
  /// Takes how well numbers are known, by key path; null: the numbers of this file may not say it.
  std::map<std::string, Uncertainty>* uncertain = nullptr;
};

/// A mapping with its key path and the line of its key.
struct Layer {
  YAML::Node map;
  std::string path;
  int line = 0;
};

/// Several layers form one mapping in which earlier layers override later ones key by key, at any depth.
class Reader {
 public:
  static constexpr bool kReading = true, kListing = false;

  Reader(const Source& source, std::vector<Layer> layers);

  // The last argument of each is the key's meaning: see lister.h.

  void Number(std::string_view key, double& value, Range range, std::string_view meaning);
  template <std::integral T>
  void Integer(std::string_view key, T& value, Range range, std::string_view) {
    long long wide = static_cast<long long>(value);
    IntegerValue(key, wide, range);
    value = static_cast<T>(wide);
  }
  /// An integer usually written in hexadecimal.
  void Identifier(std::string_view key, std::uint32_t& value, std::string_view meaning) {
    Integer(key, value, {0, std::numeric_limits<std::uint32_t>::max()}, meaning);
  }
  void Flag(std::string_view key, bool& value, std::string_view meaning);
  void Text(std::string_view key, std::string& value, const TextRule& rule, std::string_view meaning);
  template <class E>
  void Choice(std::string_view key, E& value, Choices<E> choices, std::string_view) {
    std::vector<std::string_view> names;
    for (const auto& c : choices) names.push_back(c.first);
    if (const int chosen = ChoiceIndex(key, names); chosen >= 0) value = choices.begin()[chosen].second;
  }
  /// A flow or block list of numbers, `count` of them (min, max).
  void Numbers(std::string_view key, std::vector<double>& values, Range range, Range count,
               std::string_view meaning);
  void Integers(std::string_view key, std::vector<long long>& values, Range range, Range count,
                std::string_view meaning);
  void Identifiers(std::string_view key, std::vector<std::uint32_t>& values, Range count,
                   std::string_view meaning);

  /// A list of at least one of these words, each at most once.
  void Words(std::string_view key, std::vector<std::string>& values,
             std::initializer_list<std::string_view> choices, std::string_view meaning);

  /// A mapping under `key`, described by Describe(Reader&, T&).
  template <class T>
  void Block(std::string_view key, T& value, std::string_view) {
    std::vector<Layer> inner = Children(key);
    if (inner.empty()) return;
    Reader reader(*source_, std::move(inner));
    Describe(reader, value);
    reader.Finish();
  }
  template <class T>
  void OptionalBlock(std::string_view key, std::optional<T>& value, std::string_view meaning) {
    value.reset();
    if (!Has(key)) return Allow(key);
    Block(key, value.emplace(), meaning);
  }
  /// A list of mappings.
  template <class T>
  void List(std::string_view key, std::vector<T>& values, Range count, std::string_view) {
    values.clear();
    for (Layer& item : Items(key, count)) {
      Reader reader(*source_, {std::move(item)});
      Describe(reader, values.emplace_back());
      reader.Finish();
    }
  }

  /// What was read of how well `from` is known counts for the keys in its place, which go by a power of it.
  void PassUncertainty(std::string_view from, double value, double power,
                       std::initializer_list<std::string_view> to);
  /// The entries of a list that was read are in another order now: entry i of them was `order[i]`, from 0.
  void ReorderUncertainty(std::string_view list, const std::vector<std::size_t>& order);

  bool Has(std::string_view key) const;
  /// The key is allowed but not read by this description.
  void Allow(std::string_view key) { known_.emplace_back(key); }
  /// Known only in the last (common) layer.
  void AllowInCommon(std::string_view key) { known_in_common_.emplace_back(key); }

  /// A rule between keys: unless `ok`, reports an error at `key` (may be a path, "motor.nominal_current_A").
  void Check(bool ok, std::string_view key, const std::string& wrong_accepted_remedy);
  [[noreturn]] void Refuse(std::string_view key, const std::string& wrong_accepted_remedy) const;

  /// The first of these key paths that an overriding layer contains; the first path when none does.
  std::string_view FirstOverridden(std::initializer_list<std::string_view> keys) const;

  /// Refuses unknown keys, then reports missing ones.
  void Finish();

  /// The mappings under `key`, one for each layer that has it; empty (and recorded as missing) when none has.
  std::vector<Layer> Children(std::string_view key);
  const std::vector<Layer>& layers() const { return layers_; }
  const Source& source() const { return *source_; }

 private:
  struct Found {
    YAML::Node value;
    const Layer* layer = nullptr;
    int line = 0;
    std::string path;
  };

  /// Of `{value: 2.3e10, within: 10 %}` both; of anything else the value.
  struct Parts {
    Found value;
    std::optional<Found> within;
  };

  std::optional<Found> Find(std::string_view key) const;
  std::optional<Found> Lookup(std::string_view key, const std::string& accepted);
  void IntegerValue(std::string_view key, long long& value, Range range);
  int ChoiceIndex(std::string_view key, const std::vector<std::string_view>& names);
  std::vector<Layer> Items(std::string_view key, Range count);
  std::vector<Found> Elements(std::string_view key, std::string_view what, Range count);
  Parts PartsOf(const Found& number, const std::string& accepted) const;
  double ToNumber(const Found& found, std::string_view key, Range range) const;
  double ToPlainNumber(const Found& found, std::string_view key, Range range) const;
  long long ToInteger(const Found& found, std::string_view key, Range range) const;
  long long ToPlainInteger(const Found& found, std::string_view key, Range range) const;
  /// The same of the common layers that an override hides: what they say of the key's uncertainty still
  /// counts.
  void ReadHidden(std::string_view key, Range range) const;
  void KeepUncertainty(const Found& number, const Found& within, std::string_view key, double value,
                       Range range) const;
  [[noreturn]] void Fail(int line, const std::string& path, const std::string& rest) const;

  const Source* source_;
  std::vector<Layer> layers_;
  std::vector<std::string> known_, known_in_common_;
  struct Missing {
    std::string key, accepted;
  };
  std::optional<Missing> missing_;
};

/// Line of a node in the file, from 1.
inline int LineOf(const YAML::Node& node) { return node.Mark().line + 1; }

/// "0.0001 .. 1 m", with the unit of the key's suffix.
std::string RangeText(std::string_view key, Range range);

}  // namespace tendril::config
