// Single values and vectors of messages, to and from those of structs. Shared by the wire's files.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "tendril/core/cycle.h"
#include "tendril/io/client.h"

namespace tendril::io {

inline constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

template <class Vector>
void Fill(std::vector<double>& out, const Vector& values, int n) {
  out.resize(static_cast<std::size_t>(n));
  if (values.size() == n) {
    std::copy(values.data(), values.data() + n, out.begin());
  } else {
    std::fill(out.begin(), out.end(), kNaN);
  }
}

inline void Fill(double (&out)[3], const Eigen::Vector3d& v) { std::copy(v.data(), v.data() + 3, out); }

inline void Fill(double (&out)[4], const Eigen::Quaterniond& q) {
  out[0] = q.w();
  out[1] = q.x();
  out[2] = q.y();
  out[3] = q.z();
}

template <class Vector>
void FromArray(const std::vector<double>& values, int n, Vector& out) {
  out.resize(n);
  std::copy(values.begin(), values.begin() + n, out.data());
}

inline Eigen::Vector3d FromArray(const double (&v)[3]) { return {v[0], v[1], v[2]}; }
inline Eigen::Quaterniond TakeQuaternion(const double (&q)[4]) { return {q[0], q[1], q[2], q[3]}; }

template <class To, class From>
void Number(To& to, From from) {
  to = static_cast<To>(from);
}

inline void TakeSequence(std::int64_t as_sent, Command& c) {
  Number(c.sequence, as_sent);
  c.sender = SenderOf(as_sent);
}

}  // namespace tendril::io
