// One unit of constant strain as a joint of the chain: bending (u, v), torsion w, extension e and shear (sx,
// sy). Shared by the files of the strained chain; unit_joint.h is the same for units that only bend.
//
// The unit's strain is constant in its own frame: its end is exp(xi^) of its start, xi = [phi; l m] with
// phi = (-v, u, w) and m = (sx, sy, 1 + e) (Renda et al., 2018). With the Stumpff functions c_k(|phi|^2) and
// d_k = 2 dc_k/d|phi|^2:
//   R = c0 1 + c1 phi^ + c2 phi phi^T,   p = l J m,   angular velocity = J dphi/dt,
//   J n = c1 n + c2 phi x n + c3 (phi . n) phi.
// All is smooth through phi = 0.
#pragma once

#include <array>

#include "small_vectors.h"
#include "tendril/model/stumpff.h"

namespace tendril::model {

inline constexpr int kStrains = 6;  // u, v, w, e, sx, sy
inline constexpr int kTurns = 3;    // those that turn

/// Values of the strains of one unit, or their rates; 0 where a strain is switched off.
struct Strains {
  double u, v, w, e, sx, sy;

  double operator[](int a) const {
    const std::array<double, kStrains> all{u, v, w, e, sx, sy};
    return all[static_cast<std::size_t>(a)];
  }
  Vec rotation() const { return {-v, u, w}; }
  /// Of m for strains, of dm/dt for rates.
  Vec shift(double straight) const { return {sx, sy, straight + e}; }
};

/// Place of B relative to A in F_0 and the motion subspace.
struct StrainJoint {
  Vec p;                         // from A to B
  std::array<Vec, kStrains> jv;  // linear velocity of B relative to A
  std::array<Vec, kTurns> jw;    // angular velocity; extension and shear do not turn

  Vec Moving(const Strains& rate) const {
    return rate.u * jv[0] + rate.v * jv[1] + rate.w * jv[2] + rate.e * jv[3] + rate.sx * jv[4] +
           rate.sy * jv[5];
  }
  Vec Turning(const Strains& rate) const { return rate.u * jw[0] + rate.v * jw[1] + rate.w * jw[2]; }
  Vec Turning(int a) const { return a < kTurns ? jw[static_cast<std::size_t>(a)] : kZero; }
};

/// c_k and d_k of one unit.
struct StrainSeries {
  std::array<double, kStumpffCount> c;
  double d1, d2, d3;

  explicit StrainSeries(const Strains& q)
      : c(Stumpff(q.u * q.u + q.v * q.v + q.w * q.w)),
        d1(c[3] - c[2]),
        d2(2 * c[4] - c[3]),
        d3(3 * c[5] - c[4]) {}
};

/// f1 n + f2 phi x n + f3 (phi . n) phi: J n, and with other factors its derivatives.
inline Vec Along(const Vec& phi, const Vec& n, double f1, double f2, double f3) {
  return f1 * n + f2 * Cross(phi, n) + (f3 * phi.dot(n)) * phi;
}

/// l: length of the unit when unstrained.
inline void PlaceJoint(const Mat& r_wa, double l, const Strains& q, const StrainSeries& k,
                       StrainJoint& joint) {
  const auto& c = k.c;
  const double u = q.u, v = q.v, w = q.w, c3w = c[3] * w;
  const Vec phi = q.rotation(), m = q.shift(1);
  joint.jw[0] = Times(r_wa, -c[2] * w - c[3] * u * v, c[1] + c[3] * u * u, c3w * u - c[2] * v);
  joint.jw[1] = Times(r_wa, -c[1] - c[3] * v * v, c[3] * u * v - c[2] * w, c[2] * u + c3w * v);
  joint.jw[2] = Times(r_wa, c[2] * u - c3w * v, c[2] * v + c3w * u, c[1] + c3w * w);
  joint.jv[3] = l * joint.jw[2];
  joint.jv[4] = -l * joint.jw[1];
  joint.jv[5] = l * joint.jw[0];
  joint.p = m.x * joint.jv[4] + m.y * joint.jv[5] + m.z * joint.jv[3];
  // d(J m) by a strain that turns about the axis n: (phi . n) D + c2 n x m + c3 ((n . m) phi + (phi . m) n).
  const Vec d = Along(phi, m, k.d1, k.d2, k.d3);
  const double c2 = l * c[2], c3 = l * c[3], along = c3 * phi.dot(m);
  const Vec by_u = (l * u) * d + (c3 * m.y) * phi, by_v = (l * v) * d + (-c3 * m.x) * phi,
            by_w = (l * w) * d + (c3 * m.z) * phi;
  joint.jv[0] = Times(r_wa, by_u.x + c2 * m.z, by_u.y + along, by_u.z - c2 * m.x);
  joint.jv[1] = Times(r_wa, by_v.x - along, by_v.y + c2 * m.z, by_v.z - c2 * m.y);
  joint.jv[2] = Times(r_wa, by_w.x - c2 * m.y, by_w.y + c2 * m.x, by_w.z + along);
}

// R_WB = R_WA exp(phi^).
inline Mat Turn(const Mat& r, const Strains& q, const StrainSeries& k) {
  const auto& c = k.c;
  const double u = q.u, v = q.v, w = q.w;
  return {Times(r, c[0] + c[2] * v * v, c[1] * w - c[2] * u * v, -c[1] * u - c[2] * v * w),
          Times(r, -c[1] * w - c[2] * u * v, c[0] + c[2] * u * u, c[2] * u * w - c[1] * v),
          Times(r, c[1] * u - c[2] * v * w, c[1] * v + c[2] * u * w, c[0] + c[2] * w * w)};
}

// Accelerations of B relative to A that remain when the strains' second derivatives are 0, in F_0. e_k = 2
// dd_k/d|phi|^2.
inline void RelativeBias(const Mat& r_wa, double l, const Strains& q, const Strains& dq,
                         const StrainSeries& k, Vec& linear, Vec& angular) {
  const auto& c = k.c;
  const double d4 = 4 * c[6] - c[5], d5 = 5 * c[7] - c[6];
  const double e1 = k.d3 - k.d2, e2 = 2 * d4 - k.d3, e3 = 3 * d5 - d4;
  const Vec phi = q.rotation(), rate = dq.rotation(), m = q.shift(1), dm = dq.shift(0);
  const double s = phi.dot(rate), square = rate.dot(rate), ss = s * s;
  const double dc1 = k.d1 * s, dc2 = k.d2 * s, dc3 = k.d3 * s;
  const double ddc1 = e1 * ss + k.d1 * square, ddc2 = e2 * ss + k.d2 * square, ddc3 = e3 * ss + k.d3 * square;
  // d2(J m)/dt2 = (d2J/dt2) m + 2 (dJ/dt) dm/dt.
  const double pm = phi.dot(m), rm = rate.dot(m), pd = phi.dot(dm), rd = rate.dot(dm);
  const Vec across = ddc2 * m + (2 * dc2) * dm;
  const Vec second =
      ddc1 * m + (2 * dc1) * dm + Cross(phi, across) + Cross(rate, (2 * dc2) * m + (2 * c[2]) * dm) +
      (ddc3 * pm + 2 * (dc3 * (rm + pd) + c[3] * rd)) * phi + (2 * (dc3 * pm + c[3] * (rm + pd))) * rate;
  linear = l * (r_wa * second);
  const Vec turn = (s * (k.d1 + c[3])) * rate + dc2 * Cross(phi, rate) + (dc3 * s + c[3] * square) * phi;
  angular = r_wa * turn;
}

/// Second derivatives of p by the strains and first ones of jw, in the axes of A, by all strains.
struct StrainCurvature {
  std::array<std::array<Vec, kStrains>, kStrains> p;  // d jv_a / db
  std::array<std::array<Vec, kTurns>, kTurns> w;      // d jw_a / db

