// Kane's equations as the paper prints them (eqs. 2-4, 7, 9-12, 16-25 with their signs mended): sums over all
// pairs of units in (theta, beta), tendon forces hole by hole. A check of the O(N) recursion, not used
// anywhere else.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <vector>

#include "bodies.h"
#include "tendril/model/body.h"

namespace tendril::model {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using Matrix32 = Eigen::Matrix<double, 3, 2>;

// Accelerations of (theta_1, beta_1, ..., theta_N, beta_N).
VectorXd PrintedAccelerations(const BodyParameters& parameters, const VectorXd& angles, const VectorXd& rates,
                              const VectorXd& tension) {
  const SectionParameters& s = parameters.sections[0];
  const int n = s.units;
  const double l = s.unit_length_m;
  std::vector<Matrix3d> r{Matrix3d::Identity()};
  std::vector<Vector3d> p{Vector3d::Zero()};
  std::vector<Matrix32> jv, jw;        // of each unit, in F_0
  std::vector<Vector3d> arm, dp, ddp;  // R p, R dp, R ddp (without the accelerations' share)
  std::vector<Vector3d> w_rel, dw_rel;
  for (int i = 0; i < n; ++i) {
    const double theta = angles[2 * i], beta = angles[2 * i + 1], dt = rates[2 * i], db = rates[2 * i + 1];
    const double st = std::sin(theta), ct = std::cos(theta), sb = std::sin(beta), cb = std::cos(beta);
    const double t2 = theta * theta, t3 = t2 * theta;
    const double a = (1 - ct) / theta, b = st / theta;
    const double da = (theta * st - 1 + ct) / t2, db_ = (theta * ct - st) / t2;
    const double dda = (t2 * ct - 2 * theta * st + 2 - 2 * ct) / t3,
                 ddb = (-t2 * st - 2 * theta * ct + 2 * st) / t3;
    const Matrix3d& base = r.back();
    Matrix32 v, w;
    v << l * da * cb, -l * a * sb, l * da * sb, l * a * cb, l * db_, 0;
    w << -sb, -cb * st, cb, -sb * st, 0, 1 - ct;
    jv.push_back(base * v);
    jw.push_back(base * w);
    arm.push_back(base * (l * Vector3d(a * cb, a * sb, b)));
    dp.push_back(jv.back() * Eigen::Vector2d(dt, db));
    ddp.push_back(
        base * (l * Vector3d(dda * cb * dt * dt - 2 * da * sb * dt * db - a * cb * db * db,
                             dda * sb * dt * dt + 2 * da * cb * dt * db - a * sb * db * db, ddb * dt * dt)));
    w_rel.push_back(jw.back() * Eigen::Vector2d(dt, db));
    dw_rel.push_back(base * Vector3d(-cb * dt * db - cb * ct * dt * db + sb * st * db * db,
                                     -sb * dt * db - sb * ct * dt * db - cb * st * db * db, st * dt * db));
    p.push_back(p.back() + arm.back());
    const Matrix3d turn =
        (Eigen::AngleAxisd(beta, Vector3d::UnitZ()) * Eigen::AngleAxisd(theta, Vector3d::UnitY()) *
         Eigen::AngleAxisd(-beta, Vector3d::UnitZ()))
            .toRotationMatrix();
    r.push_back(base * turn);
  }

  MatrixXd h = MatrixXd::Zero(2 * n, 2 * n);
  VectorXd c = VectorXd::Zero(2 * n), g = VectorXd::Zero(2 * n), q = VectorXd::Zero(2 * n);
  const Eigen::DiagonalMatrix<double, 3> disk(s.disk_inertia_xx_kgm2, s.disk_inertia_xx_kgm2,
                                              s.disk_inertia_zz_kgm2);
  for (int k = 1; k <= n; ++k) {  // disk k
    MatrixXd linear = MatrixXd::Zero(3, 2 * n), angular = MatrixXd::Zero(3, 2 * n);
    Vector3d a = Vector3d::Zero(), psi = Vector3d::Zero(), w = Vector3d::Zero();
    for (int i = 0; i < k; ++i) {
      for (int column = 0; column < 2; ++column) {
        const Vector3d turn = jw[i].col(column);
        linear.col(2 * i + column) = jv[i].col(column) + turn.cross(p[k] - p[i + 1]);
        angular.col(2 * i + column) = turn;
      }
      a += psi.cross(arm[i]) + 2 * w.cross(dp[i]) + w.cross(w.cross(arm[i])) + ddp[i];
      psi += w.cross(w_rel[i]) + dw_rel[i];
      w += w_rel[i];
    }
    const Matrix3d inertia = r[k] * disk * r[k].transpose();
    h += s.unit_mass_kg * linear.transpose() * linear + angular.transpose() * inertia * angular;
    c += s.unit_mass_kg * linear.transpose() * a +
         angular.transpose() * (inertia * psi + w.cross(inertia * w));
    g -= linear.transpose() * (s.unit_mass_kg * parameters.gravity_W_mps2);
    for (std::size_t j = 0; j < s.tendons.size(); ++j) {
      const Vector3d hole(s.tendons[j].radius_m * std::cos(s.tendons[j].angle_rad),
                          s.tendons[j].radius_m * std::sin(s.tendons[j].angle_rad), 0);
      const Vector3d here = p[k] + r[k] * hole;
      Vector3d force =
          tension[static_cast<Eigen::Index>(j)] * (p[k - 1] + r[k - 1] * hole - here).normalized();
      if (k < n)
        force += tension[static_cast<Eigen::Index>(j)] * (p[k + 1] + r[k + 1] * hole - here).normalized();
      q += linear.transpose() * force + angular.transpose() * (r[k] * hole).cross(force);
    }
  }
  for (int i = 0; i < n; ++i) g[2 * i] += s.UnitStiffness() * angles[2 * i];
  return h.partialPivLu().solve(q - c - g);
}

TEST(PrintedSums, GiveTheSameAccelerationsAsTheRecursion) {
  BodyParameters parameters = test::PaperBody(5);
  parameters.gravity_W_mps2 = {3, -2, -9};
  parameters.sections[0].disk_inertia_zz_kgm2 *= 0.7;
  const Body body(parameters);
  Body::Workspace workspace(body);
  const int n = body.dof();
  test::Random random(11);
  for (int trial = 0; trial < 50; ++trial) {
    VectorXd angles(n), rates(n), q(n), dq(n), force(n), ddq(n), polar(n);
    const VectorXd tension = random.Vector(3, 0, 8);
    for (int i = 0; i < n; i += 2) {
      const double theta = random.Uniform(0.2, 2.5), beta = random.Uniform(-3, 3);
      const double dt = random.Uniform(-20, 20), db = random.Uniform(-20, 20);
      angles.segment<2>(i) << theta, beta;
      rates.segment<2>(i) << dt, db;
      q.segment<2>(i) << theta * std::cos(beta), theta * std::sin(beta);
      dq.segment<2>(i) << dt * std::cos(beta) - theta * db * std::sin(beta),
          dt * std::sin(beta) + theta * db * std::cos(beta);
    }
    body.TendonForce(q, tension, force);
    body.ForwardDynamics(q, dq, force, ddq, workspace);
    for (int i = 0; i < n; i += 2) {
      const double theta = angles[i], cb = std::cos(angles[i + 1]), sb = std::sin(angles[i + 1]);
      const double dt = rates[i], db = rates[i + 1];
      polar[i] = cb * ddq[i] + sb * ddq[i + 1] + theta * db * db;
      polar[i + 1] = (cb * ddq[i + 1] - sb * ddq[i] - 2 * dt * db) / theta;
    }
    const VectorXd printed = PrintedAccelerations(parameters, angles, rates, tension);
    EXPECT_LT((printed - polar).norm(), 1e-10 * polar.norm()) << trial;
  }
}

}  // namespace
}  // namespace tendril::model
