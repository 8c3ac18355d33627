// What is usually known of each kind of number, and the text of an uncertainty. Knows keys by their last
// word.
#include "tendril/core/uncertainty.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <numbers>
#include <system_error>

namespace tendril {
namespace {

constexpr Uncertainty Share(double percent) { return {Uncertainty::Kind::kShare, percent / 100}; }
constexpr Uncertainty Absolute(double deviation) { return {Uncertainty::Kind::kAbsolute, deviation}; }
constexpr Uncertainty kKnown{Uncertainty::Kind::kKnown, 0}, kUnknown{Uncertainty::Kind::kUnknown, 0};
constexpr double kDegree_rad = std::numbers::pi / 180;

struct Usual {
  std::string_view word;
  Uncertainty uncertainty;
};

/// Numbers that are not here are known: limits, counts, noise, rates, node ids, what a drive is set to.
constexpr Usual kUsual[] = {
    // The body: drawn, cut and weighed, but for E, which depends on alloy, bend and temperature.
    {"youngs_modulus_Pa", Share(15)},
    {"unit_length_m", Share(2)},
    {"disk_diameter_m", Share(2)},
    {"core_radius_m", Share(5)},
    {"radius_m", Share(5)},
    {"end_radius_m", Share(5)},
    {"angle_rad", Absolute(2 * kDegree_rad)},
    {"turn_rad_per_m", Absolute(0.5)},
    {"unit_mass_kg", Share(20)},
    {"disk_mass_kg", Share(20)},
    {"tip_payload_kg", Share(20)},
    {"tip_force_W_N", Share(20)},
    {"disk_inertia_xx_kgm2", Share(20)},
    {"disk_inertia_zz_kgm2", Share(20)},
    {"bending_damping_Nms", Share(40)},
    {"poissons_ratio", Share(10)},
    {"torsional_stiffness_Nm2", Share(15)},
    {"axial_stiffness_N", Share(15)},
    {"shear_stiffness_N", Share(15)},
    {"torsional_damping_Nms", Share(40)},
    {"axial_damping_Nspm", Share(40)},
    {"shear_damping_Nspm", Share(40)},
    {"rest_torsion_rad_per_m", Absolute(0.5)},
    {"rest_extension", Absolute(0.005)},
    {"stiffness_scale", Share(5)},
    {"rest_u_rad", Absolute(kDegree_rad)},
    {"rest_v_rad", Absolute(kDegree_rad)},
    {"twist_rad_per_m", Absolute(0.5)},
    // Data sheets: a constant of copper and magnet, an inertia; friction they do not give.
    {"torque_constant_NmpA", Share(4)},
    {"rotor_inertia_kgm2", Share(10)},
    {"coulomb_friction_Nm", Share(40)},
    {"coulomb_angle_rad", Share(40)},
    {"coulomb_damping_Nms", Share(40)},
    {"viscous_friction_Nms", Share(40)},
    {"torque_lag_s", Share(40)},
    {"efficiency", Share(10)},
    {"presliding_yields_rad", Share(40)},
    // Tendons and what they slide on.
    {"free_length_m", Share(2)},
    {"stiffness_Npm", Share(20)},
    {"damping_Nspm", Share(40)},
    {"wrap_rad", Share(5)},
    {"radius_ratio", Share(5)},
    {"alpha", Share(40)},
    {"exponent", Share(5)},
    {"entry_angle_rad", Absolute(2 * kDegree_rad)},
    {"presliding_m", Share(40)},
    {"coulomb_N", Share(40)},
    {"pretension_N", Share(20)},
    // Sensors.
    {"gain_VpN", Share(5)},
    {"offset_N", Absolute(0.1)},
    {"delay_s", Share(40)},
};

constexpr Uncertainty kSpoolRadius = Share(2);  // turned on a lathe, a hole is drilled

std::string Shortest(double value) {
  std::array<char, 32> text;
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), value).ptr};
}

/// The share's shortest decimal digits with the point two places on: 7 for 0.07, though 0.07 x 100 is not. So
/// it is read back bit for bit.
std::string PercentOf(double share) {
  std::array<char, 32> text;
  const char* end =
      std::to_chars(text.data(), text.data() + text.size(), share, std::chars_format::scientific).ptr;
  const char* e = std::find(static_cast<const char*>(text.data()), end, 'e');
  int exponent = 0;  // of the share's first digit
  std::from_chars(e[1] == '+' ? e + 2 : e + 1, end, exponent);
  const int whole = exponent + 3;  // digits of the percentage before its point
  std::string percent;
  int place = 0;
  const auto put = [&](char digit) {
    if (place == std::max(whole, 1)) percent.push_back('.');
    percent.push_back(digit);
    ++place;
  };
  for (int zero = whole; zero < 1; ++zero) put('0');
  for (const char* digit = text.data(); digit != e; ++digit) {
    if (*digit != '.') put(*digit);
  }
  while (place < whole) put('0');
  return percent;
}

}  // namespace

Uncertainty UsualUncertainty(std::string_view key) {
  if (key.starts_with("effects[")) return kUnknown;  // a parameter of a law, which nobody measures apart
  key = key.substr(0, key.ends_with(']') ? key.rfind('[') : key.npos);
  if (key.ends_with("spool.radius_m")) return kSpoolRadius;
  const std::size_t dot = key.rfind('.');
  const std::string_view word = dot == key.npos ? key : key.substr(dot + 1);
  const auto* row =
      std::find_if(std::begin(kUsual), std::end(kUsual), [&](const Usual& u) { return u.word == word; });
  return row == std::end(kUsual) ? kKnown : row->uncertainty;
}

std::string UncertaintyText(const Uncertainty& uncertainty) {
  switch (uncertainty.kind) {
    case Uncertainty::Kind::kShare:
      return PercentOf(uncertainty.deviation) + " %";
    case Uncertainty::Kind::kAbsolute:
      return Shortest(uncertainty.deviation);
    case Uncertainty::Kind::kKnown:
      return "known";
    case Uncertainty::Kind::kUnknown:
      break;
  }
  return "unknown";
}

}  // namespace tendril