  StrainCurvature(double l, const Strains& q, const StrainSeries& k);
};

inline StrainCurvature::StrainCurvature(double l, const Strains& q, const StrainSeries& k) {
  const auto& c = k.c;
  const double d4 = 4 * c[6] - c[5], d5 = 5 * c[7] - c[6];
  const double e1 = k.d3 - k.d2, e2 = 2 * d4 - k.d3, e3 = 3 * d5 - d4;
  const std::array<double, kTurns> at{q.u, q.v, q.w};                             // phi . axis
  const std::array<Vec, kTurns> axis{Vec(0, 1, 0), Vec(-1, 0, 0), Vec(0, 0, 1)};  // dphi by the strain
  const Vec phi = q.rotation(), m = q.shift(1);
  const double pm = phi.dot(m);
  const Vec d = Along(phi, m, k.d1, k.d2, k.d3), e = Along(phi, m, e1, e2, e3);
  // Of f2 phi x m + f3 (phi . m) phi by phi alone, its factors constant.
  const auto slope = [&](std::size_t a, double f2, double f3) {
    return f2 * Cross(axis[a], m) + (f3 * axis[a].dot(m)) * phi + (f3 * pm) * axis[a];
  };
  for (std::size_t a = 0; a < kTurns; ++a) {
    for (std::size_t b = 0; b < kTurns; ++b) {
      Vec s = (at[a] * at[b]) * e + at[b] * slope(a, k.d2, k.d3) + at[a] * slope(b, k.d2, k.d3) +
              (c[3] * axis[b].dot(m)) * axis[a] + (c[3] * axis[a].dot(m)) * axis[b];
      if (a == b) s += d;
      p[a][b] = l * s;
      w[a][b] = (at[b] * k.d1) * axis[a] + (at[b] * k.d2) * Cross(phi, axis[a]) +
                c[2] * Cross(axis[b], axis[a]) + (at[b] * k.d3 * at[a] + (a == b ? c[3] : 0)) * phi +
                (c[3] * at[a]) * axis[b];
    }
  }
  // jv of extension and shear are l times J's columns.
  for (std::size_t a = 0; a < kTurns; ++a) {
    p[a][3] = p[3][a] = l * w[2][a];
    p[a][4] = p[4][a] = -l * w[1][a];
    p[a][5] = p[5][a] = l * w[0][a];
  }
  for (std::size_t a = kTurns; a < kStrains; ++a) {
    for (std::size_t b = kTurns; b < kStrains; ++b) p[a][b] = kZero;
  }
}

}  // namespace tendril::model
