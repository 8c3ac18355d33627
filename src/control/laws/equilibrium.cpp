// The equilibrium law: tensions for which every unit's balance, with weight and straight tendons, puts the
// section ends where the reference arcs have them, corrected by shape and tip feedback. Without a solution
// the arcs' tensions are used; the ramp bridges the change.
#include <algorithm>
#include <optional>

#include "../report.h"
#include "../tendon_side.h"
#include "tendril/control/arc_allocation.h"
#include "tendril/control/equilibrium_solver.h"
#include "tendril/control/law.h"
#include "tendril/control/shape_feedback.h"
#include "tendril/control/state_archive.h"
#include "tendril/control/tip_feedback.h"

namespace tendril::control {
namespace {

// Time constant of shape feedback relative to that of the tension loops below it; share of the motors' dry
// friction that it leaves alone at rest.
constexpr double kShapeFeedback = 10, kShapeRest = 0.1;
constexpr double kNearBound = 0.125;  // share of a tension's bound within which the approach slows down

class EquilibriumLaw final : public Law {
 public:
  explicit EquilibriumLaw(const LawSetup& setup);

  void Reset() noexcept override;
  LawSolution Solve(const LawInput& cycle, CycleOutput& output) noexcept override;
  void Archive(StateArchive& archive) noexcept override;

 private:
  LawSolution FollowTensions(const LawInput& cycle, CycleOutput& output) noexcept;
  LawSolution SolveForReference(const LawInput& cycle, CycleOutput& output) noexcept;
  void CorrectTip(const LawInput& cycle, CycleOutput& output) noexcept;
  BendingVector LackingMoment() const noexcept;
  double LeastTension(const LawInput& cycle) const noexcept;
  TendonVector MostTension(const LawInput& cycle) const noexcept;
  double HeldByFriction(const TendonVector& tension_N) const noexcept;

