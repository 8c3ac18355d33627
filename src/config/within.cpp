#include "within.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>

#include "document.h"
#include "tendril/config/config.h"
#include "units.h"

namespace tendril::config {
namespace {

constexpr double kMostPercent = 1000;
/// Below this share of its number a deviation is the 0.1 that was to be a tenth: 0.1 Pa of an E.
constexpr double kNoDeviation = 1e-9;

std::optional<double> NumberOf(std::string_view text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

/// Of a number's text: the double next to it in decimal, so that 7 % is 0.07 and what is written is read
/// back.
double HundredthOf(std::string_view number) {
  const std::size_t e = std::min(number.find_first_of("eE"), number.size());
  int exponent = 0;
  if (e < number.size()) {
    const char* begin = number.data() + e + 1;
    std::from_chars(begin + (*begin == '+'), number.data() + number.size(), exponent);
  }
  return NumberOf(fmt::format("{}e{}", number.substr(0, e), exponent - 2)).value_or(0);
}

std::string InUnit(std::string_view key) {
  const std::string_view unit = UnitText(UnitSuffix(key));
  return unit.empty() ? "in the number's own unit" : fmt::format("in {}", unit);
}

struct Refusal {
  std::string_view key;

  [[noreturn]] void operator()(const std::string& wrong, const std::string& remedy) const {
    throw ConfigError(fmt::format("{}; accepted: {}; {}", wrong, WithinAccepted(key), remedy));
  }
};

Uncertainty ShareOf(const std::string& text, double value, const Refusal& refuse) {
  std::string_view number(text);
  number.remove_suffix(1);
  while (number.ends_with(' ')) number.remove_suffix(1);
  const auto percent = NumberOf(number);
  if (!percent || *percent <= 0 || *percent > kMostPercent) {
    refuse(fmt::format("'{}' is no share above 0 up to {} %", Printable(text), kMostPercent),
           "correct it, or write known or unknown");
  }
  if (value == 0) {
    refuse(fmt::format("{} of 0 is nothing", Printable(text)),
           fmt::format("give the deviation {}", InUnit(refuse.key)));
  }
  return {Uncertainty::Kind::kShare, HundredthOf(number)};
}

Uncertainty AbsoluteOf(const std::string& text, double value, Range range, const Refusal& refuse) {
  const auto deviation = NumberOf(text);
  if (!deviation) refuse(fmt::format("'{}' is not understood", Printable(text)), "write one of these");
  if (*deviation <= 0) {
    refuse(fmt::format("{} is no standard deviation", Printable(text)),
           "write a number above 0, or known for an exact value");
  }
  const std::string share = "for a share write it with a percent sign, as in 10 %";
  if (*deviation > range.max - range.min)
    refuse(fmt::format("{} is more than the whole range of the value", Printable(text)), share);
  if (*deviation < kNoDeviation * std::abs(value))
    refuse(fmt::format("{} is next to nothing of {:.4g}", Printable(text), value), share);
  return {Uncertainty::Kind::kAbsolute, *deviation};
}

Uncertainty Read(const std::string& text, double value, Range range, const Refusal& refuse) {
  if (text == "known") return {Uncertainty::Kind::kKnown, 0};
  if (text == "unknown") return {Uncertainty::Kind::kUnknown, 0};
  return text.ends_with('%') ? ShareOf(text, value, refuse) : AbsoluteOf(text, value, range, refuse);
}

}  // namespace

std::string WithinAccepted(std::string_view key) {
  return fmt::format("one standard deviation as a share (10 %) or a number {}, or known, or unknown",
                     InUnit(key));
}

Uncertainty ReadWithin(const YAML::Node& within, std::string_view key, double value, Range range) {
  const Refusal refuse{key};
  if (!within.IsScalar()) refuse(fmt::format("is {}", TypeName(within)), "write one of these");
  const std::string& text = within.Scalar();
  if (within.Tag() == "!" && NumberOf(text))
    refuse("is text in quotes", "remove the quotes, or write a percent sign in them");
  return Read(text, value, range, refuse);
}

Uncertainty ReadWithin(const std::string& within, std::string_view key, double value, Range range) {
  return Read(within, value, range, Refusal{key});
}

}  // namespace tendril::config
