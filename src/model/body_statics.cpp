// The body at rest: forces that hold a shape, and how they change with it.
#include <array>

#include "strained_chain.h"
#include "tendril/core/limits.h"
#include "tendril/model/body.h"
#include "unit_joint.h"

namespace tendril::model {
namespace {

// Second derivatives of the joint's place and first ones of its angular velocity, in the axes of A and per
// unit of its length.
struct JointCurvature {
  Vec p_uu, p_uv, p_vv;
  Vec w_uu, w_uv, w_vu, w_vv;  // d jw_u / du, d jw_u / dv, d jw_v / du, d jw_v / dv

  JointCurvature(double u, double v, const Stumpffs& c) {
    const double d1 = c[3] - c[2], d2 = 2 * c[4] - c[3], d3 = 3 * c[5] - c[4];
    const double e1 = d3 - d2, e2 = 8 * c[6] - 5 * c[5] + c[4];
    const double uu = u * u, uv = u * v, vv = v * v;
    p_uu = {u * (3 * d2 + uu * e2), v * (d2 + uu * e2), d1 + uu * e1};
    p_uv = {v * (d2 + uu * e2), u * (d2 + vv * e2), uv * e1};
    p_vv = {u * (d2 + vv * e2), v * (3 * d2 + vv * e2), d1 + vv * e1};
    w_uu = {-v * (c[3] + uu * d3), -u * vv * d3, -uv * d2};
    w_uv = {-u * (c[3] + vv * d3), -v * (2 * c[3] + vv * d3), -(c[2] + vv * d2)};
    w_vu = {u * (2 * c[3] + uu * d3), v * (c[3] + uu * d3), c[2] + uu * d2};
    w_vv = {uu * v * d3, u * (c[3] + vv * d3), uv * d2};
  }
};

}  // namespace

void Body::StaticForce(ConstVectorRef q, const TipWrench& tip, VectorRef force_Nm) const noexcept {
  if (strained_) return strained_->StaticForce(q, tip, force_Nm);
  std::array<Joint, kMaxUnits> joints;
  PlaceJoints(
      units_, [this](int i) { return unit_[i].length_m; }, q, joints);
  const Vec gravity(parameters_.gravity_W_mps2);
  Vec f = Vec(tip.force_W_N) + Vec(parameters_.tip_force_W_N), n(tip.moment_W_Nm);
  for (int i = units_ - 1; i >= 0; --i) {
    const UnitConstants& k = unit_[i];
    const Joint& j = joints[i];
    f += k.mass_kg * gravity;
    force_Nm[2 * i] = k.stiffness_Nm * (q[2 * i] - k.rest_u) - j.jv_u.dot(f) - j.jw_u.dot(n);
    force_Nm[2 * i + 1] = k.stiffness_Nm * (q[2 * i + 1] - k.rest_v) - j.jv_v.dot(f) - j.jw_v.dot(n);
    n += Cross(j.p, f);
  }
}

void Body::DiskForce(ConstVectorRef q, const Eigen::Ref<const Eigen::Matrix3Xd>& force_W_N,
                     VectorRef force_Nm) const noexcept {
  if (strained_) return strained_->DiskForce(q, force_W_N, force_Nm);
  std::array<Joint, kMaxUnits> joints;
  PlaceJoints(
      units_, [this](int i) { return unit_[i].length_m; }, q, joints);
  Vec f = kZero, n = kZero;
  for (int i = units_ - 1; i >= 0; --i) {
    const Joint& j = joints[i];
    f += Vec(force_W_N.col(i));
    force_Nm[2 * i] = j.jv_u.dot(f) + j.jw_u.dot(n);
    force_Nm[2 * i + 1] = j.jv_v.dot(f) + j.jw_v.dot(n);
    n += Cross(j.p, f);
  }
}

void Body::TangentStiffness(ConstVectorRef q, ConstVectorRef tension_N, const TipWrench& tip,
                            MatrixRef stiffness) const noexcept {
  if (strained_) return strained_->TangentStiffness(q, tension_N, tip, stiffness);
  std::array<Joint, kMaxUnits> joints;
  std::array<Mat, kMaxUnits> r_wa;
  std::array<Stumpffs, kMaxUnits> stumpff;
  Mat r = kIdentity;
  for (int i = 0; i < units_; ++i) {
    const double u = q[2 * i], v = q[2 * i + 1];
    stumpff[i] = Stumpff(u * u + v * v);
    r_wa[i] = r;
    PlaceJoint(r, unit_[i].length_m, u, v, stumpff[i], joints[i]);
    r = Turn(r, u, v, stumpff[i]);
  }

  // Forces F_k at disks k >= i, seen from the origin of B with arms d_k: sum F, sum d x F, and sum d F^T -
  // (d.F) 1, which turns a small rotation w into sum (w x d) x F.
  const Vec gravity(parameters_.gravity_W_mps2);
  Vec f = Vec(tip.force_W_N) + Vec(parameters_.tip_force_W_N), n = kZero;
  Mat turning{kZero, kZero, kZero};
  double sum = 0, moment_u = 0, moment_v = 0;
  int counted = tendons();
  for (int i = units_ - 1; i >= 0; --i) {
    const UnitConstants& k = unit_[i];
    const Joint& j = joints[i];
    const Stumpffs& c = stumpff[i];
    const double l = k.length_m, u = q[2 * i], v = q[2 * i + 1];
    f += k.mass_kg * gravity;

    // Change of the moment about the origin of A when this unit bends, as it acts on the units below.
    const Vec y_u = Cross(j.jv_u, f) + turning * j.jw_u, y_v = Cross(j.jv_v, f) + turning * j.jw_v;
    for (int below = i - 1; below >= 0; --below) {
      const Joint& g = joints[below];
      stiffness(2 * below, 2 * i) = stiffness(2 * i, 2 * below) = -g.jw_u.dot(y_u);
      stiffness(2 * below, 2 * i + 1) = stiffness(2 * i + 1, 2 * below) = -g.jw_u.dot(y_v);
      stiffness(2 * below + 1, 2 * i) = stiffness(2 * i, 2 * below + 1) = -g.jw_v.dot(y_u);
      stiffness(2 * below + 1, 2 * i + 1) = stiffness(2 * i + 1, 2 * below + 1) = -g.jw_v.dot(y_v);
    }

    // Within the unit, with F and the moment in the axes of A.
    const Vec fa = r_wa[i].TransposeTimes(f), na = r_wa[i].TransposeTimes(n);
    const JointCurvature bent(u, v, c);

    while (twisted_.empty() && counted > k.first_tendon) {
      const Tendon& t = tendons_[--counted];
      sum += tension_N[counted];
      moment_u += tension_N[counted] * t.radius_m * t.cos_angle;
      moment_v += tension_N[counted] * t.radius_m * t.sin_angle;
    }
    const double uu = u * u, uv = u * v, vv = v * v;
    const Chord chord = ChordOf(uu + vv);
    const double lever = sum * l - (u * moment_u + v * moment_v);
    const Vec turn_v = turning * j.jw_v;
    stiffness(2 * i, 2 * i) = k.stiffness_Nm + lever * (chord.slope + uu * chord.bend) -
                              2 * u * moment_u * chord.slope - l * fa.dot(bent.p_uu) - na.dot(bent.w_uu) -
                              j.jw_u.dot(turning * j.jw_u);
    stiffness(2 * i, 2 * i + 1) = stiffness(2 * i + 1, 2 * i) =
        lever * uv * chord.bend - (u * moment_v + v * moment_u) * chord.slope - l * fa.dot(bent.p_uv) -
        na.dot(bent.w_uv) - j.jw_u.dot(turn_v);
    stiffness(2 * i + 1, 2 * i + 1) = k.stiffness_Nm + lever * (chord.slope + vv * chord.bend) -
                                      2 * v * moment_v * chord.slope - l * fa.dot(bent.p_vv) -
                                      na.dot(bent.w_vv) - j.jw_v.dot(turn_v);
    if (!twisted_.empty()) {
      for (int t = k.first_tendon; t < tendons(); ++t) {
        const SpanSlopes s = TwistedSlopes(i, t, u, v);
        stiffness(2 * i, 2 * i) += tension_N[t] * s.uu;
        stiffness(2 * i, 2 * i + 1) += tension_N[t] * s.uv;
        stiffness(2 * i + 1, 2 * i) += tension_N[t] * s.uv;
        stiffness(2 * i + 1, 2 * i + 1) += tension_N[t] * s.vv;
      }
    }

    n += Cross(j.p, f);
    turning.x += f.x * j.p;
    turning.y += f.y * j.p;
    turning.z += f.z * j.p;
    const double trace = j.p.dot(f);
    turning.x.x -= trace;
    turning.y.y -= trace;
    turning.z.z -= trace;
  }
  if (!tip.moment_W_Nm.isZero(0)) AddMomentStiffness(q, tip.moment_W_Nm, stiffness);
}

// A constant moment M has the generalised force jw . M, and jw turns with the units before its own alone.
void Body::AddMomentStiffness(ConstVectorRef q, const Eigen::Vector3d& moment_W_Nm,
                              MatrixRef stiffness) const noexcept {
  std::array<Joint, kMaxUnits> joints;
  Mat r = kIdentity;
  const Vec moment(moment_W_Nm);
  for (int i = 0; i < units_; ++i) {
    const double u = q[2 * i], v = q[2 * i + 1];
    const Stumpffs c = Stumpff(u * u + v * v);
    const Joint& j = joints[i];
    PlaceJoint(r, unit_[i].length_m, u, v, c, joints[i]);
    const Vec local = r.TransposeTimes(moment);
    const JointCurvature bent(u, v, c);
    stiffness(2 * i, 2 * i) -= local.dot(bent.w_uu);
    stiffness(2 * i, 2 * i + 1) -= local.dot(bent.w_uv);
    stiffness(2 * i + 1, 2 * i) -= local.dot(bent.w_vu);
    stiffness(2 * i + 1, 2 * i + 1) -= local.dot(bent.w_vv);
    const Vec y_u = Cross(j.jw_u, moment), y_v = Cross(j.jw_v, moment);
    for (int below = 0; below < i; ++below) {
      const Joint& g = joints[below];
      stiffness(2 * i, 2 * below) -= g.jw_u.dot(y_u);
      stiffness(2 * i, 2 * below + 1) -= g.jw_v.dot(y_u);
      stiffness(2 * i + 1, 2 * below) -= g.jw_u.dot(y_v);
      stiffness(2 * i + 1, 2 * below + 1) -= g.jw_v.dot(y_v);
    }
    r = Turn(r, u, v, c);
  }
}

}  // namespace tendril::model
