// Controller, master, drives and plant on a bus in memory, with every fault that can be acted out between
// them, and the rules that no cycle may break. Simulated time; test use only.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "tendril/can/memory_bus.h"
#include "tendril/canopen/master.h"
#include "tendril/config/config.h"
#include "tendril/control/controller.h"
#include "tendril/daemon/control_cycle.h"
#include "tendril/daemon/wiring.h"
#include "tendril/emulator/faults.h"
#include "tendril/rig/virtual_rig.h"

namespace tendril::daemon {

/// A wrong sensor on its way from a drive: applied to each feedback frame of the node while `node` is not 0.
struct Tampering {
  int node = 0;
  bool cell_fixed = false;
  std::int16_t cell_mV = 0;  // with cell_fixed
  double cell_gain = 1;
  std::int32_t offset_counts = 0;  // added to the position
  double counts_per_cycle = 0;     // further added, cycle by cycle
  // Its application hangs: heartbeats and feedback go on with the values of that moment, torque frames are
  // not heard and the last torque stays. NMT is obeyed.
  bool hung = false;
};

struct SafetyOptions {
  RobotParameters robot, plant;
  DaemonParameters daemon;
  std::uint64_t seed = 1;
  bool noise = true;
};

/// Beyond limits.max_tension_motor_N and guards.tension_margin of it: what a tension may rise within the
/// cycles of a reaction, and the noise of its cell.
inline constexpr double kTensionSlop_N = 0.3;
/// The same at the base, and what the pulleys hide between it and a cell before them: 0.66 N behind motors
/// that are eight times as strong as their file says.
inline constexpr double kBaseSlop_N = 0.7;

/// Above what a tendon carries, or should, when a stop begins: what swings still adds.
inline constexpr double kRise_N = 1;

/// What sensors and drives may make believe, and for how many cycles in a row, before it must be a fault
/// while drives pull: judged by the plant's own truth, whatever caused it. A cell may be off by the
/// disagreement that is allowed and by what gear and motor friction leave open; an encoder by more than the
/// following error, for what a tendon shows is the robot's error, too.
inline constexpr double kCellOff_N = 6, kEncoderOff_m = 0.008, kTorqueOff_N = 1.5;
inline constexpr int kUnnoticedCycles = 60;

class SafetyRig {
 public:
  explicit SafetyRig(const SafetyOptions& o)
      : options_(o),
        bus_(clock_),
        faults_(bus_.AddPort(), o.seed),
        rig_(o.plant, faults_, {.seed = o.seed, .sensor_noise = o.noise}),
        port_(bus_.AddPort()),
        master_(o.daemon.bus, DriveSetups(o.robot, o.daemon.bus), port_),
        controller_(o.robot, o.daemon.controller, o.daemon.bus.cycle_ns),
        cycle_(controller_, master_, clock_, o.robot, o.daemon.bus, [this](TimeNs) {
          if (answered_) return false;
          faults_.Poll(clock_.Now());
          rig_.Poll(clock_.Now());
          if (guest_) guest_->Poll(clock_.Now());
          answered_ = true;
          return true;
        }) {
    faults_.Attach(rig_.drives());
    bus_.SetFilter([this](can::CanFrame& f) {
      Tamper(f);
      return !Hangs(f);
    });
    master_.Start(clock_.Now());
  }

