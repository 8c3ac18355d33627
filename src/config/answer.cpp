// Values are read by the reader of the files, so that they are judged and refused as there.
#include "tendril/config/answer.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <regex>
#include <stdexcept>
#include <string_view>

#include "reader.h"
#include "units.h"
#include "within.h"

namespace tendril::config {
namespace {

std::string_view Trimmed(std::string_view text) {
  while (!text.empty() && text.front() == ' ') text.remove_prefix(1);
  while (!text.empty() && text.back() == ' ') text.remove_suffix(1);
  return text;
}

/// "60 mm" as "0.06" for a key in metres; any other text as it is.
std::string InUnitOf(const std::string& name, std::string_view text) {
  text = Trimmed(text);
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  const std::string_view unit = Trimmed(text.substr(static_cast<std::size_t>(end - text.data())));
  if (error != std::errc() || unit.empty()) return std::string(text);
  const std::string_view own = UnitSuffix(name);
  if (!own.empty() && (unit == own || unit == UnitText(own))) return fmt::format("{}", value);
  if (const auto other = FindOtherUnit(own, unit)) return fmt::format("{:.12g}", value * other->factor);
  return std::string(text);
}

ConfigError Refused(const Key& key, std::string_view text, const std::string& accepted) {
  return ConfigError(
      fmt::format("{}: '{}' is not accepted; accepted: {}; correct it", key.path, text, accepted));
}

}  // namespace

double ReadNumber(const Key& key, const std::string& text) {
  YAML::Node map;
  map[key.path] = InUnitOf(key.path, text);
  const Source source{"answer"};
  Reader reader(source, {{map, "", 0}});
  double value = 0;
  try {
    if (key.type == Key::Type::kInteger) {
      long long whole = 0;
      reader.Integer(key.path, whole, *key.range, "");
      value = static_cast<double>(whole);
    } else {
      reader.Number(key.path, value, *key.range, "");
    }
  } catch (const ConfigError& e) {  // "answer:LINE: " is no place
    const std::string line = e.what();
    throw ConfigError(line.substr(line.find(": ") + 2));
  }
  if (!key.choices.empty() &&
      std::find(key.choices.begin(), key.choices.end(), fmt::format("{}", value)) == key.choices.end())
    throw Refused(key, text, fmt::format("{}", fmt::join(key.choices, ", ")));
  return value;
}

std::pair<std::string, std::string> PartsOfAnswer(const std::string& text) {
  constexpr std::string_view kWithin = " within ";
  const std::size_t at = text.find(kWithin);
  if (at == text.npos) return {text, ""};
  return {text.substr(0, at), std::string(Trimmed(std::string_view(text).substr(at + kWithin.size())))};
}

Uncertainty ReadUncertainty(const Key& key, const std::string& text, double value) {
  try {
    return ReadWithin(InUnitOf(key.path, text), key.path, value, *key.range);
  } catch (const ConfigError& e) {
    throw ConfigError(fmt::format("{}: within: {}", key.path, e.what()));
  }
}

std::string ReadText(const Key& key, const std::string& text) {
  const std::string trimmed(Trimmed(text));
  if (key.type == Key::Type::kChoice) {
    if (std::find(key.choices.begin(), key.choices.end(), trimmed) == key.choices.end())
      throw Refused(key, trimmed, fmt::format("{}", fmt::join(key.choices, ", ")));
  } else if (!std::regex_match(trimmed, std::regex(key.pattern))) {
    throw Refused(key, trimmed, key.accepted);
  }
  return trimmed;
}

const Key& KeyAt(const std::vector<Key>& keys, const std::string& path) {
  const auto found = std::find_if(keys.begin(), keys.end(), [&](const Key& key) { return key.path == path; });
  if (found == keys.end()) throw std::out_of_range("no key " + path);
  return *found;
}

}  // namespace tendril::config
