// Keys that may be omitted, and their defaults, for the files' descriptions. Knows no key.
#pragma once

#include <string_view>

#include "reader.h"

namespace tendril::config {

/// Whether to read or write a key now: where a file omits it, `nominal` applies, which the reference shows as
/// `shown`.
template <class Io, class T, class Shown>
bool Given(Io& io, std::string_view key, T& value, T nominal, Shown shown) {
  if constexpr (Io::kReading) {
    value = nominal;
    if (io.Has(key)) return true;
    io.Allow(key);
    return false;
  }
  if constexpr (Io::kListing) io.MayBeLeftOut(shown);
  return true;
}
/// The same for a key that is written only where it is not nominal.
template <class Io, class T, class Shown>
bool GivenOrOther(Io& io, std::string_view key, T& value, T nominal, Shown shown) {
  const bool given = Given(io, key, value, nominal, shown);
  return Io::kReading || Io::kListing ? given : value != nominal;
}

/// Written only where it is not nominal.
template <class Io>
void OptionalNumber(Io& io, std::string_view key, double& value, double nominal, Range range,
                    std::string_view meaning) {
  if (GivenOrOther(io, key, value, nominal, nominal)) io.Number(key, value, range, meaning);
}

/// Always written, because a resolved file must not let a common block override it.
template <class Io>
void NumberOrNominal(Io& io, std::string_view key, double& value, double nominal, Range range,
                     std::string_view meaning) {
  if (Given(io, key, value, nominal, nominal)) io.Number(key, value, range, meaning);
}

/// Always written.
template <class Io>
void OptionalChoice(Io& io, std::string_view key, bool& value, bool nominal, const Choices<bool>& choices,
                    std::string_view meaning) {
  const std::string_view shown = choices.begin()[choices.begin()->second == nominal ? 0 : 1].first;
  if (Given(io, key, value, nominal, shown)) io.Choice(key, value, choices, meaning);
}
template <class Io>
void OptionalSwitch(Io& io, std::string_view key, bool& value, bool nominal, std::string_view meaning) {
  OptionalChoice(io, key, value, nominal, {{"off", false}, {"on", true}}, meaning);
}

/// Written only where it is reversed.
template <class Io>
void Direction(Io& io, std::string_view key, bool& reversed, std::string_view meaning) {
  if (GivenOrOther(io, key, reversed, false, std::string_view("normal")))
    io.Choice(key, reversed, Choices<bool>{{"normal", false}, {"reversed", true}}, meaning);
}

}  // namespace tendril::config
