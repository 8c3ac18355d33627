// The third use of the descriptions beside reader.h and writer.h: what each key means and accepts, as a list.
// Knows nothing of robots.
#pragma once

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <concepts>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "reader.h"
#include "tendril/config/keys.h"

namespace tendril::config {

class Lister {
 public:
  static constexpr bool kReading = false, kListing = true;

  /// Adds to `keys`, all below `prefix` ("bus."). `defaults`: the structs' values apply if the block is
  /// missing.
  Lister(std::vector<Key>& keys, std::string prefix, bool defaults = false)
      : keys_(keys), prefix_(std::move(prefix)), defaults_(defaults) {}

  /// The next key may be omitted, and this is its default.
  void MayBeLeftOut(std::string_view otherwise) { otherwise_ = otherwise; }
  void MayBeLeftOut(double otherwise) { otherwise_ = fmt::format("{}", otherwise); }
  /// The next key stands in place of these.
  void InsteadOf(std::vector<std::string> others) { instead_of_ = std::move(others); }
  /// Until the next call: keys that may be omitted, or 0, where `key` has this value.
  void NeedlessWhere(std::string_view key, std::string_view value) {
    needless_ = {std::string(key), std::string(value)};
  }
  /// The last key accepts only these of its range.
  void Only(std::span<const int> numbers) {
    for (const int number : numbers) keys_.back().choices.push_back(fmt::format("{}", number));
  }
  /// The next block may be omitted, and its struct is the default.
  void BlockMayBeLeftOut() {
    MayBeLeftOut("the values given at its keys");
    block_has_defaults_ = true;
  }

  void Number(std::string_view key, double& value, Range range, std::string_view meaning) {
    Typed(Add(key, meaning, RangeText("", range), fmt::format("{}", value)), Key::Type::kNumber, range);
  }
  template <std::integral T>
  void Integer(std::string_view key, T& value, Range range, std::string_view meaning) {
    Typed(Add(key, meaning, "whole number " + RangeText("", range), fmt::format("{}", value)),
          Key::Type::kInteger, range);
  }
  void Identifier(std::string_view key, std::uint32_t&, std::string_view meaning) {
    Typed(Add(key, meaning, kIdentifier), Key::Type::kInteger, kIdentifiers);
  }
  void Flag(std::string_view key, bool&, std::string_view meaning) {
    Add(key, meaning, "true, false").type = Key::Type::kFlag;
  }
  void Text(std::string_view key, std::string&, const TextRule& rule, std::string_view meaning) {
    Add(key, meaning, rule.accepted).pattern = rule.pattern;
  }
  template <class E>
  void Choice(std::string_view key, E&, Choices<E> choices, std::string_view meaning) {
    std::string names;
    for (const auto& choice : choices) names += (names.empty() ? "" : ", ") + std::string(choice.first);
    Key& added = Add(key, meaning, names);
    added.type = Key::Type::kChoice;
    for (const auto& choice : choices) added.choices.emplace_back(choice.first);
  }
  void Numbers(std::string_view key, std::vector<double>&, Range range, Range count,
               std::string_view meaning) {
    Typed(Add(key, meaning, CountText(count, "numbers") + ", each " + RangeText("", range)),
          Key::Type::kNumber, range, count);
  }
  void Integers(std::string_view key, std::vector<long long>&, Range range, Range count,
                std::string_view meaning) {
    Typed(Add(key, meaning, "a list of whole numbers, each " + RangeText("", range)), Key::Type::kInteger,
          range, Range{1, count.max});  // as many as the robot has of what they are given for
  }
  void Identifiers(std::string_view key, std::vector<std::uint32_t>&, Range count, std::string_view meaning) {
    Typed(Add(key, meaning, CountText(count, "numbers") + fmt::format(", each {}", kIdentifier)),
          Key::Type::kInteger, kIdentifiers, count);
  }
  void Words(std::string_view key, std::vector<std::string>&, std::initializer_list<std::string_view> choices,
             std::string_view meaning) {
    Key& added = Add(key, meaning, fmt::format("a list of {}, each at most once", fmt::join(choices, ", ")));
    added.type = Key::Type::kChoice;
    added.choices.assign(choices.begin(), choices.end());
    added.count = Range{1, static_cast<double>(choices.size())};
  }

  template <class T>
  void Block(std::string_view key, T& value, std::string_view meaning) {
    const bool defaults = std::exchange(block_has_defaults_, false);
    Group(
        key, meaning, [&](Lister& inside) { Describe(inside, value); }, defaults);
  }
  template <class T>
  void OptionalBlock(std::string_view key, std::optional<T>& value, std::string_view meaning) {
    MayBeLeftOut("none");
    Block(key, value.emplace(), meaning);
  }
  template <class T>
  void List(std::string_view key, std::vector<T>&, Range count, std::string_view meaning) {
    Key& added = Add(key, meaning, CountText(count, "entries"));
    added.kind = Key::Kind::kList;
    added.count = count;
    T entry;
    Lister inside(keys_, fmt::format("{}{}[].", prefix_, key));
    Describe(inside, entry);
  }
  /// A block whose keys `describe(Lister&)` lists.
  template <class F>
  void Group(std::string_view key, std::string_view meaning, const F& describe, bool defaults = false) {
    Add(key, meaning, "").kind = Key::Kind::kBlock;
    Lister inside(keys_, fmt::format("{}{}.", prefix_, key), defaults);
    describe(inside);
  }
  /// A mapping whose keys the writer chooses; `range`: of its numbers, where it has numbers.
  void Mapping(std::string_view key, std::string_view accepted, std::string_view meaning,
               std::optional<Range> range = std::nullopt) {
    Key& added = Add(key, meaning, accepted);
    added.kind = Key::Kind::kMapping;
    added.range = range;
  }
  void Check(bool, std::string_view, const std::string&) {}

 private:
  static constexpr std::string_view kIdentifier = "0x00000000 .. 0xFFFFFFFF";
  static constexpr Range kIdentifiers{0, std::numeric_limits<std::uint32_t>::max()};

  static std::string CountText(Range count, std::string_view what) {
    return count.min == count.max ? fmt::format("{} {}", count.min, what)
                                  : fmt::format("{} .. {} {}", count.min, count.max, what);
  }
  static void Typed(Key& key, Key::Type type, Range range, std::optional<Range> count = std::nullopt) {
    key.type = type;
    key.range = range;
    key.count = count;
  }
  Key& Add(std::string_view key, std::string_view meaning, std::string_view accepted,
           const std::string& value = "") {
    Key& added = keys_.emplace_back();
    added.path = prefix_ + std::string(key);
    added.meaning = meaning;
    added.accepted = accepted;
    added.unit = UnitOfKey(key);
    added.otherwise = std::exchange(otherwise_, std::nullopt);
    added.without_block = defaults_ ? value : "";
    added.instead_of = std::exchange(instead_of_, {});
    added.needless = needless_;
    return added;
  }

  std::vector<Key>& keys_;
  std::string prefix_;
  bool defaults_ = false, block_has_defaults_ = false;
  std::optional<std::string> otherwise_;
  std::vector<std::string> instead_of_;
  std::pair<std::string, std::string> needless_;
};

}  // namespace tendril::config
