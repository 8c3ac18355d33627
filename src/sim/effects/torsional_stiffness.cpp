// Effect: the backbone twists under load, or more than its file says.
#include "sections.h"

namespace tendril::sim {
namespace {

// Twist per moment that a round rod of the section's bending stiffness has: (1 + nu) / EI with nu = 0.3.
double OfARoundRod(const SectionParameters& s) { return 1.3 / (s.UnitStiffness() * s.unit_length_m); }

void Soften(SectionParameters& s, double compliance) {
  const double own = s.torsion ? 1 / (s.UnitTorsionalStiffness() * s.unit_length_m) : 0;
  if (compliance == 0) return;
  const double total = own + compliance * (s.torsion ? own : OfARoundRod(s));
  const bool damped = s.torsion;
  s.torsion = true;
  s.torsional_stiffness_Nm2 = 1 / total;
  if (!s.shear) s.poissons_ratio.reset();  // a file gives one of the two
  if (!damped) s.torsional_damping_Nms = DampingTime_s(s) * s.UnitTorsionalStiffness();
}

}  // namespace

Effect TorsionalStiffness() {
  return {
      .name = "torsional_stiffness",
      .stage = Stage::kBody,
      .scope = Scope::kSection,
      .cut = Cut::kShape,
      .cut_robot_side = Cut::kShape,
      .on_all = true,
      .on_one = true,
      .parameters = {{.name = "compliance", .nominal = 0, .lower = 0, .upper = 50, .typical = 2}},
      .summary = "the backbone twists about its axis under load, or more than its file says",
      .physics =
          "Each unit twists by the moment about its axis times its torsional compliance. Where the file has "
          "no "
          "torsion, compliance counts in that of a round rod, (1 + nu) / EI: a solid wire has 1; tubes, "
          "springs "
          "and braids have more. Where the file has it, this is the part by which the robot is softer. A "
          "load "
          "across the plane of the bend has a lever about the backbone and twists it; without such a load "
          "nothing changes.",
      .signature =
          "Bent and loaded sideways, by weight or at the tip, the tip gives way across the plane of the "
          "bend, in "
          "proportion to load and bend; straight, or loaded within that plane, the model is right.",
      .experiment =
          "Bend by one tendon, then turn the bend about the axis: gravity across the plane of the bend is "
          "what "
          "twists. The base turned on its side, or a known weight hung sideways on the bent tip, shows it "
          "best.",
      .confusable = {"torsion", "hole_angle", "base_tilt", "tip_payload"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForSections(robot, target, [&](SectionParameters& s) { Soften(s, v[0]); });
          },
  };
}

}  // namespace tendril::sim
