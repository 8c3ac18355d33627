// The implicit integrator of the body under given tensions. Knows one step at a time.
#include "body_motion.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace tendril::sim {
namespace {

// Generalised-alpha: modes far too fast for the step lose a tenth per step.
constexpr double kRho = 0.9;
constexpr double kAlphaM = (2 * kRho - 1) / (kRho + 1);
constexpr double kAlphaF = kRho / (kRho + 1);
constexpr double kGamma = 0.5 + kAlphaF - kAlphaM;
constexpr double kBeta = 0.25 * (kGamma + 0.5) * (kGamma + 0.5);
constexpr double kShare = (1 - kAlphaF) / (1 - kAlphaM);
constexpr double kRateWeight = kGamma * kShare, kBendWeight = kBeta * kShare;

// Newton's matrix is recomputed beyond this bend from its reference, or beyond the constructor's tension.
constexpr double kReferenceBend_rad = 0.02;
// Smaller changes between two iterates give no slope.
constexpr double kSecant_m = 1e-10;
constexpr int kMostIterations = 12;
constexpr int kMostHalvings = 6;

}  // namespace

BodyStepper::BodyStepper(const model::Body& body, const BodyLaws& laws, double near_N)
    : body_(body),
      laws_(laws),
      near_N_(near_N),
      plain_(laws.empty()),
      workspace_(body),
      n_(body.dof()),
      m_(body.tendons()) {
  for (auto* v : {&q_, &v_, &a_, &algorithm_, &q_new_, &v_new_, &a_new_, &residual_, &step_, &law_force_}) {
    v->setZero(n_);
  }
  for (auto* v : {&shortening_, &shortening_rate_, &tension_, &reference_tension_, &active_rhs_,
                  &previous_shortening_, &previous_rate_, &previous_tension_}) {
    v->setZero(m_);
  }
  for (auto* matrix : {&mass_, &stiffness_, &matrix_, &inverse_}) matrix->setZero(n_, n_);
  jacobian_.setZero(m_, n_);
  weighted_.setZero(m_, n_);
  reference_jacobian_.setZero(m_, n_);
  across_.setZero(n_, m_);
  small_.setZero(m_, m_);
  active_matrix_.setZero(m_, m_);
  pull_.resize(static_cast<std::size_t>(m_));
}

// Residual of the equations of motion at the iterate.
void BodyStepper::Evaluate(const TensionSource& source) {
  body_.TendonShortening(q_new_, shortening_, jacobian_);
  for (int j = 0; j < m_; ++j) {
    double rate = 0;
    for (int i = 0; i < n_; ++i) rate -= jacobian_(j, i) * v_new_[i];
    shortening_rate_[j] = rate;
  }
  source.Evaluate(shortening_.data(), shortening_rate_.data(), pull_.data());
  body_.InverseDynamics(q_new_, v_new_, a_new_, residual_, workspace_);
  for (int j = 0; j < m_; ++j) tension_[j] = pull_[static_cast<std::size_t>(j)].value_N;
  if (!plain_) {
    laws_.WeighLengths(body_, q_new_, jacobian_, weighted_);
    law_force_.setZero();
    laws_.AddForce(body_, q_new_, v_new_, to_s_, law_force_);
    residual_ -= law_force_;
  }
  const Eigen::MatrixXd& weighted = plain_ ? jacobian_ : weighted_;
  for (int i = 0; i < n_; ++i) {
    double force = 0;
    for (int j = 0; j < m_; ++j) force += weighted(j, i) * tension_[j];
    residual_[i] += force;
  }
}

