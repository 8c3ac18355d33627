// The strained chain's recursions in motion: forward and inverse dynamics, mass matrix, energy.
#include "articulated_inertia.h"
#include "strained_chain.h"

namespace tendril::model {
namespace {

// A unit's strains yield one after another, as joints of one freedom at the same place: each takes its share
// out of the inertia and force that the strains before it carry.
inline void Yield(int strain, ArticulatedInertia& all, Vec& force, Vec& moment, StrainedState& b) {
  const StrainJoint& j = b.joint;
  const Vec& jv = j.jv[strain];
  Vec& uf = b.uf[strain];
  Vec& un = b.un[strain];
  uf = all.mass * jv;
  un = all.cross.TransposeTimes(jv);
  double inertia, left = b.left[strain] - jv.dot(force);
  if (strain < kTurns) {
    const Vec& jw = j.jw[strain];
    uf += all.cross * jw;
    un += all.inertia * jw;
    inertia = jv.dot(uf) + jw.dot(un);
    left -= jw.dot(moment);
  } else {
    inertia = jv.dot(uf);
  }
  const double inverse = 1 / inertia;
  b.inverse_inertia[strain] = inverse;
  b.left[strain] = left;
  all.mass.AddSquare(-inverse, uf);
  all.inertia.AddSquare(-inverse, un);
  const Vec share = -inverse * uf;
  all.cross.x += un.x * share;
  all.cross.y += un.y * share;
  all.cross.z += un.z * share;
  force += (left * inverse) * uf;
  moment += (left * inverse) * un;
}

inline void Accelerate(int strain, const StrainedState& b, Vec& a, Vec& alpha, double& ddq) {
  ddq = b.inverse_inertia[strain] * (b.left[strain] - b.uf[strain].dot(a) - b.un[strain].dot(alpha));
  a += ddq * b.joint.jv[strain];
  if (strain < kTurns) alpha += ddq * b.joint.jw[strain];
}

}  // namespace

void StrainedChain::ForwardDynamics(ConstVectorRef q, ConstVectorRef dq, ConstVectorRef force_Nm,
                                    VectorRef ddq, StrainedState* state) const noexcept {
  const int n = static_cast<int>(units_.size());
  Mat r = kIdentity;
  Vec w = kZero;
  for (int i = 0; i < n; ++i) {
    const StrainedUnit& unit = units_[static_cast<std::size_t>(i)];
    StrainedState& b = state[i];
    StrainJoint& j = b.joint;
    const Strains at = unit.At(q), rate = unit.At(dq), force = unit.At(force_Nm);
    const StrainSeries k(at);
    PlaceJoint(r, unit.length_m, at, k, j);
    Vec linear, angular;
    RelativeBias(r, unit.length_m, at, rate, k, linear, angular);
    const Vec dp = j.Moving(rate), w_rel = j.Turning(rate);
    b.bias_v = Cross(w, Cross(w, j.p) + 2 * dp) + linear;
    b.bias_w = Cross(w, w_rel) + angular;
    w += w_rel;
    r = Turn(r, at, k);
    b.z = r.z;
    b.n = ((unit.inertia_zz - unit.inertia_xx) * b.z.dot(w)) * Cross(w, b.z);
    for (int a = 0; a < kStrains; ++a)
      b.left[a] = force[a] - unit.stiffness[a] * (at[a] - unit.rest[a]) - unit.damping[a] * rate[a];
  }

  // Everything from unit i to the tip, about the origin of B, its joints free to yield.
  ArticulatedInertia all;
  Vec f = -tip_force_, moment = kZero;
  for (int i = n - 1; i >= 0; --i) {
    const StrainedUnit& unit = units_[static_cast<std::size_t>(i)];
    StrainedState& b = state[i];
    all.mass.AddDiagonal(unit.mass_kg);
    all.inertia.AddDiagonal(unit.inertia_xx);
    all.inertia.AddSquare(unit.inertia_zz - unit.inertia_xx, b.z);
    moment += b.n;
    for (int a = kStrains - 1; a >= 0; --a) {
      if (unit.Has(a)) Yield(a, all, f, moment, b);
    }
    if (i == 0) break;
    f += all.mass * b.bias_v + all.cross * b.bias_w;
    moment += all.cross.TransposeTimes(b.bias_v) + all.inertia * b.bias_w + Cross(b.joint.p, f);
    all.Shift(b.joint.p);
  }

  Vec a = -gravity_, alpha = kZero;
  for (int i = 0; i < n; ++i) {
    const StrainedUnit& unit = units_[static_cast<std::size_t>(i)];
    const StrainedState& b = state[i];
    a += Cross(alpha, b.joint.p) + b.bias_v;
    alpha += b.bias_w;
    for (int c = 0; c < kStrains; ++c) {
      if (unit.Has(c)) Accelerate(c, b, a, alpha, ddq[unit.IndexOf(c)]);
    }
  }
}

void StrainedChain::InverseDynamics(ConstVectorRef q, ConstVectorRef dq, ConstVectorRef ddq,
                                    VectorRef force_Nm, StrainedState* state) const noexcept {
  const int n = static_cast<int>(units_.size());
  Mat r = kIdentity;
  Vec w = kZero, dw = kZero, a = -gravity_;
  for (int i = 0; i < n; ++i) {
    const StrainedUnit& unit = units_[static_cast<std::size_t>(i)];
    StrainJoint& j = state[i].joint;
    const Strains at = unit.At(q), rate = unit.At(dq), more = unit.At(ddq);
    const StrainSeries k(at);
    PlaceJoint(r, unit.length_m, at, k, j);
    Vec linear, angular;
    RelativeBias(r, unit.length_m, at, rate, k, linear, angular);
    const Vec dp = j.Moving(rate), w_rel = j.Turning(rate);
    a += Cross(dw, j.p) + Cross(w, Cross(w, j.p) + 2 * dp) + linear + j.Moving(more);
    dw += Cross(w, w_rel) + angular + j.Turning(more);
    w += w_rel;
    r = Turn(r, at, k);
    const double extra = unit.inertia_zz - unit.inertia_xx;
    state[i].f = unit.mass_kg * a;
    state[i].n = unit.inertia_xx * dw + (extra * r.z.dot(dw)) * r.z + (extra * r.z.dot(w)) * Cross(w, r.z);
  }
  Vec f = -tip_force_, moment = kZero;
  for (int i = n - 1; i >= 0; --i) {
    const StrainedUnit& unit = units_[static_cast<std::size_t>(i)];
    const StrainJoint& j = state[i].joint;
    const Strains at = unit.At(q), rate = unit.At(dq);
    f += state[i].f;
    moment += state[i].n;
    for (int c = 0; c < kStrains; ++c) {
      if (!unit.Has(c)) continue;
      force_Nm[unit.IndexOf(c)] = j.jv[c].dot(f) + j.Turning(c).dot(moment) +
                                  unit.stiffness[c] * (at[c] - unit.rest[c]) + unit.damping[c] * rate[c];
    }
    moment += Cross(j.p, f);
  }
}

void StrainedChain::MassMatrix(ConstVectorRef q, MatrixRef mass, StrainedState* state) const noexcept {
  const int n = static_cast<int>(units_.size());
  Mat r = kIdentity;
  for (int i = 0; i < n; ++i) {
    const StrainedUnit& unit = units_[static_cast<std::size_t>(i)];
    const Strains at = unit.At(q);
    const StrainSeries k(at);
    PlaceJoint(r, unit.length_m, at, k, state[i].joint);
    r = Turn(r, at, k);
    state[i].z = r.z;
  }
  // Everything from unit i to the tip as one rigid body: mass, first moment and inertia about the origin of
  // B.
  double m = 0;
  Vec first = kZero;
  Symmetric inertia;
  for (int i = n - 1; i >= 0; --i) {
    const StrainedUnit& unit = units_[static_cast<std::size_t>(i)];
    const StrainJoint& j = state[i].joint;
    m += unit.mass_kg;
    inertia.AddSquare(unit.inertia_zz - unit.inertia_xx, state[i].z);
    inertia.AddDiagonal(unit.inertia_xx);
    for (int c = 0; c < kStrains; ++c) {
      if (!unit.Has(c)) continue;
      const int column = unit.IndexOf(c);
      const Vec turning = j.Turning(c);
      const Vec f = m * j.jv[c] + Cross(turning, first);
      Vec moment = Cross(first, j.jv[c]) + inertia * turning;
      for (int a = 0; a <= c; ++a) {
        if (!unit.Has(a)) continue;
        const int row = unit.IndexOf(a);
        mass(row, column) = mass(column, row) = j.jv[a].dot(f) + j.Turning(a).dot(moment);
      }
      for (int below = i - 1; below >= 0; --below) {
        const StrainedUnit& before = units_[static_cast<std::size_t>(below)];
        moment += Cross(state[below + 1].joint.p, f);
        const StrainJoint& g = state[below].joint;
        for (int a = 0; a < kStrains; ++a) {
          if (!before.Has(a)) continue;
          const int row = before.IndexOf(a);
          mass(row, column) = mass(column, row) = g.jv[a].dot(f) + g.Turning(a).dot(moment);
        }
      }
    }
    // Shift by p: d -> d + p in sum m (d.d 1 - d d^T).
    const Vec& p = j.p;
    inertia.SubtractOuter(first, p, p, first + m * p);
    inertia.AddDiagonal(2 * first.dot(p) + m * p.dot(p));
    first += m * p;
  }
}

Energy StrainedChain::EnergyOf(ConstVectorRef q, ConstVectorRef dq) const noexcept {
  Energy energy;
  StrainJoint j;
  Mat r = kIdentity;
  Vec p = kZero, velocity = kZero, w = kZero;
  for (const StrainedUnit& unit : units_) {
    const Strains at = unit.At(q), rate = unit.At(dq);
    const StrainSeries k(at);
    PlaceJoint(r, unit.length_m, at, k, j);
    velocity += Cross(w, j.p) + j.Moving(rate);
    for (int a = 0; a < kStrains; ++a) {
      const double strained = at[a] - unit.rest[a];
      if (unit.Has(a)) energy.elastic += 0.5 * unit.stiffness[a] * strained * strained;
    }
    w += j.Turning(rate);
    p += j.p;
    r = Turn(r, at, k);
    const double spin = r.z.dot(w);
    energy.kinetic += 0.5 * (unit.mass_kg * velocity.dot(velocity) + unit.inertia_xx * w.dot(w) +
                             (unit.inertia_zz - unit.inertia_xx) * spin * spin);
    energy.gravity -= unit.mass_kg * gravity_.dot(p);
  }
  energy.gravity -= tip_force_.dot(p);
  return energy;
}

}  // namespace tendril::model
