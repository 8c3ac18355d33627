// Effect: the mass of the disks differs.
#include "sections.h"

namespace tendril::sim {

Effect UnitMass() {
  return {
      .name = "unit_mass",
      .stage = Stage::kBody,
      .scope = Scope::kSection,
      .cut = Cut::kShape,
      .cut_robot_side = Cut::kShape,
      .on_all = true,
      .on_one = true,
      .number = "body.sections.unit_mass_kg",
      // A response at another frequency is soon out of phase, so distant starts are tried as well.
      .parameters = {Scale(0.2, 3, 0.3, {0.65, 1.8})},
      .summary = "mass and inertia of the disks differ by a factor",
      .physics =
          "Mass and both moments of inertia of every disk of the section are scale x nominal: the weight of "
          "tendons, glue, cables and the backbone itself is not in a disk's drawing.",
      .signature =
          "Slow: a sag that grows with the bend and points where gravity does, a few per cent of the elastic "
          "forces on a small robot. Fast: natural frequencies fall with the root of the mass.",
      .experiment =
          "The same slow bends upright and hanging upside down: only weight changes sign. Steps or a "
          "multisine show the inertia.",
      .confusable = {"tip_payload", "bending_stiffness", "bending_damping", "base_tilt"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForSections(robot, target, [&](SectionParameters& s) {
              s.unit_mass_kg *= v[0];
              s.disk_inertia_xx_kgm2 *= v[0];
              s.disk_inertia_zz_kgm2 *= v[0];
            });
          },
  };
}

}  // namespace tendril::sim
