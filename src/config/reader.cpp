// Strict reading of one YAML mapping and the wording of every error. Knows nothing of robots.
#include "reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <numeric>

#include "document.h"
#include "units.h"
#include "within.h"

namespace tendril::config {
namespace {

std::string Join(const std::string& path, std::string_view key) {
  return path.empty() ? Printable(key) : path + "." + Printable(key);
}

std::string Lowered(std::string text) {
  for (char& c : text) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return text;
}

std::size_t EditDistance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, replaced});
    }
  }
  return row.back();
}

std::string_view StemOf(std::string_view key) { return key.substr(0, key.rfind('_')); }

bool IsPlainScalar(const YAML::Node& node) { return node.IsScalar() && node.Tag() != "!"; }

bool Within(double value, Range range) {
  return (range.above_min ? value > range.min : value >= range.min) && value <= range.max;
}

std::string CountText(Range count, std::string_view what) {
  if (count.min == count.max) return fmt::format("a list of {} {}", count.min, what);
  return fmt::format("a list of {} .. {} {}", count.min, count.max, what);
}

}  // namespace

std::string RangeText(std::string_view key, Range range) {
  const std::string_view unit = UnitText(UnitSuffix(key));
  std::string text = range.above_min ? fmt::format("above {} up to {}", range.min, range.max)
                                     : fmt::format("{} .. {}", range.min, range.max);
  if (!unit.empty()) text += fmt::format(" {}", unit);
  return text;
}

Reader::Reader(const Source& source, std::vector<Layer> layers)
    : source_(&source), layers_(std::move(layers)) {
  for (const Layer& layer : layers_) {
    std::vector<std::pair<std::string, int>> seen;
    for (const auto& entry : layer.map) {
      const int line = LineOf(entry.first);
      if (!entry.first.IsScalar()) {
        Fail(line, layer.path.empty() ? "(top level)" : layer.path,
             "a key is not a plain word; accepted: key: value; correct it");
      }
      const std::string& key = entry.first.Scalar();
      for (const auto& [earlier, first_line] : seen) {
        if (earlier == key) {
          Fail(line, Join(layer.path, key),
               fmt::format("given twice (first on line {}); accepted: once; remove one of them", first_line));
        }
      }
      seen.emplace_back(key, line);
    }
  }
}

void Reader::Fail(int line, const std::string& path, const std::string& rest) const {
  throw ConfigError(fmt::format("{}:{}: {}: {}", source_->name, line, path, rest));
}

std::optional<Reader::Found> Reader::Find(std::string_view key) const {
  for (const Layer& layer : layers_) {
    for (const auto& entry : layer.map) {
      if (entry.first.Scalar() == key)
        return Found{entry.second, &layer, LineOf(entry.first), Join(layer.path, key)};
    }
  }
  return std::nullopt;
}

bool Reader::Has(std::string_view key) const { return Find(key).has_value(); }

std::optional<Reader::Found> Reader::Lookup(std::string_view key, const std::string& accepted) {
  known_.emplace_back(key);
  auto found = Find(key);
  if (!found) {
    if (!missing_) missing_ = {std::string(key), accepted};
    return std::nullopt;
  }
  if (found->value.IsNull()) {
    Fail(found->line, found->path,
         fmt::format("has no value; accepted: {}; write one after the colon", accepted));
  }
  return found;
}

double Reader::ToNumber(const Found& found, std::string_view key, Range range) const {
  const Parts parts = PartsOf(found, RangeText(key, range));
  const double value = ToPlainNumber(parts.value, key, range);
  if (parts.within) KeepUncertainty(found, *parts.within, key, value, range);
  return value;
}