  /// One cycle, after `skipped` whole ones and `off_ns` off the grid.
  const CycleRecord& Step(const Command& command = {}, std::uint64_t skipped = 0, TimeNs off_ns = 0) {
    clock_.Advance(options_.daemon.bus.cycle_ns * static_cast<TimeNs>(1 + skipped) + off_ns);
    count_ += skipped;
    answered_ = false;
    drift_counts_ += tampering.counts_per_cycle;
    const CycleOutput before = record_.output;
    TrackerSample tip;
    if (options_.daemon.controller.tip_feedback) tip = rig_.TakeTrackerReading().value_or(tip);
    cycle_.Run({.cycle = count_++, .grid_ns = clock_.Now(), .wake_latency_ns = 0, .missed = skipped}, command,
               tip, record_);
    canopen::BusEvent event;
    while (master_.PopEvent(&event)) {
      last_event_ = event.text.data();
      events_ += last_event_ + "\n";
    }
    Judge(before, command);
    return record_;
  }
  void Run(double seconds) {
    for (const TimeNs end_ns = clock_.Now() + static_cast<TimeNs>(seconds * 1e9); clock_.Now() < end_ns;)
      Step();
  }
  /// A cycle without a daemon: it was killed, and its drives are left to themselves.
  void StepAlone() {
    clock_.Advance(options_.daemon.bus.cycle_ns);
    faults_.Poll(clock_.Now());
    rig_.Poll(clock_.Now());
  }
  bool RunUntil(Mode mode, double seconds) {
    for (const TimeNs end_ns = clock_.Now() + static_cast<TimeNs>(seconds * 1e9); clock_.Now() < end_ns;) {
      if (Step().output.mode == mode) return true;
    }
    return false;
  }
  bool Arm() {
    if (!RunUntil(Mode::kConfigured, 10)) return false;
    Step(Request(ModeRequest::kArm));
    return RunUntil(Mode::kRunning, 10);
  }

  // ---- commands, fresh and in order ----

  Command Make(CommandKind kind, double valid_s = 0.1) {
    Command c;
    c.kind = kind;
    c.sequence = ++sequence_;
    c.received_ns = clock_.Now() + options_.daemon.bus.cycle_ns;
    c.valid_for_ns = static_cast<TimeNs>(valid_s * 1e9);
    return c;
  }
  Command Request(ModeRequest request) {
    Command c = Make(CommandKind::kMode);
    c.mode = request;
    return c;
  }
  Command Bend(double us, double vs) {
    Command c = Make(CommandKind::kBending);
    c.bending_rad = BendingVector::Zero(2 * static_cast<int>(options_.robot.body.sections.size()));
    c.bending_rad[0] = us;
    c.bending_rad[1] = vs;
    return c;
  }
  /// On a circle of bending, moving on.
  Command Circle(double amplitude_rad, double omega_radps, double t_s) {
    const double a = omega_radps * t_s;
    Command c = Bend(amplitude_rad * std::cos(a), amplitude_rad * std::sin(a));
    c.bending_rate_radps = BendingVector::Zero(c.bending_rad.size());
    c.bending_rate_radps[0] = -amplitude_rad * omega_radps * std::sin(a);
    c.bending_rate_radps[1] = amplitude_rad * omega_radps * std::cos(a);
    return c;
  }
  Command Tensions(const TendonVector& tension_N) {
    Command c = Make(CommandKind::kTension);
    c.tension_N = tension_N;
    return c;
  }

  void Order(const FaultParameters& fault) { faults_.Add(fault, clock_.Now()); }

  const CycleRecord& record() const { return record_; }
  const CycleOutput& output() const { return record_.output; }
  const SafetyOptions& options() const { return options_; }
  rig::VirtualRig& rig() { return rig_; }
  double now_s() const { return ToSeconds(clock_.Now()); }
  const std::string& last_event() const { return last_event_; }
  const std::string& events() const { return events_; }
  /// Rules that were broken, a line each; the first few.
  const std::vector<std::string>& violations() const { return violations_; }
  double max_tension_N() const { return max_tension_N_; }  // true, motor side
  double max_base_N() const { return max_base_N_; }        // true, at the robot's base
  double max_tension_wanted_N() const { return max_wanted_N_; }
  /// Time from entering a fault to the drives' disable command; negative: not yet.
  double fall_s() const { return fall_s_; }

  Tampering tampering;
  /// One more drive on the same bus.
  emulator::DriveRack& PlugIn(const emulator::EmulatedDriveParameters& drive) {
    return guest_.emplace(std::span(&drive, 1), bus_.AddPort());
  }
  /// The master's interface is down or gone: nothing goes either way.
  void TakeDown(bool down) { port_.down = down; }