// The body's part of Newton's matrix by acceleration: M + h g D + h^2 b K. At rest (h = 0): K.
bool BodyStepper::Refresh(double h) {
  if (std::abs(h - reference_h_) < 1e-6 * h &&
      (q_new_ - reference_q_).cwiseAbs().maxCoeff() < kReferenceBend_rad &&
      (tension_ - reference_tension_).cwiseAbs().maxCoeff() < near_N_) {
    return true;
  }
  body_.MassMatrix(q_new_, mass_, workspace_);
  body_.TangentStiffness(q_new_, tension_, Eigen::Vector3d::Zero(), stiffness_);
  if (!plain_) laws_.AddStiffness(body_, q_new_, tension_, stiffness_);
  matrix_ = mass_ + (h * h * kBendWeight) * stiffness_;
  matrix_.diagonal() += (h * kRateWeight) * body_.damping_Nms();
  if (plain_) {
    const Eigen::LLT<Eigen::MatrixXd> cholesky(matrix_);
    if (cholesky.info() != Eigen::Success) return false;
    inverse_.setIdentity();
    cholesky.solveInPlace(inverse_);
  } else {
    inverse_ = matrix_.partialPivLu().inverse();
  }
  if (!inverse_.allFinite()) return false;
  reference_jacobian_ = jacobian_;
  across_.noalias() = inverse_ * (plain_ ? jacobian_ : weighted_).transpose();
  small_.noalias() = jacobian_ * across_;
  reference_q_ = q_new_;
  reference_tension_ = tension_;
  reference_h_ = h;
  return true;
}

// step = (A + J^T W J)^-1 residual by Woodbury, over the tendons whose weight is not zero.
void BodyStepper::Solve(double h) {
  for (int i = 0; i < n_; ++i) step_[i] = 0;
  for (int j = 0; j < n_; ++j) {
    const double r = residual_[j];
    const double* column = inverse_.data() + static_cast<std::ptrdiff_t>(j) * n_;
    for (int i = 0; i < n_; ++i) step_[i] += column[i] * r;
  }
  active_.clear();
  for (int j = 0; j < m_; ++j) {
    const auto& p = pull_[static_cast<std::size_t>(j)];
    if (p.stiffness_Npm != 0 || p.damping_Nspm != 0) active_.push_back(j);
  }
  const int count = static_cast<int>(active_.size());
  if (count == 0) return;
  // (1 + W J A^-1 J^T) x = W J A^-1 residual; step -= A^-1 J^T x.
  for (int a = 0; a < count; ++a) {
    const int j = active_[static_cast<std::size_t>(a)];
    const auto& p = pull_[static_cast<std::size_t>(j)];
    const double weight = h * h * kBendWeight * p.stiffness_Npm + h * kRateWeight * p.damping_Nspm;
    for (int b = 0; b < count; ++b) {
      active_matrix_(a, b) = weight * small_(j, active_[static_cast<std::size_t>(b)]) + (a == b ? 1 : 0);
    }
    double moved = 0;
    for (int i = 0; i < n_; ++i) moved += reference_jacobian_(j, i) * step_[i];
    active_rhs_[a] = weight * moved;
  }
  for (int k = 0; k < count; ++k) {
    int pivot = k;
    for (int a = k + 1; a < count; ++a) {
      if (std::abs(active_matrix_(a, k)) > std::abs(active_matrix_(pivot, k))) pivot = a;
    }
    if (pivot != k) {
      for (int b = k; b < count; ++b) std::swap(active_matrix_(k, b), active_matrix_(pivot, b));
      std::swap(active_rhs_[k], active_rhs_[pivot]);
    }
    const double inverse = 1 / active_matrix_(k, k);
    for (int a = k + 1; a < count; ++a) {
      const double factor = active_matrix_(a, k) * inverse;
      if (factor == 0) continue;
      for (int b = k + 1; b < count; ++b) active_matrix_(a, b) -= factor * active_matrix_(k, b);
      active_rhs_[a] -= factor * active_rhs_[k];
    }
  }
  for (int k = count - 1; k >= 0; --k) {
    double x = active_rhs_[k];
    for (int b = k + 1; b < count; ++b) x -= active_matrix_(k, b) * active_rhs_[b];
    active_rhs_[k] = x / active_matrix_(k, k);
  }
  for (int a = 0; a < count; ++a) {
    const double x = active_rhs_[a];
    const double* column =
        across_.data() + static_cast<std::ptrdiff_t>(active_[static_cast<std::size_t>(a)]) * n_;
    for (int i = 0; i < n_; ++i) step_[i] -= column[i] * x;
  }
}

// Between two branches of a friction law the tangents may make Newton oscillate; the secant has the slope
// across the corner.
void BodyStepper::SteepenToSecants() {
  for (int j = 0; j < m_; ++j) {
    const double moved = shortening_[j] - previous_shortening_[j];
    if (std::abs(moved) < kSecant_m) continue;
    auto& p = pull_[static_cast<std::size_t>(j)];
    const double damped = p.damping_Nspm * (shortening_rate_[j] - previous_rate_[j]);
    p.stiffness_Npm = std::max(p.stiffness_Npm, (previous_tension_[j] - tension_[j] - damped) / moved);
  }
}

