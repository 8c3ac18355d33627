// The rig of section 5: tensions that a bend needs by the model, and what the whole closed loop does in
// simulated time.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <string>
#include <vector>

#include "study.h"
#include "tendril/core/cycle.h"
#include "tendril/model/body.h"

namespace tendril::qi2021 {

/// (us, vs) of a robot of one section.
BendingVector Bend(double theta_rad, double beta_rad);

/// The robot with another total length, its units equally long.
RobotParameters WithLength(RobotParameters robot, double length_m);

/// Tensions at the base that hold a bend of constant curvature at rest: model::ArcTensions, without an upper
/// limit to speak of. Throws std::runtime_error when there are none.
TendonVector NeededTensions(const model::Body& body, const BendingVector& us_vs, double min_tension_N);

/// What the pulleys take of a tendon that is pulled.
double PullLoss(const TransmissionParameters& transmission, double base_N);

struct Run {
  struct Sample {
    double target_s;
    BendingVector bend_rad;  // true
    Eigen::Vector3d tip_W_m, wanted_W_m;
    TendonVector desired_N, base_N, motor_N;  // desired and base: at the robot, motor: at the spool
  };
  std::vector<Sample> samples;  // every cycle of the motion's judged part
  double min_tension_N = 0;

  template <class Value>
  double Rms(Value value) const {
    double sum = 0;
    for (const Sample& s : samples) sum += value(s) * value(s);
    return std::sqrt(sum / static_cast<double>(samples.size()));
  }
  double TipRms_m() const {
    return Rms([](const Sample& s) { return (s.tip_W_m - s.wanted_W_m).norm(); });
  }
  /// Calls use(sample, tendon) where a tendon is commanded to carry a load, as the demo's figures do.
  template <class Use>
  void ForLoaded(Use use) const {
    for (const Sample& s : samples) {
      for (int j = 0; j < s.desired_N.size(); ++j) {
        if (s.desired_N[j] > min_tension_N + 0.05) use(s, j);
      }
    }
  }
};

/// A motion of motion::MakeMotion by the rig that the controller believes in. Throws std::runtime_error on a
/// fault.
Run Follow(Study& study, const RobotParameters& robot, const std::string& motion_name, bool compensation);

/// Every tenth cycle as a series.
void Write(Study& study, const std::string& name, const Run& run, int tendons);

}  // namespace tendril::qi2021
