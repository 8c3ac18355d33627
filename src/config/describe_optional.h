// Keys that may be left out, and what stands for them, as the files' descriptions need them. Knows no key.
#pragma once

#include <string_view>

#include "reader.h"

namespace tendril::config {

/// Read where it is given, written where it is not the nominal value.
template <class Io>
void OptionalNumber(Io& io, std::string_view key, double& value, double nominal, Range range,
                    std::string_view meaning) {
  if constexpr (Io::kReading) {
    value = nominal;
    if (!io.Has(key)) return io.Allow(key);
  } else if constexpr (Io::kListing) {
    io.MayBeLeftOut(nominal);
  } else if (value == nominal) {
    return;
  }
  io.Number(key, value, range, meaning);
}

/// `nominal` unless given; always written, for what spells out nothing may be overridden by a common block.
template <class Io>
void NumberOrNominal(Io& io, std::string_view key, double& value, double nominal, Range range,
                     std::string_view meaning) {
  if constexpr (Io::kReading) {
    value = nominal;
    if (!io.Has(key)) return io.Allow(key);
  }
  if constexpr (Io::kListing) io.MayBeLeftOut(nominal);
  io.Number(key, value, range, meaning);
}

/// `nominal` unless given; always written.
template <class Io>
void OptionalChoice(Io& io, std::string_view key, bool& value, bool nominal, const Choices<bool>& choices,
                    std::string_view meaning) {
  if constexpr (Io::kReading) {
    value = nominal;
    if (!io.Has(key)) return io.Allow(key);
  }
  if constexpr (Io::kListing)
    io.MayBeLeftOut(choices.begin()[choices.begin()->second == nominal ? 0 : 1].first);
  io.Choice(key, value, choices, meaning);
}
template <class Io>
void OptionalSwitch(Io& io, std::string_view key, bool& value, bool nominal, std::string_view meaning) {
  OptionalChoice(io, key, value, nominal, {{"off", false}, {"on", true}}, meaning);
}

/// As usual unless given, and written only where it is not.
template <class Io>
void Direction(Io& io, std::string_view key, bool& reversed, std::string_view meaning) {
  if constexpr (Io::kReading) {
    reversed = false;
    if (!io.Has(key)) return io.Allow(key);
  } else if constexpr (Io::kListing) {
    io.MayBeLeftOut("normal");
  } else if (!reversed) {
    return;
  }
  io.Choice(key, reversed, Choices<bool>{{"normal", false}, {"reversed", true}}, meaning);
}

}  // namespace tendril::config
