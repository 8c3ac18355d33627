// The operator's side of an experiment: streams targets in real time and receives the daemon's reports. Knows
// nothing of CAN.
#include "tendril/experiment/experiment_live.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <lcm/lcm-cpp.hpp>
#include <stdexcept>
#include <utility>

#include "tendril/config/config.h"
#include "tendril/control/nearest_held.h"
#include "tendril/core/clock.h"
#include "tendril/core/drive_counts.h"
#include "tendril/io/client.h"
#include "tendril/io/connection.h"
#include "tendril/io/wire.h"
#include "tendril/model/bending_model.h"
#include "tendril/model/pull_cone.h"
#include "tendril/model/tendon_pairs.h"

namespace tendril::experiment {
namespace {

// Bend at the minimum tension: straight, or where tendons do not pull in every direction the controller's
// rest shape.
BendingVector RestBend(const RobotParameters& robot) {
  BendingVector rest_rad = BendingVector::Zero(2 * static_cast<int>(robot.body.sections.size()));
  if (model::PullsEveryWay(robot.body)) return rest_rad;
  const model::Body body(model::BendingModel(robot.body));
  control::NearestHeld(body, robot.limits.min_tension_N, robot.limits.max_tension_base_N,
                       model::TendonPairs(robot))
      .Project(rest_rad);
  return rest_rad;
}

constexpr TimeNs kValidFor_ns = 100 * kNsPerMs, kSilence_ns = kNsPerS;
constexpr double kRestBetween_s = 1.0, kHomeRate_radps = 0.5;
// A slower rate of tension targets distorts the quick experiments.
constexpr double kBriskTension_Nps = 30;

class Operator {
 public:
  Operator(const LiveOptions& options, const std::atomic<bool>* stop)
      : options_(options),
        stop_(stop),
        lcm_(io::OpenLcm(options.lcm_url)),
        client_(lcm_.get(), options.channel_prefix) {
    lcm_->subscribe(io::ChannelName(options.channel_prefix, "CYCLE"), &Operator::TakeCycle, this)
        ->setQueueCapacity(2000);
    lcm_->subscribe(io::ChannelName(options.channel_prefix, "RUN"), &Operator::TakeRun, this);
    const TimeNs end_ns = clock_.Now() + 3 * kNsPerS;
    while (clock_.Now() < end_ns && !(every_cycle_ && !run_.robot_yaml.empty())) io::HandleWaiting(*lcm_, 20);
    const std::string where = options.lcm_url + " with prefix " + options.channel_prefix;
    if (run_.robot_yaml.empty()) {
      throw std::runtime_error(io::NobodyAnswers(options.lcm_url, options.channel_prefix, 3, client_));
    }
    if (!every_cycle_) {
      throw std::runtime_error("the daemon on " + where +
                               " does not publish every cycle; set lcm.cycle_every_cycles to 1 in its file");
    }
  }

  RobotParameters Robot() const { return config::ParseRobot(run_.robot_yaml, "the daemon's robot"); }
  DaemonParameters Daemon() const { return config::ParseDaemon(run_.daemon_yaml, "the daemon's file"); }

  /// Brings the robot to rest at pretension. `rest_rad`: the bend at the minimum tension.
  void Begin(const Program& program, const BendingVector& rest_rad) {
    if (options_.arm) {
      if (mode() == Mode::kRunning || mode() == Mode::kHold) Release();
      Await(Mode::kConfigured, 10, "the drives to be ready");
      armed_ = true;
      refused_ = Status::kOk;
      Send(ModeRequest::kArm);
      Await(Mode::kRunning, 20, "arming and pretension");
    } else {
      Check();
      GoHome(program, rest_rad);
    }
    Pass(kRestBetween_s);
  }

  void Record(const Program& program, RunRecorder& recorder, Experiment& result,
              const std::function<void(double)>& progress) {
    const std::uint64_t refused = record_.output.commands_refused;
    const auto add = [&](const CycleRecord& r) {
      recorder.Add(r);
      result.largest_tension_N =
          std::max(result.largest_tension_N, r.output.tension_base_estimate_N.maxCoeff());
      result.largest_command_N =
          std::max(result.largest_command_N, r.output.tension_desired_base_N.maxCoeff());
      if (r.output.status != Status::kOk) ++result.limited_cycles;
    };
    sink_ = add;
    struct Quiet {
      Operator* self;
      ~Quiet() { self->sink_ = nullptr; }
    } quiet{this};
    const auto period_ns = static_cast<TimeNs>(program.step_s * 1e9);
    const TimeNs start_ns = clock_.Now();
    double shown_s = 0;
    for (TimeNs next_ns = start_ns;
         clock_.Now() - start_ns < static_cast<TimeNs>(program.duration_s() * 1e9);) {
      const double t = ToSeconds(clock_.Now() - start_ns);
      if (Command command = program.At(t); command.kind != CommandKind::kNone) Send(command);
      // Grid points missed by a late scheduler are left out.
      while (next_ns <= clock_.Now()) next_ns += period_ns;
      HandleUntil(next_ns);
      Check();
      // A late command is superseded by the next; any other refusal would repeat.
      if (const CycleOutput& o = record_.output; o.commands_refused > refused &&
                                                 o.command_status != Status::kOk &&
                                                 o.command_status != Status::kCommandStale) {
        throw std::runtime_error(fmt::format("the daemon refused a target: {} ({})",
                                             StatusText(o.command_status), StatusRemedy(o.command_status)));
      }
      if (progress && t > shown_s + 0.5) progress((shown_s = t) / program.duration_s());
    }
  }

