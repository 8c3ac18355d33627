// Vectors of three numbers and matrices of three columns that stay in registers. Know nothing of robots.
#pragma once

#include <Eigen/Core>

namespace tendril::model {

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

inline constexpr Mat kIdentity{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
inline constexpr Vec kZero(0, 0, 0);

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

}  // namespace tendril::model
