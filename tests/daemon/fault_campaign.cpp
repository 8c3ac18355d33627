// fault_campaign: random faults at random moments of random motions, in simulated time, each scenario given
// by its seed alone. The rules of safety_rig.h hold in every cycle, faults are noticed in time where they
// must be, and nothing comes back by itself. Prints outcomes by kind; exit status 1 when a rule was broken.
#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <map>
#include <mutex>
#include <optional>
#include <random>
#include <thread>

#include "safety_rig.h"
#include "tendril/core/version.h"

namespace tendril::daemon {
namespace {

enum class Kind {
  kDropFeedback,
  kDropTorque,
  kDropAll,
  kDelayFeedback,
  kDuplicate,
  kCorruptFeedback,
  kCorruptTorque,
  kDie,
  kReboot,
  kFreeze,
  kEmcy,
  kHeartbeat,
  kStuckEncoder,
  kStuckCell,
  kStuckTorque,
  kBusOff,
  kCellOff,
  kCellRail,
  kCellGain,
  kEncoderJump,
  kEncoderDrift,
  kStrongMotor,
  kWeakMotor,
  kJitter,
  kStall,
  kClockStep,
  kBadCommand,
  kSilence,
  kTwoDrives,
  kHungDrive,
  kInterfaceDown,
  kCount
};
const char* const kKindText[] = {"feedback lost",
                                 "torque frames lost",
                                 "frames lost at random",
                                 "feedback late",
                                 "frames doubled",
                                 "feedback spoilt",
                                 "torque spoilt",
                                 "drive dies",
                                 "drive reboots",
                                 "drive freezes",
                                 "EMCY",
                                 "heartbeat stops",
                                 "encoder stuck",
                                 "load cell stuck",
                                 "torque reading stuck",
                                 "bus off",
                                 "load cell off",
                                 "load cell at its rail",
                                 "load cell gain",
                                 "encoder jumps",
                                 "encoder drifts",
                                 "motor too strong",
                                 "motor too weak",
                                 "late cycles",
                                 "daemon stalls",
                                 "clock steps",
                                 "bad commands",
                                 "commands stop",
                                 "two drives die",
                                 "drive hangs",
                                 "interface down"};
static_assert(std::size(kKindText) == static_cast<std::size_t>(Kind::kCount));

enum class Moment { kArming, kRunning, kHold, kSafeStop, kHoming, kCommissioning };
const char* const kMomentText[] = {"arming", "running", "hold", "safe stop", "homing", "commissioning"};
enum class Path { kRest, kSlowCircle, kCircle, kBends, kTensions, kCount };
const char* const kPathText[] = {"rest", "slow circle", "circle", "bends", "tensions"};

struct Scenario {
  std::uint64_t seed = 0;
  Kind kind{};
  Moment moment{};
  Path path{};
  bool equilibrium = false;  // the law, with tension feedback; else the paper's
  int node = 1;
  double at_s = 0;   // after running (or arming) began
  double for_s = 0;  // 0: to the end
  double size = 0;   // 0..1, what it means depends on the kind
};

Scenario Make(std::uint64_t seed) {
  std::mt19937_64 random(seed * 0x9E3779B97F4A7C15u + 1);
  const auto share = [&random] { return static_cast<double>(random() >> 11) * 0x1p-53; };
  const auto one_of = [&](int n) { return static_cast<int>(share() * n); };
  Scenario s;
  s.seed = seed;
  s.kind = static_cast<Kind>(seed % static_cast<std::uint64_t>(Kind::kCount));  // all kinds alike often
  const double when = share();
  s.moment = when < 0.12   ? Moment::kArming
             : when < 0.55 ? Moment::kRunning
             : when < 0.65 ? Moment::kHold
             : when < 0.80 ? Moment::kSafeStop
             : when < 0.90 ? Moment::kHoming
                           : Moment::kCommissioning;
  s.path = static_cast<Path>(one_of(static_cast<int>(Path::kCount)));
  s.equilibrium = share() < 0.5;
  s.node = 1 + one_of(3);
  s.at_s = s.moment == Moment::kArming ? 0.15 * share() : 0.2 + 1.3 * share();
  s.for_s = share() < 0.3 ? 0 : 0.002 + 0.4 * share();
  s.size = share();
  if (s.kind == Kind::kSilence) s.for_s = 0;  // shorter silences are other kinds' motions
  return s;
}

std::string Text(const Scenario& s) {
  char text[200];
  std::snprintf(text, sizeof text, "%s, node %d, %s, %s, %s law, at %.3f s for %.3f s, size %.3f",
                kKindText[static_cast<int>(s.kind)], s.node, kMomentText[static_cast<int>(s.moment)],
                kPathText[static_cast<int>(s.path)], s.equilibrium ? "equilibrium" : "paper", s.at_s, s.for_s,
                s.size);
  return text;
}

struct Result {
  bool faulted = false, held = false, refused = false, recovered = false;
  Status status = Status::kOk;
  int reaction_cycles = -1;  // from the beginning of the fault
  double max_tension_N = 0, max_base_N = 0;
  std::vector<std::string> violations;
};

class Play {
 public:
  Play(const Scenario& scenario, const std::string& config, bool verbose)
      : s_(scenario), verbose_(verbose), rig_(Options(scenario, config)) {}

