// The strained chain at rest: forces that hold a shape, and how they change with it.
#include "strained_chain.h"

namespace tendril::model {

void StrainedChain::Load::Count(const Vec& f, const Vec& arm) {
  moment += Cross(arm, f);
  turning.x += f.x * arm;
  turning.y += f.y * arm;
  turning.z += f.z * arm;
  const double trace = arm.dot(f);
  turning.x.x -= trace;
  turning.y.y -= trace;
  turning.z.z -= trace;
}

void StrainedChain::StaticForce(ConstVectorRef q, const TipWrench& tip, VectorRef force_Nm) const noexcept {
  Placed placed;
  Place(q, placed);
  Vec f = Vec(tip.force_W_N) + tip_force_, n = Vec(tip.moment_W_Nm);
  for (std::size_t i = units_.size(); i-- > 0;) {
    const StrainedUnit& unit = units_[i];
    const StrainJoint& j = placed.joints[i];
    const Strains at = unit.At(q);
    f += unit.mass_kg * gravity_;
    for (int a = 0; a < kStrains; ++a) {
      if (!unit.Has(a)) continue;
      force_Nm[unit.IndexOf(a)] =
          unit.stiffness[a] * (at[a] - unit.rest[a]) - j.jv[a].dot(f) - j.Turning(a).dot(n);
    }
    n += Cross(j.p, f);
  }
}

void StrainedChain::DiskForce(ConstVectorRef q, const Eigen::Ref<const Eigen::Matrix3Xd>& force_W_N,
                              VectorRef force_Nm) const noexcept {
  Placed placed;
  Place(q, placed);
  Vec f = kZero, n = kZero;
  for (std::size_t i = units_.size(); i-- > 0;) {
    const StrainJoint& j = placed.joints[i];
    f += Vec(force_W_N.col(static_cast<Eigen::Index>(i)));
    for (int a = 0; a < kStrains; ++a) {
      if (units_[i].Has(a)) force_Nm[units_[i].IndexOf(a)] = j.jv[a].dot(f) + j.Turning(a).dot(n);
    }
    n += Cross(j.p, f);
  }
}

void StrainedChain::TangentStiffness(ConstVectorRef q, ConstVectorRef tension_N, const TipWrench& tip,
                                     MatrixRef stiffness) const noexcept {
  Placed placed;
  Place(q, placed);
  stiffness.setZero();
  Load load;
  load.Add(Vec(tip.force_W_N) + tip_force_, kZero);
  for (int i = static_cast<int>(units_.size()) - 1; i >= 0; --i) {
    const StrainedUnit& unit = units_[static_cast<std::size_t>(i)];
    load.Add(unit.mass_kg * gravity_, kZero);
    AddSecondDerivatives(placed, i, 0, q, load, stiffness);
    load.ShiftBy(placed.joints[static_cast<std::size_t>(i)].p);
    for (int a = 0; a < kStrains; ++a) {
      if (unit.Has(a)) stiffness(unit.IndexOf(a), unit.IndexOf(a)) += unit.stiffness[a];
    }
  }
  for (std::size_t k = 0; k < spans_.size(); ++k) AddTendons(placed, k, q, tension_N, stiffness);
  if (!tip.moment_W_Nm.isZero(0)) AddTipMoment(placed, q, Vec(tip.moment_W_Nm), stiffness);
}

// Subtracts the derivatives of the generalised forces of `load`, constant forces beyond the end of `unit`, by
// the unit's strains, for the units from `lowest` to this one.
void StrainedChain::AddSecondDerivatives(const Placed& placed, int unit, int lowest, ConstVectorRef q,
                                         const Load& load, MatrixRef stiffness) const noexcept {
  const auto i = static_cast<std::size_t>(unit);
  const StrainedUnit& b = units_[i];
  const StrainJoint& j = placed.joints[i];
  const Strains at = b.At(q);
  const StrainCurvature bent(b.length_m, at, StrainSeries(at));
  const Vec fa = placed.r[i].TransposeTimes(load.force), na = placed.r[i].TransposeTimes(load.moment);
  for (int c = 0; c < kStrains; ++c) {
    if (!b.Has(c)) continue;
    const int column = b.IndexOf(c);
    const Vec turned = load.turning * j.Turning(c);
    for (int a = 0; a <= c; ++a) {
      if (!b.Has(a)) continue;
      double slope = fa.dot(bent.p[a][c]) + j.Turning(a).dot(turned);
      if (c < kTurns) slope += na.dot(bent.w[a][c]);
      stiffness(b.IndexOf(a), column) -= slope;
      if (a != c) stiffness(column, b.IndexOf(a)) -= slope;
    }
    // Change of the moment about the origin of A when this unit strains, as it acts on the units below.
    const Vec y = Cross(j.jv[c], load.force) + turned;
    for (int below = unit - 1; below >= lowest; --below) {
      const StrainedUnit& g = units_[static_cast<std::size_t>(below)];
      for (int a = 0; a < kTurns; ++a) {
        if (!g.Has(a)) continue;
        const double slope = placed.joints[static_cast<std::size_t>(below)].jw[a].dot(y);
        stiffness(g.IndexOf(a), column) -= slope;
        stiffness(column, g.IndexOf(a)) -= slope;
      }
    }
  }
}

// Sum of T d2L: as a constant pull at the hole, and its change as the line turns, (d_a . d_b - (n . d_a)(n .
// d_b)) T/L with d_a the hole's motion by strain a.
void StrainedChain::AddTendons(const Placed& placed, std::size_t span, ConstVectorRef q,
                               ConstVectorRef tension_N, MatrixRef stiffness) const noexcept {
  const Span& s = spans_[span];
  const auto end = static_cast<std::size_t>(s.end_unit);
  Load pull;
  std::array<Vec, kStrains * kMaxUnits>
      across;  // d_a less its part along the line, by coordinate of the span
  const int first = units_[static_cast<std::size_t>(s.first_unit)].IndexOf(0);
  const int count = units_[end - 1].end() - first;
  for (int t = 0; t < tendons_; ++t) {
    if (!Passes(t, span)) continue;
    const Line line = LineOf(placed, span, t);
    pull.Add(-tension_N[t] * line.direction, line.arm);
    Vec arm = line.arm;
    for (std::size_t i = end; i-- > static_cast<std::size_t>(s.first_unit);) {
      const StrainJoint& j = placed.joints[i];
      for (int a = 0; a < kStrains; ++a) {
        if (!units_[i].Has(a)) continue;
        const Vec motion = j.jv[a] + Cross(j.Turning(a), arm);
        across[static_cast<std::size_t>(units_[i].IndexOf(a) - first)] =
            motion + (-motion.dot(line.direction)) * line.direction;
      }
      arm += j.p;
    }
    const double stretch = tension_N[t] / line.length_m;
    for (int c = 0; c < count; ++c) {
      for (int a = 0; a <= c; ++a) {
        const double added =
            stretch * across[static_cast<std::size_t>(a)].dot(across[static_cast<std::size_t>(c)]);
        stiffness(first + a, first + c) += added;
        if (a != c) stiffness(first + c, first + a) += added;
      }
    }
  }
  for (int i = s.end_unit - 1; i >= s.first_unit; --i) {
    AddSecondDerivatives(placed, i, s.first_unit, q, pull, stiffness);
    pull.ShiftBy(placed.joints[static_cast<std::size_t>(i)].p);
  }
}

// A constant moment M has the generalised force jw_a . M, and jw_a turns with the units before its own alone.
void StrainedChain::AddTipMoment(const Placed& placed, ConstVectorRef q, const Vec& moment,
                                 MatrixRef stiffness) const noexcept {
  for (std::size_t i = 0; i < units_.size(); ++i) {
    const StrainedUnit& unit = units_[i];
    const Strains at = unit.At(q);
    const StrainCurvature bent(unit.length_m, at, StrainSeries(at));
    const Vec local = placed.r[i].TransposeTimes(moment);
    for (int a = 0; a < kTurns; ++a) {
      if (!unit.Has(a)) continue;
      for (int c = 0; c < kTurns; ++c) {
        if (unit.Has(c)) stiffness(unit.IndexOf(a), unit.IndexOf(c)) -= local.dot(bent.w[a][c]);
      }
      const Vec y = Cross(placed.joints[i].jw[a], moment);
      for (std::size_t below = 0; below < i; ++below) {
        for (int c = 0; c < kTurns; ++c) {
          if (units_[below].Has(c))
            stiffness(unit.IndexOf(a), units_[below].IndexOf(c)) -= placed.joints[below].jw[c].dot(y);
        }
      }
    }
  }
}

}  // namespace tendril::model
