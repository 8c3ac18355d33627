#include "tendril/model/pull_cone.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "tendril/model/statics.h"

namespace tendril::model {
namespace {

constexpr double kTurn = 2 * std::numbers::pi, kHalfTurn = std::numbers::pi;
constexpr double kAlike_rad = 0.01;
// A gap this close to half a turn counts as such; the tendons beside it hold nothing across it.
constexpr double kOpposite_rad = 1e-6 * kHalfTurn / 180;

double Wrapped(double angle_rad) { return angle_rad - kTurn * std::floor(angle_rad / kTurn); }

double SignedAngle(double angle_rad) { return std::remainder(angle_rad, kTurn); }

/// Arc length to the middle of a section.
double MiddleOf(const BodyParameters& body, int section) {
  double middle_m = 0;
  for (int k = 0; k <= section; ++k) {
    const SectionParameters& s = body.sections[static_cast<std::size_t>(k)];
    middle_m += (k < section ? 1 : 0.5) * s.units * s.unit_length_m;
  }
  return middle_m;
}

double AngleAt(const BodyParameters& body, const TendonRoute& t, double arc_m) {
  return t.angle_rad + (body.twist_rad_per_m + t.turn_rad_per_m) * arc_m;
}

Eigen::Vector2d Along(double angle_rad) { return {std::cos(angle_rad), std::sin(angle_rad)}; }

}  // namespace

Eigen::Vector2d PullCone::Nearest(const Eigen::Vector2d& bend_rad) const noexcept {
  const Eigen::Vector2d first = Along(from_rad), last = Along(from_rad + width_rad);
  switch (kind) {
    case Kind::kPlane:
      return bend_rad;
    case Kind::kLine:
      return first * first.dot(bend_rad);
    case Kind::kHalfPlane: {
      const Eigen::Vector2d inwards(-first.y(), first.x());
      return bend_rad - inwards * std::min(0.0, inwards.dot(bend_rad));
    }
    case Kind::kRay:
    case Kind::kWedge:
      break;
  }
  const double at_rad = Wrapped(std::atan2(bend_rad.y(), bend_rad.x()) - from_rad);
  if (kind == Kind::kWedge && at_rad <= width_rad) return bend_rad;
  const Eigen::Vector2d on_first = first * std::max(0.0, first.dot(bend_rad)),
                        on_last = last * std::max(0.0, last.dot(bend_rad));
  return on_first.norm() >= on_last.norm() ? on_first : on_last;
}

PullCone PullConeOf(const BodyParameters& body, int section) {
  const double middle_m = MiddleOf(body, section);
  std::vector<double> angles;
  for (const TendonRoute& t : body.sections[static_cast<std::size_t>(section)].tendons)
    angles.push_back(Wrapped(AngleAt(body, t, middle_m)));
  std::sort(angles.begin(), angles.end());
  // The cone begins after the widest gap.
  double widest = angles.front() + kTurn - angles.back();
  PullCone cone{.from_rad = angles.front()};
  for (std::size_t i = 1; i < angles.size(); ++i) {
    if (angles[i] - angles[i - 1] <= widest) continue;
    widest = angles[i] - angles[i - 1];
    cone.from_rad = angles[i];
  }
  cone.width_rad = kTurn - widest;
  const bool at_ends = std::all_of(angles.begin(), angles.end(), [&](double angle) {
    const double at = Wrapped(angle - cone.from_rad + kAlike_rad) - kAlike_rad;
    return std::min(std::abs(at), std::abs(at - cone.width_rad)) <= kAlike_rad;
  });
  if (widest < kHalfTurn - (at_ends ? kAlike_rad : kOpposite_rad)) {
    cone = {PullCone::Kind::kPlane, 0, kTurn};
  } else if (widest <= kHalfTurn + kAlike_rad) {
    cone.kind = at_ends ? PullCone::Kind::kLine : PullCone::Kind::kHalfPlane;
    cone.width_rad = kHalfTurn;
  } else {
    cone.kind = cone.width_rad <= kAlike_rad ? PullCone::Kind::kRay : PullCone::Kind::kWedge;
  }
  return cone;
}

void AlignHoles(BodyParameters& body) {
  for (int k = 0; k < static_cast<int>(body.sections.size()); ++k) {
    const PullCone cone = PullConeOf(body, k);
    if (!cone.on_line()) continue;
    const double middle_m = MiddleOf(body, k);
    for (TendonRoute& t : body.sections[static_cast<std::size_t>(k)].tendons) {
      const double from_first = SignedAngle(AngleAt(body, t, middle_m) - cone.from_rad);
      const bool opposite = std::abs(from_first) > 0.5 * kHalfTurn;
      t.angle_rad -= opposite ? from_first - std::copysign(kHalfTurn, from_first) : from_first;
    }
  }
}

bool PullsEveryWay(const BodyParameters& body) {
  for (int k = 0; k < static_cast<int>(body.sections.size()); ++k) {
    if (PullConeOf(body, k).kind != PullCone::Kind::kPlane) return false;
  }
  return true;
}

Eigen::VectorXd RestShape(const Body& body, ConstVectorRef tension_N) {
  const Equilibrium rest = SolveStatics(body, tension_N, Eigen::Vector3d::Zero());
  if (rest.result != StaticsResult::kConverged) return Eigen::VectorXd::Zero(body.dof());
  return rest.q;
}

Eigen::VectorXd RestShape(const Body& body, double tension_N) {
  return RestShape(body, Eigen::VectorXd::Constant(body.tendons(), tension_N));
}

}  // namespace tendril::model