bool BodyStepper::TryStep(TensionSource& source, double h) {
  const double bend_weight = h * h * kBendWeight, rate_weight = h * kRateWeight;
  for (int i = 0; i < n_; ++i) {
    a_new_[i] = a_[i];
    const double algorithm = (a_[i] - kAlphaM * algorithm_[i]) / (1 - kAlphaM);
    q_new_[i] = q_[i] + h * v_[i] + h * h * ((0.5 - kBeta) * algorithm_[i] + kBeta * algorithm);
    v_new_[i] = v_[i] + h * ((1 - kGamma) * algorithm_[i] + kGamma * algorithm);
  }
  double last = 0;
  for (int iteration = 0;; ++iteration) {
    Evaluate(source);
    if (!Refresh(h)) return false;
    if (iteration > 0) SteepenToSecants();
    previous_shortening_ = shortening_;
    previous_rate_ = shortening_rate_;
    previous_tension_ = tension_;
    Solve(h);
    double size = 0;
    for (int i = 0; i < n_; ++i) {
      a_new_[i] -= step_[i];
      q_new_[i] -= bend_weight * step_[i];
      v_new_[i] -= rate_weight * step_[i];
      size = std::max(size, std::abs(step_[i]));
    }
    size *= bend_weight;
    if (!std::isfinite(size) || size > 1) return false;
    if (size < kBendTolerance_rad) break;
    if (iteration + 1 >= kMostIterations) return false;
    if (iteration > 0 && size > 0.3 * last) reference_h_ = 0;  // the matrix is stale
    last = size;
  }
  // Tendons at the accepted shape, by the tangent at their last evaluation.
  for (int j = 0; j < m_; ++j) {
    double moved = 0;
    for (int i = 0; i < n_; ++i) moved += jacobian_(j, i) * step_[i];
    shortening_[j] += bend_weight * moved;
    shortening_rate_[j] += rate_weight * moved;
  }
  for (int i = 0; i < n_; ++i) {
    algorithm_[i] = ((1 - kAlphaF) * a_new_[i] + kAlphaF * a_[i] - kAlphaM * algorithm_[i]) / (1 - kAlphaM);
    a_[i] = a_new_[i];
    q_[i] = q_new_[i];
    v_[i] = v_new_[i];
  }
  Commit(source);
  return true;
}

void BodyStepper::Commit(TensionSource& source) {
  source.Commit(shortening_.data(), shortening_rate_.data());
  if (!plain_) laws_.Commit(body_, q_, to_s_);
}

void BodyStepper::MoveTo(TensionSource& source, double time_s) {
  to_s_ = time_s;
  source.MoveTo(time_s);
}

bool BodyStepper::StepTo(TensionSource& source, double to_s) {
  const double from = time_s_, whole = to_s - from;
  MoveTo(source, to_s);
  if (TryStep(source, whole)) {
    time_s_ = to_s;
    return true;
  }
  // Part steps: halved at each failure, doubled after a success.
  double done = 0, part = 0.5;
  while (done < 1) {
    const double h = std::min(part, 1 - done);
    MoveTo(source, from + (done + h) * whole);
    if (TryStep(source, h * whole)) {
      done += h;
      part = std::min(2 * part, 0.5);
      continue;
    }
    part = 0.5 * h;
    if (part < std::ldexp(1.0, -kMostHalvings)) {
      if (!Settle(source, to_s)) return false;
      break;
    }
  }
  time_s_ = to_s;
  return true;
}

bool BodyStepper::LetGo(TensionSource& source, double time_s) {
  MoveTo(source, time_s);
  time_s_ = time_s;
  q_new_ = q_;
  v_new_ = v_;
  a_new_.setZero();
  Evaluate(source);
  if (!residual_.allFinite()) return false;
  body_.MassMatrix(q_, mass_, workspace_);
  a_ = -mass_.llt().solve(residual_);
  algorithm_ = a_;
  Commit(source);
  return a_.allFinite();
}

