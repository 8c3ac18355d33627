// Units and their usual confusions. Knows nothing of any particular key.
#include "units.h"

#include <array>
#include <numbers>

namespace tendril::config {
namespace {

struct Unit {
  std::string_view suffix, text;
};

constexpr Unit kUnits[] = {
    {"m", "m"},           {"kg", "kg"},
    {"kgm2", "kg·m²"},    {"Pa", "Pa"},
    {"N", "N"},           {"Nm", "N·m"},
    {"Nms", "N·m·s"},     {"Nm2", "N·m²"},
    {"Nps", "N/s"},       {"Npm", "N/m"},
    {"Nspm", "N·s/m"},    {"NmpA", "N·m/A"},
    {"A", "A"},           {"V", "V"},
    {"VpN", "V/N"},       {"s", "s"},
    {"ms", "ms"},         {"ns", "ns"},
    {"Hz", "Hz"},         {"bps", "bit/s"},
    {"rad", "rad"},       {"rad_per_m", "rad/m"},
    {"radps", "rad/s"},   {"radps2", "rad/s²"},
    {"radps3", "rad/s³"}, {"mps", "m/s"},
    {"mps2", "m/s²"},     {"permille", "per mille"},
};

constexpr double kDegree = std::numbers::pi / 180;

struct MixUp {
  std::string_view accepted;
  OtherUnit other;
};

// By likelihood: the first one that makes the value fit is suggested.
constexpr MixUp kMixUps[] = {
    {"m", {"mm", "millimetres", 1e-3}},
    {"m", {"cm", "centimetres", 1e-2}},
    {"m", {"um", "micrometres", 1e-6}},
    {"kg", {"g", "grams", 1e-3}},
    {"kg", {"mg", "milligrams", 1e-6}},
    {"kgm2", {"gcm2", "g·cm²", 1e-7}},
    {"kgm2", {"kgmm2", "kg·mm²", 1e-6}},
    {"kgm2", {"gmm2", "g·mm²", 1e-9}},
    {"Pa", {"GPa", "gigapascals", 1e9}},
    {"Pa", {"MPa", "megapascals", 1e6}},
    {"Pa", {"kPa", "kilopascals", 1e3}},
    {"N", {"mN", "millinewtons", 1e-3}},
    {"N", {"kN", "kilonewtons", 1e3}},
    {"Nm", {"mNm", "mN·m", 1e-3}},
    {"Nm", {"uNm", "µN·m", 1e-6}},
    {"Nms", {"mNms", "mN·m·s", 1e-3}},
    {"Npm", {"Npmm", "N/mm", 1e3}},
    {"Npm", {"kNpm", "kN/m", 1e3}},
    {"NmpA", {"mNmpA", "mN·m/A", 1e-3}},
    {"NmpA", {"uNmpA", "µN·m/A", 1e-6}},
    {"A", {"mA", "milliamperes", 1e-3}},
    {"V", {"mV", "millivolts", 1e-3}},
    {"VpN", {"mVpN", "mV/N", 1e-3}},
    {"s", {"ms", "milliseconds", 1e-3}},
    {"s", {"us", "microseconds", 1e-6}},
    {"s", {"ns", "nanoseconds", 1e-9}},
    {"ms", {"s", "seconds", 1e3}},
    {"ms", {"us", "microseconds", 1e-3}},
    {"ms", {"ns", "nanoseconds", 1e-6}},
    {"ns", {"ms", "milliseconds", 1e6}},
    {"ns", {"us", "microseconds", 1e3}},
    {"ns", {"s", "seconds", 1e9}},
    {"Hz", {"kHz", "kilohertz", 1e3}},
    {"bps", {"kbps", "kbit/s", 1e3}},
    {"bps", {"Mbps", "Mbit/s", 1e6}},
    {"rad", {"deg", "degrees", kDegree}},
    {"radps", {"degps", "degrees per second", kDegree}},
    {"radps2", {"degps2", "degrees per second squared", kDegree}},
    {"permille", {"percent", "per cent", 10.0}},
};

}  // namespace

std::string_view UnitSuffix(std::string_view key) {
  std::string_view longest;
  for (const Unit& unit : kUnits) {
    if (key.size() > unit.suffix.size() && key.ends_with(unit.suffix) &&
        key[key.size() - unit.suffix.size() - 1] == '_' && unit.suffix.size() > longest.size()) {
      longest = unit.suffix;
    }
  }
  return longest;
}

std::string_view UnitText(std::string_view suffix) {
  for (const Unit& unit : kUnits) {
    if (unit.suffix == suffix) return unit.text;
  }
  return {};
}

std::optional<OtherUnit> FindOtherUnit(std::string_view accepted, std::string_view suffix) {
  for (const MixUp& mix : kMixUps) {
    if (mix.accepted == accepted && mix.other.suffix == suffix) return mix.other;
  }
  return std::nullopt;
}

std::optional<OtherUnit> GuessOtherUnit(std::string_view accepted, double value, double min, double max) {
  for (const MixUp& mix : kMixUps) {
    const double converted = value * mix.other.factor;
    if (mix.accepted == accepted && value != 0 && converted >= min && converted <= max) return mix.other;
  }
  return std::nullopt;
}

}  // namespace tendril::config
