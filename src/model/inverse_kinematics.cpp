// Tip position to bending of constant-curvature sections: closed form and nearest point for one section,
// damped Newton with bending limits for several. Knows section lengths and the bending limit, no forces.
#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <string>

#include "tendril/model/inverse.h"
#include "tendril/model/stumpff.h"

namespace tendril::model {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using BendingMatrix =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 2 * kMaxSections, 2 * kMaxSections>;
using TipJacobian = Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, 2 * kMaxSections>;

Matrix3d Hat(const Vector3d& a) {
  Matrix3d m;
  m << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0;
  return m;
}

double SectionLength(const Body& body, int section) {
  const SectionParameters& s = body.parameters().sections[section];
  return s.units * s.unit_length_m;
}

/// One section's arc of bend (u, v): its end point and rotation, with their derivatives by u and v.
struct Arc {
  Vector3d p;
  Matrix3d R;
  Eigen::Matrix<double, 3, 2> dp;        // dp/du, dp/dv
  Eigen::Matrix<double, 3, 2> rotation;  // columns w with dR = hat(w) R
};

Arc ArcAt(double length_m, double u, double v) {
  const double x = u * u + v * v;
  const auto c = Stumpff(x);
  const double dc1 = 0.5 * (c[3] - c[2]), dc2 = 0.5 * (2 * c[4] - c[3]);  // by theta^2
  Arc arc;
  arc.p = length_m * Vector3d(u * c[2], v * c[2], c[1]);
  arc.dp.col(0) = length_m * Vector3d(c[2] + 2 * u * u * dc2, 2 * u * v * dc2, 2 * u * dc1);
  arc.dp.col(1) = length_m * Vector3d(2 * u * v * dc2, c[2] + 2 * v * v * dc2, 2 * v * dc1);
  const Matrix3d w = Hat(Vector3d(-v, u, 0)), ww = w * w;
  arc.R = Matrix3d::Identity() + c[1] * w + c[2] * ww;
  const Matrix3d left = Matrix3d::Identity() + c[2] * w + c[3] * ww;
  arc.rotation.col(0) = left.col(1);
  arc.rotation.col(1) = -left.col(0);
  return arc;
}

// ---- one section: the nearest point of a plane curve turned about z ----

/// The curve r(theta), z(theta) of a section's tip in its bending plane.
struct Profile {
  double length_m;

  struct Point {
    double r, z, dr, dz, ddr, ddz;
  };
  Point At(double theta) const {
    const double x = theta * theta;
    const auto c = Stumpff(x);
    return {length_m * theta * c[2],
            length_m * c[1],
            length_m * (c[1] - c[2]),
            length_m * theta * (c[3] - c[2]),
            length_m * theta * (2 * c[3] - c[2] - 2 * c[4]),
            length_m * (c[3] - c[2] + x * (3 * c[5] - 3 * c[4] + c[3]))};
  }
};

struct NearestBend {
  double theta, distance_m;
  int iterations;
};

/// The bend in [0, most] whose tip is nearest to (r, z), r >= 0. The curve is smooth and turns slowly, so
/// every local minimum of the distance shows up among a few samples; each is refined by safeguarded Newton on
/// the derivative.
NearestBend Nearest(const Profile& profile, double r, double z, double most) {
  const auto distance = [&](double theta) {
    const auto p = profile.At(theta);
    return std::hypot(p.r - r, p.z - z);
  };
  // On the surface the closed form (eq. 5) applies.
  const double closed = 2 * std::atan2(r, z);
  if (closed <= most) {
    const double off = distance(closed);
    if (off <= 1e-14 * profile.length_m) return {closed, off, 0};
  }
  constexpr int kSamples = 24;
  std::array<double, kSamples + 1> sampled;
  for (int i = 0; i <= kSamples; ++i) sampled[i] = distance(most * i / kSamples);
  NearestBend best{0, sampled[0], 0};
  int iterations = 0;
  for (int i = 0; i <= kSamples; ++i) {
    if ((i > 0 && sampled[i - 1] < sampled[i]) || (i < kSamples && sampled[i + 1] < sampled[i])) continue;
    double low = most * std::max(i - 1, 0) / kSamples, high = most * std::min(i + 1, kSamples) / kSamples;
    double theta = closed > low && closed < high ? closed : most * i / kSamples;
    for (int step = 0; step < 60; ++step, ++iterations) {
      const auto p = profile.At(theta);
      const double slope = (p.r - r) * p.dr + (p.z - z) * p.dz;
      const double curvature = p.dr * p.dr + p.dz * p.dz + (p.r - r) * p.ddr + (p.z - z) * p.ddz;
      if ((theta == 0 && slope >= 0) || (theta == most && slope <= 0))
        break;  // limited by an end of the range
      (slope > 0 ? high : low) = theta;
      double next = curvature > 0 ? theta - slope / curvature : -1;
      if (next > most && high == most) next = most;
      if (!(next >= low && next <= high)) next = 0.5 * (low + high);
      const double moved = std::abs(next - theta);
      theta = next;
      if (moved <= 1e-16 * (1 + theta)) break;
    }
    const double off = distance(theta);
    if (off < best.distance_m) best = {theta, off, 0};
  }
  best.iterations = iterations;
  return best;
}

// ---- several sections ----

class Chain {
 public:
  Chain(const Body& body, double max_bending_rad, const Vector3d& target)
      : sections_(body.sections()), max_bending_rad_(max_bending_rad), target_(target) {
    for (int k = 0; k < sections_; ++k) length_m_[k] = SectionLength(body, k);
    scale_m_ = body.parameters().length_m();
  }