  Result Run() {
    Drive();
    result_.max_tension_N = rig_.max_tension_N();
    result_.max_base_N = rig_.max_base_N();
    result_.violations.insert(result_.violations.end(), rig_.violations().begin(), rig_.violations().end());
    return result_;
  }

 private:
  static SafetyOptions Options(const Scenario& s, const std::string& config) {
    SafetyOptions o;
    o.daemon = config::LoadDaemon(config + "/tendrild.yaml");
    o.robot = config::LoadRobot(config + "/robots/rig_60mm.yaml");
    o.plant = o.robot;
    o.seed = s.seed;
    o.daemon.controller.pretension_ramp_Nps = 5;
    o.daemon.controller.pretension_settle_s = 0.05;
    if (s.equilibrium) {
      o.daemon.controller.law = ControlLaw::kEquilibrium;
      o.daemon.controller.tension_feedback = true;
    }
    if (s.moment == Moment::kHoming) {
      o.plant.effects.push_back(
          {.name = "slack", .where = "tendon:" + std::to_string(s.node), .values = {{"m", 0.003 * s.size}}});
    }
    // The motor on this node is not what the file says, from the beginning.
    double& scale = o.plant.actuation->tendons[static_cast<std::size_t>(s.node - 1)].motor.torque_scale;
    if (s.kind == Kind::kStrongMotor) scale = 1 + s.size;
    if (s.kind == Kind::kWeakMotor) scale = 1 - 0.95 * s.size;
    return o;
  }

  void Broken(const std::string& what) { result_.violations.push_back(what); }

  bool BareMotors() const { return s_.moment == Moment::kHoming || s_.moment == Moment::kCommissioning; }

  // Target of the path, every tenth cycle.
  Command Target(double t_s) {
    if (s_.moment == Moment::kCommissioning) {
      TendonVector pull_N = TendonVector::Zero(3);
      pull_N[s_.node - 1] = std::fmod(t_s, 0.8) < 0.6 ? 1.5 : -0.5;
      return rig_.Tensions(pull_N);
    }
    switch (s_.path) {
      case Path::kSlowCircle:
        return rig_.Circle(std::min(1.2, t_s), 0.5, t_s);
      case Path::kCircle:
        return rig_.Circle(std::min(0.9, t_s), 2, t_s);
      case Path::kBends:
        return rig_.Bend(std::fmod(t_s, 2) < 1 ? 1.0 : -0.8, 0.4);
      case Path::kTensions:
        return rig_.Tensions(Eigen::Vector3d(0.5, 1 + 6 * std::min(1., t_s), 0.7));
      default:
        return {};
    }
  }

