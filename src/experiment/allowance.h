// What an experiment may ask of a robot: bends with a margin to every limit of the tendons and drives, and
// the tension commands that a motion needs. Knows the controller's static model, nothing of the experiments.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "tendril/control/compensation.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"
#include "tendril/model/arc_tensions.h"
#include "tendril/model/body.h"
#include "tendril/model/capstan.h"
#include "tendril/model/pull_cone.h"

namespace tendril::experiment {

// Time between targets; a divisor of the trajectory's averaging windows, so that a staircase of targets
// becomes a smooth motion.
inline constexpr double kStep_s = 0.005;
inline constexpr double kRestAfter_s = 0.3;
// Shares of the robot's limits used by an experiment; the rest is for overshoot and for a robot that differs
// from its file.
inline constexpr double kBaseShare = 0.75, kMotorShare = 0.9, kCommandShare = 0.9, kBendingShare = 0.95;
inline constexpr double kRateShare = 0.8;

/// Reference shapes on the grid of steps, with the minimum tension of any tendon during the motion.
struct Path {
  Eigen::MatrixXd bending_rad;
  Eigen::VectorXd level_N;
};

/// Largest bend of a section.
double SectionNorm(const Eigen::VectorXd& bending_rad);

class Allowance {
 public:
  Allowance(const RobotParameters& robot, const ControllerParameters& controller);

  int sections() const { return sections_; }
  int tendons() const { return tendons_; }
  double least_N() const { return robot_.limits.min_tension_N; }

  /// Bending of the whole robot by 1 rad in the plane at `beta_rad`: spread over the sections by length
  /// (pattern 0), or all in section `pattern`. Where a section's tendons do not pull in every direction, the
  /// part in their directions, with the plane counted from the first of these.
  Eigen::VectorXd Direction(double beta_rad, int pattern = 0) const;
  /// Maps rows of bends in every direction into the directions that tendons pull: along a line, or about the
  /// middle of a wedge.
  void IntoPulled(Eigen::MatrixXd& rows) const;
  /// Whether tendons pull towards the bend, within a thousandth of an arc's length at its tip.
  bool Pulled(const Eigen::VectorXd& bending_rad) const;
  /// Ways to spread a bend over the sections.
  int patterns() const { return sections_ == 1 ? 1 : sections_ + 1; }

  /// Base tensions that hold a bend at rest with none below `level_N`, or that come nearest where tendons do
  /// not pull in every direction; empty when there are none within the robot's limit.
  Eigen::VectorXd Tensions(const Eigen::VectorXd& bending_rad, double level_N);

  /// Whether a bend can be held, and reached, with a margin to every limit; `commanded`: by tension targets,
  /// which then include friction.
  bool Allowed(const Eigen::VectorXd& bending_rad, double level_N, bool commanded);

  /// Largest share of `bending_rad`, at most 1, that is allowed all the way from straight.
  double Share(const Eigen::VectorXd& bending_rad, double level_N, bool commanded);
  /// The bend of `amplitude_rad` in a direction, reduced to the allowed share.
  Eigen::VectorXd Bend(double amplitude_rad, double beta_rad, int pattern, double level_N, bool commanded);
  /// Bend that is allowed in every plane.
  double EveryPlane(double amplitude_rad);

  const model::CapstanTable& table(int j) const { return *tables_[static_cast<std::size_t>(j)]; }

  /// A tension command drives the motors as if nothing slid. These commands add what a motion needs: its
  /// inertia, the rotors', and friction along the planned sliding. One row per step.
  Eigen::MatrixXd TensionCommands(const Path& path);
  /// Tension command with this torque when nothing slides; at least the minimum tension.
  double CommandFor(int j, double torque_Nm) const;
  /// Torque that pulls against this tension at the base.
  double PullTorque(int j, double tension_N) const;

 private:
  RobotParameters robot_;
  model::Body body_;
  model::ArcTensions arcs_;
  int sections_, tendons_;
  Eigen::VectorXd q_;
  std::vector<std::shared_ptr<const model::CapstanTable>> tables_;
  std::vector<control::Compensation> law_;
  std::vector<model::PullCone> cones_;
};

}  // namespace tendril::experiment
