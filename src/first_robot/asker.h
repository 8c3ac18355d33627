// One question after another: its key with the range that the answers so far leave, and the answer as a
// value. Knows no robot.
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "tendril/first_robot/questions.h"

namespace tendril::first_robot {

class Asker {
 public:
  using Rewrite = std::function<std::string(std::size_t section, const std::string& text)>;

  explicit Asker(const Dialogue& dialogue);

  std::string Text(std::string_view name, const std::string& suggestion);
  std::string Choice(std::string_view name, std::vector<std::string> choices, const std::string& suggestion);
  /// Of the choices that the item's key has.
  std::string Choice(std::string_view name, const std::string& suggestion);
  /// Within the item's own range and this one. The answer may say how well it is known ("0.02 within 4 %").
  double Number(std::string_view name, double suggestion, config::Range range = kAny);
  int Integer(std::string_view name, double suggestion, config::Range range = kAny);
  /// The same, or a word: `none`.
  double NumberOrNone(std::string_view name, double suggestion);
  /// One value for each section, with the suggestion and the range of each. `rewrite`: other forms of an
  /// answer as a number in the item's unit.
  std::vector<double> Each(std::string_view name, const std::vector<double>& suggestions,
                           const std::vector<config::Range>& ranges, const Rewrite& rewrite = nullptr);
  /// What the answer of Each said of how well section k's number is known, from 0.
  std::optional<Uncertainty> WithinOf(std::string_view name, std::size_t k) const;
  /// The same of the answers of Number, by key of the robot file.
  const std::map<std::string, Uncertainty>& uncertain() const { return uncertain_; }
  /// Whole numbers, `count` of them, all different.
  std::vector<int> Different(std::string_view name, const std::vector<int>& suggestion);

  /// The accepted range of a key of the robot file.
  config::Range RangeOf(std::string_view path) const;

  static constexpr config::Range kAny{-1e300, 1e300};

 private:
  Question QuestionOf(std::string_view name) const;
  /// Asks until `read` accepts the answer.
  void Until(const Question& question, const std::function<void(const std::string&)>& read) const;

  const Dialogue& dialogue_;
  std::vector<config::Key> robot_keys_, daemon_keys_;
  std::map<std::string, Uncertainty> uncertain_;
  std::map<std::string, std::vector<std::optional<Uncertainty>>, std::less<>> within_;  // by item
};

/// The part of `own` that lies in `narrower`, its ends of four digits.
config::Range Within(config::Range own, config::Range narrower);

}  // namespace tendril::first_robot