  /// Leaves the robot safe in any state. Never throws.
  void End() noexcept {
    try {
      if (armed_) {
        Release();
      } else if (mode() == Mode::kRunning && !another_in_control_) {
        Send(ModeRequest::kHold);
        Pass(0.1);
      }
    } catch (const std::exception& e) {
      fmt::print(stderr, "the robot could not be released: {}\n", e.what());
    }
  }

  /// Moves to the bend at the minimum tension and waits until it rests there.
  void GoHome(const Program& program, const BendingVector& rest_rad) {
    Command home;
    home.kind = CommandKind::kBending;
    home.bending_rad = rest_rad;
    home.speed_radps = std::min(kHomeRate_radps, program.speed_radps);
    const TimeNs end_ns = clock_.Now() + 30 * kNsPerS;
    do {
      Send(home);
      Pass(0.05);
      Check();
      if (clock_.Now() > end_ns) throw std::runtime_error("the robot did not come to rest within 30 s");
    } while ((record_.output.reference.position_rad - rest_rad).norm() > 1e-4);
  }

  /// Zero of each motor's angle: the end of pretension, where the controller has its zero.
  Eigen::VectorXd ZeroAngles(const RobotParameters& robot) const {
    Eigen::VectorXd zero(robot.body.tendons());
    for (int j = 0; j < zero.size(); ++j) {
      const auto& t = robot.actuation->tendons[static_cast<std::size_t>(j)];
      zero[j] = MotorAngle_rad(t.drive, record_.input.drive[static_cast<std::size_t>(j)].position_counts) -
                record_.output.displacement_m[j] / t.SpoolTravelPerMotorRad();
    }
    return zero;
  }

 private:
  Mode mode() const { return record_.output.mode; }

  // Repeats the request, because one may arrive late and be refused.
  void Release() {
    const TimeNs end_ns = clock_.Now() + 30 * kNsPerS;
    while (clock_.Now() < end_ns && mode() != Mode::kConfigured && mode() != Mode::kFault) {
      Send(ModeRequest::kDisarm);
      HandleUntil(clock_.Now() + 200 * kNsPerMs);
    }
    armed_ = false;
  }

  void Await(Mode mode_awaited, double timeout_s, const char* what) {
    const TimeNs end_ns = clock_.Now() + static_cast<TimeNs>(timeout_s * 1e9);
    while (mode() != mode_awaited) {
      HandleUntil(clock_.Now() + 20 * kNsPerMs);
      CheckAlive();
      if (armed_ && refused_ != Status::kOk) {
        throw std::runtime_error(fmt::format("the daemon does not arm: {} ({}); {}", StatusText(refused_),
                                             static_cast<int>(refused_), StatusRemedy(refused_)));
      }
      if (mode() == Mode::kFault || clock_.Now() > end_ns) {
        throw std::runtime_error(fmt::format("gave up waiting for {}: mode {}, {} ({})", what,
                                             ModeText(mode()), StatusText(record_.output.status),
                                             StatusRemedy(record_.output.status)));
      }
    }
  }

  void Pass(double seconds) {
    const TimeNs end_ns = clock_.Now() + static_cast<TimeNs>(seconds * 1e9);
    while (clock_.Now() < end_ns) {
      HandleUntil(std::min(end_ns, clock_.Now() + 20 * kNsPerMs));
      CheckAlive();
    }
  }

  void CheckAlive() const {
    if (stop_ && *stop_) throw std::runtime_error("stopped");
    if (clock_.Now() - heard_ns_ > kSilence_ns)
      throw std::runtime_error("the daemon stopped responding: see its log");
    if (another_in_control_) {
      throw std::runtime_error(fmt::format("the daemon refused a target: {} ({})",
                                           StatusText(Status::kAnotherSender),
                                           StatusRemedy(Status::kAnotherSender)));
    }
  }
  void Check() const {
    CheckAlive();
    if (mode() == Mode::kRunning) return;
    const Status reason = record_.output.status;
    const std::string_view remedy = mode() == Mode::kFault && reason != Status::kOk ? StatusRemedy(reason)
                                    : mode() == Mode::kFault ? "clear it with `tendril send clear`"
                                    : mode() == Mode::kConfigured
                                        ? "give --arm, or arm it with `tendril send arm`"
                                        : "bring it to running first";
    throw std::runtime_error(
        fmt::format("the daemon is in mode {}{}: {}", ModeText(mode()),
                    reason == Status::kOk ? "" : fmt::format(" ({})", StatusText(reason)), remedy));
  }