double Reader::ToPlainNumber(const Found& found, std::string_view key, Range range) const {
  const std::string accepted = RangeText(key, range);
  if (!IsPlainScalar(found.value)) {
    Fail(found.line, found.path,
         fmt::format("is {}, not a number; accepted: {}; write a plain number", TypeName(found.value),
                     accepted));
  }
  const std::string& text = found.value.Scalar();
  const std::string lowered = Lowered(text);
  for (const std::string_view word :
       {"nan", "inf", ".nan", ".inf", "+.inf", "-.inf", "+inf", "-inf", "infinity"}) {
    if (lowered == word) {
      Fail(found.line, found.path,
           fmt::format("{} is not finite; accepted: {}; write a finite number", text, accepted));
    }
  }
  double value = 0;
  const char* begin = text.data() + (text.size() > 1 && text[0] == '+' && text[1] != '-' ? 1 : 0);
  const auto [end, error] = std::from_chars(begin, text.data() + text.size(), value);
  if (error == std::errc::result_out_of_range) {
    Fail(found.line, found.path,
         fmt::format("{} does not fit into a double; accepted: {}; correct the exponent", Printable(text),
                     accepted));
  }
  if (error != std::errc() || end != text.data() + text.size()) {
    const bool number_first = error == std::errc();
    Fail(found.line, found.path,
         fmt::format("'{}' is not a number; accepted: {}; {}", Printable(text), accepted,
                     number_first
                         ? "write the number alone, with a decimal point: the unit is in the key's name"
                         : "write a number"));
  }
  if (!Within(value, range)) {
    std::string remedy = "correct the value";
    if (const auto other = GuessOtherUnit(UnitSuffix(key), value, range.min, range.max)) {
      remedy = fmt::format("{} looks like {}: write {:.10g}", text, other->name, value * other->factor);
    }
    Fail(found.line, found.path, fmt::format("{} is out of range; accepted: {}; {}", text, accepted, remedy));
  }
  return value;
}

long long Reader::ToInteger(const Found& found, std::string_view key, Range range) const {
  const Parts parts = PartsOf(found, "whole number " + RangeText(key, range));
  const long long value = ToPlainInteger(parts.value, key, range);
  if (parts.within) KeepUncertainty(found, *parts.within, key, static_cast<double>(value), range);
  return value;
}

long long Reader::ToPlainInteger(const Found& found, std::string_view key, Range range) const {
  const std::string accepted = "whole number " + RangeText(key, range);
  if (!IsPlainScalar(found.value)) {
    Fail(found.line, found.path,
         fmt::format("is {}, not a whole number; accepted: {}; write a plain number", TypeName(found.value),
                     accepted));
  }
  const std::string& text = found.value.Scalar();
  const bool hex = text.starts_with("0x") || text.starts_with("0X");
  const char* begin = text.data() + (hex ? 2 : 0);
  long long value = 0;
  const auto [end, error] = std::from_chars(begin, text.data() + text.size(), value, hex ? 16 : 10);
  const bool octal_looking = !hex && text.size() > 1 && text[0] == '0';
  if (error == std::errc::invalid_argument || end != text.data() + text.size() || octal_looking ||
      (hex && *begin == '-')) {
    Fail(found.line, found.path,
         fmt::format(
             "'{}' is not a whole number; accepted: {}; write digits only, or 0x and hexadecimal digits",
             Printable(text), accepted));
  }
  if (error == std::errc::result_out_of_range || !Within(static_cast<double>(value), range)) {
    std::string remedy = "correct the value";
    if (const auto other =
            GuessOtherUnit(UnitSuffix(key), static_cast<double>(value), range.min, range.max)) {
      const double whole = std::round(static_cast<double>(value) * other->factor);
      if (Within(whole, range))
        remedy = fmt::format("{} looks like {}: write {:.0f}", text, other->name, whole);
    }
    Fail(found.line, found.path,
         fmt::format("{} is out of range; accepted: {}; {}", Printable(text), accepted, remedy));
  }
  return value;
}

void Reader::Number(std::string_view key, double& value, Range range, std::string_view) {
  const auto found = Lookup(key, RangeText(key, range));
  if (!found) return;
  value = ToNumber(*found, key, range);
  ReadHidden(key, range);
}

Reader::Parts Reader::PartsOf(const Found& number, const std::string& accepted) const {
  const bool uncertain = source_->uncertain != nullptr && number.value.IsMap() &&
                         (number.value["value"] || number.value["within"]);
  if (!uncertain) return {number, std::nullopt};
  Reader inside(*source_, {{number.value, number.path, number.line}});
  const auto value = inside.Lookup("value", accepted);
  std::optional<Found> within;
  if (inside.Has("within")) {
    within = inside.Lookup("within", WithinAccepted(""));
  } else {
    inside.Allow("within");
  }
  inside.Finish();
  return {*value, within};  // Finish has refused the mapping without a value
}

void Reader::KeepUncertainty(const Found& number, const Found& within, std::string_view key, double value,
                             Range range) const {
  try {
    (*source_->uncertain)[number.path] = ReadWithin(within.value, key, value, range);
  } catch (const ConfigError& e) {
    Fail(within.line, within.path, e.what());
  }
}

