// Curves of bending through given points or along given tip paths, and their timing: from rest to rest within
// limits of rate, acceleration and jerk. Knows nothing of how a robot is driven.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "tendril/core/limits.h"
#include "tendril/core/robot.h"
#include "tendril/model/body.h"

namespace tendril::motion {

/// A point of a path that the robot cannot reach; what() is the whole line.
class PathError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Cubic spline through rows of values over increasing knots: two continuous derivatives, the second zero at
/// both ends. Two rows make a straight line.
class Spline {
 public:
  /// knots (n), values (n x d), n >= 2. Throws std::invalid_argument when the knots do not increase.
  Spline(Eigen::VectorXd knots, Eigen::MatrixXd values);

  struct Point {
    Eigen::VectorXd value, first, second, third;  // derivatives by the knots' variable
  };
  Point At(double s) const;
  double begin() const { return knots_[0]; }
  double end() const { return knots_[knots_.size() - 1]; }
  const Eigen::VectorXd& knots() const { return knots_; }

 private:
  Eigen::VectorXd knots_;
  Eigen::MatrixXd values_, seconds_;  // second derivatives at the knots
};

/// Limits on (us, vs) of each section, as under trajectory in the daemon's file.
struct PathLimits {
  double rate_radps = 0, acceleration_radps2 = 0, jerk_radps3 = 0;
};

/// Ratios of a motion to its limits at one moment: 1 is at a limit, less is within.
struct LimitUse {
  double rate = 0, acceleration = 0, jerk = 0;
  /// Factor by which time must be stretched to meet all limits.
  double stretch() const;
};
LimitUse UseOf(const PathLimits& limits, const Eigen::VectorXd& rate, const Eigen::VectorXd& acceleration,
               const Eigen::VectorXd& jerk);

/// Position on a curve over time, from rest to rest. The fastest run within rate and acceleration alone (a
/// forward and a backward pass over the curve) is averaged over a moving window, which bounds the jerk;
/// shares of the limits and the window are searched for the least time at which everything holds on a dense
/// grid of times.
class PathTiming {
 public:
  PathTiming(const Spline& curve, const PathLimits& limits);

  struct Point {
    double s, rate, acceleration, jerk;  // along the knots' variable
  };
  Point At(double t_s) const;
  double duration_s() const { return duration_s_; }
  /// Duration of the fastest run without a jerk limit: a lower bound.
  double bound_s() const { return bound_s_; }

 private:
  struct Profile;
  struct Search;
  struct Knot {
    double t, s, rate, acceleration, integral;  // integral of s over t
  };
  Knot Unaveraged(double t) const;
  Point Averaged(double t) const;

  std::vector<Knot> knots_;
  double window_s_ = 0, stretch_ = 1, duration_s_ = 0, bound_s_ = 0;
};

/// Bendings of tip points, each from the one before it. `names` names the points in errors. Points out of
/// reach by more than a thousandth of the robot's length are a PathError unless `nearest`: then the nearest
/// reachable point is taken, up to kNearestShare of that length; a farther point is taken as a mistake in the
/// unit.
class TipSolver {
 public:
  static constexpr double kNearestShare = 0.5;

  TipSolver(const RobotParameters& robot, bool nearest);
  Eigen::VectorXd Solve(const Eigen::Vector3d& tip_W_m, const std::string& name);
  /// Distance of the last point from the nearest reachable one [m].
  double distance_m() const { return distance_m_; }
  /// The greatest such distance of all points so far that counts as out of reach, else 0.
  double farthest_m() const { return farthest_m_; }

 private:
  RobotParameters robot_;
  model::Body body_;
  bool nearest_;
  double distance_m_ = 0, farthest_m_ = 0;
  BendingVector last_;
};

/// Throws PathError when the curve bends a section beyond the robot's limit, naming the place: between which
/// of its knots, called `knots`, or without a name the position along it.
void RequireWithinBend(const Spline& curve, const RobotParameters& robot, const char* knots = nullptr);

/// A smooth curve through bendings (n x 2K), n >= 2, each different from the next. Throws PathError when the
/// curve bends a section beyond the robot's limit.
Spline ThroughPoints(const Eigen::MatrixXd& bending_rad, const RobotParameters& robot);

/// A path of the tip, for u from 0 to 1 in proportion to its length.
struct TipPath {
  std::function<Eigen::Vector3d(double u)> at;
  double turns = 1;  // length and curvature in turns of a circle, at least 1
  Eigen::Vector3d operator()(double u) const { return at(u); }
};
/// The circle's arc from the first point through the second to the third. Throws PathError when they lie on
/// one line.
TipPath ArcThrough(const Eigen::Vector3d& from, const Eigen::Vector3d& through, const Eigen::Vector3d& to);
/// From `from` by `angle_rad` around `centre`, right-handed about `normal`. Throws PathError unless `from`
/// lies in the plane through the centre.
TipPath ArcAround(const Eigen::Vector3d& centre, const Eigen::Vector3d& normal, const Eigen::Vector3d& from,
                  double angle_rad);
TipPath LineTo(const Eigen::Vector3d& from, const Eigen::Vector3d& to);
/// The bending along a path of the tip, from the bending that `solver` found last.
Spline AlongTip(const TipPath& path, const std::string& name, TipSolver& solver,
                const RobotParameters& robot);

}  // namespace tendril::motion