  void Drive() {
    if (!rig_.RunUntil(Mode::kConfigured, 10)) return Broken("the drives were not configured");
    rig_.Step(rig_.Request(s_.moment == Moment::kHoming          ? ModeRequest::kHome
                           : s_.moment == Moment::kCommissioning ? ModeRequest::kCommission
                                                                 : ModeRequest::kArm));
    double begin_s = rig_.now_s();
    if (s_.moment != Moment::kArming && !BareMotors()) {
      if (!rig_.RunUntil(Mode::kRunning, 5)) {
        if (rig_.output().mode == Mode::kFault) return After();  // a motor that is not what it should be
        return Broken("not running after arm");
      }
      begin_s = rig_.now_s();
    }
    const double end_s = s_.at_s + (s_.for_s > 0 ? s_.for_s : 1) + 0.6;
    bool mode_sent = false, begun = false, ended = false;
    for (int i = 0; rig_.now_s() - begin_s < end_s; ++i) {
      const double t_s = rig_.now_s() - begin_s;
      Command c;
      const bool running = rig_.output().mode == Mode::kRunning;
      const bool led = running || rig_.output().mode == Mode::kCommissioning;
      if (led && i % 10 == 0) c = Target(t_s);
      // The mode in which it happens begins a little before.
      if (!mode_sent && t_s > s_.at_s - 0.1 && running) {
        mode_sent = true;
        if (s_.moment == Moment::kHold) c = rig_.Request(ModeRequest::kHold);
        if (s_.moment == Moment::kSafeStop) c = rig_.Request(ModeRequest::kDisarm);
      }
      const bool active = t_s >= s_.at_s && (s_.for_s <= 0 || t_s < s_.at_s + s_.for_s);
      if (t_s >= s_.at_s && !begun) {
        begun = true;
        since_cycle_ = rig_.record().input.cycle;
        begun_under_power_ = powered_for_ > 5;
        Begin();
      }
      if (begun && !active && !ended) {
        ended = true;
        End();
      }
      Cycle(c, active, i);
      Watch(begun);
      Judge(begun, active);
    }
    if (!ended) End();
    After();
  }

  FaultParameters Frames(FaultKind kind, FrameDirection direction) const {
    FaultParameters f;
    f.kind = kind;
    f.node = s_.node;
    f.direction = direction;
    f.for_s = s_.for_s;
    return f;
  }
  FaultParameters Simple(FaultKind kind) const {
    FaultParameters f;
    f.kind = kind;
    f.node = s_.node;
    f.for_s = s_.for_s;
    return f;
  }

  void Begin() {
    const auto node = static_cast<std::uint32_t>(s_.node);
    FaultParameters f;
    switch (s_.kind) {
      case Kind::kDropFeedback:
        f = Frames(FaultKind::kDrop, FrameDirection::kFromDrives);
        f.cob_id = 0x180 + node;
        return rig_.Order(f);
      case Kind::kDropTorque:
        f = Frames(FaultKind::kDrop, FrameDirection::kToDrives);
        f.cob_id = 0x200 + node;
        return rig_.Order(f);
      case Kind::kDropAll:
        f = Frames(FaultKind::kDrop, FrameDirection::kBoth);
        f.node = 0;
        f.probability = s_.size * s_.size;
        return rig_.Order(f);
      case Kind::kDelayFeedback:
        f = Frames(FaultKind::kDelay, FrameDirection::kFromDrives);
        f.delay_s = 0.02 * s_.size;
        return rig_.Order(f);
      case Kind::kDuplicate:
        f = Frames(FaultKind::kDuplicate, FrameDirection::kBoth);
        f.probability = s_.size;
        return rig_.Order(f);
      case Kind::kCorruptFeedback:
        f = Frames(FaultKind::kCorrupt, FrameDirection::kFromDrives);
        f.cob_id = 0x180 + node;
        f.probability = s_.size * s_.size;
        return rig_.Order(f);
      case Kind::kCorruptTorque:
        // One frame: a checksum of 15 bits lets one of many pass, not a stream.
        f = Frames(FaultKind::kCorrupt, FrameDirection::kToDrives);
        f.cob_id = 0x200 + node;
        f.count = 1;
        return rig_.Order(f);
      case Kind::kDie:
        return rig_.Order(Simple(FaultKind::kDie));
      case Kind::kTwoDrives:
        rig_.Order(Simple(FaultKind::kDie));
        f = Simple(FaultKind::kDie);
        f.node = 1 + s_.node % 3;
        return rig_.Order(f);
      case Kind::kReboot:
        return rig_.Order(Simple(FaultKind::kReboot));
      case Kind::kFreeze:
        return rig_.Order(Simple(FaultKind::kFreeze));
      case Kind::kEmcy: {
        constexpr std::uint16_t kCodes[] = {0x2310, 0x3210, 0x3220, 0x4210, 0x7320, 0x8611};
        f = Simple(FaultKind::kEmcy);
        f.code = kCodes[static_cast<std::size_t>(s_.size * 6)];
        return rig_.Order(f);
      }
      case Kind::kHeartbeat:
        return rig_.Order(Simple(FaultKind::kStopHeartbeat));
      case Kind::kStuckEncoder:
      case Kind::kStuckCell:
      case Kind::kStuckTorque:
        f = Simple(FaultKind::kStickSensor);
        f.sensor = s_.kind == Kind::kStuckEncoder ? DriveSensor::kEncoder
                   : s_.kind == Kind::kStuckCell  ? DriveSensor::kLoadCell
                                                  : DriveSensor::kTorque;
        return rig_.Order(f);
      case Kind::kBusOff:
        f = Simple(FaultKind::kBusOff);
        f.node = 0;
        return rig_.Order(f);
      case Kind::kCellOff:
        rig_.tampering.node = s_.node;
        rig_.tampering.cell_fixed = true;
        return;
      case Kind::kCellRail:
        rig_.tampering.node = s_.node;
        rig_.tampering.cell_fixed = true;
        rig_.tampering.cell_mV = s_.size < 0.5 ? 10000 : -10000;
        return;
      case Kind::kCellGain:
        rig_.tampering.node = s_.node;
        rig_.tampering.cell_gain = 3 * s_.size - 0.5;
        return;
      case Kind::kEncoderJump:
        rig_.tampering.node = s_.node;
        rig_.tampering.offset_counts = static_cast<std::int32_t>(4000 * (s_.size - 0.5));
        return;
      case Kind::kHungDrive:
        rig_.tampering.node = s_.node;
        rig_.tampering.hung = true;
        return;
      case Kind::kEncoderDrift:
        rig_.tampering.node = s_.node;
        rig_.tampering.counts_per_cycle = 100 * (s_.size - 0.5);
        return;
      case Kind::kInterfaceDown:
        rig_.TakeDown(true);
        return;
      default:
        return;
    }
  }

