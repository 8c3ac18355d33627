#include "tendril/control/nearest_held.h"

#include <cmath>
#include <utility>

#include "tendril/model/pull_cone.h"

namespace tendril::control {
namespace {

constexpr int kMaxSearchSteps = 20;
constexpr double kLongest_rad = 0.3;    // step limit per section: the linear model is invalid beyond it
constexpr double kSettled_rad = 1e-11;  // tight, because moving goals are differentiated from cycle to cycle

}  // namespace

NearestHeld::NearestHeld(const model::Body& body, double min_tension_N, double max_tension_N,
                         model::TendonPairs pairs)
    : body_(body),
      allocator_(body.tendons(), 2 * body.sections(), std::move(pairs)),
      min_tension_N_(min_tension_N),
      max_tension_N_(max_tension_N),
      spread_(body.dof(), 2 * body.sections()),
      unit_stiffness_(body.dof(), body.dof()),
      force_per_tension_(2 * body.sections(), body.tendons()),
      bend_per_tension_(force_per_tension_),
      pulled_per_tension_(force_per_tension_),
      pulled_(BendingMatrix::Identity(2 * body.sections(), 2 * body.sections())),
      q_(UnitVector::Zero(body.dof())),
      unit_force_Nm_(q_),
      force_Nm_(BendingVector::Zero(2 * body.sections())),
      stiffness_Nm_(2 * body.sections(), 2 * body.sections()) {
  for (int i = 0; i < 2 * body.sections(); ++i) {
    body.SpreadBending(BendingVector::Unit(2 * body.sections(), i), q_);
    spread_.col(i) = q_;
  }
  for (int k = 0; k < body.sections(); ++k) {
    const model::PullCone cone = model::PullConeOf(body.parameters(), k);
    if (!cone.on_line()) continue;
    const Eigen::Vector2d along(std::cos(cone.from_rad), std::sin(cone.from_rad));
    pulled_.block<2, 2>(2 * k, 2 * k) = along * along.transpose();
  }
}

// Forces and stiffness of an arc; false where it is not stable at these tensions.
bool NearestHeld::Linearise(const BendingVector& bending_rad, const TendonVector& tension_N) noexcept {
  body_.SpreadBending(bending_rad, q_);
  body_.StaticForce(q_, Eigen::Vector3d::Zero(), unit_force_Nm_);
  body_.ProjectForce(unit_force_Nm_, force_Nm_);
  model::SectionForcePerTension(body_, bending_rad, force_per_tension_);
  allocator_.Bend(body_, q_);
  body_.TangentStiffness(q_, tension_N, Eigen::Vector3d::Zero(), unit_stiffness_);
  BendingVector column(force_Nm_.size());
  for (Eigen::Index i = 0; i < force_Nm_.size(); ++i) {
    unit_force_Nm_.noalias() = unit_stiffness_.lazyProduct(spread_.col(i));
    body_.ProjectForce(unit_force_Nm_, column);
    stiffness_Nm_.col(i) = column;
  }
  factor_.compute(stiffness_Nm_);
  return factor_.info() == Eigen::Success;
}

// Gauss-Newton on the tensions with the arc in balance: db = K^-1 (J dT - r), r the residual of the balance.
Status NearestHeld::Project(BendingVector& bending_rad) noexcept {
  const BendingVector asked_rad = bending_rad;
  BendingVector at_rad = asked_rad;
  TendonVector tension_N = allocator_.Unpulled_N(min_tension_N_);
  Status bound = Status::kOk;
  for (int i = 0; i < kMaxSearchSteps; ++i) {
    if (!Linearise(at_rad, tension_N)) return Status::kOk;
    if (i == 0) {
      const auto held = allocator_.Allocate(force_per_tension_, force_Nm_, min_tension_N_, max_tension_N_);
      if (held.status == Status::kOk) return Status::kOk;
      tension_N = held.tension_N;
      if (!Linearise(at_rad, tension_N)) return Status::kOk;
    }
    BendingVector lacking_rad = force_Nm_ - force_per_tension_.lazyProduct(tension_N);
    factor_.solveInPlace(lacking_rad);
    bend_per_tension_ = force_per_tension_;
    factor_.solveInPlace(bend_per_tension_);
    BendingVector required_rad = bend_per_tension_.lazyProduct(tension_N);
    required_rad += asked_rad - at_rad + lacking_rad;
    required_rad = BendingVector(pulled_.lazyProduct(required_rad));
    pulled_per_tension_.noalias() = pulled_.lazyProduct(bend_per_tension_);
    const auto nearest =
        allocator_.Allocate(pulled_per_tension_, required_rad, min_tension_N_, max_tension_N_);
    const TendonVector change_N = nearest.tension_N - tension_N;
    const BendingVector step_rad = BendingVector(bend_per_tension_.lazyProduct(change_N)) - lacking_rad;
    const double size_rad = step_rad.lpNorm<Eigen::Infinity>();
    if (!std::isfinite(size_rad) || nearest.status == Status::kSolverFallback) return Status::kOk;
    const double share = size_rad > kLongest_rad ? kLongest_rad / size_rad : 1;
    at_rad += share * step_rad;
    tension_N += share * change_N;
    bound = nearest.bound;
    if (size_rad <= kSettled_rad) break;
  }
  bending_rad = at_rad;
  if ((at_rad - asked_rad).norm() <= kSame_rad) return Status::kOk;
  return bound == Status::kLimitedTensionMax ? bound : Status::kLimitedDirection;
}

}  // namespace tendril::control
