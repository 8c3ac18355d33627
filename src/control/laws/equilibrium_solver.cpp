// See the header. Knows the body through its forces and their derivatives only.
#include "tendril/control/equilibrium_solver.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "tendril/control/state_archive.h"
#include "tendril/model/pull_cone.h"

namespace tendril::control {
namespace {

// From last cycle's shape one step leaves a negligible error; a start from the arc takes four.
constexpr int kMaxIterations = 6;
constexpr double kSettled_rad = 1e-5;   // Newton converges quadratically: the error left is its square
constexpr double kLongest_rad = 0.3;    // step limit per unit: the linear model is invalid beyond it
constexpr double kAccepted_rad = 2e-3;  // the solution has not converged if the last step is longer

}  // namespace

EquilibriumSolver::EquilibriumSolver(const model::Body& body, const LimitParameters& limits,
                                     model::TendonPairs pairs)
    : body_(body),
      robot_min_tension_N_(limits.min_tension_N),
      max_tension_N_(limits.max_tension_base_N),
      workspace_(body),
      allocator_(body.tendons(), 2 * body.sections(), std::move(pairs)),
      q_(UnitVector::Zero(body.dof())),
      tension_N_(allocator_.Unpulled_N(limits.min_tension_N)),
      min_tension_N_(limits.min_tension_N),
      most_tension_N_(tension_N_),
      arc_q_(q_),
      dq_(q_),
      ddq_(q_),
      residual_(q_),
      pulled_(q_),
      lacking_Nm_(BendingVector::Zero(2 * body.sections())),
      pose_(body.units()),
      goal_W_m_(body.sections()),
      stiffness_(body.dof(), body.dof()),
      lengths_(body.tendons(), body.dof()),
      solved_(body.dof(), body.tendons() + 1),
      tip_jacobian_(6, body.dof()),
      goal_rows_(2 * body.sections(), body.dof()),
      goal_per_tension_(2 * body.sections(), body.tendons() + 1),
      goal_gap_(BendingVector::Zero(2 * body.sections())),
      factor_(body.dof()) {
  for (int k = 0; k < body.sections(); ++k)
    on_line_.push_back(model::PullConeOf(body.parameters(), k).on_line());
}

Status EquilibriumSolver::Solve(const BendingReference& reference, const TendonVector& arc_tension_N,
                                double least_N, const TendonVector& most_N,
                                const Eigen::Vector3d& tip_shift_W_m,
                                const BendingVector& lacking_Nm) noexcept {
  lacking_Nm_ = lacking_Nm;
  most_tension_N_ = most_N.cwiseMin(max_tension_N_);
  min_tension_N_ = std::clamp(least_N, robot_min_tension_N_, max_tension_N_);
  body_.SpreadBending(reference.position_rad, arc_q_);
  body_.SpreadBending(reference.velocity_radps, dq_);
  body_.SpreadBending(reference.acceleration_radps2, ddq_);
  body_.Poses(arc_q_, pose_);
  for (int k = 0; k < body_.sections(); ++k) goal_W_m_[k] = pose_[body_.end_unit(k) - 1].p_WA;
  goal_W_m_.back() += tip_shift_W_m;
  if (!warm_) {
    q_ = arc_q_;
    tension_N_ = arc_tension_N;
  }
  double size_rad = 0;
  status_ = Status::kOk;
  for (iterations_ = 1; iterations_ <= kMaxIterations; ++iterations_) {
    if (!Step(size_rad)) break;
    if (size_rad <= kSettled_rad) break;
  }
  iterations_ = std::min(iterations_, kMaxIterations);
  warm_ = status_ != Status::kEquilibriumNotFound && size_rad <= kAccepted_rad;
  return warm_ ? status_ : Status::kEquilibriumNotFound;
}

// Newton on balance and goals together: q moves by A dT + b with K A = force per tension and K b = -residual;
// the allocation finds the tensions whose shape meets the goals.
bool EquilibriumSolver::Step(double& size_rad) noexcept {
  const int m = body_.tendons();
  body_.TangentStiffness(q_, tension_N_, Eigen::Vector3d::Zero(), stiffness_);
  factor_.compute(stiffness_);
  if (factor_.info() != Eigen::Success) {  // unstable: tensions cannot hold this shape
    status_ = Status::kEquilibriumNotFound;
    return false;
  }
  body_.InverseDynamics(q_, dq_, ddq_, residual_, workspace_);
  Add(lacking_Nm_, residual_);
  body_.TendonLengthJacobian(q_, lengths_);
  for (int j = 0; j < m; ++j) solved_.col(j) = -lengths_.row(j).transpose();
  solved_.col(m) = -residual_;
  solved_.col(m).noalias() += solved_.leftCols(m).lazyProduct(tension_N_);
  factor_.solveInPlace(solved_);

  Goals();
  goal_per_tension_.noalias() = goal_rows_.lazyProduct(solved_);
  KeepPulledWays();
  const auto slope = goal_per_tension_.leftCols(m);
  const BendingVector required =
      goal_gap_ - goal_per_tension_.col(m) + BendingVector(slope.lazyProduct(tension_N_));
  // What a pair has unpulled changes with the shape, but hardly against the body's stiffness, so that
  // following it from step to step is enough.
  allocator_.Bend(body_, q_);
  const auto allocated = allocator_.Allocate(slope, required, min_tension_N_, most_tension_N_);
  const TendonVector change_N = allocated.tension_N - tension_N_;
  UnitVector step = solved_.col(m);
  step.noalias() += solved_.leftCols(m).lazyProduct(change_N);
  size_rad = step.lpNorm<Eigen::Infinity>();
  if (!std::isfinite(size_rad) || allocated.status == Status::kSolverFallback) {
    status_ = Status::kEquilibriumNotFound;
    return false;
  }
  const double share = size_rad > kLongest_rad ? kLongest_rad / size_rad : 1;
  q_ += share * step;
  tension_N_ += share * change_N;
  status_ = allocated.bound;
  return true;
}

void EquilibriumSolver::Add(const BendingVector& section_Nm, UnitVector& unit_Nm) const noexcept {
  for (int k = 0; k < body_.sections(); ++k) {
    for (int i = body_.first_unit(k); i < body_.end_unit(k); ++i)
      unit_Nm.segment<2>(2 * i) += section_Nm.segment<2>(2 * k);
  }
}

BendingMatrix EquilibriumSolver::SectionCompliance() noexcept {
  const int k2 = 2 * body_.sections();
  BendingMatrix compliance(k2, k2);
  BendingVector moment_Nm = BendingVector::Zero(k2), bend_rad(k2);
  for (int i = 0; i < k2; ++i) {
    moment_Nm[i] = 1;
    pulled_.setZero();
    Add(moment_Nm, pulled_);
    factor_.solveInPlace(pulled_);
    body_.SumBending(pulled_, bend_rad);
    compliance.col(i) = bend_rad;
    moment_Nm[i] = 0;
  }
  return compliance;
}

bool EquilibriumSolver::Follow(const TendonVector& tension_N, const BendingVector& lacking_Nm) noexcept {
  if (!warm_) q_.setZero();
  for (int i = 0; i < kMaxIterations; ++i) {
    body_.TangentStiffness(q_, tension_N, Eigen::Vector3d::Zero(), stiffness_);
    factor_.compute(stiffness_);
    if (factor_.info() != Eigen::Success) return false;
    body_.StaticForce(q_, Eigen::Vector3d::Zero(), residual_);
    Add(lacking_Nm, residual_);
    body_.TendonForce(q_, tension_N, pulled_);
    residual_ -= pulled_;
    factor_.solveInPlace(residual_);
    const double size_rad = residual_.lpNorm<Eigen::Infinity>();
    if (!std::isfinite(size_rad)) return false;
    q_ -= (size_rad > kLongest_rad ? kLongest_rad / size_rad : 1) * residual_;
    if (size_rad <= kSettled_rad) break;
  }
  tension_N_ = tension_N;
  return warm_ = true;
}

// Rows W_k of the position Jacobian of each section's end, and the remaining error along them.
void EquilibriumSolver::Goals() noexcept {
  body_.Poses(q_, pose_);
  body_.TipJacobian(q_, tip_jacobian_);
  const Eigen::Vector3d tip_W_m = pose_.back().p_WA;
  for (int k = 0; k < body_.sections(); ++k) {
    const int end = body_.end_unit(k);
    const Eigen::Vector3d end_W_m = pose_[end - 1].p_WA, beyond_W_m = tip_W_m - end_W_m;
    const auto velocity = [&](int column) {  // of the section's end per this angle
      return Eigen::Vector3d(tip_jacobian_.col(column).head<3>() -
                             tip_jacobian_.col(column).tail<3>().cross(beyond_W_m));
    };
    Eigen::Vector3d u = Eigen::Vector3d::Zero(), v = u;
    for (int i = body_.first_unit(k); i < end; ++i) {
      u += velocity(2 * i);
      v += velocity(2 * i + 1);
    }
    u.normalize();
    v -= u * u.dot(v);
    v.normalize();
    tip_u_ = u;
    tip_v_ = v;
    for (int i = 0; i < 2 * end; ++i) {
      const Eigen::Vector3d moves = velocity(i);
      goal_rows_(2 * k, i) = u.dot(moves);
      goal_rows_(2 * k + 1, i) = v.dot(moves);
    }
    goal_rows_.block(2 * k, 2 * end, 2, body_.dof() - 2 * end).setZero();
    const Eigen::Vector3d gap = goal_W_m_[k] - end_W_m;
    goal_gap_[2 * k] = u.dot(gap);
    goal_gap_[2 * k + 1] = v.dot(gap);
  }
}

// Tendons on a line move a section's end in one direction only. Across it, sag or load can hardly be
// corrected by co-contraction, so that direction is removed from the goals.
void EquilibriumSolver::KeepPulledWays() noexcept {
  int tendon = 0;
  for (int k = 0; k < body_.sections(); ++k) {
    const auto own =
        static_cast<int>(body_.parameters().sections[static_cast<std::size_t>(k)].tendons.size());
    const auto slope = goal_per_tension_.block(2 * k, tendon, 2, own);
    tendon += own;
    if (!on_line_[static_cast<std::size_t>(k)]) continue;
    const Eigen::Matrix2d moved = slope.lazyProduct(slope.transpose());
    const double angle_rad = 0.5 * std::atan2(2 * moved(0, 1), moved(0, 0) - moved(1, 1));
    const Eigen::Vector2d along(std::cos(angle_rad), std::sin(angle_rad));
    for (Eigen::Index j = 0; j < goal_per_tension_.cols(); ++j) {
      auto goal = goal_per_tension_.col(j).segment<2>(2 * k);
      goal = Eigen::Vector2d(along * along.dot(goal));
    }
    goal_gap_.segment<2>(2 * k) = Eigen::Vector2d(along * along.dot(goal_gap_.segment<2>(2 * k)));
    if (k + 1 < body_.sections()) continue;
    tip_u_ = along[0] * tip_u_ + along[1] * tip_v_;
    tip_v_.setZero();
  }
}

void EquilibriumSolver::Archive(StateArchive& a) noexcept {
  a.Value(warm_);
  a.Vector(q_, {body_.dof()});
  a.Vector(tension_N_, {body_.tendons()});
  a.Vector(tip_u_);
  a.Vector(tip_v_);
}

}  // namespace tendril::control
