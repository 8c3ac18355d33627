// Effect: the backbone shortens under the tendons' pull, or more than its file says.
#include "sections.h"

namespace tendril::sim {
namespace {

void Soften(SectionParameters& s, double compliance_pN) {
  if (compliance_pN == 0) return;
  const double own_pN = s.extension ? s.unit_length_m / s.UnitAxialStiffness() : 0;
  const bool damped = s.extension;
  s.extension = true;
  s.axial_stiffness_N = 1 / (own_pN + compliance_pN);
  if (!damped) s.axial_damping_Nspm = DampingTime_s(s) * *s.axial_stiffness_N / s.unit_length_m;
}

}  // namespace

Effect AxialStiffness() {
  return {
      .name = "axial_stiffness",
      .stage = Stage::kBody,
      .scope = Scope::kSection,
      .cut = Cut::kShape,
      .cut_robot_side = Cut::kShape,
      .on_all = true,
      .on_one = true,
      .parameters = {{.name = "shortening", .nominal = 0, .lower = 0, .upper = 0.3, .typical = 0.01}},
      .summary = "the backbone shortens under the tendons' pull, or more than its file says",
      .physics =
          "Each unit changes its length by the force along it times its axial compliance. A pull of "
          "limits.max_tension_base_N along the backbone shortens it by this part of its length, beside what "
          "the "
          "file's own extension does. Solid wires hardly do (3e-4 at 5 N and 1 mm of NiTi); springs, hoses, "
          "braids and printed backbones do, and disks that slide.",
      .signature =
          "Pulled by all tendons at once the robot does not bend, but its tip comes back towards the base, "
          "in "
          "proportion to the sum of tensions; the tendons take up as much.",
      .experiment =
          "Co-contraction at three levels, straight, with the tip's position: it moves along the axis. "
          "Tendons "
          "that stretch move the motors, but not the tip.",
      .confusable = {"tendon_stiffness", "unit_length"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            const double per_N = v[0] / robot.limits.max_tension_base_N;
            ForSections(robot, target, [&](SectionParameters& s) { Soften(s, per_N); });
          },
  };
}

}  // namespace tendril::sim
