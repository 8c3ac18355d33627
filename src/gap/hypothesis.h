// A hypothesis: one effect of the registry at one place, or several together, with parameter values. Makes a
// robot that has it. Knows nothing of data.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "tendril/core/robot.h"
#include "tendril/sim/effects.h"

namespace tendril::gap {

/// One effect at one place.
struct Candidate {
  const sim::Effect* effect = nullptr;
  sim::Target target;
  std::string where;
  std::vector<sim::EffectParameter> parameters{};  // at this place of the robot: sim::ParametersOf

  int size() const { return static_cast<int>(parameters.size()); }
  std::string Name() const { return std::string(effect->name) + (where == "all" ? "" : " " + where); }
  bool operator==(const Candidate& other) const { return effect == other.effect && target == other.target; }
};

/// A plainly visible change of a parameter: the unit of steps, starts and priors.
double ScaleOf(const sim::EffectParameter& parameter);

/// Standard deviation of the prior of an effect's parameter, in plainly visible deviations: nearly
/// unconstrained.
inline constexpr double kFlatPrior = 30;

/// All candidates of the registry for this robot, in its order.
std::vector<Candidate> AllCandidates(const RobotParameters& robot, bool load_cell, bool tracker);

/// Candidates that act together, with all their parameters in sequence.
struct Model {
  std::vector<Candidate> parts;
  Eigen::VectorXd values;
  /// Step of finite differences, in plainly visible deviations; small for effects that begin at a threshold.
  double derivative_step = 0.1;

  static Model Of(const Candidate& candidate);   // at nominal
  Model With(const Candidate& candidate) const;  // and this one at nominal
  Model Alone(int part) const;                   // one of its parts, with its values here
  int size() const { return static_cast<int>(values.size()); }
  /// Names of its parts: "backlash tendon:2 and torsion".
  std::string Name() const;
  const sim::EffectParameter& parameter(int k) const;
  /// The value that means no effect: the registry's, whatever the robot file has.
  double nothing(int k) const;
  /// Index of part i's first value in `values`.
  int offset(int part) const;
  /// `base` with these effects; a law that it already has is replaced by the model's.
  RobotParameters Robot(const RobotParameters& base) const;
};

}  // namespace tendril::gap
