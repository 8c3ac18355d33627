// Effect: the tendon creeps under load.
#include <cmath>

#include "common.h"

namespace tendril::sim {
namespace {

/// c' = (fraction (T - T_start) / k - c) / tau. T is held from one commit to the next: steps are half a
/// millisecond at most, tau a tenth of a second at least.
class Creep final : public StretchLaw {
 public:
  Creep(double fraction, double tau_s) : fraction_(fraction), tau_s_(tau_s) {}
  std::unique_ptr<StretchLaw> Clone() const override { return std::make_unique<Creep>(*this); }

  void Start(double tension_N, double stiffness_Npm) noexcept override {
    start_N_ = tension_N;
    gain_mpN_ = fraction_ / stiffness_Npm;
  }
  double Peek(double time_s) const noexcept override {
    return length_m_ - (target_m_ - length_m_) * std::expm1(-(time_s - time_s_) / tau_s_);
  }
  void Commit(double time_s, double tension_N) noexcept override {
    length_m_ = Peek(time_s);
    target_m_ = gain_mpN_ * (tension_N - start_N_);
    time_s_ = time_s;
  }

 private:
  double fraction_, tau_s_, start_N_ = 0, gain_mpN_ = 0;
  double time_s_ = 0, length_m_ = 0, target_m_ = 0;
};

}  // namespace

Effect TendonCreep() {
  return {
      .name = "tendon_creep",
      .stage = Stage::kTransmission,
      .scope = Scope::kTendon,
      .cut = Cut::kTendon,
      .cut_robot_side = Cut::kTendon,
      .on_one = true,
      .element = Element::kTendon,
      .parameters = {{.name = "fraction", .nominal = 0, .lower = 0, .upper = 1, .typical = 0.2},
                     {.name = "tau_s",
                      .nominal = 5,
                      .lower = 0.1,
                      .upper = 1000,
                      .typical = 0,
                      .shape = true,
                      .starts = {0.5, 3, 20, 100}}},
      .summary = "the tendon creeps under a constant load and recovers",
      .physics =
          "In addition to its elastic stretch the tendon gains length towards fraction x (tension - "
          "pretension) / stiffness, with the time constant tau_s (a standard linear solid): stiff when "
          "pulled fast, softer by 1 / (1 + fraction) in the long run. Polymer ropes creep, wire ropes "
          "hardly.",
      .signature =
          "After a step to a constant tension the motor keeps turning, or the tip keeps sinking, "
          "exponentially; it recovers on release. A fast run does not show it.",
      .experiment = "A hold of 60 s at high tension, then one at low tension.",
      .confusable = {"tendon_stiffness", "slack", "cell_drift"},
      .add =
          [](PlantLaws& laws, const RobotParameters&, Target target, std::span<const double> v) {
            ForTarget(laws.tendon, target, [&](TendonLaws& tendon) {
              tendon.stretch.emplace_back(std::make_unique<Creep>(v[0], v[1]));
            });
          },
  };
}

}  // namespace tendril::sim
