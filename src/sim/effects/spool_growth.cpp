// Effect: the spool's radius grows as it winds.
#include "common.h"

namespace tendril::sim {

Effect SpoolGrowth() {
  return {
      .name = "spool_growth",
      .stage = Stage::kTransmission,
      .scope = Scope::kTendon,
      .cut = Cut::kTendon,
      .cut_robot_side = Cut::kTendon,
      .on_one = true,
      .parameters = {{.name = "m_per_rad",
                      .nominal = 0,
                      .lower = 0,
                      .upper = 0.001,
                      .typical = 0.0001,
                      .of = Yardstick::kSpool}},
      .summary = "the spool's radius grows with the tendon wound on it",
      .physics =
          "Tendon laid over tendon: per radian wound the radius gains m_per_rad (a tendon of 0.4 mm in "
          "one layer over the other: 6e-5), so s = r phi + m_per_rad phi^2 / 2 at the spool angle phi, "
          "and the arm of the tension grows too.",
      .signature =
          "Tension and shape run ahead of the motor angle as a parabola of it, upwards on both sides; "
          "the torque needed per tension grows with the angle.",
      .experiment =
          "A slow triangle over the largest motor stroke: displacement of the tendon against the motor "
          "angle.",
      .confusable = {"tendon_stiffness", "hole_radius"},
      .add =
          [](PlantLaws& laws, const RobotParameters&, Target target, std::span<const double> v) {
            ForTarget(laws.tendon, target, [&](TendonLaws& tendon) { tendon.spool_growth_mprad += v[0]; });
          },
  };
}

}  // namespace tendril::sim