  void End() {
    rig_.tampering = {};
    rig_.TakeDown(false);
  }

  void Cycle(Command c, bool active, int i) {
    std::uint64_t skipped = 0;
    TimeNs off_ns = 0;
    if (active && s_.kind == Kind::kJitter && i % 7 == 0) skipped = static_cast<std::uint64_t>(s_.size * 6);
    if (active && s_.kind == Kind::kStall && !struck_) skipped = static_cast<std::uint64_t>(s_.size * 600);
    if (active && s_.kind == Kind::kClockStep && !struck_) off_ns = 1 + static_cast<TimeNs>(s_.size * 5e6);
    if (active && s_.kind == Kind::kSilence) c = {};
    if (active && s_.kind == Kind::kBadCommand && i % 3 == 0) c = Bad(i);
    struck_ = struck_ || active;
    rig_.Step(c, skipped, off_ns);
  }

  Command Bad(int i) {
    Command c = rig_.Bend(0.1, 0.1);
    switch (i / 3 % 6) {
      case 0:
        c.bending_rad[0] = std::nan("");
        break;
      case 1:
        c.bending_rad[1] = 50;
        break;
      case 2:
        c.received_ns -= kNsPerS;
        break;
      case 3:
        c.sequence -= 3;
        break;
      case 4:
        c.kind = CommandKind::kTension;
        c.tension_N = TendonVector::Constant(3, -1.);
        break;
      default:
        c = rig_.Request(ModeRequest::kClear);
        break;
    }
    return c;
  }

