// Newton's method on the residual, with a line search on its norm. The tangent costs most: an old one is
// kept, from the state before too, while each step leaves little.
#include "tendril/model/held_statics.h"

#include <Eigen/Dense>
#include <cmath>

namespace tendril::model {
namespace {

constexpr double kStraight = 30;  // widths beyond which the tendon is as good as tight or slack

/// log(1 + exp x) and its derivative.
double SoftPlus(double x) { return x > kStraight ? x : std::log1p(std::exp(x)); }
double Logistic(double x) { return x > kStraight ? 1 : 1 / (1 + std::exp(-x)); }

}  // namespace

HeldStatics::HeldStatics(const Body& body, ConstVectorRef stiffness_Npm, double width_m)
    : body_(&body),
      stiffness_(stiffness_Npm),
      stiffness_at_base_(stiffness_Npm),
      width_(width_m),
      shortening_(body.tendons()),
      tension_(body.tendons()),
      tendon_force_(body.dof()),
      force_(body.dof()),
      trial_force_(body.dof()),
      step_(body.dof()),
      trial_(body.dof()),
      spring_(body.tendons()),
      length_jacobian_(body.tendons(), body.dof()),
      tangent_(body.dof(), body.dof()) {}

void HeldStatics::SetLoss(ConstVectorRef loss) {
  stiffness_at_base_ = stiffness_.cwiseProduct((-loss).array().exp().matrix());
}

void HeldStatics::Residual(ConstVectorRef pull_m, ConstVectorRef q, VectorRef force_Nm) {
  body_->TendonShortening(q, shortening_);
  for (Eigen::Index j = 0; j < tension_.size(); ++j)
    tension_[j] = stiffness_at_base_[j] * width_ * SoftPlus((pull_m[j] - shortening_[j]) / width_);
  body_->StaticForce(q, TipWrench(), force_Nm);
  body_->TendonForce(q, tension_, tendon_force_);
  force_Nm -= tendon_force_;
}

void HeldStatics::Linearise(ConstVectorRef pull_m, ConstVectorRef q) {
  body_->TendonShortening(q, shortening_, length_jacobian_);
  for (Eigen::Index j = 0; j < tension_.size(); ++j)
    tension_[j] = stiffness_at_base_[j] * width_ * SoftPlus((pull_m[j] - shortening_[j]) / width_);
  body_->TangentStiffness(q, tension_, TipWrench(), tangent_);
  for (Eigen::Index j = 0; j < tension_.size(); ++j)
    spring_[j] = stiffness_at_base_[j] * Logistic((pull_m[j] - shortening_[j]) / width_);
  tangent_.noalias() += length_jacobian_.transpose() * (spring_.asDiagonal() * length_jacobian_);
}

const Eigen::PartialPivLU<Eigen::MatrixXd>& HeldStatics::Tangent(ConstVectorRef pull_m, ConstVectorRef q) {
  Linearise(pull_m, q);
  factors_.compute(tangent_);
  factored_ = true;
  return factors_;
}

bool HeldStatics::Solve(ConstVectorRef pull_m, VectorRef q) {
  constexpr int kSteps = 60, kHalvings = 12;
  constexpr double kLongest = 0.5;  // of a coordinate in one step
  constexpr double kStale = 0.1;    // of the residual, that a step with an old tangent may leave
  constexpr double kSmall = 1e-10, kFair = 1e-7;  // of the largest moment that the tendons can make
  const double scale =
      stiffness_.maxCoeff() * body_->parameters().largest_hole_m() * body_->parameters().largest_hole_m();
  Residual(pull_m, q, force_);
  bool fresh = false;  // the tangent is that at q
  for (int n = 0; n < kSteps; ++n) {
    const double norm = force_.norm();
    if (norm < kSmall * scale) return true;
    if (!factored_) {
      Tangent(pull_m, q);
      fresh = true;
    }
    step_ = -factors_.solve(force_);
    double share = std::min(1.0, kLongest / std::max(step_.cwiseAbs().maxCoeff(), 1e-300));
    bool nearer = false;
    const int halvings = fresh ? kHalvings : 1;
    const double least = fresh ? norm : kStale * norm;
    for (int half = 0; half < halvings && !nearer; ++half, share /= 2) {
      trial_ = q + share * step_;
      Residual(pull_m, trial_, trial_force_);
      nearer = trial_force_.allFinite() && trial_force_.norm() < least;
    }
    if (!nearer && fresh) return norm < kFair * scale;
    factored_ = nearer && trial_force_.norm() < kStale * norm;
    if (!nearer) continue;
    q = trial_;
    force_.swap(trial_force_);
    fresh = false;
  }
  return force_.norm() < kFair * scale;
}

}  // namespace tendril::model
