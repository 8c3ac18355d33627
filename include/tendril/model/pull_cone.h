// The directions in which tendons bend a section. Tendons only pull, so these form a cone; only the backbone
// acts against them.
#pragma once

#include <Eigen/Core>

#include "tendril/core/robot.h"
#include "tendril/model/body.h"

namespace tendril::model {

/// Directions of bend (us, vs) in which a section's own tendons pull it: from `from_rad` in [0, 2 pi)
/// counter-clockwise over `width_rad`; of a line its two ends only.
struct PullCone {
  enum class Kind { kRay, kLine, kWedge, kHalfPlane, kPlane };
  Kind kind = Kind::kPlane;
  double from_rad = 0, width_rad = 0;

  bool on_line() const noexcept { return kind == Kind::kRay || kind == Kind::kLine; }
  /// The bend of the cone that is nearest to this one.
  Eigen::Vector2d Nearest(const Eigen::Vector2d& bend_rad) const noexcept;
};

/// The cone of a section (from 0) of this body; in a twisted robot with hole angles at the section's middle.
/// Holes within 10 mrad of opposite, or of equal, count as such, which covers rounding in files and drilling
/// tolerances.
PullCone PullConeOf(const BodyParameters& body, int section);

/// Turns holes that PullConeOf counts as opposite, or as equal, to where they are exactly so. What is left of
/// a bend across a line would otherwise be sought by all the tension there is.
void AlignHoles(BodyParameters& body);

/// Whether tendons pull every section in every direction.
bool PullsEveryWay(const BodyParameters& body);

/// Equilibrium shape under these tensions [rad], 2N entries; straight where none is stable.
Eigen::VectorXd RestShape(const Body& body, ConstVectorRef tension_N);
/// The same with equal tension on every tendon.
Eigen::VectorXd RestShape(const Body& body, double tension_N);

}  // namespace tendril::model
