// Effect: the robot touches an obstacle.
#include <array>
#include <cmath>
#include <memory>
#include <numbers>

#include "common.h"
#include "tendril/core/limits.h"

namespace tendril::sim {
namespace {

/// A frictionless wall normal to the direction n = (cos angle, sin angle, 0) of F_0, at the distance gap from
/// the origin. The centre of disk i lies d = n . p_i - gap behind it; the wall pushes by -n F(d),
///   F = 0 for d < 0,   k d^2 / (2 e) up to d = e,   k (d - e / 2) beyond,   e = L / 450, L the robot's
///   length:
/// smooth, and the derivative of an energy.
class ContactLaw final : public BodyLaw {
 public:
  ContactLaw(double stiffness_Npm, double gap_m, double angle_rad, double edge_m)
      : stiffness_Npm_(stiffness_Npm),
        gap_m_(gap_m),
        edge_m_(edge_m),
        n_(std::cos(angle_rad), std::sin(angle_rad), 0) {}
  std::unique_ptr<BodyLaw> Clone() const override { return std::make_unique<ContactLaw>(*this); }

  void AddForce(const model::Body& body, model::ConstVectorRef q, model::ConstVectorRef, double,
                model::VectorRef force_Nm) const noexcept override {
    Depths depth;
    if (!Touches(body, q, depth)) return;
    Forces force(3, body.units());
    force.setZero();
    for (int k = 0; k < body.disks(); ++k)
      force.col(body.disk_unit(k)) = -Push(depth[static_cast<std::size_t>(k)]) * n_;
    CoordinateVector generalised(body.dof());
    body.DiskForce(q, force, generalised);
    force_Nm += generalised;
  }

  /// Neglects the change of the levers under a constant force.
  void AddStiffness(const model::Body& body, model::ConstVectorRef q, model::ConstVectorRef,
                    model::MatrixRef stiffness) const noexcept override {
    Depths depth;
    if (!Touches(body, q, depth)) return;
    Forces force(3, body.units());
    CoordinateVector lever(body.dof());
    for (int k = 0; k < body.disks(); ++k) {
      const double d = depth[static_cast<std::size_t>(k)];
      if (d <= 0) continue;
      force.setZero();
      force.col(body.disk_unit(k)) = n_;
      body.DiskForce(q, force, lever);
      stiffness.noalias() += (stiffness_Npm_ * std::min(1.0, d / edge_m_)) * lever * lever.transpose();
    }
  }

 private:
  using Depths = std::array<double, kMaxUnits>;  // by disk
  using Forces = Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, kMaxUnits>;

  double Push(double d) const {
    if (d <= 0) return 0;
    return stiffness_Npm_ * (d < edge_m_ ? 0.5 * d * d / edge_m_ : d - 0.5 * edge_m_);
  }

  bool Touches(const model::Body& body, model::ConstVectorRef q, Depths& depth) const {
    std::array<model::Pose, kMaxUnits> poses;
    body.Poses(q, std::span(poses).first(static_cast<std::size_t>(body.units())));
    bool touches = false;
    for (int k = 0; k < body.disks(); ++k) {
      const double d = n_.dot(poses[static_cast<std::size_t>(body.disk_unit(k))].p_WA) - gap_m_;
      depth[static_cast<std::size_t>(k)] = d;
      touches = touches || d > 0;
    }
    return touches;
  }

  double stiffness_Npm_, gap_m_, edge_m_;
  Eigen::Vector3d n_;
};

}  // namespace

Effect Contact() {
  return {
      .name = "contact",
      .stage = Stage::kBody,
      .scope = Scope::kRobot,
      .cut = Cut::kShape,
      .cut_robot_side = Cut::kShape,
      .parameters = {{.name = "stiffness_Npm",
                      .nominal = 0,
                      .lower = 0,
                      .upper = 20000,
                      .typical = 100,
                      .starts = {1},
                      .of = Yardstick::kTipStiffness},
                     {.name = "gap_m",
                      .nominal = 0.01,
                      .lower = 0.001,
                      .upper = 0.2,
                      .typical = 0.003,
                      .shape = true,
                      .starts = {0.004, 0.01, 0.02},
                      .of = Yardstick::kLength},
                     {.name = "angle_rad",
                      .nominal = 0,
                      // Wider than one turn, so that no search ends at the wrap.
                      .lower = -2 * std::numbers::pi,
                      .upper = 2 * std::numbers::pi,
                      .typical = 0.3,
                      .shape = true,
                      .starts = {0, 1.05, 2.1, 3.14, -2.1, -1.05}}},
      .summary = "the robot touches something in part of its workspace",
      .physics =
          "A wall stands at gap_m from the straight robot's axis, in the direction angle_rad in the base's "
          "x-y plane. Each disk whose centre gets behind it is pushed back by stiffness_Npm times the depth "
          "(less within the 450th part of the length); there is no friction along the wall.",
      .signature =
          "The model is right up to a place in space, and the tip falls short of its target beyond it: "
          "always at the same place, whatever the speed and direction of approach; no loop.",
      .experiment =
          "A circle or slow bends in every direction: a map of the error over the tip's position shows a "
          "straight edge. Then inspect that place.",
      .confusable = {"superelastic", "unit_stiffness", "tip_force"},
      .add =
          [](PlantLaws& laws, const RobotParameters& robot, Target, std::span<const double> v) {
            if (v[0] == 0) return;
            laws.body.Add(std::make_unique<ContactLaw>(v[0], v[1], v[2], robot.body.length_m() / 450));
          },
  };
}

}  // namespace tendril::sim