  Vector3d Tip(const BendingVector& q, TipJacobian* jacobian = nullptr) const {
    std::array<Arc, kMaxSections> arcs;
    for (int k = 0; k < sections_; ++k) arcs[k] = ArcAt(length_m_[k], q[2 * k], q[2 * k + 1]);
    // From the tip down: `rest` is the tip in the frame at the end of section k.
    Vector3d rest = Vector3d::Zero();
    std::array<Eigen::Matrix<double, 3, 2>, kMaxSections> local;
    for (int k = sections_ - 1; k >= 0; --k) {
      const Vector3d arm = arcs[k].R * rest;
      for (int i = 0; i < 2; ++i) local[k].col(i) = arcs[k].dp.col(i) + arcs[k].rotation.col(i).cross(arm);
      rest = arcs[k].p + arm;
    }
    if (jacobian) {
      Matrix3d R_W = Matrix3d::Identity();
      for (int k = 0; k < sections_; ++k) {
        jacobian->middleCols<2>(2 * k) = R_W * local[k];
        R_W = R_W * arcs[k].R;
      }
    }
    return rest;
  }

  void Limit(BendingVector& q) const {
    for (int k = 0; k < sections_; ++k) {
      const double bend = q.segment<2>(2 * k).norm();
      if (bend > max_bending_rad_) q.segment<2>(2 * k) *= max_bending_rad_ / bend;
    }
  }

  struct End {
    BendingVector q;
    double distance_m;
    bool stationary;
    int iterations;
  };

  /// Minimises the distance from a start with Levenberg's damping on the exact Hessian; a section at its
  /// limit with an outward descent direction moves along the limit only.
  End Descend(BendingVector q, int max_iterations) const {
    Limit(q);
    const int n = static_cast<int>(q.size());
    TipJacobian jacobian(3, n);
    Vector3d error = (Tip(q, &jacobian) - target_) / scale_m_;
    double damping = 1e-6;
    // Gauss-Newton moves least and suffices while it converges; the exact Hessian is for unreachable targets.
    bool curved = false;
    for (int iteration = 1; iteration <= max_iterations; ++iteration) {
      if (error.norm() <= kExact) return {q, error.norm() * scale_m_, true, iteration};
      const BendingMatrix scaled_transpose = jacobian.transpose() / scale_m_;
      const BendingVector gradient = scaled_transpose * error;
      BendingMatrix hessian = scaled_transpose * scaled_transpose.transpose();
      if (curved) AddCurvature(q, error, hessian);
      // Basis of the admissible directions.
      BendingMatrix basis = BendingMatrix::Zero(n, n);
      int count = 0;
      for (int k = 0; k < sections_; ++k) {
        const Eigen::Vector2d bend = q.segment<2>(2 * k);
        const double outward = -gradient.segment<2>(2 * k).dot(bend) / (max_bending_rad_ * max_bending_rad_);
        if (bend.norm() >= max_bending_rad_ * (1 - 1e-12) && outward > 0) {
          basis.col(count++).segment<2>(2 * k) = Eigen::Vector2d(-bend.y(), bend.x()) / bend.norm();
          hessian.block<2, 2>(2 * k, 2 * k) += outward * Eigen::Matrix2d::Identity();
        } else {
          basis.col(count++)[2 * k] = 1;
          basis.col(count++)[2 * k + 1] = 1;
        }
      }
      basis.conservativeResize(Eigen::NoChange, count);
      const BendingVector slope = basis.transpose() * gradient;
      if (slope.norm() <= 1e-14) return {q, error.norm() * scale_m_, true, iteration};
      const BendingMatrix reduced = basis.transpose() * hessian * basis;
      bool better = false;
      for (int attempt = 0; attempt < 12 && !better; ++attempt) {
        const Eigen::LLT<BendingMatrix> factor(reduced + damping * BendingMatrix::Identity(count, count));
        if (factor.info() == Eigen::Success) {
          BendingVector next = q + basis * -factor.solve(slope);
          Limit(next);
          TipJacobian next_jacobian(3, n);
          const Vector3d next_error = (Tip(next, &next_jacobian) - target_) / scale_m_;
          better = next_error.squaredNorm() < error.squaredNorm();
          if (better) {
            curved = next_error.norm() > 0.5 * error.norm();
            q = next;
            error = next_error;
            jacobian = next_jacobian;
          }
        }
        damping = better ? std::max(0.05 * damping, 1e-15) : std::max(8 * damping, 1e-12);
      }
      if (!better && curved) return {q, error.norm() * scale_m_, slope.norm() <= 1e-9, iteration};
      curved = curved || !better;
    }
    return {q, error.norm() * scale_m_, false, max_iterations};
  }