  void Watch(bool begun) {
    const CycleOutput& o = rig_.output();
    if (begun && o.mode == Mode::kFault && !result_.faulted) {
      result_.reaction_cycles = static_cast<int>(rig_.record().input.cycle - since_cycle_);
    }
    if (o.mode == Mode::kFault && !result_.faulted) {
      result_.faulted = true;
      result_.status = o.status;
      const bool from_the_start = s_.kind == Kind::kStrongMotor || s_.kind == Kind::kWeakMotor;
      if (!begun && !from_the_start)
        Broken("a fault before anything happened: " + std::string(StatusText(o.status)));
      mode_at_ = last_mode_;
      if (verbose_) {
        std::printf("%.3f s: %s -> fault %d %s\n", rig_.now_s(), std::string(ModeText(last_mode_)).c_str(),
                    static_cast<int>(o.status), std::string(StatusText(o.status)).c_str());
      }
    } else if (verbose_ && o.mode != last_mode_) {
      std::printf("%.3f s: %s -> %s\n", rig_.now_s(), std::string(ModeText(last_mode_)).c_str(),
                  std::string(ModeText(o.mode)).c_str());
    }
    result_.held = result_.held || o.status == Status::kCommandsSilent;
    result_.refused = result_.refused || o.commands_refused > 0;
    last_mode_ = o.mode;
  }

  // How many cycles of it, with torque on the tendons, must make a fault; nothing where that depends on more
  // than the scenario says: then the rules of safety_rig.h judge by what the plant does. `at_once`: it
  // happens in one cycle, and counts from there.
  struct Bound {
    int cycles = 0;
    bool at_once = false;
  };
  std::optional<Bound> Within() const {
    const BusParameters& bus = rig_.options().daemon.bus;
    const GuardParameters& g = rig_.options().daemon.controller.guards;
    switch (s_.kind) {
      case Kind::kDropFeedback:
      case Kind::kDie:
      case Kind::kTwoDrives:
      case Kind::kFreeze:
        return Bound{g.max_missing_cycles + 2};
      case Kind::kDelayFeedback:
        if (0.02 * s_.size > 1e-3 * (g.max_missing_cycles + 2)) return Bound{g.max_missing_cycles + 3};
        return {};
      case Kind::kDropAll:
        if (s_.size * s_.size > 0.7) return Bound{250};
        return {};
      case Kind::kCorruptFeedback:
        // Of the position's bits, those of half a millimetre and more make a third of the frame.
        if (s_.size * s_.size > 0.5) return Bound{100};
        return {};
      case Kind::kReboot:
      case Kind::kEmcy:
      case Kind::kBusOff:
      case Kind::kInterfaceDown:
        return Bound{4, true};
      case Kind::kHeartbeat:
        return Bound{static_cast<int>(bus.heartbeat_timeout_ms) + bus.heartbeat_ms + 5};
      case Kind::kCellRail:
        if (!BareMotors()) return Bound{g.confirm_cycles + 2};
        return {};
      case Kind::kEncoderJump:
        // 0.5 mm are 385 counts.
        if (std::abs(4000 * (s_.size - 0.5)) > 400) return Bound{3, true};
        return {};
      case Kind::kStall:
        if (s_.size * 600 > g.max_late_cycles + 1) return Bound{2, true};
        return {};
      case Kind::kJitter: {
        // As many as are skipped in seven cycles, less what is forgotten in them.
        const int skipped = static_cast<int>(s_.size * 6);
        const double more = skipped - 1e-3 * g.max_late_cycles * 7;
        if (skipped > 1) return Bound{static_cast<int>(7 * g.max_late_cycles / more) + 15};
        return {};
      }
      case Kind::kClockStep:
        return Bound{1, true};
      default:
        return {};
    }
  }

  // In every mode in which motors pull.
  bool Powered() {
    const Mode mode = rig_.output().mode;
    const bool bare = mode == Mode::kHoming || mode == Mode::kCommissioning;
    for (int d = 0; bare && d < 3; ++d) engaged_ = engaged_ || rig_.rig().drives().enabled(d);
    engaged_ = engaged_ && bare;
    return engaged_ || mode == Mode::kPretension || mode == Mode::kRunning || mode == Mode::kHold ||
           mode == Mode::kSafeStop;
  }

