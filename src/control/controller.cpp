#include "tendril/control/controller.h"

#include <algorithm>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "feedback/tracker_check.h"
#include "modes/modes.h"
#include "report.h"
#include "stages/commanded_tensions.h"
#include "stages/drive_torques.h"
#include "stages/reference_motion.h"
#include "tendril/control/estimator.h"
#include "tendril/control/guards.h"
#include "tendril/control/law.h"
#include "tendril/control/state_archive.h"
#include "tendril/control/tension_loop_design.h"
#include "tendril/control/tension_ramp.h"
#include "tendril/model/bending_model.h"

namespace tendril::control {
namespace {

const RobotParameters& Checked(const RobotParameters& robot) {
  if (!robot.actuation) {
    throw std::invalid_argument(
        "robot '" + robot.name +
        "' has no actuation: a controller needs motors, gears and tendons; use a rig file");
  }
  if (static_cast<int>(robot.actuation->tendons.size()) != robot.body.tendons()) {
    throw std::invalid_argument("robot '" + robot.name + "': one drive per tendon is needed");
  }
  if (robot.body.tendons() > kMaxTendons || robot.body.units() > kMaxUnits ||
      static_cast<int>(robot.body.sections.size()) > kMaxSections) {
    throw std::invalid_argument("robot '" + robot.name + "' exceeds the controller's capacity of " +
                                std::to_string(kMaxSections) + " sections, " + std::to_string(kMaxUnits) +
                                " units, " + std::to_string(kMaxTendons) + " tendons");
  }
  return robot;
}

const ControllerParameters& Checked(const ControllerParameters& parameters, const RobotParameters& robot,
                                    TimeNs period_ns) {
  if (period_ns <= 0) throw std::invalid_argument("the control period must be positive");
  if (!(parameters.pretension_ramp_Nps > 0))
    throw std::invalid_argument("pretension_ramp_Nps must be positive");
  if (parameters.shape_feedback && !parameters.tension_feedback)
    throw std::invalid_argument("controller.shape_feedback: on needs tension_feedback: on");
  if (parameters.tip_feedback && !robot.actuation->tracker)
    throw std::invalid_argument("controller.tip_feedback: on needs actuation.tracker in the robot file");
  return parameters;
}

std::optional<TensionLoopGains> TensionFeedbackGains(const RobotParameters& robot,
                                                     const ControllerParameters& parameters,
                                                     double period_s) {
  if (!parameters.tension_feedback) return {};
  for (const auto& t : robot.actuation->tendons) {
    if (t.load_cell.place == LoadCellPlace::kNone)
      throw std::invalid_argument("controller.tension_feedback: on needs a load cell at every tendon");
  }
  const TensionLoopGains gains = DesignTensionLoop(robot, period_s);
  if (!(gains.bandwidth_radps > 0)) {
    throw std::invalid_argument(
        "controller.tension_feedback: on has no stable gains with this rig and cycle");
  }
  return gains;
}

// A torque sent in this cycle acts a cycle later, for one cycle, through the drives' torque loops.
TimeNs ActuationDelay(const RobotParameters& robot, TimeNs period_ns) {
  double lag_s = 0;
  for (const auto& t : robot.actuation->tendons) lag_s = std::max(lag_s, t.motor.torque_lag_s);
  return period_ns + period_ns / 2 + static_cast<TimeNs>(lag_s * 1e9);
}

void Clear(const CycleInput& input, int sections, int tendons, CycleOutput& output) noexcept {
  output = CycleOutput{};
  output.cycle = input.cycle;
  output.time_ns = input.time_ns;
  for (BendingVector* v :
       {&output.target_bending_rad, &output.generalised_force_Nm, &output.bending_estimate_rad}) {
    v->setZero(2 * sections);
  }
  for (TendonVector* v :
       {&output.tension_desired_base_N, &output.sliding_direction, &output.tension_desired_motor_N,
        &output.torque_desired_Nm, &output.displacement_desired_m, &output.displacement_m,
        &output.tension_measured_N, &output.tension_base_estimate_N, &output.torque_measured_Nm}) {
    v->setZero(tendons);
  }
}

}  // namespace

LimitParameters CommandedLimits(LimitParameters limits) noexcept {
  limits.max_tension_base_N =
      std::max(kCommandedTensionShare * limits.max_tension_base_N, limits.min_tension_N);
  return limits;
}

// The wiring: what each stage knows of the others.
struct Controller::Impl {
  Impl(const RobotParameters& robot_in, const ControllerParameters& parameters_in, TimeNs period_ns,
       const LawRow& row)
      : robot(model::ControlModel(Checked(robot_in))),
        parameters(Checked(parameters_in, robot, period_ns)),
        period_s(ToSeconds(period_ns)),
        limits(CommandedLimits(robot.limits)),
        actuation_delay_ns(row.feeds_forward ? ActuationDelay(robot, period_ns) : 0),
        gains(TensionFeedbackGains(robot, parameters, period_s)),
        body(robot.body),
        tables(model::MakeCapstanTables(robot.actuation->tendons, robot.limits.max_tension_motor_N)),
        estimator(robot, body, tables, period_s, model::UnseenBending(robot_in)),
        tracker_check(robot),
        guards(robot, parameters.guards, period_ns, body, tables),
        reference(robot, parameters, body, limits, period_ns, row.feeds_forward, actuation_delay_ns),
        law(row.make({.robot = robot,
                      .parameters = parameters,
                      .body = body,
                      .tables = tables,
                      .limits = limits,
                      .period_s = period_s,
                      .gather_s = reference.gather_s(),
                      .actuation_delay_ns = actuation_delay_ns,
                      .tension_loop_radps = gains ? gains->bandwidth_radps : 0})),
        tensions(robot, parameters.pretension_ramp_Nps, period_s, Ramp(row.feeds_forward)),
        torques(robot, parameters, tables, row.feeds_forward, gains, period_s),
        modes(robot, parameters, limits, period_ns,
              {.estimator = estimator,
               .guards = guards,
               .reference = reference,
               .tensions = tensions,
               .torques = torques,
               .law = *law}) {}

