// Nodes and the cycle that their drives fit; thresholds follow from the answers.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

#include "parts.h"
#include "tendril/canopen/master.h"
#include "tendril/core/clock.h"
#include "tendril/daemon/wiring.h"

namespace tendril::first_robot {
namespace {

using config::Range;

constexpr TimeNs kShortest_ns = 500000, kLongest_ns = 100000000, kStep_ns = 10000;

double Rounded(double value) { return std::stod(fmt::format("{:.2g}", value)); }

/// Half-way between the last feedback and the last moment for the torques; false where there is none.
bool SetDeadline(BusParameters& bus, const std::vector<canopen::DriveSetup>& drives) {
  const canopen::BusBudget budget = canopen::ComputeBusBudget(bus, drives);
  const TimeNs middle_ns = (budget.feedback_ns + bus.cycle_ns - budget.torques_ns) / 2;
  bus.feedback_deadline_ns = std::clamp(middle_ns / kStep_ns * kStep_ns, 5 * kStep_ns, bus.cycle_ns - 1);
  return budget.load <= bus.max_load && canopen::FeedbackDeadlineProblem(bus, drives).empty();
}

/// From this cycle on, in steps of a millisecond, the first that the drives fit.
TimeNs ShortestFrom(TimeNs cycle_ns, BusParameters bus, const std::vector<canopen::DriveSetup>& drives) {
  for (; cycle_ns <= kLongest_ns; cycle_ns += kNsPerMs) {
    bus.cycle_ns = cycle_ns;
    if (SetDeadline(bus, drives)) return cycle_ns;
  }
  throw std::runtime_error(
      "these drives fit no cycle of this bus; give it a higher bit rate or fewer tendons");
}

void AskCycle(Asker& ask, const RobotParameters& robot, BusParameters& bus) {
  const std::vector<canopen::DriveSetup> drives = daemon::DriveSetups(robot, bus);
  const TimeNs usual_ns = ShortestFrom(kNsPerMs, bus, drives);
  const TimeNs least_ns = std::min(usual_ns, ShortestFrom(kShortest_ns, bus, drives));
  bus.cycle_ns = ask.Integer("cycle_ns", static_cast<double>(usual_ns), {static_cast<double>(least_ns), 1e8});
  if (!SetDeadline(bus, drives)) {  // between two steps
    bus.cycle_ns = ShortestFrom(bus.cycle_ns, bus, drives);
    SetDeadline(bus, drives);
  }
}

/// Two seconds without the daemon are too many; of the usual 250 ms many cycles have to pass.
void SetHeartbeats(BusParameters& bus, GuardParameters& guards) {
  const double cycle_ms = 1e3 * ToSeconds(bus.cycle_ns);
  bus.heartbeat_timeout_ms = static_cast<int>(std::max(250., std::ceil(12 * cycle_ms)));
  const double cycles = bus.heartbeat_timeout_ms / cycle_ms;
  guards.max_missing_cycles = std::clamp(static_cast<int>(0.5 * cycles), 1, guards.max_missing_cycles);
  guards.max_late_cycles = std::clamp(static_cast<int>(0.5 * cycles), 1, guards.max_late_cycles);
}

/// The rig's thresholds, by how far this robot's tendons go and how hard they are pulled.
void SetThresholds(const RobotParameters& robot, ControllerParameters& controller, double cycle_s) {
  constexpr double kRigWay_m = 0.004 * 2.6, kRigMotor_N = 10;
  const LimitParameters& limits = robot.limits;
  double hole_m = 1;
  for (const SectionParameters& s : robot.body.sections)
    hole_m = std::min(hole_m, s.tendons.front().radius_m);
  const double farther = hole_m * limits.max_bending_rad / kRigWay_m;
  const double harder = limits.max_tension_motor_N / kRigMotor_N;
  GuardParameters& g = controller.guards;
  const auto metres = [&](double rig, double least) { return Rounded(std::clamp(rig * farther, least, 1.)); };
  const auto newtons = [&](double rig) { return Rounded(std::clamp(rig * harder, 1e-3, 1000.)); };
  g.max_displacement_rate_mps = Rounded(std::clamp(0.2 * farther, 1e-4, 100.));
  g.max_displacement_jump_m =
      Rounded(std::clamp(std::max(0.0005 * farther, 2 * g.max_displacement_rate_mps * cycle_s), 1e-6, 1.));
  g.max_following_error_m = metres(0.004, 1e-6);
  g.max_estimator_residual_m = metres(0.002, 1e-6);
  g.tension_disagreement_N = newtons(2);
  g.stuck_torque_change_N = newtons(2);
  g.max_torque_error_N = newtons(1);
  g.slack_tension_N = Rounded(std::min(100., limits.min_tension_N / 15));
  controller.pretension_ramp_Nps = Rounded(std::clamp(limits.max_tension_base_N / 4, 1e-3, 1000.));
}

void SetTakeUp(const RobotParameters& robot, ControllerParameters& controller) {
  const TendonDriveParameters& t = robot.actuation->tendons.front();
  const LimitParameters& limits = robot.limits;
  const double held_N =
      t.motor.coulomb_friction_Nm / t.SpoolTravelPerMotorRad() + limits.min_tension_N / t.gear.efficiency;
  TakeUpParameters& take_up = controller.take_up;
  take_up.pull_N = std::clamp(Rounded(std::max(0.2 * limits.max_tension_motor_N, 2 * held_N)), 1e-3,
                              std::min(1000., limits.max_tension_motor_N));
  take_up.max_speed_mps = std::min(take_up.max_speed_mps, 0.5 * controller.guards.max_displacement_rate_mps);
  take_up.max_travel_m =
      std::min(take_up.max_travel_m, Rounded(0.5 * take_up.max_speed_mps * take_up.timeout_s));
}

}  // namespace

void AskBus(Asker& ask, NewRobot& made) {
  std::vector<TendonDriveParameters>& tendons = made.robot.actuation->tendons;
  BusParameters& bus = made.daemon.bus;
  std::vector<int> ids(tendons.size());
  std::iota(ids.begin(), ids.end(), 1);
  ids = ask.Different("nodes", ids);
  bus.nodes.clear();
  for (std::size_t j = 0; j < ids.size(); ++j) {
    tendons[j].node_id = ids[j];
    bus.nodes.push_back({.node_id = ids[j], .tendon = static_cast<int>(j) + 1});
  }
  bus.interface = ask.Text("interface", bus.interface);
  bus.bitrate_bps = ask.Integer("bitrate_bps", bus.bitrate_bps);
  AskCycle(ask, made.robot, bus);
  ControllerParameters& controller = made.daemon.controller;
  SetHeartbeats(bus, controller.guards);
  SetThresholds(made.robot, controller, ToSeconds(bus.cycle_ns));
  SetTakeUp(made.robot, controller);
}

}  // namespace tendril::first_robot
