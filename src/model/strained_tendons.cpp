// The strained chain's tendons: straight from disk to disk over all units between, through holes that may be
// turned against each other.
#include <cmath>

#include "strained_chain.h"

namespace tendril::model {

StrainedChain::Line StrainedChain::LineOf(const Placed& placed, std::size_t span, int tendon) const noexcept {
  const auto first = static_cast<std::size_t>(spans_[span].first_unit);
  const auto end = static_cast<std::size_t>(spans_[span].end_unit);
  const Holes& holes = HolesOf(span, tendon);
  Line line;
  line.arm = placed.r[end] * holes.end;
  Vec way = line.arm + -(placed.r[first] * holes.begin);
  for (std::size_t i = first; i < end; ++i) way += placed.joints[i].p;
  line.length_m = std::sqrt(way.dot(way));
  line.direction = (1 / line.length_m) * way;
  return line;
}

void StrainedChain::TendonLengths(ConstVectorRef q, VectorRef length_m) const noexcept {
  Placed placed;
  Place(q, placed);
  length_m.setZero();
  for (std::size_t k = 0; k < spans_.size(); ++k) {
    for (int t = 0; t < tendons_; ++t) {
      if (Passes(t, k)) length_m[t] += LineOf(placed, k, t).length_m;
    }
  }
}

void StrainedChain::TendonShortening(ConstVectorRef q, VectorRef shortening_m) const noexcept {
  Placed placed;
  Place(q, placed);
  shortening_m.setZero();
  for (std::size_t k = 0; k < spans_.size(); ++k) {
    for (int t = 0; t < tendons_; ++t) {
      if (Passes(t, k)) shortening_m[t] += HolesOf(k, t).straight_m - LineOf(placed, k, t).length_m;
    }
  }
}

void StrainedChain::SpanShortening(ConstVectorRef q, MatrixRef shortening_m) const noexcept {
  Placed placed;
  Place(q, placed);
  shortening_m.setZero();
  for (std::size_t k = 0; k < spans_.size(); ++k) {
    for (int t = 0; t < tendons_; ++t) {
      if (!Passes(t, k)) continue;
      shortening_m(t, static_cast<Eigen::Index>(k)) =
          HolesOf(k, t).straight_m - LineOf(placed, k, t).length_m;
    }
  }
}

void StrainedChain::TendonShortening(ConstVectorRef q, VectorRef shortening_m,
                                     MatrixRef length_jacobian) const noexcept {
  Placed placed;
  Place(q, placed);
  shortening_m.setZero();
  length_jacobian.setZero();
  for (std::size_t k = 0; k < spans_.size(); ++k) {
    for (int t = 0; t < tendons_; ++t) {
      if (!Passes(t, k)) continue;
      const Line line = LineOf(placed, k, t);
      shortening_m[t] += HolesOf(k, t).straight_m - line.length_m;
      Vec moment = Cross(line.arm, line.direction);
      for (int i = spans_[k].end_unit - 1; i >= spans_[k].first_unit; --i) {
        const StrainedUnit& unit = units_[static_cast<std::size_t>(i)];
        const StrainJoint& j = placed.joints[static_cast<std::size_t>(i)];
        for (int a = 0; a < kStrains; ++a) {
          if (unit.Has(a))
            length_jacobian(t, unit.IndexOf(a)) = j.jv[a].dot(line.direction) + j.Turning(a).dot(moment);
        }
        moment += Cross(j.p, line.direction);
      }
    }
  }
}

void StrainedChain::TendonTurns(ConstVectorRef q, MatrixRef turn_rad) const noexcept {
  Placed placed;
  Place(q, placed);
  turn_rad.setZero();
  for (std::size_t k = 1; k < spans_.size(); ++k) {
    for (int t = 0; t < tendons_; ++t) {
      if (!Passes(t, k)) continue;
      const Vec before = LineOf(placed, k - 1, t).direction, after = LineOf(placed, k, t).direction;
      const Vec across = Cross(before, after);
      turn_rad(t, static_cast<Eigen::Index>(k) - 1) =
          std::atan2(std::sqrt(across.dot(across)), before.dot(after));
    }
  }
}

void StrainedChain::TendonForce(ConstVectorRef q, ConstVectorRef tension_N,
                                VectorRef force_Nm) const noexcept {
  Placed placed;
  Place(q, placed);
  for (std::size_t k = 0; k < spans_.size(); ++k) {
    Vec force = kZero, moment = kZero;  // of all tendons on the disk that ends the span
    for (int t = 0; t < tendons_; ++t) {
      if (!Passes(t, k)) continue;
      const Line line = LineOf(placed, k, t);
      const Vec pull = -tension_N[t] * line.direction;
      force += pull;
      moment += Cross(line.arm, pull);
    }
    for (int i = spans_[k].end_unit - 1; i >= spans_[k].first_unit; --i) {
      const StrainedUnit& unit = units_[static_cast<std::size_t>(i)];
      const StrainJoint& j = placed.joints[static_cast<std::size_t>(i)];
      for (int a = 0; a < kStrains; ++a) {
        if (unit.Has(a)) force_Nm[unit.IndexOf(a)] = j.jv[a].dot(force) + j.Turning(a).dot(moment);
      }
      moment += Cross(j.p, force);
    }
  }
}

}  // namespace tendril::model