void Reader::ReadHidden(std::string_view key, Range range) const {
  const auto first = Find(key);
  if (source_->uncertain == nullptr || !first) return;
  for (const Layer& layer : layers_) {
    for (const auto& entry : layer.map) {
      if (&layer == first->layer || entry.first.Scalar() != key) continue;
      Found hidden{entry.second, &layer, LineOf(entry.first), Join(layer.path, key)};
      if (entry.second.IsMap()) ToNumber(hidden, key, range);
      for (std::size_t i = 0; entry.second.IsSequence() && i < entry.second.size(); ++i) {
        const YAML::Node item = entry.second[i];
        if (item.IsMap())
          ToNumber({item, &layer, LineOf(item), fmt::format("{}[{}]", hidden.path, i + 1)}, key, range);
      }
    }
  }
}

void Reader::PassUncertainty(std::string_view from, double value, double power,
                             std::initializer_list<std::string_view> to) {
  if (source_->uncertain == nullptr) return;
  const std::string& path = layers_.back().path;
  const auto given = source_->uncertain->extract(Join(path, from));
  if (given.empty()) return;
  Uncertainty passed = given.mapped();
  if (passed.kind == Uncertainty::Kind::kAbsolute)
    passed = {Uncertainty::Kind::kShare, passed.deviation / value};
  passed.deviation *= power;
  for (const std::string_view key : to) (*source_->uncertain)[Join(path, key)] = passed;
}

void Reader::ReorderUncertainty(std::string_view list, const std::vector<std::size_t>& order) {
  if (source_->uncertain == nullptr) return;
  const std::string path = Join(layers_.back().path, list) + "[";
  std::map<std::string, Uncertainty> renamed;
  for (std::size_t i = 0; i < order.size(); ++i) {
    const std::string was = fmt::format("{}{}]", path, order[i] + 1), is = fmt::format("{}{}]", path, i + 1);
    for (const auto& [key, uncertainty] : *source_->uncertain) {
      if (key.starts_with(was)) renamed[is + key.substr(was.size())] = uncertainty;
    }
  }
  std::erase_if(*source_->uncertain, [&](const auto& entry) { return entry.first.starts_with(path); });
  source_->uncertain->merge(renamed);
}

void Reader::IntegerValue(std::string_view key, long long& value, Range range) {
  const auto found = Lookup(key, "whole number " + RangeText(key, range));
  if (!found) return;
  value = ToInteger(*found, key, range);
  ReadHidden(key, range);
}

void Reader::Flag(std::string_view key, bool& value, std::string_view) {
  const auto found = Lookup(key, "true or false");
  if (!found) return;
  const bool plain = IsPlainScalar(found->value);
  const std::string text = plain ? found->value.Scalar() : std::string(TypeName(found->value));
  if (!plain || (text != "true" && text != "false")) {
    Fail(found->line, found->path,
         fmt::format("'{}' is neither true nor false; accepted: true or false; write one of them",
                     Printable(text)));
  }
  value = text == "true";
}

void Reader::Text(std::string_view key, std::string& value, const TextRule& rule, std::string_view) {
  const auto found = Lookup(key, std::string(rule.accepted));
  if (!found) return;
  if (!found->value.IsScalar()) {
    Fail(found->line, found->path,
         fmt::format("is {}, not text; accepted: {}; write one line of text", TypeName(found->value),
                     rule.accepted));
  }
  if (!rule.ok(found->value.Scalar())) {
    Fail(found->line, found->path,
         fmt::format("'{}' is not accepted; accepted: {}; correct the text", Printable(found->value.Scalar()),
                     rule.accepted));
  }
  value = found->value.Scalar();
}

int Reader::ChoiceIndex(std::string_view key, const std::vector<std::string_view>& names) {
  const std::string accepted = fmt::format("{}", fmt::join(names, ", "));
  const auto found = Lookup(key, accepted);
  if (!found) return -1;
  if (found->value.IsScalar()) {
    const auto it = std::find(names.begin(), names.end(), found->value.Scalar());
    if (it != names.end()) return static_cast<int>(it - names.begin());
  }
  Fail(found->line, found->path,
       fmt::format("'{}' is not known; accepted: {}; choose one",
                   found->value.IsScalar() ? Printable(found->value.Scalar()) : TypeName(found->value),
                   accepted));
}

