// Times as texts; see the header. Whole nanoseconds, since a double of seconds since 1970 resolves 0.2 us
// only.
#include "time_text.h"

#include <algorithm>
#include <array>
#include <cstdlib>

namespace tendril::gap {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000, kMinute_ns = 60 * kSecond_ns, kHour_ns = 60 * kMinute_ns,
                       kDay_ns = 24 * kHour_ns;

bool IsDigit(char c) { return c >= '0' && c <= '9'; }

/// Of the Gregorian calendar; empty for a day that does not exist.
std::optional<std::int64_t> DaysSince1970(std::int64_t year, std::int64_t month, std::int64_t day) {
  static constexpr std::array<int, 13> kBefore{0, 31, 59, 90, 120, 151, 181, 212, 243, 273, 304, 334, 365};
  if (month < 1 || month > 12 || day < 1) return {};
  const auto m = static_cast<std::size_t>(month - 1);
  const bool leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
  if (day > kBefore[m + 1] - kBefore[m] + (leap && month == 2)) return {};
  const auto years_end = [](std::int64_t y) { return 365 * y + y / 4 - y / 100 + y / 400; };  // since year 1
  return years_end(year - 1) - years_end(1969) + kBefore[m] + (leap && month > 2) + day - 1;
}

/// Reads fields from the front of a text; `ok` becomes false at the first missing one.
struct Fields {
  std::string_view rest;
  bool ok = true;

  bool Skip(char c) {
    if (rest.empty() || rest.front() != c) return false;
    rest.remove_prefix(1);
    return true;
  }
  void Expect(char c) { ok = Skip(c) && ok; }
  /// A whole number with this many digits, in [0, most].
  std::int64_t Digits(std::size_t least, std::size_t width, std::int64_t most) {
    std::int64_t value = 0;
    std::size_t n = 0;
    while (n < width && n < rest.size() && IsDigit(rest[n])) value = 10 * value + (rest[n++] - '0');
    rest.remove_prefix(n);
    ok = ok && n >= least && value <= most;
    return value;
  }
  /// Nothing, or a point or comma and digits; digits beyond nanoseconds are dropped.
  std::int64_t Fraction_ns() {
    if (!Skip('.') && !Skip(',')) return 0;
    std::int64_t value = 0, unit = kSecond_ns / 10;
    ok = ok && !rest.empty() && IsDigit(rest.front());
    for (; !rest.empty() && IsDigit(rest.front()); rest.remove_prefix(1), unit /= 10)
      value += unit * (rest.front() - '0');
    return value;
  }
  /// Up to 60 seconds, for leap seconds.
  std::int64_t Seconds_ns() {
    const std::int64_t whole = Digits(2, 2, 60);
    return whole * kSecond_ns + Fraction_ns();
  }
};

}  // namespace

std::optional<Moment> ParseIso8601(std::string_view text) {
  Fields f{text};
  const std::int64_t year = f.Digits(4, 4, 9999);
  f.Expect('-');
  const std::int64_t month = f.Digits(2, 2, 12);
  f.Expect('-');
  const std::int64_t day = f.Digits(2, 2, 31);
  const auto days = f.ok ? DaysSince1970(year, month, day) : std::nullopt;
  if (!days || !(f.Skip('T') || f.Skip('t') || f.Skip(' '))) return {};
  Moment moment{*days * kDay_ns, false};
  moment.ns += f.Digits(2, 2, 23) * kHour_ns;
  f.Expect(':');
  moment.ns += f.Digits(2, 2, 59) * kMinute_ns;
  if (f.Skip(':')) moment.ns += f.Seconds_ns();
  f.Skip(' ');
  if (f.Skip('Z') || f.Skip('z')) {
    moment.with_offset = true;
  } else if (const char sign = f.rest.empty() ? '\0' : f.rest.front(); sign == '+' || sign == '-') {
    f.Skip(sign);
    std::int64_t offset_ns = f.Digits(2, 2, 23) * kHour_ns;
    if (f.Skip(':') || !f.rest.empty()) offset_ns += f.Digits(2, 2, 59) * kMinute_ns;
    moment.ns -= sign == '+' ? offset_ns : -offset_ns;
    moment.with_offset = true;
  }
  return f.ok && f.rest.empty() ? std::optional(moment) : std::nullopt;
}

std::optional<std::int64_t> ParseClock(std::string_view text) {
  Fields f{text};
  std::int64_t hours = f.Digits(1, 4, 9999);
  f.Expect(':');
  std::int64_t ns = f.Digits(2, 2, 59) * kMinute_ns;
  f.Expect(':');
  ns += f.Seconds_ns();
  f.Skip(' ');
  if (f.rest.size() == 2 && (f.rest[1] == 'M' || f.rest[1] == 'm')) {
    const bool morning = f.rest[0] == 'A' || f.rest[0] == 'a', evening = f.rest[0] == 'P' || f.rest[0] == 'p';
    if (!(morning || evening) || hours < 1 || hours > 12) return {};
    hours = hours % 12 + (evening ? 12 : 0);
    f.rest = {};
  }
  return f.ok && f.rest.empty() ? std::optional(ns + hours * kHour_ns) : std::nullopt;
}

int PassMidnights(std::vector<std::optional<std::int64_t>>& ns) {
  if (std::any_of(ns.begin(), ns.end(), [](const auto& t) { return t && *t >= kDay_ns; })) return -1;
  std::int64_t days_ns = 0;
  const std::optional<std::int64_t>* last = nullptr;
  int first = -1;
  for (auto& t : ns) {
    if (!t) continue;
    *t += days_ns;
    if (last != nullptr && std::abs(*t - **last) > kDay_ns / 2) {
      const std::int64_t turn_ns = *t < **last ? kDay_ns : -kDay_ns;
      days_ns += turn_ns;
      *t += turn_ns;
      if (first < 0) first = static_cast<int>(&t - ns.data());
    }
    last = &t;
  }
  return first;
}

}  // namespace tendril::gap
