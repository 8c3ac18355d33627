// Rows become cycles of a gateway, as the daemon's own: what reads its logs reads these.
#include "tendril/gap/run_log.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>
#include <stdexcept>

#include "tendril/config/config.h"
#include "tendril/core/clock.h"
#include "tendril/core/cycle.h"
#include "tendril/core/version.h"
#include "tendril/io/gateway.h"
#include "tendril/io/log.h"

namespace tendril::gap {
namespace {

io::RobotShape ShapeOf(const RobotParameters& robot) {
  return {static_cast<int>(robot.body.sections.size()), robot.body.units(), robot.body.tendons()};
}

// A motor that begins nearer to its zero than this is where its controller zeroed it.
constexpr double kStartAtRest_rad = 0.01;

class CycleLog {
 public:
  CycleLog(const RobotParameters& robot, const std::string& path)
      : robot_(robot), gateway_(Lcm(), ShapeOf(robot), clock_), log_(gateway_, path, clock_) {
    gateway_.PublishRun({.robot_yaml = config::ToYaml(robot),
                         .daemon_yaml = {},
                         .version = std::string(Version()),
                         .git_revision = std::string(GitRevision()),
                         .start_utime = 0});
  }

  void Write(const Run& run) {
    const Eigen::VectorXd& t = run.time_s;
    const double step_s = std::max((t[t.size() - 1] - t[0]) / static_cast<double>(t.size() - 1), 1e-9);
    // Drives on but not in motion between runs: each begins anew.
    Publish(run, 0, Mode::kConfigured, clock_.Now());
    const TimeNs start_ns = clock_.Now();
    std::uint64_t cycle = cycle_;
    for (Eigen::Index i = 0; i < t.size(); ++i) {
      const double at_s = t[i] - t[0];
      cycle_ = std::max(cycle_ + (i > 0), cycle + static_cast<std::uint64_t>(std::llround(at_s / step_s)));
      Publish(run, i, Mode::kRunning, start_ns + std::llround(at_s * 1e9));
    }
    ++cycle_;
    clock_.Advance(std::max<TimeNs>(std::llround(step_s * 1e9), 1));
  }

  /// Throws std::runtime_error unless everything is on the disk.
  WrittenLog Finish() const {
    if (!log_.error().empty()) throw std::runtime_error(log_.error());
    return {.events = log_.events(), .clipped = clipped_};
  }

 private:
  static LcmParameters Lcm() {
    LcmParameters lcm;
    lcm.url = "memq://";
    lcm.channel_prefix = "TENDRIL";
    lcm.cycle_every_cycles = 1;
    return lcm;
  }

  template <class Integer>
  Integer Whole(double value) {
    if (!std::isfinite(value)) return 0;
    const double least = std::numeric_limits<Integer>::min(), most = std::numeric_limits<Integer>::max();
    if (value < least || value > most) ++clipped_;
    return static_cast<Integer>(std::llround(std::clamp(value, least, most)));
  }

  void Publish(const Run& run, Eigen::Index row, Mode mode, TimeNs time_ns) {
    clock_.Advance(std::max<TimeNs>(time_ns - clock_.Now(), 0));
    CycleRecord record;
    record.input.cycle = cycle_;
    record.input.time_ns = time_ns;
    record.input.drives = robot_.body.tendons();
    record.output.mode = mode;
    record.output.displacement_m = TendonVector::Zero(record.input.drives);
    for (int j = 0; j < record.input.drives; ++j) FillDrive(run, row, j, mode, record);
    if (mode == Mode::kRunning) FillTracker(run, row, time_ns, record.input.tracker);
    gateway_.PublishCycle(record);
    gateway_.Handle(0);  // what goes round in the process must not pile up
    if (mode != Mode::kRunning) ++cycle_;
  }

  void FillDrive(const Run& run, Eigen::Index row, int j, Mode mode, CycleRecord& record) {
    const auto d = static_cast<std::size_t>(j);
    const auto& tendon = robot_.actuation->tendons[d];
    const auto value = [&](const Eigen::MatrixXd& m, Eigen::Index i) { return m.cols() > j ? m(i, j) : 0.0; };
    DriveFeedback& drive = record.input.drive[d];
    drive.state = mode == Mode::kRunning ? DriveState::kEnabled : DriveState::kReady;
    const double position = value(run.motor_position_rad, row), torque = value(run.torque_actual_Nm, row),
                 tension = value(run.tension_N, row);
    drive.age_cycles = std::isfinite(position + torque + tension) ? 0 : 1;
    const double per_turn = tendon.drive.encoder_counts_per_turn / (2 * std::numbers::pi);
    drive.position_counts = Whole<std::int32_t>(position * per_turn);
    // By which a reader of the log knows where positions count from.
    if (std::isfinite(position)) record.output.displacement_m[j] = position * tendon.SpoolTravelPerMotorRad();
    drive.torque_permille = Whole<std::int16_t>(1e3 * torque / tendon.drive.rated_torque_Nm);
    drive.analog_mV =
        Whole<std::int16_t>(1e3 * tendon.load_cell.gain_VpN * (tension + tendon.load_cell.offset_N));
    record.output.torque_target_permille[d] =
        Whole<std::int16_t>(1e3 * value(run.torque_target_Nm, row) / tendon.drive.rated_torque_Nm);
  }

  static void FillTracker(const Run& run, Eigen::Index row, TimeNs time_ns, TrackerSample& sample) {
    if (run.tip_m.cols() == 0 || !run.tip_m.row(row).allFinite()) return;
    sample.valid = true;
    sample.time_ns = time_ns;
    sample.tip_W_m = run.tip_m.row(row).transpose();
    if (run.tip_quaternion.cols() == 0 || !run.tip_quaternion.row(row).allFinite()) return;
    sample.orientation_WT = {run.tip_quaternion(row, 0), run.tip_quaternion(row, 1),
                             run.tip_quaternion(row, 2), run.tip_quaternion(row, 3)};
  }

  const RobotParameters& robot_;
  SimulatedClock clock_;
  io::Gateway gateway_;
  io::LogWriter log_;
  std::uint64_t cycle_ = 0, clipped_ = 0;
};
}  // namespace

LostInLog WhatALogLoses(const DataSet& set) {
  LostInLog lost;
  std::set<std::string> lacking;
  for (const Run& run : set.runs) {
    if (run.motor_position_rad.cols() == 0) lacking.insert("motor_position");
    if (run.torque_actual_Nm.cols() == 0) lacking.insert("torque_actual");
    if (run.torque_target_Nm.cols() == 0) lacking.insert("torque_target");
    if (run.tension_N.cols() == 0) lacking.insert("tension");
    if (run.tip_quaternion.cols() == 0 && run.tip_m.cols() > 0) lacking.insert("orientation");
  }
  lost.channels.assign(lacking.begin(), lacking.end());
  lost.start_position = std::any_of(set.runs.begin(), set.runs.end(), [](const Run& run) {
    return run.motor_position_rad.cols() > 0 &&
           run.motor_position_rad.row(0).cwiseAbs().maxCoeff() > kStartAtRest_rad;
  });
  return lost;
}

WrittenLog WriteLog(const DataSet& set, const std::string& path) {
  CycleLog log(set.robot, path);
  for (const Run& run : set.runs) log.Write(run);
  return log.Finish();
}

}  // namespace tendril::gap