 private:
  class Port final : public can::CanPort {
   public:
    explicit Port(can::CanPort& port) : port_(port) {}
    bool Send(const can::CanFrame& frame) noexcept override { return !down && port_.Send(frame); }
    int Receive(std::span<can::StampedFrame> frames) noexcept override {
      const int received = port_.Receive(frames);
      return down ? 0 : received;
    }
    bool WaitUntil(TimeNs deadline_ns) noexcept override { return port_.WaitUntil(deadline_ns); }
    bool up() const noexcept override { return !down && port_.up(); }
    bool bus_off() const noexcept override { return !down && port_.bus_off(); }
    void Restart() noexcept override { port_.Restart(); }
    const can::CanCounters& counters() const noexcept override { return port_.counters(); }
    bool down = false;

   private:
    can::CanPort& port_;
  };

  void Tamper(can::CanFrame& f) {
    if (tampering.node == 0 || f.error || f.id != 0x180u + static_cast<unsigned>(tampering.node) ||
        f.size < 8)
      return;
    const auto word = [&f](std::size_t at) {
      return static_cast<std::uint16_t>(f.data[at] | f.data[at + 1] << 8);
    };
    auto counts = static_cast<std::uint32_t>(word(0) | static_cast<std::uint32_t>(word(2)) << 16);
    counts += static_cast<std::uint32_t>(tampering.offset_counts + static_cast<std::int32_t>(drift_counts_));
    for (std::size_t i = 0; i < 4; ++i) f.data[i] = static_cast<std::uint8_t>(counts >> (8 * i));
    const auto cell = static_cast<std::int16_t>(word(6));
    const double shown = tampering.cell_fixed ? tampering.cell_mV : tampering.cell_gain * cell;
    const auto out =
        static_cast<std::uint16_t>(static_cast<std::int16_t>(std::clamp(shown, -32768., 32767.)));
    f.data[6] = static_cast<std::uint8_t>(out);
    f.data[7] = static_cast<std::uint8_t>(out >> 8);
  }

  bool Hangs(can::CanFrame& f) {
    if (!tampering.hung || f.error) {
      hung_feedback_.reset();
      return false;
    }
    const auto node = static_cast<unsigned>(tampering.node);
    if (f.id == 0x180u + node) {
      if (!hung_feedback_) hung_feedback_ = f;
      f = *hung_feedback_;
    }
    return f.id == 0x200u + node || f.id == 0x280u + node;
  }

  void Violated(const std::string& what) {
    if (violations_.size() < 5) {
      violations_.push_back(std::to_string(now_s()) + " s, " + std::string(ModeText(record_.output.mode)) +
                            " " + std::to_string(static_cast<int>(record_.output.status)) + ": " + what);
    }
  }

  void Believed(int& cycles, bool off, const char* what) {
    cycles = off ? cycles + 1 : 0;
    if (cycles == kUnnoticedCycles) Violated(std::string(what) + ", and nobody notices");
  }

  void JudgeWhatIsBelieved(const CycleOutput& before) {
    const CycleOutput& o = record_.output;
    const bool shape = o.mode == Mode::kRunning || o.mode == Mode::kHold;
    const bool was_shape = before.mode == Mode::kRunning || before.mode == Mode::kHold;
    const bool pulls = shape || o.mode == Mode::kPretension ||
                       (o.mode == Mode::kSafeStop && (was_shape || shape_before_stop_));
    shape_before_stop_ = o.mode == Mode::kSafeStop ? shape_before_stop_ || was_shape : false;
    shape_for_ = shape ? shape_for_ + 1 : 0;
    for (int j = 0; j < options_.robot.body.tendons(); ++j) {
      const auto i = static_cast<std::size_t>(j);
      const TendonDriveParameters& t = options_.robot.actuation->tendons[i];
      const sim::TendonState& truth = rig_.plant().tendon()[i];
      Belief& belief = belief_[i];
      // What is shown in the cycle in which it is zeroed counts from before.
      if (shape_for_ == 2) belief.zero_m = truth.spool_pull_m - o.displacement_m[j];
      const double moved_m = truth.spool_pull_m - belief.zero_m;
      Believed(belief.encoder, shape_for_ > 2 && std::abs(o.displacement_m[j] - moved_m) > kEncoderOff_m,
               "an encoder is off");
      const bool at_motor = t.load_cell.place == LoadCellPlace::kMotorSide;
      const double tension_N = at_motor ? truth.tension_motor_N : truth.tension_base_N;
      Believed(belief.cell, pulls && std::abs(o.tension_measured_N[j] - tension_N) > kCellOff_N,
               "a load cell is off");
      // Between what was asked for in the last cycles lies every torque on the way.
      const double newton = t.drive.rated_torque_Nm / t.SpoolTravelPerMotorRad();
      const auto [least, most] = std::minmax_element(belief.asked.begin(), belief.asked.end());
      const auto off = [&](double share) {
        return std::max({0., *least * 1e-3 - share, share - *most * 1e-3}) * newton > kTorqueOff_N;
      };
      const double torque = rig_.drives().torque_Nm(j) / t.drive.rated_torque_Nm;
      Believed(belief.torque, pulls && off(torque), "a drive does not make the torque it was told");
      Believed(belief.told, pulls && off(1e-3 * record_.input.drive[i].torque_permille),
               "a drive tells another torque than it was told");
      std::copy_backward(belief.asked.begin(), belief.asked.end() - 1, belief.asked.end());
      belief.asked[0] = o.torque_target_permille[i];
    }
  }

