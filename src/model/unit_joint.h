// One unit as a joint of the chain, its tendons as chords of its arc. Shared by the body's files.
//
// Every vector is in the axes of F_0 with the disk's origin as its reference point, so that an inertia is
// only shifted, never rotated, on its way down the chain.
//
// Unit i joins frame A = i-1 to frame B = i. Its two-freedom joint has the motion subspace (Jv, Jw): linear
// velocity of the origin of B and angular velocity of B, both relative to A.
#pragma once

#include <array>

#include "small_vectors.h"
#include "tendril/core/limits.h"
#include "tendril/model/body.h"
#include "tendril/model/stumpff.h"

namespace tendril::model {

using Stumpffs = std::array<double, kStumpffCount>;

inline Pose ToPose(const Vec& p, const Mat& r) {
  Pose pose;
  pose.p_WA = p.eigen();
  pose.R_WA << r.x.eigen(), r.y.eigen(), r.z.eigen();
  return pose;
}

// One unit's geometry in F_0: place of B relative to A and the motion subspace.
struct Joint {
  Vec p;           // from A to B
  Vec jv_u, jv_v;  // dp
  Vec jw_u, jw_v;  // angular velocity
};

// eqs. 2, 7, 9 without their singularity at theta = 0; d_k = 2 dc_k/dx.
inline void PlaceJoint(const Mat& r_wa, double l, double u, double v, const Stumpffs& c, Joint& joint) {
  const double d1 = c[3] - c[2], d2 = 2 * c[4] - c[3];
  const double uu = u * u, uv = u * v, vv = v * v;
  joint.p = Times(r_wa, l * c[2] * u, l * c[2] * v, l * c[1]);
  joint.jv_u = Times(r_wa, l * (c[2] + uu * d2), l * uv * d2, l * u * d1);
  joint.jv_v = Times(r_wa, l * uv * d2, l * (c[2] + vv * d2), l * v * d1);
  joint.jw_u = Times(r_wa, -c[3] * uv, 1 - c[3] * vv, -c[2] * v);
  joint.jw_v = Times(r_wa, c[3] * uu - 1, c[3] * uv, c[2] * u);
}

// R_WB = R_WA exp(hat(-v, u, 0)), eqs. 3, 4.
inline Mat Turn(const Mat& r, double u, double v, const Stumpffs& c) {
  const double uv = -c[2] * u * v;
  return {Times(r, 1 - c[2] * u * u, uv, -c[1] * u), Times(r, uv, 1 - c[2] * v * v, -c[1] * v),
          Times(r, c[1] * u, c[1] * v, c[0])};
}

// Joints of the whole chain in the shape q.
template <class LengthOf>
void PlaceJoints(int units, LengthOf length_m, ConstVectorRef q, std::array<Joint, kMaxUnits>& joints) {
  Mat r = kIdentity;
  for (int i = 0; i < units; ++i) {
    const double u = q[2 * i], v = q[2 * i + 1];
    const Stumpffs c = Stumpff(u * u + v * v);
    PlaceJoint(r, length_m(i), u, v, c, joints[i]);
    r = Turn(r, u, v, c);
  }
}

// Straight tendons of one unit: L_j = (l - r_j (u cos + v sin)) k, k = 2 sin(theta/2)/theta = c1(x/4).
// slope: dk/du = u slope; bend: d(slope)/du = u bend; the same in v.
struct Chord {
  double k, slope, bend;
};

inline Chord ChordOf(double x) {
  const Stumpffs c = Stumpff(0.25 * x);
  return {c[1], 0.25 * (c[3] - c[2]), (3 * c[5] - 3 * c[4] + c[3]) / 16};
}

// Length of a tendon within a unit whose disks are twisted, its fall from the straight unit, its derivatives.
struct Body::SpanSlopes {
  double length, shortening, u, v, uu, uv, vv;
};

}  // namespace tendril::model
