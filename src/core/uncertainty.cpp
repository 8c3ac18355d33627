// One table: what a workshop's drawing, a scale, a data sheet and a guess are each good for.
#include "tendril/core/uncertainty.h"

#include <algorithm>
#include <array>

#include "tendril/core/angle.h"

namespace tendril {
namespace {

struct Usual {
  std::string_view word;   // the last of the key
  std::string_view block;  // that the key goes through; empty: any
  Uncertainty uncertainty;
};

constexpr Uncertainty Share(double of_value) { return {Uncertainty::Kind::kShare, of_value}; }

constexpr std::array<Usual, 26> kUsual{{
    {"unit_length_m", "", Share(0.02)},
    {"youngs_modulus_Pa", "", Share(0.15)},
    {"core_radius_m", "", Share(0.05)},
    {"unit_mass_kg", "", Share(0.2)},
    {"disk_inertia_xx_kgm2", "", Share(0.2)},
    {"disk_inertia_zz_kgm2", "", Share(0.2)},
    {"bending_damping_Nms", "", Share(0.4)},
    {"angle_rad", "tendons", {Uncertainty::Kind::kAbsolute, 2 / kDegreesPerRadian}},
    {"radius_m", "spool", Share(0.02)},
    {"radius_m", "tendons", Share(0.05)},
    {"tip_payload_kg", "", Share(0.2)},
    {"torque_constant_NmpA", "", Share(0.04)},
    {"rotor_inertia_kgm2", "", Share(0.1)},
    {"coulomb_friction_Nm", "", Share(0.4)},
    {"coulomb_angle_rad", "", Share(0.4)},
    {"viscous_friction_Nms", "", Share(0.4)},
    {"torque_lag_s", "", Share(0.4)},
    {"efficiency", "gear", Share(0.1)},
    {"stiffness_Npm", "tendon", Share(0.2)},
    {"damping_Nspm", "tendon", Share(0.4)},
    {"wrap_rad", "", Share(0.05)},
    {"radius_ratio", "", Share(0.05)},
    {"alpha", "", Share(0.4)},
    {"exponent", "", Share(0.05)},
    {"presliding_m", "", Share(0.4)},
    {"gain_VpN", "load_cell", Share(0.05)},
}};

}  // namespace

Uncertainty UsualUncertainty(std::string_view key) {
  const std::size_t at = key.find_last_of(". ");
  const std::string_view word = at == key.npos ? key : key.substr(at + 1);
  const auto usual = std::find_if(kUsual.begin(), kUsual.end(), [&](const Usual& u) {
    return u.word == word && key.find(u.block) != key.npos;
  });
  return usual == kUsual.end() ? Uncertainty{Uncertainty::Kind::kKnown, 0} : usual->uncertainty;
}

}  // namespace tendril
