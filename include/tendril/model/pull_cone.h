// Which ways tendons bend a section. They only pull, so what they reach together is a cone of directions;
// against them works nothing but the backbone.
#pragma once

#include <Eigen/Core>

#include "tendril/core/robot.h"
#include "tendril/model/body.h"

namespace tendril::model {

/// Directions of bend (us, vs) into which a section's own tendons pull it: from `from_rad` in [0, 2 pi)
/// counter-clockwise over `width_rad`; of a line its two ends only.
struct PullCone {
  enum class Kind { kRay, kLine, kWedge, kHalfPlane, kPlane };
  Kind kind = Kind::kPlane;
  double from_rad = 0, width_rad = 0;

  bool on_line() const noexcept { return kind == Kind::kRay || kind == Kind::kLine; }
  /// The bend of the cone that is nearest to this one.
  Eigen::Vector2d Nearest(const Eigen::Vector2d& bend_rad) const noexcept;
};

/// Of a section of this body, from 0; holes of a twisted robot where they are in the section's middle. Holes
/// that are opposite, or alike, to within 10 mrad count as such: files round pi, and drills are no better.
PullCone PullConeOf(const BodyParameters& body, int section);

/// Tendons pull every section every way.
bool PullsEveryWay(const BodyParameters& body);

/// Shape at rest under these tensions [rad], 2N entries; where none is stable, the straight one.
Eigen::VectorXd RestShape(const Body& body, ConstVectorRef tension_N);
/// The same with one tension on every tendon.
Eigen::VectorXd RestShape(const Body& body, double tension_N);

}  // namespace tendril::model
