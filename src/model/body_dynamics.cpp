// The body's recursions in motion: forward and inverse dynamics, mass matrix, energy. Knows nothing of
// motors.
#include "articulated_inertia.h"
#include "strained_chain.h"
#include "tendril/model/body.h"
#include "unit_joint.h"

namespace tendril::model {
namespace {

// Accelerations of B relative to A that remain when ddu = ddv = 0, in the axes of A (eqs. 11, 12); d_k as
// above, e_k = 2 dd_k/dx.
inline void RelativeBias(double l, double u, double v, double du, double dv, const Stumpffs& c, Vec& linear,
                         Vec& angular) {
  const double d1 = c[3] - c[2], d2 = 2 * c[4] - c[3], d3 = 3 * c[5] - c[4];
  const double e1 = d3 - d2, e2 = 8 * c[6] - 5 * c[5] + c[4];
  const double s = u * du + v * dv, e = du * du + dv * dv, h = u * dv - v * du;
  const double dc2 = d2 * s, ddc2 = e2 * s * s + d2 * e, ddc1 = e1 * s * s + d1 * e;
  linear = {l * (ddc2 * u + 2 * dc2 * du), l * (ddc2 * v + 2 * dc2 * dv), l * ddc1};
  angular = {h * (d3 * s * u + c[3] * du), h * (d3 * s * v + c[3] * dv), h * dc2};
}

}  // namespace

struct Body::Workspace::Unit {
  Stumpffs series;  // at theta^2
  Joint joint;
  Vec bias_v, bias_w;  // acceleration of B with the joint's and A's accelerations zero
  Vec f, n;            // force and moment at the origin of B: articulated bias, or what the joint carries
  Vec uf_u, un_u, uf_v, un_v;  // articulated inertia times the motion subspace
  double d_uu, d_uv, d_vv;     // inverse of the 2 x 2 joint inertia
  double t_u, t_v;             // joint force left for the acceleration
  Vec z;                       // axis of the disk