std::vector<Reader::Found> Reader::Elements(std::string_view key, std::string_view what, Range count) {
  const std::string accepted = CountText(count, what);
  const auto found = Lookup(key, accepted);
  if (!found) return {};
  if (!found->value.IsSequence()) {
    Fail(found->line, found->path,
         fmt::format("is {}, not a list; accepted: {}; write [a, b, ...] or lines with '- '",
                     TypeName(found->value), accepted));
  }
  if (!Within(static_cast<double>(found->value.size()), count)) {
    Fail(found->line, found->path,
         fmt::format("has {} entries; accepted: {}; {}", found->value.size(), accepted,
                     static_cast<double>(found->value.size()) < count.min ? "add the missing ones"
                                                                          : "remove the surplus"));
  }
  std::vector<Found> elements;
  for (const auto& item : found->value) {
    elements.push_back(
        {item, found->layer, LineOf(item), fmt::format("{}[{}]", found->path, elements.size() + 1)});
  }
  return elements;
}

void Reader::Numbers(std::string_view key, std::vector<double>& values, Range range, Range count,
                     std::string_view) {
  values.clear();
  for (const Found& item : Elements(key, fmt::format("numbers, each {}", RangeText(key, range)), count)) {
    values.push_back(ToNumber(item, key, range));
  }
  ReadHidden(key, range);
}

void Reader::Integers(std::string_view key, std::vector<long long>& values, Range range, Range count,
                      std::string_view) {
  values.clear();
  for (const Found& item :
       Elements(key, fmt::format("whole numbers, each {}", RangeText(key, range)), count)) {
    values.push_back(ToInteger(item, key, range));
  }
}

void Reader::Identifiers(std::string_view key, std::vector<std::uint32_t>& values, Range count,
                         std::string_view meaning) {
  std::vector<long long> wide;
  Integers(key, wide, {0, std::numeric_limits<std::uint32_t>::max()}, count, meaning);
  values.assign(wide.begin(), wide.end());
}

void Reader::Words(std::string_view key, std::vector<std::string>& values,
                   std::initializer_list<std::string_view> choices, std::string_view) {
  values.clear();
  const std::string accepted = fmt::format("{}", fmt::join(choices, ", "));
  const Range count{1, static_cast<double>(choices.size())};
  for (const Found& item : Elements(key, fmt::format("of {}", accepted), count)) {
    const std::string word = item.value.IsScalar() ? item.value.Scalar() : "";
    const bool known = std::find(choices.begin(), choices.end(), word) != choices.end();
    if (!known || std::find(values.begin(), values.end(), word) != values.end()) {
      Fail(item.line, item.path,
           fmt::format("'{}' is {}; accepted: {}, each at most once; {}",
                       item.value.IsScalar() ? Printable(word) : TypeName(item.value),
                       known ? "there twice" : "not known", accepted,
                       known ? "remove one" : "choose among them"));
    }
    values.push_back(word);
  }
}

std::vector<Layer> Reader::Children(std::string_view key) {
  static const std::string kAccepted = "a mapping of keys to values";
  if (!Lookup(key, kAccepted)) return {};
  std::vector<Layer> inner;
  for (const Layer& layer : layers_) {
    for (const auto& entry : layer.map) {
      if (entry.first.Scalar() != key) continue;
      const std::string path = Join(layer.path, key);
      if (!entry.second.IsMap()) {
        Fail(LineOf(entry.first), path,
             fmt::format("is {}, not a mapping; accepted: {}; indent its keys below it",
                         TypeName(entry.second), kAccepted));
      }
      inner.push_back({entry.second, path, LineOf(entry.first)});
    }
  }
  return inner;
}

std::vector<Layer> Reader::Items(std::string_view key, Range count) {
  std::vector<Layer> items;
  for (const Found& item : Elements(key, "mappings", count)) {
    if (!item.value.IsMap()) {
      Fail(item.line, item.path,
           fmt::format("is {}, not a mapping; accepted: a mapping of keys to values; correct it",
                       TypeName(item.value)));
    }
    items.push_back({item.value, item.path, item.line});
  }
  return items;
}

