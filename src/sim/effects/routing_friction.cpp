// Effect: friction of the tendons on the disks where they turn.
#include <array>
#include <cmath>
#include <memory>
#include <vector>

#include "sections.h"
#include "tendril/core/limits.h"
#include "tendril/model/stop_operator.h"

namespace tendril::sim {
namespace {

/// At disk i tendon j turns by phi_ij. It slides over that disk, towards the base when positive, by its
/// shortening beyond it:  x_ij = sum_{k > i} (length in the straight span before disk k - length).
///   T_(i+1) = T_i exp(-mu phi_ij z(x_ij)),   z from four stop operators, 1 when it slides to the base,
/// so that a pulled tendon loses tension towards the tip and one that is paid out holds it there. The base's
/// own plate is not one of the disks: a turn before it belongs to the guide pulleys.
class RoutingLaw final : public BodyLaw {
 public:
  RoutingLaw(const RobotParameters& robot, Target target, double mu)
      : target_(target), mu_(mu), disks_(robot.body.disks()) {
    memory_.assign(static_cast<std::size_t>(robot.body.tendons() * disks_),
                   model::PulleyPresliding(kPresliding_m));
  }
  std::unique_ptr<BodyLaw> Clone() const override { return std::make_unique<RoutingLaw>(*this); }

  void Share(const model::Body& body, model::ConstVectorRef q,
             model::MatrixRef share) const noexcept override {
    Spans turn(body.tendons(), disks_), slide(body.tendons(), disks_);
    body.TendonTurns(q, turn);
    Slide(body, q, slide);
    for (int j = 0; j < body.tendons(); ++j) {
      if (!IsMine(j)) continue;
      double lost = 0;
      for (int i = 0; i + 1 < body.tendon_end_disk(j); ++i) {
        lost += mu_ * turn(j, i) * memory_[At(j, i)].Peek(slide(j, i));
        for (int u = body.span_unit(i + 1); u <= body.disk_unit(i + 1); ++u) share(j, u) *= std::exp(-lost);
      }
    }
  }

  /// From the change of z along x and of phi, with phi about half the sum of the neighbouring spans' bends.
  void AddStiffness(const model::Body& body, model::ConstVectorRef q, model::ConstVectorRef tension_N,
                    model::MatrixRef stiffness) const noexcept override {
    const int m = body.tendons(), n = body.dof();
    Spans slide(m, disks_);
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxTendons, kMaxCoordinates> lengths(m, n);
    body.TendonLengthJacobian(q, lengths);
    Slide(body, q, slide);
    CoordinateVector slope(n);  // slope of the loss up to a disk
    for (int j = 0; j < m; ++j) {
      if (!IsMine(j)) continue;
      const int disks = body.tendon_end_disk(j), end = body.coordinate(body.disk_unit(disks - 1) + 1);
      double lost = 0;
      slope.setZero();
      for (int i = 0; i + 1 < disks; ++i) {
        const Eigen::Vector2d bend = 0.5 * (BendOf(body, q, i) + BendOf(body, q, i + 1));
        const double turn = bend.norm();
        const Eigen::Vector2d towards = turn > 0 ? Eigen::Vector2d(bend / turn) : Eigen::Vector2d(0, 0);
        const auto& memory = memory_[At(j, i)];
        constexpr double kStep_m = 1e-3 * kPresliding_m;
        const double x = slide(j, i), before = memory.Peek(x - kStep_m), after = memory.Peek(x + kStep_m);
        const double z = 0.5 * (before + after), along_x = mu_ * turn * (after - before) / (2 * kStep_m);
        lost += mu_ * turn * z;
        const int beyond = body.coordinate(body.span_unit(i + 1));
        for (int k = beyond; k < end; ++k) slope[k] -= along_x * lengths(j, k);
        for (int u = body.span_unit(i); u <= body.disk_unit(i + 1); ++u)
          slope.segment<2>(body.coordinate(u)) += 0.5 * mu_ * z * towards;
        const double tension = tension_N[j] * std::exp(-lost);
        for (int row = beyond; row < body.coordinate(body.disk_unit(i + 1) + 1); ++row) {
          for (int k = 0; k < end; ++k) stiffness(row, k) -= tension * lengths(j, row) * slope[k];
        }
      }
    }
  }