  void Meet(const ArticulatedInertia& all, const Vec& force, const Vec& moment);
  void PassOn(ArticulatedInertia& all, Vec& force, Vec& moment) const;
};

// The joint's inertia and the force that it has left, from what the disk carries.
inline void Body::Workspace::Unit::Meet(const ArticulatedInertia& all, const Vec& force, const Vec& moment) {
  const Joint& j = joint;
  uf_u = all.mass * j.jv_u + all.cross * j.jw_u;
  uf_v = all.mass * j.jv_v + all.cross * j.jw_v;
  un_u = all.cross.TransposeTimes(j.jv_u) + all.inertia * j.jw_u;
  un_v = all.cross.TransposeTimes(j.jv_v) + all.inertia * j.jw_v;
  const double h_uu = j.jv_u.dot(uf_u) + j.jw_u.dot(un_u);
  const double h_uv = j.jv_u.dot(uf_v) + j.jw_u.dot(un_v);
  const double h_vv = j.jv_v.dot(uf_v) + j.jw_v.dot(un_v);
  const double inverse = 1 / (h_uu * h_vv - h_uv * h_uv);
  d_uu = h_vv * inverse;
  d_uv = -h_uv * inverse;
  d_vv = h_uu * inverse;
  t_u -= j.jv_u.dot(force) + j.jw_u.dot(moment);
  t_v -= j.jv_v.dot(force) + j.jw_v.dot(moment);
}

// Seen from A, the unit yields along its joint; the rest of its inertia and force is passed on.
inline void Body::Workspace::Unit::PassOn(ArticulatedInertia& all, Vec& force, Vec& moment) const {
  const Vec wf_u = d_uu * uf_u + d_uv * uf_v, wf_v = d_uv * uf_u + d_vv * uf_v;
  const Vec wn_u = d_uu * un_u + d_uv * un_v, wn_v = d_uv * un_u + d_vv * un_v;
  all.mass.SubtractOuter(wf_u, uf_u, wf_v, uf_v);
  all.inertia.SubtractOuter(wn_u, un_u, wn_v, un_v);
  all.cross.x += -un_u.x * wf_u + -un_v.x * wf_v;
  all.cross.y += -un_u.y * wf_u + -un_v.y * wf_v;
  all.cross.z += -un_u.z * wf_u + -un_v.z * wf_v;
  force += all.mass * bias_v + all.cross * bias_w + t_u * wf_u + t_v * wf_v;
  moment += all.cross.TransposeTimes(bias_v) + all.inertia * bias_w + t_u * wn_u + t_v * wn_v;

  moment += Cross(joint.p, force);
  all.Shift(joint.p);
}

struct Body::Workspace::Strained : StrainedState {};

Body::Workspace::Workspace(const Body& body)
    : units_(body.strained_ ? 0 : body.units()), strained_(body.strained_ ? body.units() : 0) {}
Body::Workspace::Workspace(const Workspace& other) = default;
Body::Workspace::Workspace(Workspace&& other) noexcept = default;
Body::Workspace& Body::Workspace::operator=(const Workspace& other) = default;
Body::Workspace& Body::Workspace::operator=(Workspace&& other) noexcept = default;
Body::Workspace::~Workspace() = default;

void Body::InverseDynamics(ConstVectorRef q, ConstVectorRef dq, ConstVectorRef ddq, VectorRef force_Nm,
                           Workspace& workspace) const noexcept {
  if (strained_) return strained_->InverseDynamics(q, dq, ddq, force_Nm, workspace.strained_.data());
  Workspace::Unit* const unit = workspace.units_.data();
  Mat r = kIdentity;
  Vec w = kZero, dw = kZero, a = -Vec(parameters_.gravity_W_mps2);
  // The series of all units first: they are independent.
  for (int i = 0; i < units_; ++i)
    unit[i].series = Stumpff(q[2 * i] * q[2 * i] + q[2 * i + 1] * q[2 * i + 1]);
  for (int i = 0; i < units_; ++i) {
    const UnitConstants& k = unit_[i];
    Joint& j = unit[i].joint;
    const double u = q[2 * i], v = q[2 * i + 1], du = dq[2 * i], dv = dq[2 * i + 1];
    const double ddu = ddq[2 * i], ddv = ddq[2 * i + 1];
    const Stumpffs& c = unit[i].series;
    PlaceJoint(r, k.length_m, u, v, c, j);
    Vec linear, angular;
    RelativeBias(k.length_m, u, v, du, dv, c, linear, angular);
    const Vec dp = du * j.jv_u + dv * j.jv_v, w_rel = du * j.jw_u + dv * j.jw_v;
    a += Cross(dw, j.p) + Cross(w, Cross(w, j.p) + 2 * dp) + r * linear + ddu * j.jv_u + ddv * j.jv_v;
    dw += Cross(w, w_rel) + r * angular + ddu * j.jw_u + ddv * j.jw_v;
    w += w_rel;
    r = Turn(r, u, v, c);
    const Vec z = r.z;
    const double extra = k.inertia_zz - k.inertia_xx, spin = z.dot(w);
    unit[i].f = k.mass_kg * a;
    unit[i].n = k.inertia_xx * dw + (extra * z.dot(dw)) * z + (extra * spin) * Cross(w, z);
  }
  Vec f = kZero + -Vec(parameters_.tip_force_W_N), n = kZero;
  for (int i = units_ - 1; i >= 0; --i) {
    const UnitConstants& k = unit_[i];
    const Joint& j = unit[i].joint;
    f += unit[i].f;
    n += unit[i].n;
    force_Nm[2 * i] =
        j.jv_u.dot(f) + j.jw_u.dot(n) + k.stiffness_Nm * (q[2 * i] - k.rest_u) + k.damping_Nms * dq[2 * i];
    force_Nm[2 * i + 1] = j.jv_v.dot(f) + j.jw_v.dot(n) + k.stiffness_Nm * (q[2 * i + 1] - k.rest_v) +
                          k.damping_Nms * dq[2 * i + 1];
    n += Cross(j.p, f);
  }
}

void Body::ForwardDynamics(ConstVectorRef q, ConstVectorRef dq, ConstVectorRef force_Nm, VectorRef ddq,
                           Workspace& workspace) const noexcept {
  if (strained_) return strained_->ForwardDynamics(q, dq, force_Nm, ddq, workspace.strained_.data());
  Workspace::Unit* const unit = workspace.units_.data();
  Mat r = kIdentity;
  Vec w = kZero;
  for (int i = 0; i < units_; ++i) {
    const UnitConstants& k = unit_[i];
    Workspace::Unit& b = unit[i];
    Joint& j = b.joint;
    const double u = q[2 * i], v = q[2 * i + 1], du = dq[2 * i], dv = dq[2 * i + 1];
    const Stumpffs c = Stumpff(u * u + v * v);
    PlaceJoint(r, k.length_m, u, v, c, j);
    Vec linear, angular;
    RelativeBias(k.length_m, u, v, du, dv, c, linear, angular);
    const Vec dp = du * j.jv_u + dv * j.jv_v, w_rel = du * j.jw_u + dv * j.jw_v;
    b.bias_v = Cross(w, Cross(w, j.p) + 2 * dp) + r * linear;
    b.bias_w = Cross(w, w_rel) + r * angular;
    w += w_rel;
    r = Turn(r, u, v, c);
    b.z = r.z;
    const double extra = k.inertia_zz - k.inertia_xx;
    b.n = (extra * b.z.dot(w)) * Cross(w, b.z);
    b.t_u = force_Nm[2 * i] - k.stiffness_Nm * (u - k.rest_u) - k.damping_Nms * du;
    b.t_v = force_Nm[2 * i + 1] - k.stiffness_Nm * (v - k.rest_v) - k.damping_Nms * dv;
  }

  // Everything from disk i to the tip, about the origin of B, its joints free to yield.
  ArticulatedInertia all;
  Vec f = kZero + -Vec(parameters_.tip_force_W_N), n = kZero;
  for (int i = units_ - 1; i >= 0; --i) {
    const UnitConstants& k = unit_[i];
    Workspace::Unit& b = unit[i];
    all.mass.AddDiagonal(k.mass_kg);
    all.inertia.AddDiagonal(k.inertia_xx);
    all.inertia.AddSquare(k.inertia_zz - k.inertia_xx, b.z);
    n += b.n;
    b.Meet(all, f, n);
    if (i == 0) break;
    b.PassOn(all, f, n);
  }

  Vec a = -Vec(parameters_.gravity_W_mps2), alpha = kZero;
  for (int i = 0; i < units_; ++i) {
    const Workspace::Unit& b = unit[i];
    const Joint& j = b.joint;
    a += Cross(alpha, j.p) + b.bias_v;
    alpha += b.bias_w;
    const double t_u = b.t_u - b.uf_u.dot(a) - b.un_u.dot(alpha),
                 t_v = b.t_v - b.uf_v.dot(a) - b.un_v.dot(alpha);
    const double ddu = b.d_uu * t_u + b.d_uv * t_v, ddv = b.d_uv * t_u + b.d_vv * t_v;
    ddq[2 * i] = ddu;
    ddq[2 * i + 1] = ddv;
    a += ddu * j.jv_u + ddv * j.jv_v;
    alpha += ddu * j.jw_u + ddv * j.jw_v;
  }
}

void Body::MassMatrix(ConstVectorRef q, MatrixRef mass, Workspace& workspace) const noexcept {
  if (strained_) return strained_->MassMatrix(q, mass, workspace.strained_.data());
  Workspace::Unit* const unit = workspace.units_.data();
  Mat r = kIdentity;
  for (int i = 0; i < units_; ++i) {
    const double u = q[2 * i], v = q[2 * i + 1];
    const Stumpffs c = Stumpff(u * u + v * v);
    PlaceJoint(r, unit_[i].length_m, u, v, c, unit[i].joint);
    r = Turn(r, u, v, c);
    unit[i].z = r.z;
  }
  // Everything from disk i to the tip as one rigid body: mass, first moment and inertia about the origin of
  // B.
  double m = 0;
  Vec first = kZero;
  Symmetric inertia;
  for (int i = units_ - 1; i >= 0; --i) {
    const UnitConstants& k = unit_[i];
    const Joint& j = unit[i].joint;
    m += k.mass_kg;
    inertia.AddSquare(k.inertia_zz - k.inertia_xx, unit[i].z);
    inertia.AddDiagonal(k.inertia_xx);

    Vec f_u = m * j.jv_u + Cross(j.jw_u, first), f_v = m * j.jv_v + Cross(j.jw_v, first);
    Vec n_u = Cross(first, j.jv_u) + inertia * j.jw_u, n_v = Cross(first, j.jv_v) + inertia * j.jw_v;
    mass(2 * i, 2 * i) = j.jv_u.dot(f_u) + j.jw_u.dot(n_u);
    mass(2 * i, 2 * i + 1) = mass(2 * i + 1, 2 * i) = j.jv_u.dot(f_v) + j.jw_u.dot(n_v);
    mass(2 * i + 1, 2 * i + 1) = j.jv_v.dot(f_v) + j.jw_v.dot(n_v);
    for (int below = i - 1; below >= 0; --below) {
      n_u += Cross(unit[below + 1].joint.p, f_u);
      n_v += Cross(unit[below + 1].joint.p, f_v);
      const Joint& g = unit[below].joint;
      mass(2 * below, 2 * i) = mass(2 * i, 2 * below) = g.jv_u.dot(f_u) + g.jw_u.dot(n_u);
      mass(2 * below, 2 * i + 1) = mass(2 * i + 1, 2 * below) = g.jv_u.dot(f_v) + g.jw_u.dot(n_v);
      mass(2 * below + 1, 2 * i) = mass(2 * i, 2 * below + 1) = g.jv_v.dot(f_u) + g.jw_v.dot(n_u);
      mass(2 * below + 1, 2 * i + 1) = mass(2 * i + 1, 2 * below + 1) = g.jv_v.dot(f_v) + g.jw_v.dot(n_v);
    }
    if (i == 0) break;

    // Shift by p: d -> d + p in sum m (d.d 1 - d d^T).
    const Vec& p = j.p;
    inertia.SubtractOuter(first, p, p, first + m * p);
    inertia.AddDiagonal(2 * first.dot(p) + m * p.dot(p));
    first += m * p;
  }
}

Energy Body::EnergyOf(ConstVectorRef q, ConstVectorRef dq, Workspace& workspace) const noexcept {
  if (strained_) return strained_->EnergyOf(q, dq);
  Energy energy;
  const Vec gravity(parameters_.gravity_W_mps2);
  Joint& j = workspace.units_[0].joint;
  Mat r = kIdentity;
  Vec p = kZero, velocity = kZero, w = kZero;
  for (int i = 0; i < units_; ++i) {
    const UnitConstants& k = unit_[i];
    const double u = q[2 * i], v = q[2 * i + 1], du = dq[2 * i], dv = dq[2 * i + 1];
    const Stumpffs c = Stumpff(u * u + v * v);
    PlaceJoint(r, k.length_m, u, v, c, j);
    velocity += Cross(w, j.p) + du * j.jv_u + dv * j.jv_v;
    w += du * j.jw_u + dv * j.jw_v;
    p += j.p;
    r = Turn(r, u, v, c);
    const double spin = r.z.dot(w);
    energy.kinetic += 0.5 * (k.mass_kg * velocity.dot(velocity) + k.inertia_xx * w.dot(w) +
                             (k.inertia_zz - k.inertia_xx) * spin * spin);
    const double bent_u = u - k.rest_u, bent_v = v - k.rest_v;
    energy.elastic += 0.5 * k.stiffness_Nm * (bent_u * bent_u + bent_v * bent_v);
    energy.gravity -= k.mass_kg * gravity.dot(p);
  }
  energy.gravity -= Vec(parameters_.tip_force_W_N).dot(p);
  return energy;
}

}  // namespace tendril::model
