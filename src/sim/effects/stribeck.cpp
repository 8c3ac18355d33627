// Effect: dry friction of the motor falls with speed (Stribeck).
#include <cmath>

#include "common.h"

namespace tendril::sim {
namespace {

class StribeckFriction final : public ShaftLaw {
 public:
  StribeckFriction(double torque_Nm, double speed_radps) : torque_Nm_(torque_Nm), speed_radps_(speed_radps) {}

  ShaftTorque Against(const Shaft& shaft) const noexcept override {
    const double ratio = shaft.velocity_radps / speed_radps_;
    const double torque = torque_Nm_ * std::exp(-ratio * ratio);
    return {torque * shaft.dahl, torque * shaft.dahl_slope, -2 * ratio / speed_radps_ * torque * shaft.dahl};
  }

 private:
  double torque_Nm_, speed_radps_;
};

}  // namespace

Effect Stribeck() {
  return {
      .name = "stribeck",
      .stage = Stage::kDrive,
      .scope = Scope::kTendon,
      .cut = Cut::kDrivetrain,
      .cut_robot_side = Cut::kDrivetrain,
      .on_one = true,
      .parameters = {{.name = "torque_Nm",
                      .nominal = 0,
                      .lower = 0,
                      .upper = 0.0005,
                      .typical = 0.0001,
                      .of = Yardstick::kMotorTorque},
                     {.name = "speed_radps",
                      .nominal = 2,
                      .lower = 0.05,
                      .upper = 50,
                      .typical = 0,
                      .shape = true,
                      .starts = {0.5, 2, 8},
                      .of = Yardstick::kMotorSpeed}},
      .summary = "the motor's friction is higher near standstill and falls with speed",
      .physics =
          "At low speed the lubricant film has not formed yet: on top of the Coulomb friction there is "
          "torque_Nm x exp(-(speed / speed_radps)^2), with the same smooth sign at reversals. Friction that "
          "falls with speed makes a slow motor stick and slip.",
      .signature =
          "Torque against tension is off at creeping speed and right at high speed; slow motions start "
          "with a jerk.",
      .experiment =
          "A ladder of constant speeds through zero: torque against speed first falls, then rises; "
          "without this effect it only rises.",
      .confusable = {"motor_coulomb", "motor_viscous", "cogging"},
      .add =
          [](PlantLaws& laws, const RobotParameters&, Target target, std::span<const double> v) {
            ForTarget(laws.tendon, target, [&](TendonLaws& tendon) {
              tendon.shaft.push_back(std::make_shared<StribeckFriction>(v[0], v[1]));
            });
          },
  };
}

}  // namespace tendril::sim