  void Send(ModeRequest request) {
    Command command;
    command.kind = CommandKind::kMode;
    command.mode = request;
    command.valid_for_ns = kNsPerS;
    Send(command);
  }
  void Send(Command command) {
    if (command.valid_for_ns == 0) command.valid_for_ns = kValidFor_ns;
    io::Publish(client_, command, options_.lcm_url);
  }

  void HandleUntil(TimeNs time_ns) {
    for (TimeNs left_ns = time_ns - clock_.Now(); left_ns > 0; left_ns = time_ns - clock_.Now()) {
      io::HandleWaiting(*lcm_, static_cast<int>((left_ns + kNsPerMs - 1) / kNsPerMs));
    }
  }

  void TakeCycle(const lcm::ReceiveBuffer* buffer, const std::string&) {
    if (!io::Decode(buffer->data, static_cast<int>(buffer->data_size), message_)) return;
    const std::uint64_t before = record_.input.cycle;
    if (!io::FromMessage(message_, record_)) return;
    if (record_.input.command.kind != CommandKind::kNone &&
        record_.input.command.sender == io::SenderOfProcess()) {
      refused_ = record_.output.command_status;
      another_in_control_ = another_in_control_ || refused_ == Status::kAnotherSender;
    }
    every_cycle_ = every_cycle_ || record_.input.cycle == before + 1;
    heard_ns_ = clock_.Now();
    if (sink_) sink_(record_);
  }
  void TakeRun(const lcm::ReceiveBuffer* buffer, const std::string&) {
    tendril_lcm::run_t run;
    if (io::Decode(buffer->data, static_cast<int>(buffer->data_size), run)) run_ = run;
  }

  const LiveOptions& options_;
  const std::atomic<bool>* stop_;
  MonotonicClock clock_;
  std::unique_ptr<lcm::LCM> lcm_;
  io::Client client_;
  tendril_lcm::cycle_t message_{};
  tendril_lcm::run_t run_{};
  CycleRecord record_;
  std::function<void(const CycleRecord&)> sink_;
  TimeNs heard_ns_ = 0;
  bool every_cycle_ = false;  // two consecutive cycles were received
  bool armed_ = false;
  Status refused_ = Status::kOk;     // reason for our own last refused command
  bool another_in_control_ = false;  // another sender is in control while ours are refused
};

}  // namespace

ExperimentSet RunLiveSet(const Plan& plan, const LiveOptions& options, const std::atomic<bool>* stop,
                         const std::function<void(const std::string& remark)>& planned,
                         const SetProgress& progress) {
  const MonotonicClock clock;
  const TimeNs start_ns = clock.Now();
  Operator robot(options, stop);
  const RobotParameters nominal = options.robot ? *options.robot : robot.Robot();
  if (const RobotParameters there = robot.Robot();
      nominal.body.tendons() != there.body.tendons() ||
      nominal.body.sections.size() != there.body.sections.size()) {
    throw std::runtime_error(
        fmt::format("the daemon runs '{}' with {} tendons, --robot is '{}' with {}: give the "
                    "daemon's robot file",
                    there.name, there.body.tendons(), nominal.name, nominal.body.tendons()));
  }
  const ControllerParameters controller = robot.Daemon().controller;
  const std::vector<Program> programs = MakePrograms(plan, nominal, controller);
  const bool tension =
      std::any_of(programs.begin(), programs.end(), [](const Program& program) { return program.tension; });
  planned(tension && controller.pretension_ramp_Nps < kBriskTension_Nps
              ? fmt::format(
                    "the daemon moves tension targets at {} N/s only (controller.pretension_ramp_Nps): quick "
                    "experiments are distorted; set {} N/s or more",
                    controller.pretension_ramp_Nps, kBriskTension_Nps)
              : "");
  const std::vector<NamedRun> names = NameRuns(plan);
  const BendingVector rest_rad = RestBend(nominal);
  ExperimentSet set;
  set.data.name = plan.name;
  set.data.robot = nominal;
  for (std::size_t i = 0; i < names.size() && set.trouble.empty(); ++i) {
    const Program& program = programs[names[i].planned];
    Experiment result;
    std::optional<RunRecorder> recorder;
    try {
      robot.Begin(program, rest_rad);
      recorder.emplace(nominal, robot.ZeroAngles(nominal));
      robot.Record(program, *recorder, result, [&](double share) { progress(i, share, nullptr); });
    } catch (const std::exception& e) {
      result.trouble = set.trouble = names[i].name + ": " + e.what();
    }
    if (recorder && recorder->rows() > 1) {
      result.run = recorder->Finish(names[i].name, program.family);
      result.run.zero_at_rest = true;
      progress(i, 1, &result);
      const double seconds = result.run.time_s.tail(1)[0];
      const bool whole = result.trouble.empty();
      if (whole) result.run.repeat_of = names[i].repeat_of;  // a run that ended early is no repeat
      if (whole || seconds >= kShortestRun_s) {
        set.simulated_s += seconds;
        set.data.runs.push_back(result.run);
      }
    }
    set.experiments.push_back(std::move(result));
  }
  robot.End();
  set.wall_s = ToSeconds(clock.Now() - start_ns);
  return set;
}

}  // namespace tendril::experiment
