// Cost of the tick: one Controller::Step while the paper's circle is followed, against the number of tendons
// and the control law.
#include <benchmark/benchmark.h>

#include <cmath>
#include <numbers>
#include <string>

#include "tendril/config/config.h"
#include "tendril/control/controller.h"

namespace tendril {
namespace {

void Step(benchmark::State& state, const char* file, ControlLaw law, bool feedback,
          bool shape_feedback = false) {
  const RobotParameters robot = config::LoadRobot(std::string(TENDRIL_SOURCE_DIR "/config/robots/") + file);
  DaemonParameters daemon = config::LoadDaemon(TENDRIL_SOURCE_DIR "/config/tendrild.yaml");
  daemon.controller.law = law;
  daemon.controller.tension_feedback = feedback;
  daemon.controller.shape_feedback = shape_feedback;
  // These drives stand still whatever is asked of them; what the guards would say of that is not measured.
  GuardParameters& guards = daemon.controller.guards;
  guards.max_torque_error_N = guards.stuck_torque_change_N = guards.tension_disagreement_N = 1000;
  guards.max_following_error_m = guards.max_estimator_residual_m = 1;
  control::Controller controller(robot, daemon.controller, kNsPerMs);
  CycleInput input;
  CycleOutput output;
  input.drives = robot.body.tendons();
  std::uint32_t sequence = 0;
  const auto step = [&](Command command) {
    input.time_ns += kNsPerMs;
    ++input.cycle;
    command.sequence = ++sequence;
    command.received_ns = input.time_ns;
    command.valid_for_ns = kNsPerS;
    input.command = command;
    for (int j = 0; j < input.drives; ++j) {
      auto& d = input.drive[static_cast<std::size_t>(j)];
      d.state = output.drive_request == DriveRequest::kEnable ? DriveState::kEnabled : DriveState::kReady;
      d.analog_mV = 200;
    }
    controller.Step(input, output);
  };
  step({});
  Command arm;
  arm.kind = CommandKind::kMode;
  arm.mode = ModeRequest::kArm;
  step(arm);
  for (int i = 0; i < 3000 && output.mode != Mode::kRunning; ++i) step({});
  if (output.mode != Mode::kRunning) state.SkipWithError("the controller does not run");

  const double theta = std::numbers::pi / 3, l = robot.body.length_m();
  Command tip;
  tip.kind = CommandKind::kTip;
  for (auto _ : state) {
    const double angle = std::numbers::pi / 6 * ToSeconds(input.time_ns);
    tip.tip_W_m = {l / theta * (1 - std::cos(theta)) * std::cos(angle),
                   l / theta * (1 - std::cos(theta)) * std::sin(angle), l / theta * std::sin(theta)};
    step(tip);
    benchmark::DoNotOptimize(output.torque_target_permille);
  }
}

using enum ControlLaw;
BENCHMARK_CAPTURE(Step, three_tendons, "rig_60mm.yaml", kPaper, false);
BENCHMARK_CAPTURE(Step, four_tendons, "four_tendon_90mm.yaml", kPaper, false);
BENCHMARK_CAPTURE(Step, two_sections_six_tendons, "two_section.yaml", kPaper, false);
BENCHMARK_CAPTURE(Step, three_tendons_equilibrium, "rig_60mm.yaml", kEquilibrium, false);
BENCHMARK_CAPTURE(Step, three_tendons_equilibrium_fed_back, "rig_60mm.yaml", kEquilibrium, true);
BENCHMARK_CAPTURE(Step, three_tendons_shape_feedback, "rig_60mm.yaml", kEquilibrium, true, true);
BENCHMARK_CAPTURE(Step, four_tendons_equilibrium_fed_back, "four_tendon_90mm.yaml", kEquilibrium, true);
BENCHMARK_CAPTURE(Step, two_sections_equilibrium_fed_back, "two_section.yaml", kEquilibrium, true);
BENCHMARK_CAPTURE(Step, two_sections_shape_feedback, "two_section.yaml", kEquilibrium, true, true);

}  // namespace
}  // namespace tendril