  // Without feed-forward, friction damps the motors.
  std::optional<TensionRamp> Ramp(bool feeds_forward) const {
    if (!feeds_forward) return {};
    return TensionRamp(body, reference.CommandedTensionRate_radps(), reference.gather_s(), period_s);
  }

  void Archive(StateArchive& a) noexcept {
    estimator.Archive(a);
    tracker_check.Archive(a);
    guards.Archive(a);
    reference.Archive(a);
    law->Archive(a);
    tensions.Archive(a);
    torques.Archive(a);
    modes.Archive(a);
  }

  const RobotParameters robot;
  const ControllerParameters parameters;
  const double period_s;
  const LimitParameters limits;  // of commanded tensions
  const TimeNs actuation_delay_ns;
  const std::optional<TensionLoopGains> gains;
  const model::Body body;
  const std::vector<std::shared_ptr<const model::CapstanTable>> tables;

  // In flow order.
  Estimator estimator;
  TrackerCheck tracker_check;
  Guards guards;
  ReferenceMotion reference;
  std::unique_ptr<Law> law;
  CommandedTensions tensions;
  DriveTorques torques;
  Modes modes;  // after the stages that it acts on
};

// -----------------------------------------------------------------------------------------------------------

void Controller::Step(const CycleInput& input, CycleOutput& output) noexcept {
  Impl& c = *impl_;
  const ModeState& mode = c.modes.state();
  Clear(input, c.body.sections(), c.body.tendons(), output);
  c.estimator.Step(input, output);
  Report(output,
         c.tracker_check.Step(input.tracker, output.tip_estimate_W_m, mode.zeroed && mode.controls_shape()));
  const bool entered = c.modes.Admit(input, output);
  c.modes.Supervise(input, output, entered);
  c.reference.Follow({.time_ns = input.time_ns,
                      .running = mode.mode() == Mode::kRunning,
                      .controls_shape = mode.controls_shape()},
                     c.modes.target(), c.tensions, output);
  const LawSolution solution = c.law->Solve({.input = input,
                                             .controls_shape = mode.controls_shape(),
                                             .tension_commanded = c.reference.tension_commanded(),
                                             .joined = mode.controls_shape() && c.tensions.joined(),
                                             .rotor_N = c.torques.rotor_N(),
                                             .tension_N = c.tensions.tension_N(),
                                             .displacement_desired_m = c.torques.last_reference_m(),
                                             .shortening_m = c.estimator.shortening_m(),
                                             .pair_offset_N = c.torques.pair_offset_N(),
                                             .weight = c.estimator.weight()},
                                            output);
  const bool switched = c.reference.switched() || !solution.continuous;
  if (!solution.continuous) c.tensions.Leave();
  c.modes.CommandTensions(switched, output);
  c.torques.Step({.input = input,
                  .mode = mode.mode(),
                  .controls_shape = mode.controls_shape(),
                  .zeroed = mode.zeroed,
                  .moving = mode.controls_shape() && !switched && solution.has_paths,
                  .bare = c.modes.bare(),
                  .tension_N = c.tensions.tension_N(),
                  .arc_shortening_m = solution.arc_shortening_m},
                 output);
  if (!output.torque_desired_Nm.allFinite()) c.modes.ReleaseAll(output);
  c.torques.Send(c.modes.Powered(output), output);
  c.guards.Expect(output, solution.arc_shortening_m);
}

// -----------------------------------------------------------------------------------------------------------

Controller::Controller(const RobotParameters& robot, const ControllerParameters& parameters, TimeNs period_ns)
    : Controller(robot, parameters, period_ns, Laws()[static_cast<std::size_t>(parameters.law)]) {}

Controller::Controller(const RobotParameters& robot, const ControllerParameters& parameters, TimeNs period_ns,
                       const LawRow& law)
    : impl_(std::make_unique<Impl>(robot, parameters, period_ns, law)) {}

Controller::~Controller() = default;

TimeNs Controller::look_ahead_ns() const noexcept { return impl_->reference.ahead_ns(); }

std::size_t Controller::state_bytes() const noexcept {
  StateArchive archive;
  impl_->Archive(archive);
  return archive.bytes();
}

void Controller::SaveState(std::span<std::byte> bytes) const noexcept {
  auto archive = StateArchive::Saver(bytes);
  impl_->Archive(archive);
}

bool Controller::LoadState(std::span<const std::byte> bytes) noexcept {
  if (bytes.size() != state_bytes()) return false;
  auto archive = StateArchive::Loader(bytes);
  impl_->Archive(archive);
  return archive.ok();
}

}  // namespace tendril::control