  void Judge(bool begun, bool active) {
    const bool powered = Powered();
    powered_for_ = powered ? powered_for_ + 1 : 0;
    const bool unharmed = s_.kind == Kind::kDuplicate || s_.kind == Kind::kBadCommand;
    if (begun && unharmed && result_.faulted && !told_) {
      told_ = true;
      Broken("a fault of what harms nobody: " + std::string(StatusText(result_.status)));
    }
    if (begun && s_.kind == Kind::kSilence && active && rig_.output().mode == Mode::kRunning) {
      const GuardParameters& g = rig_.options().daemon.controller.guards;
      const bool moving = s_.path == Path::kSlowCircle || s_.path == Path::kCircle;
      // Valid for 0.1 s.
      if (moving && ++exposed_ == static_cast<int>(1e3 * (0.1 + g.max_stream_silence_s)) + 5)
        Broken("a silent stream is followed on");
      return;
    }
    const std::optional<Bound> within = Within();
    if (!begun || !within || result_.faulted || !powered) return;
    if (within->at_once ? !begun_under_power_ : !active) return;
    if (++exposed_ == within->cycles + 1)
      Broken("not noticed within " + std::to_string(within->cycles) + " cycles under torque");
  }

  // Down, and back only on the operator's word.
  void After() {
    Watch(true);
    rig_.Run(2.5);
    if (rig_.output().mode == Mode::kFault && rig_.fall_s() < 0) rig_.Run(2.5);  // it has only just come
    if (rig_.output().mode == Mode::kFault) {
      for (int d = 0; d < 3 && !(s_.kind == Kind::kFreeze && s_.for_s <= 0); ++d) {
        if (rig_.rig().drives().torque_Nm(d) != 0) Broken("torque 2.5 s after a fault");
      }
      if (rig_.Step(rig_.Request(ModeRequest::kArm)).output.command_status != Status::kCommandWrongMode) {
        Broken("a fault was armed away");
      }
      rig_.Step(rig_.Request(ModeRequest::kClear));
      result_.recovered = rig_.RunUntil(Mode::kConfigured, 8);
    } else {
      rig_.Step(rig_.Request(ModeRequest::kDisarm));
      result_.recovered = rig_.RunUntil(Mode::kConfigured, 5);
    }
    rig_.Run(0.8);  // also for a drive that must be stopped by NMT
    // A drive that hangs for good keeps its torque, and no daemon can take it away.
    if (s_.kind == Kind::kFreeze && s_.for_s <= 0) return;
    for (int d = 0; d < 3; ++d) {
      if (rig_.rig().drives().torque_Nm(d) != 0) Broken("torque at the end");
    }
  }

  Scenario s_;
  bool verbose_;
  SafetyRig rig_;
  Result result_;
  std::uint64_t since_cycle_ = 0;
  Mode last_mode_ = Mode::kDisconnected, mode_at_ = Mode::kDisconnected;
  bool struck_ = false, engaged_ = false, begun_under_power_ = false, told_ = false;
  int powered_for_ = 0, exposed_ = 0;  // cycles
};

struct Row {
  int scenarios = 0, tolerated = 0, held = 0, faulted = 0, recovered = 0, violations = 0, slowest = 0;
  double max_tension_N = 0, max_base_N = 0;
  std::map<int, int> by_status;

