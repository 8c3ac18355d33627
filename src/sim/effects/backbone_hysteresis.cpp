// Effect: hysteresis of the backbone's bending: friction in strands, sleeves and glue, or in the metal
// itself.
#include <array>
#include <cmath>
#include <memory>
#include <vector>

#include "sections.h"

namespace tendril::sim {
namespace {

/// Maxwell slip in the plane of (u, v), equal in every direction. Each unit has four springs e_k of which
/// each slips when |e_k| reaches its yield y_k = (k/4)^spread yield_rad:
///   e_k follows q and is brought back to the circle |e_k| = y_k,   moment = -(M / 4) sum_k e_k / y_k,
/// of size M once all slip. Return along the radius is the plastic flow of greatest dissipation: no cycle
/// gains energy.
class HysteresisLaw final : public BodyLaw {
 public:
  HysteresisLaw(UnitRange units, double moment_Nm, double yield_rad, double spread)
      : units_(units), moment_Nm_(moment_Nm), memory_(units.end - units.first) {
    for (int k = 0; k < kElements; ++k)
      yield_rad_[static_cast<std::size_t>(k)] = yield_rad * std::pow((k + 1.0) / kElements, spread);
    for (Memory& memory : memory_) memory.fill({0, 0});
    committed_.assign(memory_.size(), {0, 0});
  }
  std::unique_ptr<BodyLaw> Clone() const override { return std::make_unique<HysteresisLaw>(*this); }

  void AddForce(const model::Body& body, model::ConstVectorRef q, model::ConstVectorRef, double,
                model::VectorRef force_Nm) const noexcept override {
    for (int i = units_.first; i < units_.end; ++i) {
      const int at = body.coordinate(i);
      for (int k = 0; k < kElements; ++k) {
        const Slip slip = Peek(i, k, q.segment<2>(at));
        const double stiffness = moment_Nm_ / (kElements * Yield(k));
        force_Nm[at] -= stiffness * slip.u;
        force_Nm[at + 1] -= stiffness * slip.v;
      }
    }
  }

  void AddStiffness(const model::Body& body, model::ConstVectorRef q, model::ConstVectorRef,
                    model::MatrixRef stiffness) const noexcept override {
    for (int i = units_.first; i < units_.end; ++i) {
      const int at = body.coordinate(i);
      for (int k = 0; k < kElements; ++k) {
        const Slip slip = Peek(i, k, q.segment<2>(at));
        const double slope = moment_Nm_ / (kElements * Yield(k)) * slip.kept;
        const double u = slip.slips ? slip.u / Yield(k) : 0, v = slip.slips ? slip.v / Yield(k) : 0;
        stiffness(at, at) += slope * (1 - u * u);
        stiffness(at, at + 1) -= slope * u * v;
        stiffness(at + 1, at) -= slope * u * v;
        stiffness(at + 1, at + 1) += slope * (1 - v * v);
      }
    }
  }

  void Commit(const model::Body& body, model::ConstVectorRef q, double) noexcept override {
    for (int i = units_.first; i < units_.end; ++i) {
      const std::size_t at = static_cast<std::size_t>(i - units_.first);
      const Eigen::Vector2d bend = q.segment<2>(body.coordinate(i));
      for (int k = 0; k < kElements; ++k) {
        const Slip slip = Peek(i, k, bend);
        memory_[at][static_cast<std::size_t>(k)] = {slip.u, slip.v};
      }
      committed_[at] = {bend[0], bend[1]};
    }
  }

 private:
  static constexpr int kElements = 4;
  struct Pair {
    double u, v;
  };
  using Memory = std::array<Pair, kElements>;
  struct Slip {
    double u, v;
    double kept;  // yield over the length before the return, 1 while it sticks
    bool slips;
  };

  double Yield(int k) const { return yield_rad_[static_cast<std::size_t>(k)]; }

  Slip Peek(int unit, int k, const Eigen::Vector2d& bend) const {
    const std::size_t at = static_cast<std::size_t>(unit - units_.first);
    const Pair from = memory_[at][static_cast<std::size_t>(k)];
    const double u = from.u + (bend[0] - committed_[at].u);
    const double v = from.v + (bend[1] - committed_[at].v);
    const double length = std::hypot(u, v);
    if (length <= Yield(k)) return {u, v, 1, false};
    const double kept = Yield(k) / length;
    return {kept * u, kept * v, kept, true};
  }

  UnitRange units_;
  double moment_Nm_;
  std::array<double, kElements> yield_rad_;
  std::vector<Memory> memory_;
  std::vector<Pair> committed_;  // bend at the last commit
};

}  // namespace

Effect BackboneHysteresis() {
  return {
      .name = "backbone_hysteresis",
      .stage = Stage::kBody,
      .scope = Scope::kSection,
      .cut = Cut::kShape,
      .cut_robot_side = Cut::kShape,
      .on_all = true,
      .on_one = true,
      .parameters = {{.name = "moment_Nm",
                      .nominal = 0,
                      .lower = 0,
                      .upper = 0.02,
                      .typical = 1e-3,
                      .of = Yardstick::kUnitMoment},
                     {.name = "yield_rad",
                      .nominal = 0.05,
                      .lower = 0.005,
                      .upper = 0.5,
                      .typical = 0.02,
                      .shape = true,
                      .starts = {0.03, 0.1},
                      .of = Yardstick::kUnitBend},
                     {.name = "spread",
                      .nominal = 1,
                      .lower = 0.3,
                      .upper = 4,
                      .typical = 0.5,
                      .shape = true,
                      .starts = {1}}},
      .summary = "bending the backbone takes a moment that depends on the path, not on the speed",
      .physics =
          "Each unit resists its change of bend with a moment that builds up over yield_rad and stays at "
          "moment_Nm, against the motion in the plane of (u, v), the same in every direction (four springs "
          "in parallel, each slipping at its own bend, evenly spaced at a spread of 1, more of them early at "
          "a larger one). Strands rubbing on each other, sleeves, glue, and phase changes of NiTi do this. "
          "The energy lost becomes heat; at rest the moment holds the shape.",
      .signature =
          "Shape against tension draws a loop whose height does not depend on speed nor on the level of "
          "tension, at every bend alike; when released, each unit stops up to moment_Nm / (EI / l) short of "
          "straight.",
      .experiment =
          "Slow triangles with reversals at several amplitudes at three levels of co-contraction: a loop of "
          "pulleys or disks widens with the tension, that of the backbone does not. Sways at zero tension "
          "end in a finite time, not by an exponential.",
      .confusable = {"routing_friction", "capstan_alpha", "pulley_coulomb", "superelastic"},
      .add =
          [](PlantLaws& laws, const RobotParameters& robot, Target target, std::span<const double> v) {
            if (v[0] == 0) return;
            laws.body.Add(std::make_unique<HysteresisLaw>(UnitsOf(robot, target), v[0], v[1], v[2]));
          },
  };
}

}  // namespace tendril::sim
