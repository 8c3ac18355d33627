// Effect: the backbone's wire softens at large bends.
#include <cmath>
#include <memory>

#include "sections.h"

namespace tendril::sim {
namespace {

/// With theta the unit's bend from its rest shape, k = EI / l, s the softening and a the onset, the elastic
/// energy of a unit is
///   W = k [(1 - s) theta^2 / 2 + s a^2 ln cosh(theta / a)],
/// its moment k [(1 - s) theta + s a tanh(theta / a)] and its tangent stiffness k [1 - s tanh^2(theta / a)]:
/// k at the rest shape, less by 58 % of s at the onset, k (1 - s) far beyond. What is added here is that
/// moment's difference from the linear one, k s (theta - a tanh(theta / a)), outwards.
class SuperelasticLaw final : public BodyLaw {
 public:
  SuperelasticLaw(UnitRange units, double softening, double onset_rad)
      : units_(units), softening_(softening), onset_rad_(onset_rad) {}
  std::unique_ptr<BodyLaw> Clone() const override { return std::make_unique<SuperelasticLaw>(*this); }

  void AddForce(const model::Body& body, model::ConstVectorRef q, model::ConstVectorRef, double,
                model::VectorRef force_Nm) const noexcept override {
    for (int i = units_.first; i < units_.end; ++i) {
      const Eigen::Vector2d bend = q.segment<2>(body.coordinate(i)) - body.rest_bend_rad(i);
      force_Nm.segment<2>(body.coordinate(i)) +=
          softening_ * body.unit_stiffness_Nm(i) * Loss(bend.norm()) * bend;
    }
  }

  void AddStiffness(const model::Body& body, model::ConstVectorRef q, model::ConstVectorRef,
                    model::MatrixRef stiffness) const noexcept override {
    for (int i = units_.first; i < units_.end; ++i) {
      const Eigen::Vector2d bend = q.segment<2>(body.coordinate(i)) - body.rest_bend_rad(i);
      const double theta = bend.norm(), across = Loss(theta), t = std::tanh(theta / onset_rad_);
      const Eigen::Vector2d along = theta > 0 ? Eigen::Vector2d(bend / theta) : Eigen::Vector2d(0, 0);
      stiffness.block<2, 2>(body.coordinate(i), body.coordinate(i)) -=
          softening_ * body.unit_stiffness_Nm(i) *
          (across * Eigen::Matrix2d::Identity() + (t * t - across) * along * along.transpose());
    }
  }

 private:
  /// 1 - tanh(x) / x, x = theta / onset: the lost fraction of the secant stiffness over the softening.
  double Loss(double theta) const {
    const double x = theta / onset_rad_;
    if (x < 1e-2) return x * x * (1.0 / 3 - x * x * (2.0 / 15 - x * x * 17 / 315));
    return 1 - std::tanh(x) / x;
  }

  UnitRange units_;
  double softening_, onset_rad_;
};

}  // namespace

Effect Superelastic() {
  return {
      .name = "superelastic",
      .stage = Stage::kBody,
      .scope = Scope::kSection,
      .cut = Cut::kShape,
      .cut_robot_side = Cut::kShape,
      .on_all = true,
      .on_one = true,
      .parameters = {{.name = "softening", .nominal = 0, .lower = 0, .upper = 0.95, .typical = 0.2},
                     {.name = "onset_rad",
                      .nominal = 0.3,
                      .lower = 0.05,
                      .upper = 1.5,
                      .typical = 0.1,
                      .shape = true,
                      .starts = {0.15, 0.5},
                      .of = Yardstick::kUnitBend}},
      .summary = "the backbone softens beyond a bend: the plateau of NiTi, cracked glue, a yielding sleeve",
      .physics =
          "The tangent stiffness of a unit falls smoothly from EI / l when straight to (1 - softening) EI / "
          "l "
          "far beyond the bend onset_rad, as k (1 - softening tanh^2(theta / onset)). Elastic: nothing is "
          "lost, loading and unloading follow the same curve. In NiTi the wire's surface reaches the "
          "plateau at about 1 % strain, theta = 0.01 l / r.",
      .signature =
          "Small bends fit the model; large ones are too large for their tensions, in every direction alike "
          "and without a loop.",
      .experiment =
          "One slow pull to the largest bend and back, at low co-contraction: a kink in the curve of shape "
          "against tension, at the same shape on both branches.",
      .confusable = {"bending_stiffness", "backbone_hysteresis", "contact"},
      .add =
          [](PlantLaws& laws, const RobotParameters& robot, Target target, std::span<const double> v) {
            if (v[0] == 0) return;
            laws.body.Add(std::make_unique<SuperelasticLaw>(UnitsOf(robot, target), v[0], v[1]));
          },
  };
}

}  // namespace tendril::sim