  void Commit(const model::Body& body, model::ConstVectorRef q, double) noexcept override {
    Spans slide(body.tendons(), disks_);
    Slide(body, q, slide);
    for (int j = 0; j < body.tendons(); ++j) {
      for (int i = 0; IsMine(j) && i + 1 < body.tendon_end_disk(j); ++i)
        memory_[At(j, i)].Commit(slide(j, i));
    }
  }

 private:
  /// Assumed: a hole presses the tendon over a shorter length than a pulley.
  static constexpr double kPresliding_m = 2e-5;
  using Spans = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxTendons, kMaxUnits>;

  bool IsMine(int tendon) const { return !target_ || *target_ == tendon; }
  std::size_t At(int tendon, int disk) const { return static_cast<std::size_t>(tendon * disks_ + disk); }

  /// Of the units between a disk and the one before.
  static Eigen::Vector2d BendOf(const model::Body& body, model::ConstVectorRef q, int disk) noexcept {
    Eigen::Vector2d bend(0, 0);
    for (int u = body.span_unit(disk); u <= body.disk_unit(disk); ++u)
      bend += q.segment<2>(body.coordinate(u));
    return bend;
  }

  static void Slide(const model::Body& body, model::ConstVectorRef q, model::MatrixRef slide) noexcept {
    body.SpanShortening(q, slide);  // of each span; then of all spans beyond it
    for (int j = 0; j < slide.rows(); ++j) {
      double beyond = 0;
      for (Eigen::Index i = slide.cols() - 1; i >= 0; --i) {
        const double own = slide(j, i);
        slide(j, i) = beyond;
        beyond += own;
      }
    }
  }

  Target target_;
  double mu_;
  int disks_;
  std::vector<model::StopOperators<4>> memory_;
};

}  // namespace

Effect RoutingFriction() {
  return {
      .name = "routing_friction",
      .stage = Stage::kBody,
      .scope = Scope::kTendon,
      .cut = Cut::kShape,
      .cut_robot_side = Cut::kShape,
      .on_all = true,
      .on_one = true,
      .parameters = {{.name = "mu", .nominal = 0, .lower = 0, .upper = 0.6, .typical = 0.1}},
      .summary = "Coulomb friction of the tendons in the holes of the disks",
      .physics =
          "At every disk that it passes, a tendon turns by half the bends of the units on either side. "
          "Sliding over it costs the factor exp(-mu x turn), as on a capstan: a pulled tendon arrives at the "
          "tip with less tension than at the base, a released one keeps it there. After a reversal the "
          "friction reverses over 0.04 mm of sliding. With n units bent by theta in all the last unit lacks "
          "about mu theta (n - 1) / n of the tension.",
      .signature =
          "Hysteresis of the shape against base tension that grows with tension and with bend and vanishes "
          "when straight; while pulling, units near the tip bend less than those near the base.",
      .experiment =
          "Slow triangles with reversals at several bends and three levels of co-contraction, load cell on "
          "the robot's side if there is one. Friction of the pulleys shows when straight too; hysteresis of "
          "the backbone does not grow with tension.",
      .confusable = {"capstan_alpha", "wrap_angle", "backbone_hysteresis", "presliding"},
      .add =
          [](PlantLaws& laws, const RobotParameters& robot, Target target, std::span<const double> v) {
            if (v[0] == 0) return;
            laws.body.Add(std::make_unique<RoutingLaw>(robot, target, v[0]));
          },
  };
}

}  // namespace tendril::sim