  void Add(const Result& r) {
    ++scenarios;
    faulted += r.faulted ? 1 : 0;
    held += r.held && !r.faulted ? 1 : 0;
    tolerated += !r.faulted && !r.held ? 1 : 0;
    recovered += r.recovered ? 1 : 0;
    violations += r.violations.empty() ? 0 : 1;
    slowest = std::max(slowest, r.reaction_cycles);
    max_tension_N = std::max(max_tension_N, r.max_tension_N);
    max_base_N = std::max(max_base_N, r.max_base_N);
    if (r.faulted) ++by_status[static_cast<int>(r.status)];
  }
};

void PrintRow(const char* name, const Row& r) {
  std::string statuses;
  for (const auto& [status, count] : r.by_status)
    statuses += std::to_string(status) + "x" + std::to_string(count) + " ";
  std::printf("%-22s%7d%8d%7d%7d%9d%9.2f%9.2f%10d%7d  %s\n", name, r.scenarios, r.tolerated, r.held,
              r.faulted, r.slowest, r.max_tension_N, r.max_base_N, r.recovered, r.violations,
              statuses.c_str());
}

void PrintTable(const std::vector<Row>& rows, const Row& all) {
  std::printf("%-22s%7s%8s%7s%7s%9s%9s%9s%10s%7s  %s\n", "fault", "runs", "went on", "held", "faults",
              "slowest", "motor N", "base N", "recovered", "broken", "faults by number");
  for (std::size_t k = 0; k < rows.size(); ++k) {
    if (rows[k].scenarios > 0) PrintRow(kKindText[k], rows[k]);
  }
  PrintRow("all", all);
  std::fflush(stdout);
}

struct Orders {
  std::uint64_t first = 1;
  int scenarios = 1000, jobs = std::max(1, static_cast<int>(std::thread::hardware_concurrency())),
      every = 100;
  bool one = false;
  std::string config = std::string(TENDRIL_SOURCE_DIR) + "/config";
};

void AddOptions(CLI::App& app, Orders& o) {
  const auto count = [](int most) { return CLI::Range(1, most); };
  app.add_option("--scenarios", o.scenarios, "how many are played")
      ->check(count(100'000'000))
      ->capture_default_str();
  CLI::Option* first =
      app.add_option("--first", o.first, "seed of the first; the next have the next")->capture_default_str();
  app.add_option("--jobs", o.jobs,
                 "how many at a time; the outcome does not depend on it (default: a CPU each)")
      ->check(count(1000));
  app.add_option("--every", o.every, "prints the table so far after so many")
      ->check(count(100'000'000))
      ->capture_default_str();
  app.add_option_function<std::uint64_t>(
         "--seed",
         [&o](std::uint64_t seed) {
           o.first = seed;
           o.scenarios = 1;
           o.one = true;
         },
         "plays this one alone and tells what happened")
      ->excludes(first);
  app.add_option("--config", o.config, "folder of the configuration")
      ->check(CLI::ExistingDirectory)
      ->capture_default_str();
  app.set_version_flag("--version", "fault_campaign " + std::string(Version()));
}

Result PlayOne(const Scenario& s, const Orders& o) {
  try {
    return Play(s, o.config, o.one).Run();
  } catch (const std::exception& e) {
    Result r;
    r.violations.push_back(e.what());
    return r;
  }
}

int Main(int argc, char** argv) {
  Orders o;
  CLI::App app(
      "Random faults at random moments of random motions, in simulated time; exit status 1 when a rule of "
      "safety was broken, 2 for wrong use");
  AddOptions(app, o);
  try {
    app.parse(argc, argv);
    // What is wrong with the files is no rule that a scenario breaks.
    Play(Make(o.first), o.config, false);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "fault_campaign: %s\n", e.what());
    return 2;
  }
  o.jobs = std::min(o.jobs, o.scenarios);
  if (o.one) std::printf("%s\n", Text(Make(o.first)).c_str());

  std::mutex mutex;  // of all that follows, up to the threads
  std::vector<Row> rows(static_cast<std::size_t>(Kind::kCount));
  Row all;
  int next = 0;
  const auto begin = std::chrono::steady_clock::now();
  const auto work = [&] {
    for (;;) {
      Scenario s;
      {
        const std::lock_guard lock(mutex);
        if (next >= o.scenarios) return;
        s = Make(o.first + static_cast<std::uint64_t>(next++));
      }
      const Result r = PlayOne(s, o);
      const std::lock_guard lock(mutex);
      rows[static_cast<std::size_t>(s.kind)].Add(r);
      all.Add(r);
      if (!r.violations.empty()) {
        std::printf("seed %llu: %s\n", static_cast<unsigned long long>(s.seed), Text(s).c_str());
        for (const std::string& v : r.violations) std::printf("  %s\n", v.c_str());
      }
      if (all.scenarios % o.every == 0 && all.scenarios < o.scenarios) {
        PrintTable(rows, all);
        const double seconds =
            std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
        std::printf("%d of %d after %.0f s, %d broken\n\n", all.scenarios, o.scenarios, seconds,
                    all.violations);
      }
      std::fflush(stdout);
    }
  };
  std::vector<std::thread> threads;
  for (int i = 0; i < o.jobs; ++i) threads.emplace_back(work);
  for (std::thread& t : threads) t.join();

  PrintTable(rows, all);
  if (all.violations > 0) std::printf("again: fault_campaign --config %s --seed SEED\n", o.config.c_str());
  return all.violations > 0 ? 1 : 0;
}

}  // namespace
}  // namespace tendril::daemon

int main(int argc, char** argv) { return tendril::daemon::Main(argc, argv); }
