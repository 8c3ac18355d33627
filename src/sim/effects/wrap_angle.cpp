// Effect: the tendon bends round more, or less, than drawn.
#include <algorithm>

#include "common.h"
#include "tendril/model/capstan.h"

namespace tendril::sim {

Effect WrapAngle() {
  return {
      .name = "wrap_angle",
      .stage = Stage::kTransmission,
      .scope = Scope::kTendon,
      .cut = Cut::kShape,
      .cut_robot_side = Cut::kDrivetrain,
      .on_one = true,
      .element = Element::kPulleys,
      .parameters = {{.name = "extra_rad", .nominal = 0, .lower = -3.1, .upper = 6.3, .typical = 0.4}},
      .summary = "the tendon wraps a larger angle along its path than drawn",
      .physics =
          "Friction grows with the angle that the tendon is turned through: a pulley out of place, a "
          "bent sheath or an edge that it drags over add extra_rad to the wrap (shared by the pulleys "
          "of the path; never less than none). On a path drawn without pulleys it is a steel tendon in a "
          "polymer sheath, with the friction coefficient 0.15.",
      .signature =
          "Like a larger friction coefficient: tension lost between motor and robot, in a loop between "
          "pulling and paying out.",
      .experiment =
          "Inspect the path. Data separate it from the coefficient only where the tendons differ in wrap, or "
          "by the dependence on the tension.",
      .confusable = {"capstan_alpha", "capstan_n", "routing_friction"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForTendons(robot, target, [&](TendonDriveParameters& tendon) {
              auto& pulleys = tendon.transmission.pulleys;
              if (pulleys.empty() && v[0] > 0) pulleys = {model::Sheath(0)};
              for (PulleyParameters& pulley : pulleys) {
                pulley.wrap_rad = std::max(0.0, pulley.wrap_rad + v[0] / static_cast<double>(pulleys.size()));
              }
            });
          },
  };
}

}  // namespace tendril::sim
