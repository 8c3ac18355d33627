// One unit of constant strain as a joint of the chain: bending (u, v), torsion w and extension e. Shared by
// the files of the strained chain; unit_joint.h is the same for units that only bend.
//
// The unit's strain is constant in its own frame: its end is exp(xi^) of its start, xi = [phi; 0, 0, L] with
// phi = (-v, u, w) and L = l (1 + e) (Renda et al., 2018). With x = |phi|^2, the Stumpff functions c_k(x) and
// d_k = 2 dc_k/dx:
//   R = c0 1 + c1 phi^ + c2 phi phi^T,   p = L s,   s = c1 z + c2 phi x z + c3 w phi,
//   angular velocity = J dphi/dt,        J n = c1 n + c2 phi x n + c3 (phi . n) phi.
// J z = s: turning about z by dw moves no point of the axis but turns by s dw. All is smooth through phi = 0.
#pragma once

#include <array>

#include "small_vectors.h"
#include "tendril/model/stumpff.h"

namespace tendril::model {

inline constexpr int kStrains = 4;  // u, v, w, e
inline constexpr int kTurns = 3;    // those that turn

/// Values of the four strains of one unit, or their rates; 0 where a strain is switched off.
struct Strains {
  double u, v, w, e;

  double operator[](int a) const { return a == 0 ? u : a == 1 ? v : a == 2 ? w : e; }
  Vec rotation() const { return {-v, u, w}; }
};

/// Place of B relative to A in F_0 and the motion subspace. Columns of strains that are switched off are 0.
struct StrainJoint {
  Vec p;                         // from A to B
  std::array<Vec, kStrains> jv;  // linear velocity of B relative to A
  std::array<Vec, kTurns> jw;    // angular velocity; extension does not turn

  Vec Turning(int a) const { return a < kTurns ? jw[a] : kZero; }
};

/// c_k and d_k = 2 dc_k/dx of one unit.
struct StrainSeries {
  std::array<double, kStumpffCount> c;
  double d1, d2, d3;