void Reader::Refuse(std::string_view key, const std::string& wrong_accepted_remedy) const {
  // Walks down the key path as far as it exists; the deepest key found gives the line.
  std::vector<Layer> level = layers_;
  int line = level.back().line;
  std::string path = level.back().path;
  while (!key.empty()) {
    const std::string_view step = key.substr(0, key.find('.'));
    const std::string_view name = step.substr(0, step.find('['));
    key.remove_prefix(std::min(key.size(), step.size() + 1));
    std::size_t item = 0;  // entry of a list, from 1: "effects[2]"
    if (name.size() < step.size()) {
      std::from_chars(step.data() + name.size() + 1, step.data() + step.size(), item);
    }
    std::vector<Layer> next;
    for (const Layer& layer : level) {
      for (const auto& entry : layer.map) {
        if (entry.first.Scalar() != name) continue;
        const bool in_list = item > 0 && entry.second.IsSequence() && item <= entry.second.size();
        const YAML::Node node = in_list ? entry.second[item - 1] : entry.second;
        next.push_back({node, Join(layer.path, step), in_list ? LineOf(node) : LineOf(entry.first)});
      }
    }
    if (next.empty()) {
      path = Join(path, step);
      break;
    }
    line = next.front().line;
    path = next.front().path;
    std::erase_if(next, [](const Layer& layer) { return !layer.map.IsMap(); });
    level = std::move(next);
  }
  Fail(line, path, wrong_accepted_remedy);
}

std::string_view Reader::FirstOverridden(std::initializer_list<std::string_view> keys) const {
  const auto gives = [](YAML::Node node, std::string_view path) {
    while (!path.empty()) {
      const std::string_view step = path.substr(0, path.find('.'));
      path.remove_prefix(std::min(path.size(), step.size() + 1));
      YAML::Node inner;
      for (const auto& entry : node) {
        if (entry.first.Scalar() == step) inner.reset(entry.second);
      }
      if (inner.IsNull()) return false;
      node.reset(inner);
    }
    return true;
  };
  if (layers_.size() > 1) {
    for (const std::string_view key : keys) {
      if (gives(layers_.front().map, key)) return key;
    }
  }
  return *keys.begin();
}

void Reader::Check(bool ok, std::string_view key, const std::string& wrong_accepted_remedy) {
  // With missing keys the values are incomplete; Finish reports that instead.
  if (!ok && !missing_) Refuse(key, wrong_accepted_remedy);
}

void Reader::Finish() {
  for (const Layer& layer : layers_) {
    std::vector<std::string> known = known_;
    if (&layer == &layers_.back())
      known.insert(known.end(), known_in_common_.begin(), known_in_common_.end());
    for (const auto& entry : layer.map) {
      const std::string& key = entry.first.Scalar();
      if (std::find(known.begin(), known.end(), key) != known.end()) continue;
      const int line = LineOf(entry.first);
      const std::string path = Join(layer.path, key);
      for (const std::string& candidate : known) {
        const std::string_view unit = UnitSuffix(candidate);
        if (unit.empty()) continue;
        if (key == StemOf(candidate)) {
          Fail(line, path,
               fmt::format("unknown key: the unit is missing; accepted: {} in {}; write {}", candidate,
                           UnitText(unit), candidate));
        }
        if (key.find('_') == std::string::npos || StemOf(key) != StemOf(candidate)) continue;
        const std::string_view given = std::string_view(key).substr(key.rfind('_') + 1);
        const auto other = FindOtherUnit(unit, given);
        double value = 0;
        std::string example = candidate;
        if (other && entry.second.IsScalar()) {
          const std::string& text = entry.second.Scalar();
          if (std::from_chars(text.data(), text.data() + text.size(), value).ec == std::errc()) {
            example = fmt::format("{}: {:.10g}", candidate, value * other->factor);
          }
        }
        Fail(line, path,
             fmt::format("unknown key: the unit {} is not accepted here; accepted: {} in {}; write {}",
                         other ? other->name : Printable(given), candidate, UnitText(unit), example));
      }
      if (key == "<<") {
        Fail(line, path, "merge keys are not read; accepted: anchors of whole blocks; write the keys out");
      }
      const auto nearest = std::min_element(known.begin(), known.end(), [&](const auto& a, const auto& b) {
        return EditDistance(key, a) < EditDistance(key, b);
      });
      const bool close = nearest != known.end() && EditDistance(key, *nearest) <= 1 + key.size() / 4;
      Fail(line, path,
           fmt::format("unknown key; accepted: {}; {}", fmt::join(known, ", "),
                       close ? fmt::format("did you mean {}?", *nearest) : "remove it or correct its place"));
    }
  }
  if (missing_) {
    const Layer& last = layers_.back();
    Fail(last.line, Join(last.path, missing_->key),
         fmt::format("missing; accepted: {}; add it{}", missing_->accepted,
                     last.path.empty() ? " at the top level" : " below " + last.path));
  }
}

}  // namespace tendril::config
