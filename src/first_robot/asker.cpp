// Ranges get narrower with the answers; a refused answer is asked for again.
#include "asker.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <sstream>
#include <stdexcept>

#include "tendril/config/answer.h"
#include "tendril/config/config.h"

namespace tendril::first_robot {
namespace {

using config::ConfigError;
using config::Key;
using config::Range;

constexpr double kDigits = 1e4;

/// With at most five digits, rounded towards zero from below or above.
double Rounded(double value, bool up) {
  if (value == 0 || !std::isfinite(value)) return value;
  const double unit = std::pow(10, std::floor(std::log10(std::abs(value)))) / kDigits;
  const double steps = value / unit;
  double whole = std::round(steps);
  if (std::abs(steps - whole) > 1e-6) whole = up ? std::ceil(steps) : std::floor(steps);
  return std::stod(fmt::format("{:.6g}", whole * unit));  // the double that the text means
}

std::string Number(double value) { return fmt::format("{:.3g}", value); }

/// Inside the range in spite of the digits that are shown.
std::string Suggestion(double value, Range range) {
  value = std::clamp(value, range.min, range.max);
  const double shown = std::stod(Number(value));
  return shown < range.min || shown > range.max ? fmt::format("{}", value) : Number(value);
}

std::vector<std::string> Parts(const std::string& text) {
  std::vector<std::string> parts;
  std::istringstream in(text);
  for (std::string part; std::getline(in, part, ',');) parts.push_back(part);
  if (parts.empty()) parts.emplace_back();
  return parts;
}

}  // namespace

Range Within(Range own, Range narrower) {
  if (narrower.min > own.min) own = {Rounded(narrower.min, true), own.max, narrower.above_min};
  own.max = std::min(own.max, Rounded(narrower.max, false));
  return own;
}

Asker::Asker(const Dialogue& dialogue)
    : dialogue_(dialogue), robot_keys_(config::RobotFileKeys()), daemon_keys_(config::DaemonFileKeys()) {}

Range Asker::RangeOf(std::string_view path) const {
  return *config::KeyAt(robot_keys_, std::string(path)).range;
}

Question Asker::QuestionOf(std::string_view name) const {
  const auto items = Items();
  const auto item = std::find_if(items.begin(), items.end(), [&](const Item& i) { return i.name == name; });
  if (item == items.end()) throw std::logic_error(fmt::format("no question {}", name));
  Question question{.item = &*item};
  if (!item->path.empty()) {
    question.key = config::KeyAt(item->daemon_file ? daemon_keys_ : robot_keys_, std::string(item->path));
    if (question.key.count && !question.key.range) {  // how many entries a list has
      question.key.type = Key::Type::kInteger;
      question.key.range = question.key.count;
    }
  }
  question.key.path = name;
  question.key.unit = config::UnitOfKey(name);
  return question;
}

void Asker::Until(const Question& question, const std::function<void(const std::string&)>& read) const {
  for (;;) {
    try {
      return read(dialogue_.answer(question));
    } catch (const ConfigError& e) {
      dialogue_.refused(question, e.what());
    }
  }
}

std::string Asker::Text(std::string_view name, const std::string& suggestion) {
  Question question = QuestionOf(name);
  question.suggestion = suggestion;
  std::string text;
  Until(question, [&](const std::string& answer) { text = config::ReadText(question.key, answer); });
  return text;
}

std::string Asker::Choice(std::string_view name, std::vector<std::string> choices,
                          const std::string& suggestion) {
  Question question = QuestionOf(name);
  question.key.type = Key::Type::kChoice;
  question.key.choices = std::move(choices);
  question.suggestion = suggestion;
  std::string text;
  Until(question, [&](const std::string& answer) { text = config::ReadText(question.key, answer); });
  return text;
}

std::string Asker::Choice(std::string_view name, const std::string& suggestion) {
  return Choice(name, QuestionOf(name).key.choices, suggestion);
}

double Asker::Number(std::string_view name, double suggestion, Range range) {
  Question question = QuestionOf(name);
  question.key.range = Within(*question.key.range, range);
  question.suggestion = Suggestion(suggestion, *question.key.range);
  double value = 0;
  Until(question, [&](const std::string& answer) {
    const auto [number, within] = config::PartsOfAnswer(answer);
    value = config::ReadNumber(question.key, number);
    if (within.empty()) return;
    std::string path(question.item->path);
    if (const std::size_t list = path.find("[]"); list != path.npos) path.insert(list + 1, "1");
    Key own = question.key;
    own.range = RangeOf(question.item->path);
    uncertain_[path] = config::ReadUncertainty(own, within, value);
  });
  return value;
}

std::optional<Uncertainty> Asker::WithinOf(std::string_view name, std::size_t k) const {
  const auto found = within_.find(name);
  return found == within_.end() ? std::nullopt : found->second[k];
}

int Asker::Integer(std::string_view name, double suggestion, Range range) {
  Question question = QuestionOf(name);
  question.key.range->min = std::max(question.key.range->min, range.min);
  question.key.range->max = std::min(question.key.range->max, range.max);
  question.suggestion = fmt::format(
      "{:.0f}", std::clamp(std::round(suggestion), question.key.range->min, question.key.range->max));
  double value = 0;
  Until(question, [&](const std::string& answer) { value = config::ReadNumber(question.key, answer); });
  return static_cast<int>(value);
}

double Asker::NumberOrNone(std::string_view name, double suggestion) {
  Question question = QuestionOf(name);
  question.suggestion = suggestion > 0 ? Suggestion(suggestion, *question.key.range) : "none";
  double value = 0;
  Until(question, [&](const std::string& answer) {
    value = answer == "none" ? 0 : config::ReadNumber(question.key, answer);
  });
  return value;
}

std::vector<double> Asker::Each(std::string_view name, const std::vector<double>& suggestions,
                                const std::vector<Range>& ranges, const Rewrite& rewrite) {
  Question question = QuestionOf(name);
  std::vector<Key> keys;
  std::vector<std::string> suggested;
  const bool whole = question.key.type == Key::Type::kInteger;
  for (std::size_t k = 0; k < ranges.size(); ++k) {
    keys.push_back(question.key);
    keys.back().range = ranges[k];
    suggested.push_back(whole
                            ? fmt::format("{:.0f}", std::clamp(suggestions[k], ranges[k].min, ranges[k].max))
                            : Suggestion(suggestions[k], ranges[k]));
  }
  Key own = question.key;  // its range is not narrowed by other answers
  question.key.range = ranges.front();
  const bool same = std::all_of(suggested.begin(), suggested.end(),
                                [&](const std::string& text) { return text == suggested.front(); });
  question.suggestion = same ? suggested.front() : fmt::format("{}", fmt::join(suggested, ", "));
  std::vector<double> values;
  const auto rewritten = [&](std::size_t k, const std::string& text) {
    return rewrite ? rewrite(k, text) : text;
  };
  Until(question, [&](const std::string& answer) {
    const std::vector<std::string> parts = Parts(answer);
    if (parts.size() != 1 && parts.size() != ranges.size()) {
      throw ConfigError(
          fmt::format("{}: {} values; accepted: one, or one for each of {} sections; correct it", name,
                      parts.size(), ranges.size()));
    }
    values.clear();
    std::vector<std::optional<Uncertainty>> uncertainties(ranges.size());
    for (std::size_t k = 0; k < ranges.size(); ++k) {
      const std::string& text = parts[parts.size() == 1 ? 0 : k];
      // A count has no uncertainty: there "within" is refused as no number.
      const auto [number, within] = whole ? std::pair(text, std::string()) : config::PartsOfAnswer(text);
      values.push_back(config::ReadNumber(keys[k], rewritten(k, number)));
      if (!within.empty()) uncertainties[k] = config::ReadUncertainty(own, rewritten(k, within), values[k]);
    }
    within_.insert_or_assign(std::string(name), uncertainties);
  });
  return values;
}

std::vector<int> Asker::Different(std::string_view name, const std::vector<int>& suggestion) {
  Question question = QuestionOf(name);
  question.suggestion = fmt::format("{}", fmt::join(suggestion, ","));
  std::vector<int> values;
  Until(question, [&](const std::string& answer) {
    values.clear();
    for (const std::string& part : Parts(answer))
      values.push_back(static_cast<int>(config::ReadNumber(question.key, part)));
    const bool different = std::set<int>(values.begin(), values.end()).size() == values.size();
    if (values.size() == suggestion.size() && different) return;
    throw ConfigError(fmt::format("{}: '{}' is not accepted; accepted: {} different numbers; correct it",
                                  name, answer, suggestion.size()));
  });
  return values;
}

}  // namespace tendril::first_robot
