// The body's recursions. Every vector is in the axes of F_0 with the disk's origin as its reference point, so
// that an inertia is only shifted, never rotated, on its way down the chain. Knows nothing of motors.
//
// Unit i joins frame A = i-1 to frame B = i. Its two-freedom joint has the motion subspace (Jv, Jw): linear
// velocity of the origin of B and angular velocity of B, both relative to A.
#include "tendril/model/body.h"

#include <array>
#include <cmath>
#include <stdexcept>
#include <string>

#include "tendril/core/limits.h"
#include "tendril/model/stumpff.h"

namespace tendril::model {
namespace {

using Stumpffs = std::array<double, kStumpffCount>;

// Plain three numbers: unlike an Eigen vector it stays in registers, where a half-packed store followed by a
// load of the other half would stall.
struct Vec {
  double x, y, z;

  Vec() = default;
  constexpr Vec(double x_, double y_, double z_) : x(x_), y(y_), z(z_) {}
  explicit Vec(const Eigen::Vector3d& v) : x(v[0]), y(v[1]), z(v[2]) {}
  Eigen::Vector3d eigen() const { return {x, y, z}; }
  double dot(const Vec& b) const { return x * b.x + y * b.y + z * b.z; }
  Vec& operator+=(const Vec& b) { return *this = {x + b.x, y + b.y, z + b.z}; }
};

inline Vec operator+(const Vec& a, const Vec& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec operator-(const Vec& a) { return {-a.x, -a.y, -a.z}; }
inline Vec operator*(double k, const Vec& a) { return {k * a.x, k * a.y, k * a.z}; }
inline Vec Cross(const Vec& a, const Vec& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

// By columns; of a rotation these are the axes.
struct Mat {
  Vec x, y, z;

  Vec operator*(const Vec& v) const { return v.x * x + v.y * y + v.z * z; }
  Vec TransposeTimes(const Vec& v) const { return {x.dot(v), y.dot(v), z.dot(v)}; }
};

constexpr Mat kIdentity{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
constexpr Vec kZero(0, 0, 0);

inline Vec Times(const Mat& r, double x, double y, double z) { return x * r.x + y * r.y + z * r.z; }

struct Symmetric {
  double xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;

  Vec operator*(const Vec& v) const {
    return {xx * v.x + xy * v.y + xz * v.z, xy * v.x + yy * v.y + yz * v.z, xz * v.x + yz * v.y + zz * v.z};
  }
  // k a a^T.
  void AddSquare(double k, const Vec& a) {
    const Vec b = k * a;
    xx += b.x * a.x;
    xy += b.x * a.y;
    xz += b.x * a.z;
    yy += b.y * a.y;
    yz += b.y * a.z;
    zz += b.z * a.z;
  }
  // a b^T + c d^T, which is symmetric.
  void SubtractOuter(const Vec& a, const Vec& b, const Vec& c, const Vec& d) {
    xx -= a.x * b.x + c.x * d.x;
    xy -= a.x * b.y + c.x * d.y;
    xz -= a.x * b.z + c.x * d.z;
    yy -= a.y * b.y + c.y * d.y;
    yz -= a.y * b.z + c.y * d.z;
    zz -= a.z * b.z + c.z * d.z;
  }
  void AddDiagonal(double d) {
    xx += d;
    yy += d;
    zz += d;
  }
};

// Inertia of disks about a point: force = mass a + cross alpha, moment = cross^T a + inertia alpha.
struct ArticulatedInertia {
  Symmetric mass, inertia;
  Mat cross{kZero, kZero, kZero};

  // To the point at -p: alpha there adds alpha x p to a here, a force here adds p x f to the moment there.
  void Shift(const Vec& p) {
    const Mat c = cross;
    cross.x +=
        Vec(mass.xz * p.y - mass.xy * p.z, mass.yz * p.y - mass.yy * p.z, mass.zz * p.y - mass.yz * p.z);
    cross.y +=
        Vec(mass.xx * p.z - mass.xz * p.x, mass.xy * p.z - mass.yz * p.x, mass.xz * p.z - mass.zz * p.x);
    cross.z +=
        Vec(mass.xy * p.x - mass.xx * p.y, mass.yy * p.x - mass.xy * p.y, mass.yz * p.x - mass.xz * p.y);
    inertia.xx += p.y * (c.x.z + cross.x.z) - p.z * (c.x.y + cross.x.y);
    inertia.xy += p.z * c.x.x - p.x * c.x.z + p.y * cross.y.z - p.z * cross.y.y;
    inertia.xz += p.x * c.x.y - p.y * c.x.x + p.y * cross.z.z - p.z * cross.z.y;
    inertia.yy += p.z * (c.y.x + cross.y.x) - p.x * (c.y.z + cross.y.z);
    inertia.yz += p.x * c.y.y - p.y * c.y.x + p.z * cross.z.x - p.x * cross.z.z;
    inertia.zz += p.x * (c.z.y + cross.z.y) - p.y * (c.z.x + cross.z.x);
  }
};

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

// From the pose of A to that of B.
inline void Advance(double l, double u, double v, Vec& p, Mat& r) {
  const Stumpffs c = Stumpff(u * u + v * v);
  p += Times(r, l * c[2] * u, l * c[2] * v, l * c[1]);
  r = Turn(r, u, v, c);
}

inline Pose ToPose(const Vec& p, const Mat& r) {
  Pose pose;
  pose.p_WA = p.eigen();
  pose.R_WA << r.x.eigen(), r.y.eigen(), r.z.eigen();
  return pose;
}

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

// Straight tendons of one unit: L_j = (l - r_j (u cos + v sin)) k, k = 2 sin(theta/2)/theta = c1(x/4).
// slope: dk/du = u slope; bend: d(slope)/du = u bend; the same in v.
struct Chord {
  double k, slope, bend;
};

inline Chord ChordOf(double x) {
  const Stumpffs c = Stumpff(0.25 * x);
  return {c[1], 0.25 * (c[3] - c[2]), (3 * c[5] - 3 * c[4] + c[3]) / 16};
}

void Require(bool ok, const std::string& what) {
  if (!ok) throw std::invalid_argument("body: " + what);
}

bool Positive(double x) { return std::isfinite(x) && x > 0; }

bool NotNegative(double x) { return std::isfinite(x) && x >= 0; }

}  // namespace

// Length of a tendon within a unit whose disks are twisted, its fall from the straight unit, its derivatives.
struct Body::SpanSlopes {
  double length, shortening, u, v, uu, uv, vv;
};

struct Body::Workspace::Unit {
  Stumpffs series;  // at theta^2
  Joint joint;
  Vec bias_v, bias_w;  // acceleration of B with the joint's and A's accelerations zero
  Vec f, n;            // force and moment at the origin of B: articulated bias, or what the joint carries
  Vec uf_u, un_u, uf_v, un_v;  // articulated inertia times the motion subspace
  double d_uu, d_uv, d_vv;     // inverse of the 2 x 2 joint inertia
  double t_u, t_v;             // joint force left for the acceleration
  Vec z;                       // axis of the disk
};

Body::Workspace::Workspace(const Body& body) : units_(body.units()) {}
Body::Workspace::Workspace(const Workspace& other) = default;
Body::Workspace::Workspace(Workspace&& other) noexcept = default;
Body::Workspace& Body::Workspace::operator=(const Workspace& other) = default;
Body::Workspace& Body::Workspace::operator=(Workspace&& other) noexcept = default;
Body::Workspace::~Workspace() = default;

Body::Body(const BodyParameters& parameters) : parameters_(parameters) {
  const auto& sections = parameters_.sections;
  Require(!sections.empty() && sections.size() <= static_cast<std::size_t>(kMaxSections),
          "number of sections must be 1.." + std::to_string(kMaxSections));
  Require(parameters_.gravity_W_mps2.allFinite(), "gravity must be finite");
  Require(NotNegative(parameters_.tip_payload_kg), "tip_payload_kg must not be negative");
  Require(parameters_.tip_force_W_N.allFinite(), "tip_force_W_N must be finite");
  Require(std::isfinite(parameters_.twist_rad_per_m), "twist_rad_per_m must be finite");
  first_unit_.push_back(0);
  for (std::size_t k = 0; k < sections.size(); ++k) {
    const SectionParameters& s = sections[k];
    const std::string where = "section " + std::to_string(k + 1) + ": ";
    Require(s.units >= 1, where + "units must be at least 1");
    Require(Positive(s.unit_length_m), where + "unit_length_m must be positive");
    Require(Positive(s.unit_mass_kg), where + "unit_mass_kg must be positive");
    Require(Positive(s.disk_inertia_xx_kgm2), where + "disk_inertia_xx_kgm2 must be positive");
    Require(Positive(s.disk_inertia_zz_kgm2), where + "disk_inertia_zz_kgm2 must be positive");
    Require(Positive(s.youngs_modulus_Pa), where + "youngs_modulus_Pa must be positive");
    Require(Positive(s.core_radius_m), where + "core_radius_m must be positive");
    Require(NotNegative(s.bending_damping_Nms), where + "bending_damping_Nms must not be negative");
    Require(!s.tendons.empty(), where + "needs at least 1 tendon");
    const int first_tendon = tendons();
    for (const TendonRoute& t : s.tendons) {
      Require(std::isfinite(t.angle_rad), where + "tendon angle must be finite");
      Require(Positive(t.radius_m), where + "tendon radius must be positive");
      tendons_.push_back({static_cast<int>(k), std::cos(t.angle_rad), std::sin(t.angle_rad), t.radius_m});
    }
    units_ += s.units;
    Require(units_ <= kMaxUnits, "more than " + std::to_string(kMaxUnits) + " units");
    first_unit_.push_back(units_);
    for (int i = 0; i < s.units; ++i) {
      unit_.push_back({s.unit_length_m, s.unit_mass_kg, s.disk_inertia_xx_kgm2, s.disk_inertia_zz_kgm2,
                       s.UnitStiffness(), s.bending_damping_Nms, first_tendon, 0, 0});
    }
  }
  Require(tendons() <= kMaxTendons, "more than " + std::to_string(kMaxTendons) + " tendons");
  unit_.back().mass_kg += parameters_.tip_payload_kg;
  for (const UnitDeviation& d : parameters_.unit_deviations) {
    const std::string where = "unit " + std::to_string(d.unit) + ": ";
    Require(d.unit >= 1 && d.unit <= units_, where + "there are units 1.." + std::to_string(units_));
    Require(Positive(d.stiffness_scale), where + "stiffness_scale must be positive");
    Require(std::isfinite(d.rest_u_rad) && std::isfinite(d.rest_v_rad), where + "rest bend must be finite");
    UnitConstants& unit = unit_[d.unit - 1];
    unit.stiffness_Nm *= d.stiffness_scale;
    unit.rest_u = d.rest_u_rad;
    unit.rest_v = d.rest_v_rad;
  }
  if (parameters_.twist_rad_per_m != 0) {
    double mid_m = 0;  // arc length of the unit's middle
    for (int i = 0; i < units_; ++i) {
      mid_m += 0.5 * unit_[i].length_m;
      const double delta = 0.5 * parameters_.twist_rad_per_m * unit_[i].length_m;
      for (const SectionParameters& s : sections) {
        for (const TendonRoute& t : s.tendons) {
          const double angle = t.angle_rad + parameters_.twist_rad_per_m * mid_m;
          twisted_.push_back(
              {std::cos(angle), std::sin(angle), t.radius_m * std::cos(delta), t.radius_m * std::sin(delta)});
        }
      }
      mid_m += 0.5 * unit_[i].length_m;
    }
  }
}

// ---- kinematics ----

void Body::Poses(ConstVectorRef q, std::span<Pose> poses) const noexcept {
  Vec p = kZero;
  Mat r = kIdentity;
  for (int i = 0; i < units_; ++i) {
    Advance(unit_[i].length_m, q[2 * i], q[2 * i + 1], p, r);
    poses[i] = ToPose(p, r);
  }
}

Pose Body::TipPose(ConstVectorRef q) const noexcept {
  Vec p = kZero;
  Mat r = kIdentity;
  for (int i = 0; i < units_; ++i) Advance(unit_[i].length_m, q[2 * i], q[2 * i + 1], p, r);
  return ToPose(p, r);
}

void Body::TipJacobian(ConstVectorRef q, MatrixRef jacobian) const noexcept {
  std::array<Joint, kMaxUnits> joints;
  Mat r = kIdentity;
  for (int i = 0; i < units_; ++i) {
    const double u = q[2 * i], v = q[2 * i + 1];
    const Stumpffs c = Stumpff(u * u + v * v);
    PlaceJoint(r, unit_[i].length_m, u, v, c, joints[i]);
    r = Turn(r, u, v, c);
  }
  Vec to_tip = kZero;  // from B to the tip
  for (int i = units_ - 1; i >= 0; --i) {
    const Joint& j = joints[i];
    jacobian.col(2 * i).head<3>() = (j.jv_u + Cross(j.jw_u, to_tip)).eigen();
    jacobian.col(2 * i).tail<3>() = j.jw_u.eigen();
    jacobian.col(2 * i + 1).head<3>() = (j.jv_v + Cross(j.jw_v, to_tip)).eigen();
    jacobian.col(2 * i + 1).tail<3>() = j.jw_v.eigen();
    to_tip += j.p;
  }
}

// ---- tendons ----

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

// ---- dynamics ----

void Body::InverseDynamics(ConstVectorRef q, ConstVectorRef dq, ConstVectorRef ddq, VectorRef force_Nm,
                           Workspace& workspace) const noexcept {
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

  ArticulatedInertia
      all;  // everything from disk i to the tip, about the origin of B, its joints free to yield
  Vec f = kZero + -Vec(parameters_.tip_force_W_N), n = kZero;
  for (int i = units_ - 1; i >= 0; --i) {
    const UnitConstants& k = unit_[i];
    Workspace::Unit& b = unit[i];
    const Joint& j = b.joint;
    all.mass.AddDiagonal(k.mass_kg);
    all.inertia.AddDiagonal(k.inertia_xx);
    all.inertia.AddSquare(k.inertia_zz - k.inertia_xx, b.z);
    n += b.n;

    b.uf_u = all.mass * j.jv_u + all.cross * j.jw_u;
    b.uf_v = all.mass * j.jv_v + all.cross * j.jw_v;
    b.un_u = all.cross.TransposeTimes(j.jv_u) + all.inertia * j.jw_u;
    b.un_v = all.cross.TransposeTimes(j.jv_v) + all.inertia * j.jw_v;
    const double h_uu = j.jv_u.dot(b.uf_u) + j.jw_u.dot(b.un_u);
    const double h_uv = j.jv_u.dot(b.uf_v) + j.jw_u.dot(b.un_v);
    const double h_vv = j.jv_v.dot(b.uf_v) + j.jw_v.dot(b.un_v);
    const double inverse = 1 / (h_uu * h_vv - h_uv * h_uv);
    b.d_uu = h_vv * inverse;
    b.d_uv = -h_uv * inverse;
    b.d_vv = h_uu * inverse;
    b.t_u -= j.jv_u.dot(f) + j.jw_u.dot(n);
    b.t_v -= j.jv_v.dot(f) + j.jw_v.dot(n);
    if (i == 0) break;

    // Seen from A, the unit yields along its joint; the rest of its inertia and force is passed on.
    const Vec wf_u = b.d_uu * b.uf_u + b.d_uv * b.uf_v, wf_v = b.d_uv * b.uf_u + b.d_vv * b.uf_v;
    const Vec wn_u = b.d_uu * b.un_u + b.d_uv * b.un_v, wn_v = b.d_uv * b.un_u + b.d_vv * b.un_v;
    all.mass.SubtractOuter(wf_u, b.uf_u, wf_v, b.uf_v);
    all.inertia.SubtractOuter(wn_u, b.un_u, wn_v, b.un_v);
    all.cross.x += -b.un_u.x * wf_u + -b.un_v.x * wf_v;
    all.cross.y += -b.un_u.y * wf_u + -b.un_v.y * wf_v;
    all.cross.z += -b.un_u.z * wf_u + -b.un_v.z * wf_v;
    f += all.mass * b.bias_v + all.cross * b.bias_w + b.t_u * wf_u + b.t_v * wf_v;
    n += all.cross.TransposeTimes(b.bias_v) + all.inertia * b.bias_w + b.t_u * wn_u + b.t_v * wn_v;

    n += Cross(j.p, f);
    all.Shift(j.p);
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

// ---- statics ----

void Body::StaticForce(ConstVectorRef q, const Eigen::Vector3d& tip_force_W_N,
                       VectorRef force_Nm) const noexcept {
  std::array<Joint, kMaxUnits> joints;
  Mat r = kIdentity;
  for (int i = 0; i < units_; ++i) {
    const double u = q[2 * i], v = q[2 * i + 1];
    const Stumpffs c = Stumpff(u * u + v * v);
    PlaceJoint(r, unit_[i].length_m, u, v, c, joints[i]);
    r = Turn(r, u, v, c);
  }
  const Vec gravity(parameters_.gravity_W_mps2);
  Vec f = Vec(tip_force_W_N) + Vec(parameters_.tip_force_W_N), n = kZero;
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
  std::array<Joint, kMaxUnits> joints;
  Mat r = kIdentity;
  for (int i = 0; i < units_; ++i) {
    const double u = q[2 * i], v = q[2 * i + 1];
    const Stumpffs c = Stumpff(u * u + v * v);
    PlaceJoint(r, unit_[i].length_m, u, v, c, joints[i]);
    r = Turn(r, u, v, c);
  }
  Vec f = kZero, n = kZero;
  for (int i = units_ - 1; i >= 0; --i) {
    const Joint& j = joints[i];
    f += Vec(force_W_N.col(i));
    force_Nm[2 * i] = j.jv_u.dot(f) + j.jw_u.dot(n);
    force_Nm[2 * i + 1] = j.jv_v.dot(f) + j.jw_v.dot(n);
    n += Cross(j.p, f);
  }
}

void Body::TangentStiffness(ConstVectorRef q, ConstVectorRef tension_N, const Eigen::Vector3d& tip_force_W_N,
                            MatrixRef stiffness) const noexcept {
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
  Vec f = Vec(tip_force_W_N) + Vec(parameters_.tip_force_W_N), n = kZero;
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

    // Within the unit: second derivatives of p and of the angular velocity, with F and the moment in the axes
    // of A.
    const Vec fa = r_wa[i].TransposeTimes(f), na = r_wa[i].TransposeTimes(n);
    const double d1 = c[3] - c[2], d2 = 2 * c[4] - c[3], d3 = 3 * c[5] - c[4];
    const double e1 = d3 - d2, e2 = 8 * c[6] - 5 * c[5] + c[4];
    const double uu = u * u, uv = u * v, vv = v * v;
    const Vec p_uu(u * (3 * d2 + uu * e2), v * (d2 + uu * e2), d1 + uu * e1);
    const Vec p_uv(v * (d2 + uu * e2), u * (d2 + vv * e2), uv * e1);
    const Vec p_vv(u * (d2 + vv * e2), v * (3 * d2 + vv * e2), d1 + vv * e1);
    const Vec w_uu(-v * (c[3] + uu * d3), -u * vv * d3, -uv * d2);                        // d jw_u / du
    const Vec w_uv(-u * (c[3] + vv * d3), -v * (2 * c[3] + vv * d3), -(c[2] + vv * d2));  // d jw_u / dv
    const Vec w_vv(uu * v * d3, u * (c[3] + vv * d3), uv * d2);                           // d jw_v / dv

    while (twisted_.empty() && counted > k.first_tendon) {
      const Tendon& t = tendons_[--counted];
      sum += tension_N[counted];
      moment_u += tension_N[counted] * t.radius_m * t.cos_angle;
      moment_v += tension_N[counted] * t.radius_m * t.sin_angle;
    }
    const Chord chord = ChordOf(uu + vv);
    const double lever = sum * l - (u * moment_u + v * moment_v);
    const Vec turn_v = turning * j.jw_v;
    stiffness(2 * i, 2 * i) = k.stiffness_Nm + lever * (chord.slope + uu * chord.bend) -
                              2 * u * moment_u * chord.slope - l * fa.dot(p_uu) - na.dot(w_uu) -
                              j.jw_u.dot(turning * j.jw_u);
    stiffness(2 * i, 2 * i + 1) = stiffness(2 * i + 1, 2 * i) =
        lever * uv * chord.bend - (u * moment_v + v * moment_u) * chord.slope - l * fa.dot(p_uv) -
        na.dot(w_uv) - j.jw_u.dot(turn_v);
    stiffness(2 * i + 1, 2 * i + 1) = k.stiffness_Nm + lever * (chord.slope + vv * chord.bend) -
                                      2 * v * moment_v * chord.slope - l * fa.dot(p_vv) - na.dot(w_vv) -
                                      j.jw_v.dot(turn_v);
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
}

// ---- constant curvature over sections ----

void Body::SpreadBending(ConstVectorRef us_vs, VectorRef q) const noexcept {
  for (int s = 0; s < sections(); ++s) {
    const double share = end_unit(s) - first_unit(s);
    for (int i = first_unit(s); i < end_unit(s); ++i) {
      q[2 * i] = us_vs[2 * s] / share;
      q[2 * i + 1] = us_vs[2 * s + 1] / share;
    }
  }
}

void Body::SumBending(ConstVectorRef q, VectorRef us_vs) const noexcept {
  us_vs.setZero();
  for (int s = 0; s < sections(); ++s) {
    for (int i = first_unit(s); i < end_unit(s); ++i) {
      us_vs[2 * s] += q[2 * i];
      us_vs[2 * s + 1] += q[2 * i + 1];
    }
  }
}

void Body::ProjectForce(ConstVectorRef force_Nm, VectorRef section_force_Nm) const noexcept {
  // Equal shares of us move each unit by us / n, so a section's force is the mean of its units'.
  SumBending(force_Nm, section_force_Nm);
  for (int s = 0; s < sections(); ++s) section_force_Nm.segment<2>(2 * s) /= end_unit(s) - first_unit(s);
}

}  // namespace tendril::model
