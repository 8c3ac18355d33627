// The checks of recorded runs, one function per question. Knows nothing of models.
#pragma once

#include <Eigen/Core>
#include <string>
#include <utility>
#include <vector>

#include "tendril/core/robot.h"
#include "tendril/gap/data_set.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

/// A kind of channel: its matrix in a run, its name and its usual unit.
struct SignalKind {
  Eigen::MatrixXd Run::*matrix;
  const char* name;
  const char* unit;
  bool a_tendon;  // one column per tendon
};
inline constexpr SignalKind kTarget{&Run::torque_target_Nm, "target torque", "N m", true};
inline constexpr SignalKind kActual{&Run::torque_actual_Nm, "actual torque", "N m", true};
inline constexpr SignalKind kMotor{&Run::motor_position_rad, "motor position", "rad", true};
inline constexpr SignalKind kTension{&Run::tension_N, "tension", "N", true};
inline constexpr SignalKind kTip{&Run::tip_m, "tip position", "m", false};
inline constexpr SignalKind kDirection{&Run::tip_quaternion, "tip orientation", "", false};
inline constexpr SignalKind kBending{&Run::bending_rad, "bending", "rad", false};
inline constexpr SignalKind kKinds[] = {kTarget, kActual, kMotor, kTension, kTip, kDirection, kBending};

/// "tension 2", "tip position".
std::string ChannelOf(const SignalKind& kind, Eigen::Index column);

/// Checks a set, then each of its runs; findings in that order.
class Checkup {
 public:
  explicit Checkup(const DataSet& set) : set_(set), robot_(set.robot) {}

  std::vector<HealthFinding> All();

 private:
  using Severity = HealthFinding::Severity;
  using Matrix = Eigen::MatrixXd;

  const Matrix& Of(const SignalKind& kind) const { return run_->*kind.matrix; }
  /// Measured, with one row per sample.
  bool Fits(const SignalKind& kind) const {
    return Of(kind).cols() > 0 && Of(kind).rows() == run_->time_s.size();
  }
  Eigen::Index Tendons() const { return static_cast<Eigen::Index>(robot_.actuation->tendons.size()); }

  void Add(Severity severity, const std::string& run, const std::string& channel, double value,
           std::string text);
  /// About the run that is checked.
  void Add(Severity severity, const std::string& channel, double value, std::string text);

  void WholeSet();

  // In health_sampling.cpp.
  void Sampling();
  void Missing(const SignalKind& kind);
  void Constant(const SignalKind& kind);
  bool LoadChanges(Eigen::Index tendon) const;

  // In health_values.cpp.
  void Clipped(const SignalKind& kind);
  void Saturated();
  void Steps();
  /// A sensor is as noisy as its data sheet says; with less noise, its readings were filtered and fast
  /// changes are missing too.
  void Smoothed();
  void Units();
  /// Reports a channel whose range is far from the robot's; of the candidate units, names the one that brings
  /// it nearest to the middle of the usual range.
  void UnitsBy(const SignalKind& kind, double reached, double most, double least,
               const std::vector<std::pair<const char*, double>>& units);
  void TipUnits();
  void Signs();

  // In health_motion.cpp.
  void Rest();
  void Excitation();
  /// Largest angle of the tip's axis from its first direction; negative without orientation.
  double BendRange() const;
  /// Two signals of the same tendon rise and fall together. When several signals correlate far better with
  /// another tendon than with their own, columns are exchanged; if that other tendon also correlates with its
  /// own signal, the motion itself may be the reason.
  void Pairing(const SignalKind& from, const SignalKind& to);
  void TrackerClock();
  void Repetition();

  const DataSet& set_;
  const RobotParameters& robot_;
  const Run* run_ = nullptr;  // the one that is checked
  std::vector<HealthFinding> found_;
};

}  // namespace tendril::gap