  explicit StrainSeries(const Strains& q)
      : c(Stumpff(q.u * q.u + q.v * q.v + q.w * q.w)),
        d1(c[3] - c[2]),
        d2(2 * c[4] - c[3]),
        d3(3 * c[5] - c[4]) {}
};

/// l: length of the unstrained unit. `twists`, `stretches`: strains that are switched on.
inline void PlaceJoint(const Mat& r_wa, double l, const Strains& q, const StrainSeries& k, bool twists,
                       bool stretches, StrainJoint& joint) {
  const auto& c = k.c;
  const double u = q.u, v = q.v, w = q.w, length = l * (1 + q.e);
  const double dx = k.d2 * u - k.d3 * w * v, dy = k.d2 * v + k.d3 * w * u, dz = k.d1 + k.d3 * w * w;
  const double c3w = c[3] * w;
  const Vec s = Times(r_wa, c[2] * u - c3w * v, c[2] * v + c3w * u, c[1] + c3w * w);
  joint.p = length * s;
  joint.jv[0] = Times(r_wa, length * (u * dx + c[2]), length * (u * dy + c3w), length * u * dz);
  joint.jv[1] = Times(r_wa, length * (v * dx - c3w), length * (v * dy + c[2]), length * v * dz);
  joint.jw[0] = Times(r_wa, -c[2] * w - c[3] * u * v, c[1] + c[3] * u * u, c3w * u - c[2] * v);
  joint.jw[1] = Times(r_wa, -c[1] - c[3] * v * v, c[3] * u * v - c[2] * w, c[2] * u + c3w * v);
  if (twists) {
    joint.jv[2] =
        Times(r_wa, length * (w * dx - c[3] * v), length * (w * dy + c[3] * u), length * (w * dz + 2 * c3w));
    joint.jw[2] = s;
  } else {
    joint.jv[2] = joint.jw[2] = kZero;
  }
  joint.jv[3] = stretches ? l * s : kZero;
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
// dd_k/dx.
inline void RelativeBias(const Mat& r_wa, double l, const Strains& q, const Strains& dq,
                         const StrainSeries& k, const StrainJoint& joint, Vec& linear, Vec& angular) {
  const auto& c = k.c;
  const double d4 = 4 * c[6] - c[5], d5 = 5 * c[7] - c[6];
  const double e1 = k.d3 - k.d2, e2 = 2 * d4 - k.d3, e3 = 3 * d5 - d4;
  const Vec phi = q.rotation(), rate = dq.rotation();
  const double s = phi.dot(rate), square = rate.dot(rate), ss = s * s, w = q.w, dw = dq.w;
  const double dc2 = k.d2 * s, dc3 = k.d3 * s;
  const double ddc1 = e1 * ss + k.d1 * square, ddc2 = e2 * ss + k.d2 * square, ddc3 = e3 * ss + k.d3 * square;
  const double along_phi = ddc3 * w + 2 * dc3 * dw, along_rate = 2 * (dc3 * w + c[3] * dw);
  const double length = l * (1 + q.e);
  linear = Times(r_wa, length * (ddc2 * q.u + 2 * dc2 * dq.u + along_phi * phi.x + along_rate * rate.x),
                 length * (ddc2 * q.v + 2 * dc2 * dq.v + along_phi * phi.y + along_rate * rate.y),
                 length * (ddc1 + along_phi * w + along_rate * dw));
  linear += (2 * l * dq.e / length) * (dq.u * joint.jv[0] + dq.v * joint.jv[1] + dw * joint.jv[2]);
  const Vec turn = (s * (k.d1 + c[3])) * rate + dc2 * Cross(phi, rate) + (dc3 * s + c[3] * square) * phi;
  angular = r_wa * turn;
}

/// Second derivatives of p by the strains and first ones of jw, in the axes of A, by all four strains.
struct StrainCurvature {
  std::array<std::array<Vec, kStrains>, kStrains> p;  // d jv_a / db
  std::array<std::array<Vec, kTurns>, kTurns> w;      // d jw_a / db

  StrainCurvature(double l, const Strains& q, const StrainSeries& k);
};

inline StrainCurvature::StrainCurvature(double l, const Strains& q, const StrainSeries& k) {
  const auto& c = k.c;
  const double d4 = 4 * c[6] - c[5], d5 = 5 * c[7] - c[6];
  const double e1 = k.d3 - k.d2, e2 = 2 * d4 - k.d3, e3 = 3 * d5 - d4;
  const double u = q.u, v = q.v, t = q.w, length = l * (1 + q.e);
  // s = sum of c_k times a vector polynomial; its derivatives with the factors c, d and e of the series.
  const auto factors = [&](double f1, double f2, double f3) {
    return Vec(f2 * u - f3 * t * v, f2 * v + f3 * t * u, f1 + f3 * t * t);
  };
  const auto slopes = [&](double f2, double f3) {
    return std::array<Vec, kTurns>{Vec(f2, f3 * t, 0), Vec(-f3 * t, f2, 0), Vec(-f3 * v, f3 * u, 2 * f3 * t)};
  };
  const Vec d = factors(k.d1, k.d2, k.d3), e = factors(e1, e2, e3);
  const auto c_slope = slopes(c[2], c[3]), d_slope = slopes(k.d2, k.d3);
  const std::array<double, kTurns> at{u, v, t};
  const std::array<Vec, kTurns> axis{Vec(0, 1, 0), Vec(-1, 0, 0), Vec(0, 0, 1)};  // dphi by the strain
  const Vec phi = q.rotation();
  for (int a = 0; a < kTurns; ++a) {
    for (int b = 0; b < kTurns; ++b) {
      Vec s = (at[a] * at[b]) * e + at[a] * d_slope[b] + at[b] * d_slope[a];
      if (a == b) s += d;
      p[a][b] = length * s;
      w[a][b] = (at[b] * k.d1) * axis[a] + (at[b] * k.d2) * Cross(phi, axis[a]) +
                c[2] * Cross(axis[b], axis[a]) + (at[b] * k.d3 * at[a] + (a == b ? c[3] : 0)) * phi +
                (c[3] * at[a]) * axis[b];
    }
    p[a][3] = p[3][a] = l * (at[a] * d + c_slope[a]);
  }
  p[0][2] += Vec(0, length * c[3], 0);
  p[2][0] = p[0][2];
  p[1][2] += Vec(-length * c[3], 0, 0);
  p[2][1] = p[1][2];
  p[2][2] += Vec(0, 0, 2 * length * c[3]);
  p[3][3] = kZero;
}

}  // namespace tendril::model
