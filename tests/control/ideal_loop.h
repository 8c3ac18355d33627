// Drives and tendons without any loss around a controller: encoder and load cell show what it commanded
// a cycle ago.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>

#include "tendril/config/config.h"
#include "tendril/control/controller.h"
#include "tendril/control/law.h"

namespace tendril::control {

inline constexpr ControllerParameters kParameters{
    .law = ControlLaw::kPaper,
    .capstan_compensation = true,
    .pretension_ramp_Nps = 2,
    .pretension_settle_s = 0.1,
    .trajectory = {.default_speed_radps = 1,
                   .max_rate_radps = 8,
                   .max_acceleration_radps2 = 160,
                   .max_jerk_radps3 = 8000},
    .guards = {.max_missing_cycles = 5, .slack_tension_N = 0.02},
    .take_up = {},
};

class IdealLoop {
 public:
  explicit IdealLoop(const char* file = "rig_60mm.yaml")
      : IdealLoop(config::LoadRobot(std::string(TENDRIL_SOURCE_DIR "/config/robots/") + file), kParameters) {}
  IdealLoop(const RobotParameters& driven, const ControllerParameters& parameters)
      : IdealLoop(driven, parameters, Laws()[static_cast<std::size_t>(parameters.law)]) {}
  IdealLoop(const RobotParameters& driven, const ControllerParameters& parameters, const LawRow& law)
      : robot(driven), controller(robot, parameters, kNsPerMs, law) {
    input.drives = robot.body.tendons();
    output.displacement_desired_m = TendonVector::Zero(input.drives);
    output.tension_desired_motor_N = TendonVector::Zero(input.drives);
  }

  const CycleOutput& Step(const Command& command = {}) {
    ++input.cycle;
    input.time_ns += kNsPerMs;
    input.command = command;
    for (int j = 0; j < input.drives; ++j) {
      const auto& d = robot.actuation->tendons[j];
      const double stretch =
          (output.tension_desired_motor_N[j] - robot.RestTension_N(j)) / d.tendon.stiffness_Npm;
      const double turns =
          (output.displacement_desired_m[j] + stretch) / d.SpoolTravelPerMotorRad() / (2 * std::numbers::pi);
      auto& f = input.drive[j];
      f.position_counts = static_cast<std::int32_t>(std::lround(turns * d.drive.encoder_counts_per_turn));
      f.analog_mV = static_cast<std::int16_t>(
          std::lround(output.tension_desired_motor_N[j] * d.load_cell.gain_VpN * 1000));
      if (j + 1 == hangs) f.analog_mV = 0;
      f.torque_permille = output.torque_target_permille[j];
      if (obey && output.drive_request == DriveRequest::kEnable && f.state == DriveState::kReady) {
        f.state = DriveState::kEnabled;
      }
      if (obey && output.drive_request == DriveRequest::kDisable && f.state == DriveState::kEnabled) {
        f.state = DriveState::kReady;
      }
    }
    controller.Step(input, output);
    return output;
  }
  void Run(int cycles) {
    for (int i = 0; i < cycles; ++i) Step();
  }

  Command Make(CommandKind kind) {
    Command c;
    c.kind = kind;
    c.sequence = ++sequence;
    c.received_ns = input.time_ns;
    c.valid_for_ns = kNsPerS;
    return c;
  }
  Command ModeCommand(ModeRequest m) {
    Command c = Make(CommandKind::kMode);
    c.mode = m;
    return c;
  }
  Command Tip(const Eigen::Vector3d& p) {
    Command c = Make(CommandKind::kTip);
    c.tip_W_m = p;
    return c;
  }
  Command Bending(double u, double v) {
    Command c = Make(CommandKind::kBending);
    c.bending_rad = BendingVector::Zero(2 * robot.body.sections.size());
    c.bending_rad[0] = u;
    c.bending_rad[1] = v;
    return c;
  }

  void Ready() {
    for (int j = 0; j < input.drives; ++j) input.drive[j].state = DriveState::kReady;
    Step();
  }
  void RunUntilRunning() {
    Ready();
    Step(ModeCommand(ModeRequest::kArm));
    for (int i = 0; i < 2000 && output.mode != Mode::kRunning; ++i) Step();
    ASSERT_EQ(output.mode, Mode::kRunning) << ModeText(output.mode) << ": " << StatusText(output.status);
  }

  RobotParameters robot;
  Controller controller;
  CycleInput input;
  CycleOutput output;
  int hangs = 0;  // tendon whose cell shows no tension
  std::uint32_t sequence = 0;
  bool obey = true;
};

}  // namespace tendril::control
