// Tensions for a required bend or tip in equilibrium: sequential quadratic programming over the tensions.
// Knows the body through its forces and their derivatives only.
#include "tendril/model/inverse_equilibrium.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <string>
#include <utility>

namespace tendril::model {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

struct InverseEquilibrium::Motion {
  VectorXd dq, ddq;
};

struct InverseEquilibrium::State {
  VectorXd q, tension_N;
  Eigen::PartialPivLU<MatrixXd> stiffness;  // d(balance)/dq at q and these tensions
  MatrixXd force_per_tension;               // 2N x M
  double residual_Nm = 0;
  bool stable = false;
  int iterations = 0;
};

namespace {

constexpr double kSettled_N = 1e-13;  // no tension moves more than this

/// Residual of the balance: the force that this motion requires less that of the tendons.
VectorXd Residual(const Body& body, const VectorXd& q, const VectorXd& tension_N, const VectorXd* dq,
                  const VectorXd* ddq, Body::Workspace& workspace) {
  VectorXd needed(body.dof()), given(body.dof());
  if (dq) {
    body.InverseDynamics(q, *dq, *ddq, needed, workspace);
  } else {
    body.StaticForce(q, Vector3d::Zero(), needed);
  }
  body.TendonForce(q, tension_N, given);
  return needed - given;
}

}  // namespace

InverseEquilibrium::InverseEquilibrium(const Body& body, double min_tension_N, double max_tension_N,
                                       TendonPairs pairs)
    : body_(body), min_tension_N_(min_tension_N), max_tension_N_(max_tension_N), pairs_(std::move(pairs)) {
  if (!(min_tension_N >= 0 && std::isfinite(min_tension_N) && min_tension_N <= max_tension_N)) {
    throw std::invalid_argument("tension bounds " + std::to_string(min_tension_N) + " .. " +
                                std::to_string(max_tension_N) + " N: accepted 0 <= minimum <= maximum");
  }
  const int n = body.dof(), k = 2 * body.sections();
  sum_.resize(k, n);
  spread_.resize(n, k);
  for (int i = 0; i < n; ++i) {
    VectorXd column(k);
    body.SumBending(VectorXd::Unit(n, i), column);
    sum_.col(i) = column;
  }
  for (int i = 0; i < k; ++i) {
    VectorXd column(n);
    body.SpreadBending(VectorXd::Unit(k, i), column);
    spread_.col(i) = column;
  }
}

/// Newton on q at fixed tensions; the state's derivatives belong to the q it ends at. False when no stable
/// shape is found near the start.
bool InverseEquilibrium::Balance(State& state, const Motion* motion) const {
  Body::Workspace workspace(body_);
  const int n = body_.dof();
  const VectorXd* dq = motion ? &motion->dq : nullptr;
  const VectorXd* ddq = motion ? &motion->ddq : nullptr;
  const double scale = body_.parameters().sections[0].UnitStiffness();
  VectorXd residual = Residual(body_, state.q, state.tension_N, dq, ddq, workspace);
  for (int iteration = 0; iteration < 50; ++iteration) {
    MatrixXd stiffness(n, n);
    body_.TangentStiffness(state.q, state.tension_N, Vector3d::Zero(), stiffness);
    state.stable = Eigen::LLT<MatrixXd>(stiffness).info() == Eigen::Success;
    if (motion) {
      // The part of the stiffness due to motion is small and has no closed form here; central differences
      // suffice.
      constexpr double kStep = 1e-5;
      VectorXd plus(n), minus(n), still(n);
      for (int i = 0; i < n; ++i) {
        VectorXd at = state.q;
        at[i] += kStep;
        body_.InverseDynamics(at, *dq, *ddq, plus, workspace);
        body_.StaticForce(at, Vector3d::Zero(), still);
        plus -= still;
        at[i] -= 2 * kStep;
        body_.InverseDynamics(at, *dq, *ddq, minus, workspace);
        body_.StaticForce(at, Vector3d::Zero(), still);
        minus -= still;
        stiffness.col(i) += (plus - minus) / (2 * kStep);
      }
    }
    state.stiffness.compute(stiffness);
    state.residual_Nm = residual.cwiseAbs().maxCoeff();
    const VectorXd step = state.stiffness.solve(-residual);
    if (!step.allFinite()) return false;
    if (step.cwiseAbs().maxCoeff() <= 1e-14) break;
    double length = 1;
    bool better = false;
    for (int attempt = 0; attempt < 8 && !better; ++attempt, length *= 0.5) {
      const VectorXd next = state.q + length * step;
      const VectorXd next_residual = Residual(body_, next, state.tension_N, dq, ddq, workspace);
      better = next_residual.norm() < residual.norm();
      if (better) {
        state.q = next;
        residual = next_residual;
      }
    }
    if (!better) break;  // round-off, or no further progress: distinguished by the residual
  }
  state.residual_Nm = residual.cwiseAbs().maxCoeff();
  MatrixXd lengths(body_.tendons(), n);
  body_.TendonLengthJacobian(state.q, lengths);
  state.force_per_tension = -lengths.transpose();
  return state.stable && state.residual_Nm <= 1e-9 * scale;
}

VectorXd InverseEquilibrium::Value(Goal goal, const VectorXd& q) const {
  if (goal == Goal::kBending) return sum_ * q;
  return body_.TipPose(q).p_WA;
}

/// Steps of the quadratic programme: tensions of least sum whose linearised shape meets the target, halved
/// until the body has a stable shape and the target is nearer. `state` must be in balance.
void InverseEquilibrium::Approach(Goal goal, const VectorXd& target, const Motion* motion, double least_N,
                                  double tolerance, State& state) const {
  TensionAllocator allocator(body_.tendons(), static_cast<int>(target.size()), pairs_);
  double longest = 1;
  for (int iteration = 0; iteration < 200; ++iteration) {
    ++state.iterations;
    MatrixXd slope;  // of the goal by q
    if (goal == Goal::kBending) {
      slope = sum_;
    } else {
      MatrixXd jacobian(6, body_.dof());
      body_.TipJacobian(state.q, jacobian);
      slope = jacobian.topRows(3);
    }
    const MatrixXd q_per_tension = state.stiffness.solve(state.force_per_tension);
    const MatrixXd per_tension = slope * q_per_tension;
    const VectorXd error = target - Value(goal, state.q);
    allocator.Bend(body_, state.q);
    const auto required =
        allocator.Allocate(per_tension, error + per_tension * state.tension_N, least_N, max_tension_N_);
    const VectorXd step = required.tension_N - state.tension_N;
    if (step.cwiseAbs().maxCoeff() <= tolerance) return;
    const double predicted = required.residual_Nm;  // the error that the linear model leaves
    bool moved = false;
    double length = longest;
    for (int attempt = 0; attempt < 25 && !moved; ++attempt, length *= 0.5) {
      State next = state;
      next.tension_N =
          (state.tension_N + length * step)
              .cwiseMax(pairs_.empty() ? min_tension_N_ : std::min(min_tension_N_, pairs_.least_N()))
              .cwiseMin(max_tension_N_);  // except for round-off
      next.q = state.q + length * (q_per_tension * step);
      if (!Balance(next, motion)) continue;
      const double next_error = (target - Value(goal, next.q)).norm();
      // Near the target, steps along the constraint may leave it slightly; the next step corrects that.
      const double near = 1e-4 * (1 + target.norm());
      const bool reachable = predicted <= 1e-9 * (1 + target.norm());
      moved = next_error <= error.norm() - 1e-3 * length * (error.norm() - predicted) ||
              (reachable && next_error < near);
      if (!moved) continue;
      // Steps that oscillate about the best tensions are shortened until they converge.
      longest = next_error > 0.5 * error.norm() && next_error > 1e-12 ? std::max(0.5 * length, 0.02)
                                                                      : std::min(1.0, 2 * length);
      state = std::move(next);
    }
    if (!moved) return;
  }
}

/// Continuation from the shape at equal tensions to the required sums, in steps short enough to stay on the
/// branch.
InverseEquilibrium::State InverseEquilibrium::ContinueToBending(const VectorXd& us_vs, double least_N) const {
  State state;
  state.q = VectorXd::Zero(body_.dof());
  state.tension_N = VectorXd::Constant(body_.tendons(), least_N);
  if (!Balance(state, nullptr)) return state;
  const VectorXd start = sum_ * state.q;
  const int steps = std::max(1, static_cast<int>(std::ceil((us_vs - start).norm() / 0.3)));
  for (int i = 1; i < steps; ++i) {
    Approach(Goal::kBending, start + (us_vs - start) * i / steps, nullptr, least_N, 1e-4, state);
  }
  Approach(Goal::kBending, us_vs, nullptr, least_N, kSettled_N, state);
  return state;
}

/// Continuation along the straight line of tips from there to the target.
InverseEquilibrium::State InverseEquilibrium::ContinueToTip(const Vector3d& target_W_m,
                                                            double least_N) const {
  State state = ContinueToBending(VectorXd::Zero(sum_.rows()), least_N);
  if (!state.stable) return state;
  const VectorXd start = Value(Goal::kTip, state.q);
  constexpr int kSteps = 8;
  for (int i = 1; i < kSteps; ++i) {
    Approach(Goal::kTip, start + (target_W_m - start) * i / kSteps, nullptr, least_N, 1e-4, state);
  }
  return state;
}

InverseEquilibrium::Motion InverseEquilibrium::TipMotion(const VectorXd& q, const Vector3d& velocity,
                                                         const Vector3d& acceleration) const {
  const auto jacobian = [&](const VectorXd& at) {
    MatrixXd full(6, body_.dof());
    body_.TipJacobian(at, full);
    return MatrixXd(full.topRows(3));
  };
  const MatrixXd sections = jacobian(q) * spread_;
  const Eigen::CompleteOrthogonalDecomposition<MatrixXd> inverse(sections);
  Motion motion;
  motion.dq = spread_ * inverse.solve(velocity);
  const double speed = motion.dq.norm();
  Vector3d rest = acceleration;
  if (speed > 0) {
    const VectorXd step = 1e-5 / speed * motion.dq;
    rest -= (jacobian(q + step) - jacobian(q - step)) * motion.dq / (2e-5 / speed);
  }
  motion.ddq = spread_ * inverse.solve(rest);
  return motion;
}

TensionedShape InverseEquilibrium::Finish(Goal goal, const VectorXd& target, const State& state) const {
  TensionedShape shape;
  shape.tension_N = state.tension_N;
  shape.q = state.q;
  shape.target_error = (target - Value(goal, state.q)).norm();
  shape.residual_Nm = state.residual_Nm;
  shape.iterations = state.iterations;
  const double enough = goal == Goal::kBending ? 1e-7 : 1e-8;
  if (!state.stable) {
    shape.status = Status::kSolverFallback;
  } else if (shape.target_error > enough) {
    shape.status = Status::kTargetUnreachable;
  }
  return shape;
}

TensionedShape InverseEquilibrium::ForBending(ConstVectorRef us_vs) const {
  return Finish(Goal::kBending, us_vs, ContinueToBending(us_vs, min_tension_N_));
}

TensionedShape InverseEquilibrium::ForBending(ConstVectorRef us_vs, ConstVectorRef dus_dvs,
                                              ConstVectorRef ddus_ddvs) const {
  const Motion motion{spread_ * dus_dvs, spread_ * ddus_ddvs};
  const TensionedShape still = ForBending(us_vs);
  State state;
  state.q = still.q;
  state.tension_N = still.tension_N;
  state.iterations = still.iterations;
  if (Balance(state, &motion)) Approach(Goal::kBending, us_vs, &motion, min_tension_N_, kSettled_N, state);
  return Finish(Goal::kBending, us_vs, state);
}

TensionedShape InverseEquilibrium::ForTip(const Vector3d& target_W_m, double max_bending_rad) const {
  // The arc with its tip at the target has nearly the shape: the search starts from the equilibrium with the
  // same sums.
  const InverseKinematics arc(body_, max_bending_rad);
  const VectorXd bend = arc.Solve(target_W_m, BendingVector::Zero(2 * body_.sections())).us_vs;
  // A common increase of all tensions moves the tip little and nonlinearly. A tip that needs high tension is
  // not found from low tension, so the search restarts from higher ones until a start converges. The arc of
  // several sections may be far from any equilibrium; then the tip itself is continued from the straight
  // shape.
  const double range_N = std::isfinite(max_tension_N_) ? max_tension_N_ - min_tension_N_ : 10.0;
  TensionedShape best;
  bool first = true;
  int iterations = 0;
  for (const double fraction : {0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7}) {
    const double least_N = min_tension_N_ + fraction * range_N;
    for (const bool by_tip : {false, true}) {
      State state = by_tip ? ContinueToTip(target_W_m, least_N) : ContinueToBending(bend, least_N);
      if (state.stable) Approach(Goal::kTip, target_W_m, nullptr, min_tension_N_, kSettled_N, state);
      const TensionedShape shape = Finish(Goal::kTip, target_W_m, state);
      iterations += shape.iterations;
      const bool nearer = shape.status != Status::kSolverFallback && shape.target_error < best.target_error;
      if (first || best.status == Status::kSolverFallback || nearer) best = shape;
      first = false;
      if (best.status == Status::kOk) {
        best.iterations = iterations;
        return best;
      }
    }
  }
  best.iterations = iterations;
  return best;
}

TensionedShape InverseEquilibrium::ForTip(const Vector3d& target_W_m, const Vector3d& velocity_W_mps,
                                          const Vector3d& acceleration_W_mps2, double max_bending_rad) const {
  const TensionedShape still = ForTip(target_W_m, max_bending_rad);
  State state;
  state.q = still.q;
  state.tension_N = still.tension_N;
  state.iterations = still.iterations;
  // The rates depend on the shape, and the shape slightly on the rates.
  for (int i = 0; i < 30; ++i) {
    const VectorXd before = state.q;
    const Motion motion = TipMotion(state.q, velocity_W_mps, acceleration_W_mps2);
    if (!Balance(state, &motion)) break;
    Approach(Goal::kTip, target_W_m, &motion, min_tension_N_, kSettled_N, state);
    if ((state.q - before).cwiseAbs().maxCoeff() <= 1e-13) break;
  }
  return Finish(Goal::kTip, target_W_m, state);
}

std::string WhyNoShape(const TensionedShape& shape) {
  if (shape.status != Status::kSolverFallback) return {};
  std::array<char, 128> text{};
  std::snprintf(text.data(), text.size(),
                "no stable equilibrium found (%.3g left of the target, %.3g N·m of the balance)",
                shape.target_error, shape.residual_Nm);
  return text.data();
}

}  // namespace tendril::model
