// The order of the checks, and those of the whole set.
#include "tendril/gap/health.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "health_checks.h"
#include "health_signal.h"

namespace tendril::gap {

std::string ChannelOf(const SignalKind& kind, Eigen::Index column) {
  return kind.a_tendon ? fmt::format("{} {}", kind.name, column + 1) : std::string(kind.name);
}

std::vector<HealthFinding> Checkup::All() {
  // Losses on reading come before advice on recording.
  for (const std::string& note : set_.notes) Add(Severity::kWarning, "", "files", 0, note);
  for (const Run& run : set_.runs) {
    for (const std::string& warning : run.warnings) Add(Severity::kWarning, run.name, "file", 0, warning);
  }
  WholeSet();
  for (const Run& run : set_.runs) {
    run_ = &run;
    if (run.time_s.size() < 2) continue;
    for (const std::string& note : run.notes) Add(Severity::kInfo, run.name, "file", 0, note);
    Sampling();
    for (const SignalKind& kind : kKinds) {
      if (!Fits(kind)) continue;
      Missing(kind);
      Constant(kind);
    }
    for (const SignalKind& kind : {kActual, kTension, kTip}) {
      if (Fits(kind)) Clipped(kind);
    }
    Saturated();
    Steps();
    Smoothed();
    Units();
    Signs();
    Rest();
    Excitation();
    Pairing(kTarget, kActual);
    Pairing(kActual, kTension);
    Pairing(kMotor, kTension);
    TrackerClock();
    Repetition();
  }
  return std::move(found_);
}

void Checkup::Add(Severity severity, const std::string& run, const std::string& channel, double value,
                  std::string text) {
  found_.push_back({severity, run, channel, std::isfinite(value) ? value : 0, std::move(text)});
}

void Checkup::Add(Severity severity, const std::string& channel, double value, std::string text) {
  Add(severity, run_->name, channel, value, std::move(text));
}

void Checkup::WholeSet() {
  std::set<std::string> families;
  bool repeats = false, tip = false, tension = false, torque = false, motor = false;
  double tension_range = 0, reversals = 0;
  for (const Run& run : set_.runs) {
    families.insert(run.family);
    repeats = repeats || !run.repeat_of.empty();
    tip = tip || run.tip_m.cols() > 0 || run.bending_rad.cols() > 0 || run.tip_quaternion.cols() > 0 ||
          run.disks_m.cols() > 0 || run.disk_quaternion.cols() > 0;
    tension = tension || run.tension_N.array().isFinite().any();
    torque = torque || run.torque_actual_Nm.cols() > 0;
    motor = motor || run.motor_position_rad.cols() > 0;
    run_ = &run;
    if (Fits(kTension)) {
      for (Eigen::Index j = 0; j < run.tension_N.cols(); ++j) {
        tension_range = std::max(tension_range, RangeOf(run.tension_N.col(j)).width());
      }
    }
    if (Fits(kMotor)) {
      for (Eigen::Index j = 0; j < run.motor_position_rad.cols(); ++j) {
        reversals = std::max(reversals, 1.0 * Reversals(run.motor_position_rad.col(j)));
      }
    }
  }
  const auto lacks = [&](bool there, const char* channel, const char* text) {
    if (!there) Add(Severity::kWarning, "", channel, 0, text);
  };
  lacks(tip, "tip position",
        "no run has a tip; the shape and the motion of the body (C4, C5) cannot be compared; add a tracker");
  lacks(tension, "tension",
        "no run has tensions; motors, pulleys and tendons (C2, C3) cannot be told apart; add a load cell");
  lacks(torque, "actual torque",
        "no run has actual torques; the current loop and the drivetrain (C1, C2) cannot be compared; log "
        "the drives' actual torque or current");
  lacks(motor, "motor position",
        "no run has motor positions; tendons and drivetrain (C2, C3) cannot be compared; log the encoders");
  lacks(repeats, "repetitions",
        "no run repeats another; the noise floor is taken from fast differences, which do not include "
        "imperfect repeatability; repeat at least one run unchanged and declare it by repeat_of");
  if (families.size() < 2) {
    Add(Severity::kWarning, "", "families", static_cast<double>(families.size()),
        "all runs are of one family; no family can be held out, so a cause cannot be tested on another "
        "kind of motion; record another family and name the families in runs.yaml");
  }
  if (tension && tension_range < 0.5) {
    Add(Severity::kWarning, "", "tension", tension_range,
        fmt::format("no tension changes by more than {:.2g} N over all runs; effects that grow with "
                    "tension cannot be told from those that do not; pull harder",
                    tension_range));
  }
  if (motor && reversals < 2) {
    Add(Severity::kWarning, "", "motor position", reversals,
        "no motor reverses twice in any run; friction, backlash and hysteresis cannot be told from wrong "
        "gains; record slow triangles");
  }
}

std::vector<HealthFinding> CheckHealth(const DataSet& set) { return Checkup(set).All(); }

}  // namespace tendril::gap