  // The rules of every cycle, whatever happens.
  void Judge(const CycleOutput& before, const Command& command) {
    const CycleOutput& o = record_.output;
    const LimitParameters& limits = options_.robot.limits;
    const int m = options_.robot.body.tendons();
    const double limit_N = limits.max_tension_motor_N;
    const double allowed_N =
        limit_N * (1 + options_.daemon.controller.guards.tension_margin) + kTensionSlop_N;
    const double allowed_base_N =
        limits.max_tension_base_N * (1 + options_.daemon.controller.guards.tension_margin) + kBaseSlop_N;
    const bool enabled = o.drive_request == DriveRequest::kEnable;
    JudgeWhatIsBelieved(before);
    double wanted_N = 0;
    for (int j = 0; j < m; ++j) {
      const double true_N = rig_.plant().tendon()[static_cast<std::size_t>(j)].tension_motor_N;
      max_tension_N_ = std::max(max_tension_N_, true_N);
      if (!(true_N <= allowed_N)) Violated("tension of " + std::to_string(true_N) + " N in the tendon");
      const double base_N = rig_.plant().tendon()[static_cast<std::size_t>(j)].tension_base_N;
      max_base_N_ = std::max(max_base_N_, base_N);
      if (!(base_N <= allowed_base_N)) Violated("tension of " + std::to_string(base_N) + " N at the base");
      if (enabled && o.tension_desired_base_N[j] > limits.max_tension_base_N + 1e-9)
        Violated("tension of " + std::to_string(o.tension_desired_base_N[j]) + " N commanded at the base");
      if (enabled) wanted_N = std::max(wanted_N, o.tension_desired_motor_N[j]);
      if (!std::isfinite(o.torque_desired_Nm[j]) || !std::isfinite(o.tension_desired_motor_N[j])) {
        Violated("an output that is not finite");
      }
      const auto& t = options_.robot.actuation->tendons[static_cast<std::size_t>(j)];
      const double most =
          1000 * t.drive.current_limit_A * t.motor.torque_constant_NmpA / t.drive.rated_torque_Nm;
      const int sent = o.torque_target_permille[static_cast<std::size_t>(j)];
      if (std::abs(sent) > most + 1) Violated("torque beyond the current limit");
      const bool unpowered =
          o.mode == Mode::kDisconnected || o.mode == Mode::kConfigured || o.mode == Mode::kArmed;
      if ((unpowered || !enabled) && sent != 0) Violated("torque without arm");
    }
    max_wanted_N_ = std::max(max_wanted_N_, wanted_N);
    if (wanted_N > limit_N + 1e-9) Violated("tension of " + std::to_string(wanted_N) + " N commanded");
    if ((o.mode == Mode::kDisconnected || o.mode == Mode::kConfigured) && enabled)
      Violated("drives enabled unasked");

    const bool falling = o.mode == Mode::kFault || o.mode == Mode::kSafeStop;
    const bool was_falling = before.mode == Mode::kFault || before.mode == Mode::kSafeStop;
    if (falling && was_falling && before.tension_desired_base_N.size() == m) {
      const double step_N =
          options_.daemon.controller.pretension_ramp_Nps * ToSeconds(options_.daemon.bus.cycle_ns);
      // Of what pulls: a bare motor that pays out goes to zero.
      const TendonVector change =
          o.tension_desired_base_N.cwiseMax(0) - before.tension_desired_base_N.cwiseMax(0);
      // Down to pretension by the ramp, from there to nothing by disabling the drives.
      const bool let_go =
          !enabled && before.tension_desired_base_N.maxCoeff() <= limits.min_tension_N + step_N + 1e-9;
      if (change.maxCoeff() > 1e-9) Violated("tension wanted rises on the way down");
      if (change.minCoeff() < -step_N - 1e-9 && !let_go && o.status != Status::kInternalNotFinite) {
        Violated("tension wanted falls faster than its ramp");
      }
    }
    for (int j = 0; j < m; ++j) {
      const double true_N = rig_.plant().tendon()[static_cast<std::size_t>(j)].tension_motor_N;
      double& began_N = fall_began_N_[static_cast<std::size_t>(j)];
      if (!falling || !was_falling) began_N = std::max(true_N, o.tension_desired_motor_N[j]);
      if (falling && true_N > began_N + kRise_N)
        Violated("tension rises from " + std::to_string(began_N) + " N to " + std::to_string(true_N) +
                 " N on the way down");
    }
    // Faults latch until clear; nothing moves on by itself.
    const bool asked = command.kind == CommandKind::kMode && o.command_status == Status::kOk;
    if (before.mode == Mode::kFault && o.mode != Mode::kFault &&
        !(asked && command.mode == ModeRequest::kClear)) {
      Violated("a fault went away by itself");
    }
    const bool armed_now = (o.mode == Mode::kArmed && before.mode != Mode::kArmed) ||
                           (o.mode == Mode::kRunning && before.mode == Mode::kHold);
    if (armed_now && !(asked && command.mode == ModeRequest::kArm)) Violated("armed unasked");
    for (const auto& [mode, request] : {std::pair{Mode::kHoming, ModeRequest::kHome},
                                        std::pair{Mode::kCommissioning, ModeRequest::kCommission}}) {
      if (o.mode == mode && before.mode != mode && !(asked && command.mode == request))
        Violated("tendons taken up unasked");
    }

    if (o.mode != Mode::kFault) {
      fault_since_s_ = -1;
    } else if (before.mode != Mode::kFault) {
      fault_since_s_ = now_s();
      fall_s_ = -1;
    }
    if (o.mode == Mode::kFault && !enabled && fall_s_ < 0) fall_s_ = now_s() - fault_since_s_;
    const double longest_s = limits.max_tension_base_N / options_.daemon.controller.pretension_ramp_Nps + 0.1;
    if (o.mode == Mode::kFault && enabled && now_s() - fault_since_s_ > longest_s) {
      Violated("drives still enabled long after a fault");
    }
  }

  SafetyOptions options_;
  SimulatedClock clock_;
  can::MemoryBus bus_;
  emulator::FaultInjector faults_;
  rig::VirtualRig rig_;
  std::optional<emulator::DriveRack> guest_;
  Port port_;
  canopen::Master master_;
  control::Controller controller_;
  ControlCycle cycle_;
  CycleRecord record_;
  std::uint64_t count_ = 0;
  std::uint32_t sequence_ = 0;
  bool answered_ = false;
  std::optional<can::CanFrame> hung_feedback_;
  struct Belief {
    double zero_m = 0;
    int encoder = 0, cell = 0, torque = 0, told = 0;  // cycles in a row
    std::array<int, 4> asked{};                       // [per mille], the last first
  };
  std::array<Belief, kMaxTendons> belief_{};
  bool shape_before_stop_ = false;
  int shape_for_ = 0;  // cycles
  std::array<double, kMaxTendons> fall_began_N_{};
  double drift_counts_ = 0;
  std::string last_event_, events_;
  std::vector<std::string> violations_;
  double max_tension_N_ = 0, max_base_N_ = 0, max_wanted_N_ = 0, fault_since_s_ = -1, fall_s_ = -1;
};

}  // namespace tendril::daemon
