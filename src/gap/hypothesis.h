// A hypothesis: one effect of the registry at one place, or several together, with the values of its
// parameters. Turns into a robot that has it. Knows nothing of data.
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

/// A plainly visible change of a parameter: what steps, starts and priors are measured in.
double ScaleOf(const sim::EffectParameter& parameter);

/// All that the registry has for this robot, in its order.
std::vector<Candidate> AllCandidates(const RobotParameters& robot, bool load_cell, bool tracker);

/// Candidates that hold together, with all their parameters one after the other.
struct Model {
  std::vector<Candidate> parts;
  Eigen::VectorXd values;
  /// Differences for derivatives, in plainly visible deviations: small where an effect begins at a threshold.
  double derivative_step = 0.1;

  static Model Of(const Candidate& candidate);   // at nominal
  Model With(const Candidate& candidate) const;  // and this one at nominal
  int size() const { return static_cast<int>(values.size()); }
  /// Of its parts: "backlash tendon:2 and torsion".
  std::string Name() const;
  const sim::EffectParameter& parameter(int k) const;
  /// Its value without the effect: that of the registry, whatever law the robot file has.
  double nothing(int k) const;
  /// First value of part i in `values`.
  int offset(int part) const;
  /// `base` with these effects; a law that it has there already is as the model says.
  RobotParameters Robot(const RobotParameters& base) const;
};

}  // namespace tendril::gap
