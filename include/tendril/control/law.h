// The interface of a control law: which tensions at the base hold and move the reference shape. A law knows
// nothing of modes, commands and the bus. All laws of the daemon file are rows of one table.
#pragma once

#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "tendril/core/cycle.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"
#include "tendril/model/body.h"
#include "tendril/model/capstan.h"

namespace tendril::control {

class StateArchive;

/// What a law is built from. The references outlive the law.
struct LawSetup {
  const RobotParameters& robot;
  const ControllerParameters& parameters;
  const model::Body& body;                                                // of `robot`
  const std::vector<std::shared_ptr<const model::CapstanTable>>& tables;  // one per tendon
  LimitParameters limits;  // of commanded tensions: the robot's, less a margin
  double period_s = 0;
  double gather_s = 0;            // a reference changes its rate by v at most at v / gather_s
  TimeNs actuation_delay_ns = 0;  // from the reference to the torque that follows it
  double tension_loop_radps = 0;  // bandwidth of the tension feedback; 0: there is none
};

/// One cycle as a law sees it, beside the reference and the estimates in the cycle's output.
struct LawInput {
  const CycleInput& input;
  bool controls_shape = false;     // the law's tensions act; else it is only asked what it would command
  bool tension_commanded = false;  // tensions are commanded, and the shape follows from them
  bool joined = false;             // commanded tensions are the law's own; false: they still ramp to them
  double rotor_N = 0;              // largest tension that accelerated a rotor lately
  const TendonVector& tension_N;   // commanded at the base in the last cycle
  const TendonVector& displacement_desired_m;  // ... and the tendons' displacement
  const TendonVector& shortening_m;            // of each tendon's path, measured
  const TendonVector& pair_offset_N;           // what friction adds to both base tensions of pairs
  const TendonVector& weight;                  // of that measurement, from 0 (slack) to 1 (taut)
};

/// What a law answers, beside the output's fields.
struct LawSolution {
  bool continuous = true;  // false: tensions and paths have another source than in the last cycle
  bool has_paths = true;   // displacement_desired_m is the motion that belongs to the commanded tensions
  TendonVector arc_shortening_m;  // displacement of the reference arcs, without the tracker's correction
};

class Law {
 public:
  virtual ~Law() = default;
  /// Before tensions rise on the robot at rest.
  virtual void Reset() noexcept = 0;
  /// Every cycle, in every mode. Sets reference_tip_W_m, generalised_force_Nm, tension_desired_base_N and
  /// displacement_desired_m of `output` from its reference, and reports what limits them. No allocation,
  /// lock, system call or unbounded loop.
  virtual LawSolution Solve(const LawInput& cycle, CycleOutput& output) noexcept = 0;
  /// Everything that outlives a cycle; see state_archive.h.
  virtual void Archive(StateArchive& archive) noexcept = 0;
};

struct LawRow {
  std::string_view name;  // controller.law in the daemon file
  /// The drives' torque comes from a feed-forward of the motors' inertia and friction along the reference,
  /// with the load cells' feedback where configured. The reference then leads by the drives' delay. Else
  /// friction is compensated by the direction of sliding only.
  bool feeds_forward;
  std::unique_ptr<Law> (*make)(const LawSetup& setup);
};

/// In the order of enum ControlLaw.
std::span<const LawRow> Laws() noexcept;

}  // namespace tendril::control
