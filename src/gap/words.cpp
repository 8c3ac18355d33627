#include "tendril/gap/words.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "tendril/core/angle.h"
#include "tendril/gap/report.h"

namespace tendril::gap {
namespace {

constexpr double kAny = std::numeric_limits<double>::infinity();
constexpr int kQuantityDigits = 3, kMostDigits = 4, kIntervalDigits = 2, kSigmaDigits = 2;

ShownUnit UnitFor(std::string_view unit, double size) {
  const auto listed = ShownUnits().find(unit);
  if (listed == ShownUnits().end()) return {kAny, 1, unit};
  const auto fits = [size](const ShownUnit& u) { return std::abs(size) < u.below; };
  const auto found = std::find_if(listed->second.begin(), listed->second.end(), fits);
  return found == listed->second.end() ? listed->second.back() : *found;
}

/// Decimals for `digits` significant digits of a value of this size.
int Decimals(double size, int digits) {
  return size > 0 ? digits - 1 - static_cast<int>(std::floor(std::log10(size))) : 0;
}

bool NeedsExponent(double size) { return size >= 1e5 || (size > 0 && size < 1e-4); }

std::string Exponent(double v, int digits) {
  const std::string text = fmt::format("{:.{}e}", v, digits - 1);
  const std::size_t e = text.find('e');
  return fmt::format("{}e{}", text.substr(0, e), std::stoi(text.substr(e + 1)));
}

/// `digits` digits without trailing zeros.
std::string Digits(double v, int digits) {
  if (!std::isfinite(v)) return "-";
  if (v == 0) return "0";
  if (NeedsExponent(std::abs(v))) return Exponent(v, digits);
  std::string text = fmt::format("{:.{}f}", v, std::clamp(Decimals(std::abs(v), digits), 0, 8));
  if (text.find('.') == std::string::npos) return text;
  text.erase(text.find_last_not_of('0') + 1);
  if (text.back() == '.') text.pop_back();
  return text;
}

std::string WithUnit(const std::string& number, std::string_view unit) {
  if (unit.empty() || number == "-") return number;
  return fmt::format("{}{}{}", number, unit.starts_with("°") ? "" : " ", unit);
}

/// One format for all numbers of a parameter, since they are compared with each other.
class ParameterFormat {
 public:
  ParameterFormat(std::string_view parameter, const Estimate& e) : text_(TextOf(parameter)) {
    double size = 0;
    for (const double v : {e.value, e.low, e.high}) {
      if (std::isfinite(v)) size = std::max(size, std::abs(v));
    }
    unit_ = UnitFor(text_.unit, size);
    size *= unit_.factor;
    const double spread = unit_.factor * (e.high - e.low);
    known_ = std::isfinite(spread) && spread > 0;
    exponent_ = NeedsExponent(size);
    decimals_ = std::clamp(std::min(Decimals(spread, kIntervalDigits), Decimals(size, kMostDigits)), 0, 8);
  }

  bool known() const { return known_; }
  const ParameterText& text() const { return text_; }
  std::string_view unit() const { return unit_.unit; }

  std::string Number(double v) const {
    if (!std::isfinite(v)) return "-";
    v *= unit_.factor;
    if (exponent_) return Exponent(v, kMostDigits);
    return known_ ? fmt::format("{:.{}f}", v, decimals_) : Digits(v, kQuantityDigits);
  }

 private:
  ParameterText text_;
  ShownUnit unit_{};
  bool known_ = false, exponent_ = false;
  int decimals_ = 0;
};

}  // namespace

const std::map<std::string_view, std::vector<ShownUnit>>& ShownUnits() {
  static const std::map<std::string_view, std::vector<ShownUnit>> units{
      {"m", {{1e-5, 1e6, "µm"}, {1, 1e3, "mm"}, {kAny, 1, "m"}}},
      {"rad", {{kAny, kDegreesPerRadian, "°"}}},
      {"N", {{0.05, 1e3, "mN"}, {kAny, 1, "N"}}},
      {"N·m", {{1e-3, 1e6, "µN·m"}, {0.5, 1e3, "mN·m"}, {kAny, 1, "N·m"}}},
      {"s", {{1e-3, 1e6, "µs"}, {0.5, 1e3, "ms"}, {kAny, 1, "s"}}},
      {"kg", {{0.5, 1e3, "g"}, {kAny, 1, "kg"}}},
      {"m/s", {{1, 1e3, "mm/s"}, {kAny, 1, "m/s"}}},
      {"rad/s", {{kAny, kDegreesPerRadian, "°/s"}}},
      {"m/rad", {{1, 1e3, "mm/rad"}, {kAny, 1, "m/rad"}}},
  };
  return units;
}

std::string WithUnit(double value, std::string_view unit) {
  const ShownUnit shown = UnitFor(unit, value);
  return WithUnit(Digits(value * shown.factor, kQuantityDigits), shown.unit);
}

std::string Sigmas(double value) { return Digits(value, kSigmaDigits); }

std::string Percent(double share) {
  if (!std::isfinite(share)) return "-";
  const double percent = std::round(100 * share);
  if (percent >= 100 && share < 1) return ">99 %";
  if (percent == 0 && share > 0) return "<1 %";
  return fmt::format("{:.0f} %", percent + 0.0);  // no "-0"
}

std::string ParameterValue(std::string_view parameter, const Estimate& estimate, double value) {
  const ParameterFormat format(parameter, estimate);
  return WithUnit(format.Number(value), format.unit());
}

std::string ParameterWords(std::string_view parameter, const Estimate& estimate, bool with_interval) {
  const ParameterFormat format(parameter, estimate);
  const std::string& word = format.text().word;
  std::string text = fmt::format("{}{}{}{}", word, word.empty() ? "" : " ", word == "scale" ? "× " : "",
                                 WithUnit(format.Number(estimate.value), format.unit()));
  if (with_interval && format.known())
    text += fmt::format(" [{}, {}]", format.Number(estimate.low), format.Number(estimate.high));
  return text;
}

}  // namespace tendril::gap
