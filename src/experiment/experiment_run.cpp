// Runs a program on controller, bus, drives and plant, and records the bus values as a run. Knows nothing of
// effects or of diagnosis.
#include "tendril/experiment/experiment_run.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <map>
#include <mutex>
#include <stdexcept>
#include <thread>

#include "built_in_files.h"
#include "tendril/config/config.h"
#include "tendril/core/drive_counts.h"
#include "tendril/experiment/closed_loop.h"

namespace tendril::experiment {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

double WallSeconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace

RunRecorder::RunRecorder(const RobotParameters& robot, Eigen::VectorXd zero_rad)
    : robot_(robot), zero_rad_(std::move(zero_rad)) {
  if (zero_rad_.size() == 0) zero_rad_.setZero(robot.body.tendons());
}

void RunRecorder::Add(const CycleRecord& record) {
  const int tendons = robot_.body.tendons();
  Row row;
  row.time_ns = record.input.time_ns;
  for (TendonVector* v : {&row.target_Nm, &row.actual_Nm, &row.position_rad, &row.tension_N})
    v->resize(tendons);
  for (int j = 0; j < tendons; ++j) {
    const auto& tendon = robot_.actuation->tendons[static_cast<std::size_t>(j)];
    const DriveFeedback& drive = record.input.drive[static_cast<std::size_t>(j)];
    const bool fresh = drive.age_cycles == 0;
    const double permille_Nm = 1e-3 * tendon.drive.rated_torque_Nm;
    row.target_Nm[j] = record.output.torque_target_permille[static_cast<std::size_t>(j)] * permille_Nm;
    row.actual_Nm[j] = fresh ? drive.torque_permille * permille_Nm : kNone;
    row.position_rad[j] = fresh ? MotorAngle_rad(tendon.drive, drive.position_counts) - zero_rad_[j] : kNone;
    const bool cell = tendon.load_cell.place != LoadCellPlace::kNone && tendon.load_cell.gain_VpN > 0;
    row.tension_N[j] = fresh && cell ? drive.analog_mV * 1e-3 / tendon.load_cell.gain_VpN : kNone;
  }
  rows_.push_back(row);
  if (record.input.tracker.valid) tracker_.push_back(record.input.tracker);
}

gap::Run RunRecorder::Finish(const std::string& name, const std::string& family) const {
  gap::Run run;
  run.name = name;
  run.family = family;
  run.load_cell = LoadCellPlace::kNone;
  for (const auto& tendon : robot_.actuation->tendons) {
    if (tendon.load_cell.place != LoadCellPlace::kNone) run.load_cell = tendon.load_cell.place;
  }
  const auto rows = static_cast<Eigen::Index>(rows_.size());
  if (rows == 0) return run;
  const int tendons = robot_.body.tendons();
  run.time_s.resize(rows);
  for (Eigen::MatrixXd* m :
       {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad, &run.tension_N})
    m->resize(rows, tendons);
  for (Eigen::Index i = 0; i < rows; ++i) {
    const Row& r = rows_[static_cast<std::size_t>(i)];
    run.time_s[i] = ToSeconds(r.time_ns - rows_.front().time_ns);
    run.torque_target_Nm.row(i) = r.target_Nm.transpose();
    run.torque_actual_Nm.row(i) = r.actual_Nm.transpose();
    run.motor_position_rad.row(i) = r.position_rad.transpose();
    run.tension_N.row(i) = r.tension_N.transpose();
  }
  if (run.load_cell == LoadCellPlace::kNone) run.tension_N.resize(0, 0);
  if (tracker_.empty()) return run;
  run.tip_m.setConstant(rows, 3, kNone);
  run.tip_quaternion.setConstant(rows, 4, kNone);
  for (const TrackerSample& sample : tracker_) {
    auto at = std::lower_bound(rows_.begin(), rows_.end(), sample.time_ns,
                               [](const Row& r, TimeNs t) { return r.time_ns < t; });
    if (at == rows_.end()) --at;
    if (at != rows_.begin() && sample.time_ns - (at - 1)->time_ns < at->time_ns - sample.time_ns) --at;
    if (at == rows_.begin() && sample.time_ns < at->time_ns) continue;  // measured before the run
    const Eigen::Index i = at - rows_.begin();
    const Eigen::Quaterniond& q = sample.orientation_WT;
    run.tip_m.row(i) = sample.tip_W_m.transpose();
    run.tip_quaternion.row(i) << q.w(), q.x(), q.y(), q.z();
  }
  return run;
}

DaemonParameters ForExperiments(DaemonParameters daemon) {
  auto& c = daemon.controller;
  c.pretension_ramp_Nps = std::max(c.pretension_ramp_Nps, 100.0);
  // A simulated robot that differs from its file is intended here, and breaks nothing.
  constexpr double kAny = 10;
  c.guards.max_following_error_m = kAny;
  c.guards.max_estimator_residual_m = kAny;
  c.guards.max_bending_excess_rad = kAny;
  // For torque loops that lag or saturate, and for drives without noise, whose feedback may stand still; no
  // robot pulls this hard.
  constexpr double kAny_N = 1e6;
  c.guards.max_torque_error_N = kAny_N;
  c.guards.tension_disagreement_N = kAny_N;
  c.guards.max_slack_s = std::max(c.guards.max_slack_s, 3600.0);
  daemon.lcm.cycle_every_cycles = 0;
  daemon.lcm.state_every_cycles = 1000;
  return daemon;
}

DaemonParameters DaemonFile(const std::string& file) {
  return file.empty() ? config::ParseDaemon(std::string(kDaemonFile), "tendrild.yaml (built in)")
                      : config::LoadDaemon(file);
}

DaemonParameters DaemonOfExperiments(const std::string& file) { return ForExperiments(DaemonFile(file)); }

Experiment RunExperiment(const Program& program, const std::string& name, const ExperimentOptions& options,
                         std::uint64_t noise_seed, const std::atomic<bool>* stop,
                         const std::function<void(double)>& progress) {
  Experiment result;
  ClosedLoopOptions loop_options{.controller_robot = options.controller_robot,
                                 .plant_robot = options.plant_robot,
                                 .daemon = options.daemon,
                                 .plant = {.seed = noise_seed, .sensor_noise = options.sensor_noise},
                                 .log_path = ""};
  // Without noise a load cell of a robot at rest correctly repeats one value.
  constexpr double kAny_N = 1e6;
  double& stuck_N = loop_options.daemon.controller.guards.stuck_torque_change_N;
  if (!options.sensor_noise) stuck_N = std::max(stuck_N, kAny_N);
  ClosedLoop loop(loop_options);
  RunRecorder recorder(options.controller_robot);
  const auto command_every = std::max<std::uint64_t>(
      1, static_cast<std::uint64_t>(program.step_s * 1e9 / static_cast<double>(loop.cycle_ns()) + 0.5));
  const auto report_every = static_cast<std::uint64_t>(0.5e9 / static_cast<double>(loop.cycle_ns()));
  try {
    loop.ArmBehindBrakes();
    const TimeNs start_ns = loop.now_ns();
    recorder.Add(loop.record());
    for (std::uint64_t step = 0;; ++step) {
      const double t = ToSeconds(loop.now_ns() - start_ns);
      if (t >= program.duration_s()) break;
      if (step % command_every == 0) {
        const Command command = program.At(t);
        if (command.kind != CommandKind::kNone) loop.Send(command);
      }
      const CycleRecord& r = loop.Step();
      recorder.Add(r);
      for (const sim::TendonState& tendon : loop.plant().tendon())
        result.largest_tension_N = std::max(result.largest_tension_N, tendon.tension_base_N);
      result.largest_command_N =
          std::max(result.largest_command_N, r.output.tension_desired_base_N.maxCoeff());
      if (r.output.status != Status::kOk) ++result.limited_cycles;
      if (r.output.mode != Mode::kRunning || r.output.commands_refused > 0) {
        result.trouble =
            fmt::format("{}: {} at t = {:.3f} s ({})", name,
                        StatusText(r.output.commands_refused > 0 ? r.output.command_status : r.output.status),
                        t, StatusRemedy(r.output.status));
        break;
      }
      if (stop && *stop) {
        result.trouble = fmt::format("{}: stopped at t = {:.2f} s", name, t);
        break;
      }
      if (progress && step % report_every == 0) progress(t / program.duration_s());
    }
  } catch (const std::runtime_error& e) {
    result.trouble = name + ": " + e.what();
  }
  result.run = recorder.Finish(name, program.family);
  if (!result.trouble.empty()) result.run.notes.push_back("ended early: " + result.trouble);
  return result;
}

std::vector<NamedRun> NameRuns(const Plan& plan) {
  std::vector<NamedRun> runs;
  for (std::size_t i = 0; i < plan.runs.size(); ++i) {
    const std::string first = fmt::format("{:02}_{}", runs.size() + 1, plan.runs[i].family);
    runs.push_back({i, first, ""});
    for (int r = 0; r < plan.runs[i].repeats; ++r)
      runs.push_back({i, fmt::format("{:02}_{}", runs.size() + 1, plan.runs[i].family), first});
  }
  return runs;
}

std::vector<Program> MakePrograms(const Plan& plan, const RobotParameters& robot,
                                  const ControllerParameters& controller) {
  std::vector<Program> programs;
  for (const PlannedRun& run : plan.runs) {
    try {
      programs.push_back(MakeProgram(run, robot, controller));
    } catch (const std::invalid_argument& e) {
      if (run.where.empty()) throw;
      throw std::invalid_argument(run.where + ": " + e.what());
    }
  }
  return programs;
}

ExperimentSet RunSet(const Plan& plan, const ExperimentOptions& options, const std::atomic<bool>* stop,
                     const SetProgress& progress) {
  const double start_s = WallSeconds();
  const std::vector<Program> programs =
      MakePrograms(plan, options.controller_robot, options.daemon.controller);
  const std::vector<NamedRun> names = NameRuns(plan);
  ExperimentSet set;
  set.data.name = plan.name;
  set.data.robot = options.controller_robot;
  set.experiments.resize(names.size());

  std::mutex mutex;
  std::exception_ptr failure;
  std::atomic<bool> ended = false;
  std::atomic<std::size_t> next = 0;
  const auto work = [&] {
    for (std::size_t i = next++; i < names.size(); i = next++) {
      if (ended || (stop && *stop)) return;
      try {
        const auto tell = [&](double share) {
          const std::lock_guard lock(mutex);
          if (progress) progress(i, share, nullptr);
        };
        // Spread far apart, so that sets with neighbouring seeds share no noise.
        const std::uint64_t noise_seed = options.seed * 0x9E3779B97F4A7C15u + i;
        Experiment done =
            RunExperiment(programs[names[i].planned], names[i].name, options, noise_seed, stop, tell);
        done.run.repeat_of = names[i].repeat_of;
        const std::lock_guard lock(mutex);
        if (!done.trouble.empty()) {
          ended = true;
          if (set.trouble.empty()) set.trouble = done.trouble;
        }
        if (progress) progress(i, 1, &done);
        set.experiments[i] = std::move(done);
      } catch (...) {
        const std::lock_guard lock(mutex);
        if (!failure) failure = std::current_exception();
        ended = true;
      }
    }
  };
  std::vector<std::thread> helpers;
  for (int t = 1; t < options.threads; ++t) helpers.emplace_back(work);
  work();
  for (std::thread& t : helpers) t.join();
  if (failure) std::rethrow_exception(failure);

  for (std::size_t i = 0; i < names.size(); ++i) {
    const bool begun = set.experiments[i].run.time_s.size() > 0;
    if (!begun && set.trouble.empty()) set.trouble = names[i].name + ": stopped before it began";
  }
  for (Experiment& e : set.experiments) {
    if (e.run.time_s.size() < 2) continue;
    if (!e.trouble.empty() && ((stop && *stop) || e.run.time_s.tail(1)[0] < kShortestRun_s)) continue;
    set.simulated_s += e.run.time_s.tail(1)[0];
    set.data.runs.push_back(std::move(e.run));
  }
  // A repeat without its original is no repeat.
  for (gap::Run& run : set.data.runs) {
    const auto named = [&run](const gap::Run& r) { return r.name == run.repeat_of; };
    if (!run.repeat_of.empty() && std::none_of(set.data.runs.begin(), set.data.runs.end(), named))
      run.repeat_of.clear();
  }
  set.wall_s = WallSeconds() - start_s;
  return set;
}

}  // namespace tendril::experiment
