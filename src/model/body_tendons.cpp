// The body's tendons: straight between neighbouring disks, through holes that may be twisted against each
// other. Knows nothing of what pulls them.
#include <array>
#include <cmath>

#include "strained_chain.h"
#include "tendril/core/limits.h"
#include "tendril/model/body.h"
#include "unit_joint.h"

namespace tendril::model {

// E = L^2 = 2 c2 B + side^2 with B = Y^2 - (side h)^2 / 4, Y = l - lever g, side = 2 r sin(delta); then
// L_u = E_u / 2L, L_uv = E_uv / 2L - E_u E_v / 4L^3.
Body::SpanSlopes Body::TwistedSlopes(int i, int j, double u, double v) const noexcept {
  const TwistedSpan& t = Twisted(i, j);
  const double l = unit_[i].length_m, side2 = t.side_m * t.side_m;  // a quarter of side^2
  const Stumpffs c = Stumpff(u * u + v * v);
  const double d2 = 2 * c[4] - c[3], e2 = 8 * c[6] - 5 * c[5] + c[4];
  const double g = u * t.cos_mid + v * t.sin_mid, h = v * t.cos_mid - u * t.sin_mid;
  const double y = l - t.lever_m * g;
  const double b = y * y - side2 * h * h;
  const double b_u = -2 * (y * t.lever_m * t.cos_mid - side2 * h * t.sin_mid);
  const double b_v = -2 * (y * t.lever_m * t.sin_mid + side2 * h * t.cos_mid);
  const double lever2 = t.lever_m * t.lever_m;
  const double b_uu = 2 * (lever2 * t.cos_mid * t.cos_mid - side2 * t.sin_mid * t.sin_mid);
  const double b_uv = 2 * (lever2 + side2) * t.cos_mid * t.sin_mid;
  const double b_vv = 2 * (lever2 * t.sin_mid * t.sin_mid - side2 * t.cos_mid * t.cos_mid);
  const double e_u = 2 * (c[2] * b_u + u * d2 * b), e_v = 2 * (c[2] * b_v + v * d2 * b);
  const double e_uu = 2 * (c[2] * b_uu + 2 * u * d2 * b_u + (d2 + u * u * e2) * b);
  const double e_uv = 2 * (c[2] * b_uv + u * d2 * b_v + v * d2 * b_u + u * v * e2 * b);
  const double e_vv = 2 * (c[2] * b_vv + 2 * v * d2 * b_v + (d2 + v * v * e2) * b);
  SpanSlopes s;
  s.length = std::sqrt(2 * c[2] * b + 4 * side2);
  // l^2 - 2 c2 B over the sum of both lengths, with 1 - 2 c2 = 2 theta^2 c4: exact where almost straight.
  const double in = t.lever_m * g;
  const double fall = 2 * (l * l * (u * u + v * v) * c[4] + c[2] * (in * (2 * l - in) + side2 * h * h));
  s.shortening = fall / (s.length + std::sqrt(l * l + 4 * side2));
  const double half = 0.5 / s.length, cube = half / (2 * s.length * s.length);
  s.u = half * e_u;
  s.v = half * e_v;
  s.uu = half * e_uu - cube * e_u * e_u;
  s.uv = half * e_uv - cube * e_u * e_v;
  s.vv = half * e_vv - cube * e_v * e_v;
  return s;
}

void Body::TendonLengths(ConstVectorRef q, VectorRef length_m) const noexcept {
  if (strained_) return strained_->TendonLengths(q, length_m);
  const int m = tendons();
  length_m.setZero();
  if (!twisted_.empty()) {
    for (int i = 0; i < units_; ++i) {
      for (int j = unit_[i].first_tendon; j < m; ++j) {
        length_m[j] += TwistedSlopes(i, j, q[2 * i], q[2 * i + 1]).length;
      }
    }
    return;
  }
  for (int i = 0; i < units_; ++i) {
    const double u = q[2 * i], v = q[2 * i + 1], l = unit_[i].length_m;
    const double k = ChordOf(u * u + v * v).k;
    for (int j = unit_[i].first_tendon; j < m; ++j) {
      const Tendon& t = tendons_[j];
      length_m[j] += (l - t.radius_m * (u * t.cos_angle + v * t.sin_angle)) * k;
    }
  }
}

void Body::TendonShortening(ConstVectorRef q, VectorRef shortening_m) const noexcept {
  if (strained_) return strained_->TendonShortening(q, shortening_m);
  // l (1 - k) + r a k with 1 - k = y c3(y), y = x/4: exact also where the robot is almost straight.
  const int m = tendons();
  shortening_m.setZero();
  if (!twisted_.empty()) {
    for (int i = 0; i < units_; ++i) {
      for (int j = unit_[i].first_tendon; j < m; ++j) {
        shortening_m[j] += TwistedSlopes(i, j, q[2 * i], q[2 * i + 1]).shortening;
      }
    }
    return;
  }
  for (int i = 0; i < units_; ++i) {
    const double u = q[2 * i], v = q[2 * i + 1];
    const double y = 0.25 * (u * u + v * v);
    const Stumpffs c = Stumpff(y);
    const double lost = unit_[i].length_m * y * c[3];
    for (int j = unit_[i].first_tendon; j < m; ++j) {
      const Tendon& t = tendons_[j];
      shortening_m[j] += lost + t.radius_m * (u * t.cos_angle + v * t.sin_angle) * c[1];
    }
  }
}

void Body::SpanShortening(ConstVectorRef q, MatrixRef shortening_m) const noexcept {
  if (strained_) return strained_->SpanShortening(q, shortening_m);
  const int m = tendons();
  shortening_m.setZero();
  for (int i = 0; i < units_; ++i) {
    const double u = q[2 * i], v = q[2 * i + 1];
    const double y = 0.25 * (u * u + v * v);
    const Stumpffs c = Stumpff(y);
    for (int j = unit_[i].first_tendon; j < m; ++j) {
      const Tendon& t = tendons_[j];
      shortening_m(j, i) = twisted_.empty() ? unit_[i].length_m * y * c[3] +
                                                  t.radius_m * (u * t.cos_angle + v * t.sin_angle) * c[1]
                                            : TwistedSlopes(i, j, u, v).shortening;
    }
  }
}

void Body::TendonTurns(ConstVectorRef q, MatrixRef turn_rad) const noexcept {
  if (strained_) return strained_->TendonTurns(q, turn_rad);
  // In the frame at the middle of a unit's arc the chord of the arc points along z, and so does a tendon
  // except for the twist: d = 2 r sin(delta) (-sin a, cos a) across, whose component along the bend is
  // shortened. Half the unit's rotation to either side gives the frames of its disks.
  const int m = tendons();
  const bool alike = twisted_.empty();  // all tendons of a unit run parallel
  turn_rad.setZero();
  std::array<Vec, kMaxTendons> arriving;  // in the axes of the disk between the two units
  for (int i = 0; i < units_; ++i) {
    const double u = q[2 * i], v = q[2 * i + 1];
    const Stumpffs half = Stumpff(0.25 * (u * u + v * v));
    const Mat to_first = Turn(kIdentity, 0.5 * u, 0.5 * v, half);
    const int first = unit_[i].first_tendon;
    for (int j = first; j < (alike ? first + 1 : m); ++j) {
      Vec chord(0, 0, 1);
      if (!alike) {
        const TwistedSpan& t = Twisted(i, j);
        const double x = -2 * t.side_m * t.sin_mid, y = 2 * t.side_m * t.cos_mid;
        const double along = 0.25 * half[2] * (u * x + v * y);
        chord = {x - along * u, y - along * v,
                 half[1] * (unit_[i].length_m - t.lever_m * (u * t.cos_mid + v * t.sin_mid))};
      }
      if (i > 0) {
        const Vec& before = arriving[alike ? 0 : j];
        const Vec leaving = to_first * chord, across = Cross(before, leaving);
        turn_rad(j, i - 1) = std::atan2(std::sqrt(across.dot(across)), before.dot(leaving));
      }
      arriving[alike ? 0 : j] = to_first.TransposeTimes(chord);
    }
    if (alike && i > 0)
      turn_rad.col(i - 1).segment(first + 1, m - first - 1).setConstant(turn_rad(first, i - 1));
  }
}

void Body::TendonLengthJacobian(ConstVectorRef q, MatrixRef jacobian) const noexcept {
  TendonVector shortening(tendons());
  TendonShortening(q, shortening, jacobian);
}

void Body::TendonShortening(ConstVectorRef q, VectorRef shortening_m,
                            MatrixRef length_jacobian) const noexcept {
  if (strained_) return strained_->TendonShortening(q, shortening_m, length_jacobian);
  const int m = tendons();
  for (int j = 0; j < m; ++j) shortening_m[j] = 0;
  for (int i = 0; i < units_; ++i) {
    const double u = q[2 * i], v = q[2 * i + 1], l = unit_[i].length_m;
    const int first = unit_[i].first_tendon;
    for (int j = 0; j < first; ++j) length_jacobian(j, 2 * i) = length_jacobian(j, 2 * i + 1) = 0;
    if (!twisted_.empty()) {
      for (int j = first; j < m; ++j) {
        const SpanSlopes s = TwistedSlopes(i, j, u, v);
        shortening_m[j] += s.shortening;
        length_jacobian(j, 2 * i) = s.u;
        length_jacobian(j, 2 * i + 1) = s.v;
      }
      continue;
    }
    const double y = 0.25 * (u * u + v * v);
    const Stumpffs c = Stumpff(y);
    const double lost = l * y * c[3], turned = 0.25 * (c[3] - c[2]);
    for (int j = first; j < m; ++j) {
      const Tendon& t = tendons_[j];
      const double rc = t.radius_m * t.cos_angle, rs = t.radius_m * t.sin_angle, in = u * rc + v * rs;
      const double slope = (l - in) * turned;
      shortening_m[j] += lost + in * c[1];
      length_jacobian(j, 2 * i) = u * slope - rc * c[1];
      length_jacobian(j, 2 * i + 1) = v * slope - rs * c[1];
    }
  }
}

void Body::TendonForce(ConstVectorRef q, ConstVectorRef tension_N, VectorRef force_Nm) const noexcept {
  if (strained_) return strained_->TendonForce(q, tension_N, force_Nm);
  if (!twisted_.empty()) {
    force_Nm.setZero();
    for (int i = 0; i < units_; ++i) {
      for (int j = unit_[i].first_tendon; j < tendons(); ++j) {
        const SpanSlopes s = TwistedSlopes(i, j, q[2 * i], q[2 * i + 1]);
        force_Nm[2 * i] -= tension_N[j] * s.u;
        force_Nm[2 * i + 1] -= tension_N[j] * s.v;
      }
    }
    return;
  }
  // All tendons of a unit act only through their sum and their first moments. From the tip to the base,
  // tendons that end on the way are added.
  double sum = 0, moment_u = 0, moment_v = 0;
  int counted = tendons();
  for (int i = units_ - 1; i >= 0; --i) {
    while (counted > unit_[i].first_tendon) {
      const Tendon& t = tendons_[--counted];
      sum += tension_N[counted];
      moment_u += tension_N[counted] * t.radius_m * t.cos_angle;
      moment_v += tension_N[counted] * t.radius_m * t.sin_angle;
    }
    const double u = q[2 * i], v = q[2 * i + 1];
    const Chord chord = ChordOf(u * u + v * v);
    const double slope = (sum * unit_[i].length_m - (u * moment_u + v * moment_v)) * chord.slope;
    force_Nm[2 * i] = moment_u * chord.k - u * slope;
    force_Nm[2 * i + 1] = moment_v * chord.k - v * slope;
  }
}

}  // namespace tendril::model