  const LawSetup setup_;
  ArcAllocation arcs_;
  EquilibriumSolver solver_;
  std::optional<ShapeFeedback> shape_feedback_;
  std::optional<TipFeedback> tip_feedback_;
  bool balanced_ = false;     // there was a solution in the last cycle
  bool at_limit_ = false;     // ... with a tendon at its tension limit
  UnitVector unit_force_Nm_;  // of this cycle only
};

// Largest moment by which a motor's dry friction holds its section.
double MotorFrictionMoment(const RobotParameters& robot) {
  double most_Nm = 0;
  int j = 0;
  for (const auto& section : robot.body.sections) {
    for (const auto& route : section.tendons)
      most_Nm = std::max(most_Nm, route.radius_m * FrictionAtSpool(robot.actuation->tendons[j++]));
  }
  return most_Nm;
}

EquilibriumLaw::EquilibriumLaw(const LawSetup& setup)
    : setup_(setup),
      arcs_(setup.body, model::TendonPairs(setup.robot)),
      solver_(setup.body, setup.limits, model::TendonPairs(setup.robot)),
      unit_force_Nm_(UnitVector::Zero(setup.body.dof())) {
  if (setup.parameters.shape_feedback) {
    shape_feedback_.emplace(setup.body, kShapeFeedback / setup.tension_loop_radps,
                            kShapeRest * MotorFrictionMoment(setup.robot), setup.period_s);
  }
  if (setup.parameters.tip_feedback) {
    tip_feedback_.emplace(*setup.robot.actuation->tracker, setup.robot.body.length_m(), setup.period_s);
  }
}

void EquilibriumLaw::Reset() noexcept {
  solver_.Reset();
  if (shape_feedback_) shape_feedback_->Reset();
}

LawSolution EquilibriumLaw::Solve(const LawInput& cycle, CycleOutput& output) noexcept {
  arcs_.AddFriction(cycle.pair_offset_N);
  solver_.AddFriction(cycle.pair_offset_N);
  const Status bound = arcs_.Step(setup_.limits, output);
  if (!cycle.controls_shape) {
    solver_.Reset();
    balanced_ = at_limit_ = false;
    return {.arc_shortening_m = output.displacement_desired_m};
  }
  Report(output, bound);
  if (tip_feedback_) CorrectTip(cycle, output);
  return cycle.tension_commanded ? FollowTensions(cycle, output) : SolveForReference(cycle, output);
}

void EquilibriumLaw::CorrectTip(const LawInput& cycle, CycleOutput& output) noexcept {
  Report(output, tip_feedback_->Step(cycle.input.tracker, cycle.input.time_ns, setup_.actuation_delay_ns,
                                     output.reference_tip_W_m, output.tip_estimate_W_m, solver_.tip_u(),
                                     solver_.tip_v(), cycle.joined && !cycle.tension_commanded, at_limit_));
}

BendingVector EquilibriumLaw::LackingMoment() const noexcept {
  if (shape_feedback_) return shape_feedback_->moment_Nm();
  return BendingVector::Zero(2 * setup_.body.sections());
}

// Friction follows the shape that the commanded tensions produce.
LawSolution EquilibriumLaw::FollowTensions(const LawInput& cycle, CycleOutput& output) noexcept {
  const bool before = balanced_;
  balanced_ = solver_.Follow(cycle.tension_N, LackingMoment());
  at_limit_ = false;
  output.displacement_desired_m = cycle.displacement_desired_m;
  if (balanced_) setup_.body.TendonShortening(solver_.q(), output.displacement_desired_m);
  return {.continuous = balanced_ == before, .arc_shortening_m = output.displacement_desired_m};
}

LawSolution EquilibriumLaw::SolveForReference(const LawInput& cycle, CycleOutput& output) noexcept {
  Eigen::Vector3d shift_W_m = Eigen::Vector3d::Zero();
  if (tip_feedback_) shift_W_m = tip_feedback_->shift_W_m();
  LawSolution solution{.arc_shortening_m = output.displacement_desired_m};
  const Status status = solver_.Solve(output.reference, output.tension_desired_base_N, LeastTension(cycle),
                                      MostTension(cycle), shift_W_m, LackingMoment());
  const bool answered = status != Status::kEquilibriumNotFound;
  solution.continuous = answered == balanced_;
  balanced_ = answered;
  at_limit_ = status == Status::kLimitedTensionMax || status == Status::kLimitedTensionMin;
  if (status != Status::kLimitedTensionMin) Report(output, status);
  if (!answered) return solution;
  output.tension_desired_base_N = solver_.tension_N();
  setup_.body.TendonShortening(solver_.q(), output.displacement_desired_m);
  if (shape_feedback_) {
    Report(output, shape_feedback_->Step(output.reference.position_rad, output.displacement_desired_m,
                                         cycle.shortening_m, cycle.weight, arcs_.force_per_tension(),
                                         solver_.SectionCompliance(), HeldByFriction(cycle.tension_N),
                                         cycle.joined && solution.continuous, at_limit_));
  }
  setup_.body.TendonForce(solver_.q(), solver_.tension_N(), unit_force_Nm_);
  setup_.body.ProjectForce(unit_force_Nm_, output.generalised_force_Nm);
  return solution;
}

// A tendon at minimum tension goes slack when the rotor's acceleration takes more tension than it has; the
// spool then runs free and jerks the tendon. So the minimum tension grows with the rotors' acceleration.
double EquilibriumLaw::LeastTension(const LawInput& cycle) const noexcept {
  const LimitParameters& limits = setup_.robot.limits;
  return std::min(limits.min_tension_N + cycle.rotor_N, 0.5 * limits.max_tension_base_N);
}

// A tension that hits its bound would stop the robot while the rotors run on, jerk the tendons and leave
// tension in dry friction. The trajectory keeps planned motions below the bound, but corrections by shape and
// tip feedback are not planned. So each tension approaches its bound at room / gather_s, as a motion comes to
// rest; far from the bound the limit rises quickly, so as not to restrict planned motions.
TendonVector EquilibriumLaw::MostTension(const LawInput& cycle) const noexcept {
  const double bound_N = setup_.limits.max_tension_base_N;
  const TendonVector bounds_N = TendonVector::Constant(setup_.body.tendons(), bound_N);
  if (!cycle.joined || !(shape_feedback_ || tip_feedback_)) return bounds_N;
  const TendonVector room_N = (bounds_N - cycle.tension_N).cwiseMax(0);
  const double share = setup_.period_s / setup_.gather_s;
  const TendonVector far = room_N / (kNearBound * bound_N);
  return cycle.tension_N + (share * (room_N + room_N.cwiseProduct(far.cwiseAbs2()))).cwiseMin(room_N);
}

// Section moment that dry friction of a motor and its pulleys holds at these tensions.
double EquilibriumLaw::HeldByFriction(const TendonVector& tension_N) const noexcept {
  double most_Nm = 0;
  int j = 0;
  for (const auto& section : setup_.robot.body.sections) {
    for (const auto& route : section.tendons) {
      const model::CapstanTable& pulleys = *setup_.tables[j];
      const double pulleys_N = 0.5 * (pulleys.Pull(tension_N[j]) - pulleys.Release(tension_N[j]));
      const double friction_N = FrictionAtSpool(setup_.robot.actuation->tendons[j]) + pulleys_N;
      most_Nm = std::max(most_Nm, route.radius_m * friction_N);
      ++j;
    }
  }
  return most_Nm;
}

void EquilibriumLaw::Archive(StateArchive& a) noexcept {
  solver_.Archive(a);
  if (shape_feedback_) shape_feedback_->Archive(a);
  if (tip_feedback_) tip_feedback_->Archive(a);
  a.Value(balanced_);
  a.Value(at_limit_);
}

}  // namespace

std::unique_ptr<Law> MakeEquilibriumLaw(const LawSetup& setup) {
  return std::make_unique<EquilibriumLaw>(setup);
}

}  // namespace tendril::control