 private:
  static constexpr double kExact = 1e-15;  // of the robot's length

  /// Adds the second derivative of the tip times the error, by central differences of the Jacobian: without
  /// it the descent towards an unreachable target is slow.
  void AddCurvature(const BendingVector& q, const Vector3d& error, BendingMatrix& hessian) const {
    constexpr double kStep = 1e-5;
    const int n = static_cast<int>(q.size());
    BendingMatrix second(n, n);
    TipJacobian plus(3, n), minus(3, n);
    for (int i = 0; i < n; ++i) {
      BendingVector at = q;
      at[i] = q[i] + kStep;
      Tip(at, &plus);
      at[i] = q[i] - kStep;
      Tip(at, &minus);
      second.col(i) = (plus - minus).transpose() * error / (2 * kStep * scale_m_);
    }
    hessian += 0.5 * (second + second.transpose());
  }

  int sections_;
  double max_bending_rad_;
  Vector3d target_;
  std::array<double, kMaxSections> length_m_{};
  double scale_m_;
};

double UnreachableDistance(const Body& body) { return 1e-9 + 1e-9 * body.parameters().length_m(); }

}  // namespace

InverseKinematics::InverseKinematics(const Body& body, double max_bending_rad)
    : body_(body), max_bending_rad_(max_bending_rad) {
  if (!(max_bending_rad > 0 && max_bending_rad <= 2 * std::numbers::pi)) {
    throw std::invalid_argument("inverse kinematics: bending limit = " + std::to_string(max_bending_rad) +
                                " rad: accepted above 0, up to 2 pi");
  }
}

Eigen::Vector3d InverseKinematics::Tip(const BendingVector& us_vs) const noexcept {
  return Chain(body_, max_bending_rad_, Vector3d::Zero()).Tip(us_vs);
}

IkSolution InverseKinematics::Solve(const Eigen::Vector3d& target_W_m,
                                    const BendingVector& seed) const noexcept {
  IkSolution solution;
  const Chain chain(body_, max_bending_rad_, target_W_m);
  solution.us_vs = BendingVector::Zero(2 * body_.sections());
  if (seed.size() == solution.us_vs.size() && seed.allFinite()) solution.us_vs = seed;
  chain.Limit(solution.us_vs);
  if (!target_W_m.allFinite()) {
    solution.tip_W_m = chain.Tip(solution.us_vs);
    solution.distance_m = std::numeric_limits<double>::quiet_NaN();
    solution.status = Status::kSolverFallback;
    return solution;
  }
  const double r = std::hypot(target_W_m.x(), target_W_m.y());
  const Eigen::Vector2d seed_bend = solution.us_vs.head<2>();
  // On the axis every bending plane is equal: keep the seed's.
  const Eigen::Vector2d direction = r > 0                  ? Eigen::Vector2d(target_W_m.head<2>() / r)
                                    : seed_bend.norm() > 0 ? Eigen::Vector2d(seed_bend.normalized())
                                                           : Eigen::Vector2d::UnitX();
  bool finished = true;
  if (body_.sections() == 1) {
    const NearestBend nearest = Nearest({SectionLength(body_, 0)}, r, target_W_m.z(), max_bending_rad_);
    solution.us_vs = nearest.theta * direction;
    solution.iterations = nearest.iterations;
  } else {
    Chain::End best = chain.Descend(solution.us_vs, 60);
    solution.iterations = best.iterations;
    if (best.distance_m > UnreachableDistance(body_)) {
      // Possibly in a local minimum or on the symmetric saddle of the straight shape: try other shapes in the
      // target's plane, bent to one side and S-shaped.
      constexpr std::array<std::array<double, 2>, 5> kShapes{
          {{0.3, 0.3}, {0.8, 0.8}, {0.6, -0.6}, {-0.6, 0.6}, {0.9, -0.3}}};
      for (const auto& shape : kShapes) {
        BendingVector start(solution.us_vs.size());
        for (int k = 0; k < body_.sections(); ++k) {
          start.segment<2>(2 * k) = shape[k % 2] * max_bending_rad_ * direction;
        }
        const Chain::End other = chain.Descend(start, 40);
        solution.iterations += other.iterations;
        // Another shape must be clearly nearer, to avoid jumps between equally good ones.
        if (other.distance_m < best.distance_m - UnreachableDistance(body_)) best = other;
        if (best.distance_m <= UnreachableDistance(body_)) break;
      }
    }
    solution.us_vs = best.q;
    finished = best.stationary;
  }
  solution.tip_W_m = chain.Tip(solution.us_vs);
  solution.distance_m = (solution.tip_W_m - target_W_m).norm();
  if (solution.distance_m > UnreachableDistance(body_)) {
    solution.status = finished ? Status::kTargetUnreachable : Status::kSolverFallback;
  }
  return solution;
}

}  // namespace tendril::model