bool BodyStepper::Settle(TensionSource& source, double time_s) {
  MoveTo(source, time_s);
  v_.setZero();
  a_.setZero();
  algorithm_.setZero();
  const bool settled = Descend(source) || Relax(source);
  v_.setZero();
  a_.setZero();
  algorithm_.setZero();
  reference_h_ = 0;
  time_s_ = time_s;
  return settled;
}

// (K + 1/tau) step = -residual with a line search on the residual: Newton's where it converges, gradient
// descent where the tangent is not positive definite or at the corner of a friction law.
bool BodyStepper::Descend(TensionSource& source) {
  constexpr int kMost = 100;
  // Relative to the stiffest unit's moment per radian: rounding floor, and range of the pseudo-time term.
  constexpr double kFloor = 2e-10, kDull = 2e4, kSharp = 2e-8, kFirst = 2e-3, kAgain = 2e-5;
  constexpr double kLongest_rad = 0.3, kShortest = 1e-3;
  double unit_Nm = 0;
  for (int i = 0; i < body_.units(); ++i) unit_Nm = std::max(unit_Nm, body_.unit_stiffness_Nm(i));
  q_new_ = q_;
  v_new_.setZero();
  a_new_.setZero();
  Evaluate(source);
  double size = residual_.norm(), push = kFirst * unit_Nm;  // push = 1/tau
  Eigen::VectorXd start(n_), direction(n_);
  Eigen::LLT<Eigen::MatrixXd> cholesky(n_);
  for (int i = 0; i < kMost && std::isfinite(size); ++i) {
    if (size < kFloor * unit_Nm) {
      q_ = q_new_;
      Commit(source);
      return true;
    }
    body_.TangentStiffness(q_new_, tension_, Eigen::Vector3d::Zero(), matrix_);
    if (!plain_) laws_.AddStiffness(body_, q_new_, tension_, matrix_);
    for (int j = 0; j < m_; ++j) {
      const double weight = pull_[static_cast<std::size_t>(j)].stiffness_Npm;
      if (weight != 0) {
        matrix_.noalias() += weight * (plain_ ? jacobian_ : weighted_).row(j).transpose() * jacobian_.row(j);
      }
    }
    if (push > kSharp * unit_Nm) matrix_.diagonal().array() += push;
    bool usable = true;
    if (plain_) {
      cholesky.compute(matrix_);
      usable = cholesky.info() == Eigen::Success;
      if (usable) direction = cholesky.solve(residual_);
    } else {
      direction = matrix_.partialPivLu().solve(residual_);
    }
    bool closer = false;
    if (usable && direction.allFinite()) {
      start = q_new_;
      const double longest = direction.cwiseAbs().maxCoeff();
      double share = std::min(1.0, kLongest_rad / longest);
      for (; !closer && share > kShortest; share *= 0.5) {
        q_new_ = start - share * direction;
        Evaluate(source);
        closer = residual_.norm() < (1 - 1e-3 * share) * size;
      }
      if (!closer) {
        q_new_ = start;
        Evaluate(source);
      }
    }
    if (closer) {
      size = residual_.norm();
      push = std::max(0.1 * push, 0.1 * kSharp * unit_Nm);
    } else {
      push = std::max(30 * push, kAgain * unit_Nm);
      if (push > kDull * unit_Nm) return false;
    }
  }
  return false;
}

// Where descent finds no nearby equilibrium (buckling, a corner on which Newton fails): integrates the damped
// motion instead.
bool BodyStepper::Relax(TensionSource& source) {
  constexpr int kMost = 3000, kMostFailures = 40;
  constexpr double kStep_s = 1e-3, kBrake = 0.9, kStill_radps = 1e-9;
  double h = kStep_s;
  int failures = 0;
  for (int i = 0; i < kMost; ++i) {
    if (!TryStep(source, h)) {
      h *= 0.25;
      a_.setZero();
      algorithm_.setZero();
      if (++failures > kMostFailures || h < 1e-9) return false;
      continue;
    }
    h = std::min(2 * h, kStep_s);
    v_ *= kBrake;
    if (i > 100 && v_.cwiseAbs().maxCoeff() < kStill_radps) break;
  }
  return q_.allFinite();
}

}  // namespace tendril::sim
