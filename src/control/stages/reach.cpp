#include "tendril/control/reach.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "tendril/model/pull_cone.h"

namespace tendril::control {
namespace {

constexpr int kHalvings = 8;  // 1 / 256 of the largest bend
constexpr int kMaxSecants = 40;
constexpr double kSettledShare = 1e-9;   // share of a bend; tight, because moving goals are differentiated
constexpr int kDirections = 12;          // sampled directions per section; more than there are tendons
constexpr double kHoldableShare = 0.95;  // margin for directions between the samples

}  // namespace

Reach::Reach(const RobotParameters& robot, const model::Body& body, const LimitParameters& limits,
             double gather_s, bool pulls_for_rotors)
    : body_(body),
      allocator_(body.tendons(), 2 * body.sections(), model::TendonPairs(robot)),
      min_tension_N_(limits.min_tension_N),
      max_tension_N_(limits.max_tension_base_N),
      most_room_N_(pulls_for_rotors ? HUGE_VAL : 0.5 * limits.min_tension_N),
      q_(UnitVector::Zero(body.dof())),
      unit_force_Nm_(q_),
      force_Nm_(BendingVector::Zero(2 * body.sections())),
      force_per_tension_(2 * body.sections(), body.tendons()) {
  double heaviest_Nspr = 0;  // rotor, as tension per acceleration of bend
  std::size_t j = 0;
  for (const SectionParameters& section : robot.body.sections) {
    for (const TendonRoute& route : section.tendons) {
      const TendonDriveParameters& drive = robot.actuation->tendons[j++];
      const double travel_m = drive.SpoolTravelPerMotorRad();
      heaviest_Nspr =
          std::max(heaviest_Nspr, drive.motor.rotor_inertia_kgm2 / (travel_m * travel_m) * route.radius_m);
    }
  }
  rate_per_N_ = gather_s / heaviest_Nspr;
  holdable_rad_ = limits.max_bending_rad;
  if (model::PullsEveryWay(robot.body)) {
    FindHoldable();
  } else {
    nearest_.emplace(body, min_tension_N_, max_tension_N_, model::TendonPairs(robot));
    FindHoldableOfPulled();
  }
  holdable_rad_ *= kHoldableShare;
}

void Reach::FindHoldable() {
  // Sections load each other, so combinations are checked: each straight or bent in one of the directions.
  const int ways = kDirections + 1;
  int combinations = 1;
  for (int k = 0; k < body_.sections(); ++k) combinations *= ways;
  BendingVector bending_rad = BendingVector::Zero(2 * body_.sections());
  for (int c = 0; c < combinations; ++c) {
    for (int k = 0, rest = c; k < body_.sections(); ++k, rest /= ways) {
      const double angle_rad = 2 * std::numbers::pi * (rest % ways) / kDirections;
      bending_rad.segment<2>(2 * k) << std::cos(angle_rad), std::sin(angle_rad);
      if (rest % ways == kDirections) bending_rad.segment<2>(2 * k).setZero();
    }
    double low = 0, high = holdable_rad_;
    if (Holds(high * bending_rad)) continue;
    for (int i = 0; i < kHalvings; ++i) {
      const double middle = (low + high) / 2;
      (Holds(middle * bending_rad) ? low : high) = middle;
    }
    holdable_rad_ = low;
  }
}

void Reach::FindHoldableOfPulled() {
  std::vector<std::vector<Eigen::Vector2d>> ways;  // per section, the last one straight
  std::size_t combinations = 1;
  for (int k = 0; k < body_.sections(); ++k) {
    const model::PullCone cone = model::PullConeOf(body_.parameters(), k);
    const bool ends_only = cone.kind == model::PullCone::Kind::kLine;
    std::vector<Eigen::Vector2d>& own = ways.emplace_back();
    for (int i = 0; i <= kDirections; i += ends_only ? kDirections : 1) {
      const double angle_rad = cone.from_rad + cone.width_rad * i / kDirections;
      own.emplace_back(std::cos(angle_rad), std::sin(angle_rad));
    }
    own.emplace_back(0, 0);
    combinations *= own.size();
  }
  const double most_rad = holdable_rad_;
  for (std::size_t c = 0; c < combinations; ++c) {
    BendingVector asked_rad(2 * body_.sections());
    std::size_t rest = c;
    for (int k = 0; k < body_.sections(); rest /= ways[k].size(), ++k)
      asked_rad.segment<2>(2 * k) = most_rad * ways[k][rest % ways[k].size()];
    BendingVector held_rad = asked_rad;
    if (nearest_->Project(held_rad) != Status::kLimitedTensionMax) continue;
    for (int k = 0; k < body_.sections(); ++k) {
      const double along_rad = asked_rad.segment<2>(2 * k).dot(held_rad.segment<2>(2 * k)) / most_rad;
      if (!asked_rad.segment<2>(2 * k).isZero(0)) holdable_rad_ = std::clamp(along_rad, 0.0, holdable_rad_);
    }
  }
}

double Reach::Lacking_Nm(const BendingVector& bending_rad) noexcept {
  body_.SpreadBending(bending_rad, q_);
  body_.StaticForce(q_, Eigen::Vector3d::Zero(), unit_force_Nm_);
  body_.ProjectForce(unit_force_Nm_, force_Nm_);
  model::SectionForcePerTension(body_, bending_rad, force_per_tension_);
  allocator_.Bend(body_, q_);
  const auto held = allocator_.Allocate(force_per_tension_, force_Nm_, min_tension_N_, max_tension_N_);
  return held.status == Status::kOk ? 0 : std::max(held.residual_Nm, std::numeric_limits<double>::min());
}

double Reach::Rate_radps(const BendingVector& bending_rad, bool goal_moves) const noexcept {
  double bend_rad = 0;
  for (int k = 0; k < body_.sections(); ++k)
    bend_rad = std::max(bend_rad, bending_rad.segment<2>(2 * k).norm());
  const double free = holdable_rad_ > 0 ? 1 - bend_rad / holdable_rad_ : 0;
  const double room_N = std::max(free, kLeastRoom) * kRotorShare * (max_tension_N_ - min_tension_N_);
  return rate_per_N_ * (goal_moves ? room_N : std::min(room_N, most_room_N_));
}

Status Reach::Limit(BendingVector& bending_rad) noexcept {
  if (nearest_) return nearest_->Project(bending_rad);
  double most_rad = 0;
  for (int k = 0; k < body_.sections(); ++k)
    most_rad = std::max(most_rad, bending_rad.segment<2>(2 * k).norm());
  if (most_rad <= holdable_rad_) return Status::kOk;
  if (asked_rad_.size() > 0 && bending_rad == asked_rad_) {
    bending_rad = given_rad_;
    return Status::kLimitedTensionMax;
  }
  const double lacking_Nm = Lacking_Nm(bending_rad);
  if (lacking_Nm == 0) return Status::kOk;
  const double surely_held = holdable_rad_ / most_rad;
  if (!(surely_held > 0)) return Status::kOk;
  asked_rad_ = bending_rad;
  bending_rad *= HeldShare(bending_rad, lacking_Nm, surely_held);
  given_rad_ = bending_rad;
  return Status::kLimitedTensionMax;
}

// What a bend lacks grows from zero at the bound, nearly in proportion, so that secants from outside find it.
double Reach::HeldShare(const BendingVector& bending_rad, double lacking_Nm, double held) noexcept {
  double lacks = 1, slope_Nm = 0;
  for (int i = 0; i < kMaxSecants && lacks - held > 2 * kSettledShare; ++i) {
    const double secant = slope_Nm > 0 ? lacks - lacking_Nm / slope_Nm - kSettledShare : 0;
    const double share = secant > held ? secant : (held + lacks) / 2;
    const double at_share_Nm = Lacking_Nm(share * bending_rad);
    if (at_share_Nm == 0) {
      held = share;
      continue;
    }
    slope_Nm = (lacking_Nm - at_share_Nm) / (lacks - share);
    lacks = share;
    lacking_Nm = at_share_Nm;
  }
  return held;
}

}  // namespace tendril::control
