// Effect: torque ripple of the motor over one turn.
#include <cmath>

#include "common.h"

namespace tendril::sim {
namespace {

class Ripple final : public ShaftLaw {
 public:
  Ripple(double amplitude_Nm, double periods_per_turn, double phase_rad)
      : amplitude_Nm_(amplitude_Nm), periods_(periods_per_turn), phase_rad_(phase_rad) {}

  ShaftTorque Against(const Shaft& shaft) const noexcept override {
    const double phase = periods_ * shaft.angle_rad + phase_rad_;
    return {amplitude_Nm_ * std::sin(phase), amplitude_Nm_ * periods_ * std::cos(phase), 0};
  }

 private:
  double amplitude_Nm_, periods_, phase_rad_;
};

}  // namespace

Effect Cogging() {
  return {
      .name = "cogging",
      .stage = Stage::kDrive,
      .scope = Scope::kTendon,
      .cut = Cut::kDrivetrain,
      .cut_robot_side = Cut::kDrivetrain,
      .on_one = true,
      .parameters = {{.name = "amplitude_Nm",
                      .nominal = 0,
                      .lower = 0,
                      .upper = 0.002,
                      .typical = 0.0001,
                      .of = Yardstick::kMotorTorque},
                     {.name = "periods_per_turn",
                      .nominal = 12,
                      .lower = 1,
                      .upper = 60,
                      .typical = 0,
                      .shape = true,
                      .starts = {1, 2, 4, 6, 8, 10, 12, 14, 18, 24}},
                     {.name = "phase_rad",
                      .nominal = 0,
                      .lower = -6.3,  // wider than one turn, so that no search ends at the wrap
                      .upper = 6.3,
                      .typical = 0,
                      .shape = true,
                      .starts = {-1.6, 0, 1.6, 3.1},
                      .each = "phase_{}_rad"}},
      .summary = "a torque that repeats with the motor's angle pulls it into detents",
      .physics =
          "Magnets and teeth (or an eccentric gear wheel on the motor shaft) add amplitude_Nm x "
          "sin(periods_per_turn x angle + phase_rad) against the shaft. It does no work over a period; "
          "current does not show it. With `all`, each motor has its own phase, since motors are mounted at "
          "arbitrary angles.",
      .signature =
          "The difference between torque and tension is a wave over the motor angle, equal in both "
          "directions and at every speed and load.",
      .experiment =
          "One slow triangle over several motor turns: the residual against the angle modulo one turn, "
          "its spectrum over periods per turn.",
      .confusable = {"stribeck", "motor_coulomb"},
      .add =
          [](PlantLaws& laws, const RobotParameters&, Target target, std::span<const double> v) {
            // v[2]: phase of the first motor; then each further motor's phase relative to it.
            std::size_t motor = 2;
            ForTarget(laws.tendon, target, [&](TendonLaws& tendon) {
              const double beyond_rad = motor == 2 ? 0 : v[motor];
              tendon.shaft.push_back(std::make_shared<Ripple>(v[0], v[1], v[2] + beyond_rad));
              ++motor;
            });
          },
  };
}

}  // namespace tendril::sim
