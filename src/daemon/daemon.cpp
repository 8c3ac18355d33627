// The thread that serves LCM: commands in, states, events and the log out; see the header.
#include "tendril/daemon/daemon.h"

#include <fmt/format.h>
#include <systemd/sd-daemon.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <future>
#include <map>
#include <optional>
#include <span>
#include <stdexcept>
#include <thread>
#include <utility>

#include "handover.h"
#include "loop_report.h"
#include "neighbour.h"
#include "realtime_side.h"
#include "systemd.h"
#include "tendril/canopen/master.h"
#include "tendril/config/config.h"
#include "tendril/core/version.h"
#include "tendril/daemon/black_box.h"
#include "tendril/daemon/commissioning.h"
#include "tendril/daemon/messages.h"
#include "tendril/daemon/refusals.h"
#include "tendril/daemon/wiring.h"
#include "tendril/io/epoch.h"
#include "tendril/io/log.h"
#include "tendril/io/wire.h"
#include "tendril/rt/cyclic.h"

namespace tendril::daemon {
namespace {

constexpr int kLcmWait_ms = 1, kListen_ms = 50;
// Black box cycles written between two polls of LCM: about a millisecond.
constexpr int kBlackBoxCycles = 200;
constexpr TimeNs kReportEvery_ns = kNsPerS;
constexpr TimeNs kStatisticsEvery_ns = 60 * kNsPerS;
constexpr TimeNs kDisarmAgain_ns = 100 * kNsPerMs;

// Identifies this daemon to the operator of another one.
std::string Identity(const DaemonOptions& o) {
  std::array<char, 256> host{};
  if (gethostname(host.data(), host.size() - 1) != 0) host[0] = '?';
  return fmt::format("host {}, process {}, robot {}, bus {}", host.data(), getpid(), o.robot.name,
                     o.parameters.bus.interface);
}

bool MayPull(Mode mode) {
  switch (mode) {
    case Mode::kDisconnected:
    case Mode::kConfigured:
    case Mode::kSafeStop:
    case Mode::kFault:
      return false;
    default:
      return true;
  }
}

// Commands that end motion bypass the queues.
bool Stops(const Command& c) {
  return c.kind == CommandKind::kMode && (c.mode == ModeRequest::kDisarm || c.mode == ModeRequest::kHold);
}

// On any exit of the calling thread, disarms the robot and joins the real-time thread.
class StopAndJoin {
 public:
  StopAndJoin(std::thread& thread, std::atomic<bool>& stop) : thread_(thread), stop_(stop) {}
  ~StopAndJoin() {
    stop_.store(true, std::memory_order_relaxed);
    thread_.join();
  }
  StopAndJoin(const StopAndJoin&) = delete;
  StopAndJoin& operator=(const StopAndJoin&) = delete;

 private:
  std::thread& thread_;
  std::atomic<bool>& stop_;
};

}  // namespace

struct Daemon::State {
  State(const DaemonOptions& o, can::CanPort& p, rt::Timebase& t)
      : options(o),
        clock(t.clock()),
        gateway(o.parameters.lcm, ShapeOf(o.robot), clock),
        setups(DriveSetups(o.robot, o.parameters.bus)),
        realtime(options, p, t, setups, handover),
        loop(setups, *o.robot.actuation, o.parameters.bus.bitrate_bps) {
    run = {config::ToYaml(o.robot), config::ToYaml(o.parameters),
           std::string(Version()),  std::string(GitRevision()),
           io::EpochUs(),           Identity(o)};
    if (o.parameters.black_box) {
      black_box.emplace(*o.parameters.black_box, o.parameters.lcm, ShapeOf(o.robot), run,
                        io::EpochOffsetUs(clock), o.parameters.bus.cycle_ns, realtime.controller());
      realtime.RecordIn(*black_box);
    }
    gateway.OnCommand([this](const Command& c) {
      // Before the loop runs commands have no consumer, and a target would be outdated later; requests get an
      // answer.
      if (!handover.ticks() && c.kind != CommandKind::kMode) return;
      heard_sequence = c.sequence;
      const Command checked = Checked(c);
      const bool pushed = (Stops(checked) ? handover.stops : handover.commands).TryPush(checked);
      if (!pushed && checked.mode == ModeRequest::kDisarm)
        handover.disarm_waits.store(true, std::memory_order_relaxed);
    });
    gateway.OnTracker([this](const TrackerSample& s) {
      if (!handover.ticks()) return;
      ++readings_heard;
      handover.tracker.TryPush(s);
    });
    gateway.OnRun([this](const io::RunInfo& r) { neighbour.Heard(r, machine.Now()); });
    gateway.OnComplaint(
        [this](Status status, const std::string& text) { messages.Post(status, "gateway", text); });
  }

  // A request that leads to motion requires that this daemon is alone on its channels and that the robot is
  // commissioned; the record may have been written after the start. A refusal passes through the controller
  // as a request, so that the log explains it.
  Command Checked(Command c) {
    if (c.kind != CommandKind::kMode) return c;
    const bool moves = c.mode == ModeRequest::kArm || c.mode == ModeRequest::kHome;
    if ((moves || c.mode == ModeRequest::kCommission) && neighbour.present())
      return Refused(c, ModeRequest::kNotAlone, Status::kNotAlone, neighbour.Text());
    if (!moves) return c;
    const DaemonParameters& p = options.parameters;
    if (const std::string problem = CommissioningProblem(options.robot, p); !problem.empty())
      return Refused(c, ModeRequest::kNotCommissioned, Status::kNotCommissioned, problem);
    const std::string exchanged = ExchangedDrives(p, std::span(serials).first(setups.size()));
    if (!exchanged.empty() && p.exchanged_drives_refused)
      return Refused(c, ModeRequest::kDriveExchanged, Status::kDriveExchanged, exchanged);
    if (!exchanged.empty()) Event(Status::kDegraded, "daemon", exchanged);
    return c;
  }

  Command Refused(Command c, ModeRequest becomes, Status cause, const std::string& why) {
    c.mode = becomes;
    why_refused[cause] = why;
    return c;
  }

  void WatchNeighbour(TimeNs now_ns) {
    if (const auto news = neighbour.NewsAt(machine.Now())) Event(news->status, "daemon", news->text);
    // Repeated until disarmed: a command from before may still be queued.
    if (!neighbour.present() || !MayPull(last_mode) || now_ns < disarm_again_ns) return;
    disarm_again_ns = now_ns + kDisarmAgain_ns;
    Command disarm;
    disarm.kind = CommandKind::kMode;
    disarm.mode = ModeRequest::kDisarm;
    disarm.sequence = heard_sequence;  // leaves every sender's sequence unchanged
    disarm.received_ns = now_ns;
    disarm.valid_for_ns = kNsPerS;
    handover.stops.TryPush(disarm);
  }

  void ListenForOthers(TimeNs listen_ns) {
    for (const TimeNs end_ns = machine.Now() + listen_ns; machine.Now() < end_ns && !neighbour.present();)
      gateway.Handle(kListen_ms);
    if (neighbour.present()) throw std::runtime_error(neighbour.Text());
  }

  void TellCommissioning() {
    if (!options.parameters.commissioning_required) {
      Event(Status::kCommissioningOff, "daemon",
            "commissioning is not required: arms whatever is connected; for simulated robots only");
      return;
    }
    const std::string problem = CommissioningProblem(options.robot, options.parameters);
    Event(problem.empty() ? Status::kOk : Status::kNotCommissioned, "daemon",
          problem.empty() ? "commissioned: " + RecordPath(options.parameters) : problem);
  }

  void Serve(const std::function<bool()>& stop) {
    TimeNs report_ns = 0;
    TimeNs statistics_ns = clock.Now() + kStatisticsEvery_ns;
    bool ready_told = false, stop_told = false;
    while (!handover.finished.load(std::memory_order_acquire)) {
      handover.served_ns.store(machine.Now(), std::memory_order_relaxed);
      gateway.Handle(kLcmWait_ms);
      WatchNeighbour(clock.Now());
      Publish();
      WriteBlackBox();
      const TimeNs now_ns = clock.Now();
      if (!ready_told && handover.ticks()) {
        ready_told = true;
        sd_notify(0, "READY=1");
      }
      if (machine.Now() >= report_ns) {
        report_ns = machine.Now() + kReportEvery_ns;
        Report();
      }
      if (now_ns >= statistics_ns) {
        statistics_ns = now_ns + kStatisticsEvery_ns;
        Event(Status::kOk, "timing", loop.LatencyText());
      }
      if (stop()) handover.stop_requested.store(true, std::memory_order_relaxed);
      if (!stop_told && handover.stop_requested.load(std::memory_order_relaxed)) {
        stop_told = true;
        sd_notify(0, "STOPPING=1");
        Event(Status::kOk, "daemon", "stopping: disarming");
      }
    }
  }

  void Event(Status status, const std::string& source, const std::string& text) {
    messages.Post(status, source, text);
    gateway.PublishEvent(clock.Now(), status, source, text);
  }

  int NodeOf(int tendon) const {
    return setups[static_cast<std::size_t>(options.robot.actuation->DriveOf(tendon))].node_id;
  }

  std::string WhoseFault(const CycleOutput& out) const {
    const int tendons = options.robot.body.tendons();
    if (!IsFault(out.status) || out.blamed_tendon < 1 || out.blamed_tendon > tendons) return {};
    return fmt::format(" (tendon {}, node {})", out.blamed_tendon, NodeOf(out.blamed_tendon - 1));
  }

  // Prefix to a drive fault that missed cycles of the daemon are likely to have caused.
  std::string MissedCyclesPrefix(const CycleOutput& out) const {
    const auto end = out.reported.end();
    if (std::find(out.reported.begin(), end, Status::kCyclesMissed) == end) return {};
    return fmt::format("{} of the daemon's own cycles were missed, correct that first (tendril rt-check): ",
                       loop.deadline_misses());
  }

  // The bus event of the drive for which `out` is not ready; empty if there was none.
  std::string WhyNotReadyText(const CycleRecord& r) const {
    for (std::size_t i = 0; i < static_cast<std::size_t>(r.input.drives); ++i) {
      const auto said = last_of_drive.find(NodeOf(static_cast<int>(i)));
      if (r.output.status == WhyNotReady(r.input.drive[i].state) && r.output.status != Status::kOk &&
          said != last_of_drive.end())
        return said->second;
    }
    return {};
  }

  // Cause of a mode change; Ok where a command or the drives' progress caused it.
  static Status CauseOf(const CycleOutput& out) {
    if (IsFault(out.status)) return out.status;
    const auto cause = std::find_if(out.reported.begin(), out.reported.end(), ExplainsMode);
    return cause == out.reported.end() ? Status::kOk : *cause;
  }

  // Empty where the status says it all.
  std::string WhyRefused(const Command& command, const CycleOutput& out) const {
    if (out.command_status == Status::kTargetOutOfReach)
      return OutOfReachText(command, out.nearest_tip_W_m, options.robot.body.length_m());
    // In commissioning, tensions are pulls, with their own limits.
    if (out.command_status == Status::kCommandOutOfRange && out.mode != Mode::kCommissioning)
      return OutOfRangeText(command, options.robot);
    if (out.command_status == Status::kCommandWrongMode) return WrongModeText(out.mode);
    if (out.command_status == Status::kCommandWrongSize) return WrongSizeText(command, options.robot);
    if (out.command_status == Status::kAnotherSender) return AnotherSenderText(sender_in_control, out.mode);
    const auto known = why_refused.find(out.command_status);
    return known == why_refused.end() ? "" : known->second;
  }

  void Publish() {
    Published next;
    while (handover.records.TryPop(next)) {
      const CycleOutput& out = next.record.output;
      const Command& command = next.record.input.command;
      const bool refused = command.kind != CommandKind::kNone && out.command_status != Status::kOk;
      const bool takes_control =
          command.kind != CommandKind::kMode || command.mode == ModeRequest::kCommission;
      if (command.kind != CommandKind::kNone && !refused && takes_control) sender_in_control = command.sender;
      const std::string why = refused ? WhyRefused(command, out) : "";
      if (refused) refusals.Add(out.command_status, command, out.mode, why);
      gateway.PublishState(next.record, why, WhyNotReadyText(next.record));
      gateway.PublishCycle(next.record);
      if (out.mode != last_mode || (out.status != last_status && IsFault(out.status))) {
        const Status cause = CauseOf(out), status = IsFault(cause) ? cause : Status::kOk;
        const std::string what =
            fmt::format("{}{}{}", MissedCyclesPrefix(out), StatusText(cause), WhoseFault(out));
        Event(status, "controller",
              fmt::format("{} -> {}: {} {}", ModeText(last_mode), ModeText(out.mode), static_cast<int>(cause),
                          what));
        if (IsFault(status)) loop.Fault({io::EpochUs(), status, what});
      }
      last_mode = out.mode;
      last_status = out.status;
      loop.Count(next);
      serials = next.serials;
    }
    refusals.ReportDue(clock.Now(), [this](Status s, const std::string& text) { Event(s, "gate", text); });
    canopen::BusEvent event;
    while (handover.events.TryPop(event)) {
      if (IsFault(event.status) && event.node_id != 0) last_of_drive[event.node_id] = event.text.data();
      if (event.status == Status::kOk) last_of_drive.erase(event.node_id);
      messages.Post(event.status, "bus", event.text.data());
      gateway.PublishEvent(event.time_ns, event.status, "bus", event.text.data());
    }
  }

  void WriteBlackBox() {
    if (!black_box) return;
    if (const auto outcome = black_box->WriteSome(kBlackBoxCycles))
      Event(outcome->status, "black box", outcome->text);
  }

  // An exchanged drive, or one that could be exchanged unnoticed, is reported when it appears, not only on
  // arming.
  void ReportExchangedDrives() {
    const auto known = std::span(serials).first(setups.size());
    if (serials == serials_told || std::find(known.begin(), known.end(), 0U) != known.end()) return;
    serials_told = serials;
    for (const std::string& text :
         {ExchangedDrives(options.parameters, known), UnnumberedDrives(options.parameters)}) {
      if (!text.empty()) Event(Status::kDegraded, "daemon", text);
    }
  }

  // Once per second: the run record, losses and statistics.
  void Report() {
    gateway.PublishRun(run);
    gateway.PublishStatistics(loop.Collect(clock.Now(), gateway.counters()));
    ReportExchangedDrives();
    if (const auto missed = loop.NewMisses()) Event(Status::kCycleLate, "timing", *missed);
    ReportLosses("command(s) arrived faster than one per cycle",
                 handover.commands.dropped() + handover.stops.dropped() +
                     handover.overtaken.load(std::memory_order_relaxed),
                 commands_lost);
    // Either more than one per cycle over a whole second, or a burst after a pause of the sender.
    const std::uint64_t cycles = handover.tick.load(std::memory_order_relaxed);
    const bool steadily = readings_heard - readings_before > cycles - cycles_before;
    readings_before = readings_heard;
    cycles_before = cycles;
    ReportLosses(steadily ? "tracker reading(s) arrived faster than one per cycle"
                          : "tracker reading(s) arrived in a burst, although fewer than cycles,",
                 handover.tracker.dropped(), readings_lost);
    ReportLosses("cycle record(s) could not be published in time", handover.records.dropped(), records_lost);
    ReportLosses("bus event(s) arrived too fast",
                 handover.events.dropped() + handover.master_events_lost.load(std::memory_order_relaxed),
                 events_lost);
    ReportLosses("LCM message(s) could not be sent", gateway.counters().publish_failed, sends_failed);
    if (log && !log_failed && !log->error().empty()) {
      log_failed = true;
      Event(Status::kDegraded, "log", log->error() + "; control continues");
    }
    sd_notify(0, fmt::format("STATUS={}, {} {}; {} cycles, {} missed", ModeText(last_mode),
                             static_cast<int>(last_status), StatusText(last_status), loop.cycles(),
                             loop.deadline_misses())
                     .c_str());
  }

  void ReportLosses(const char* what, std::uint64_t now, std::uint64_t& before) {
    if (now == before) return;
    Event(Status::kDegraded, "daemon",
          fmt::format("{} {} and were dropped, {} since start", now - before, what, now));
    before = now;
  }

  Messages messages{&WriteLogLine};
  DaemonOptions options;
  const Clock& clock;
  const MonotonicClock machine;  // for what other programs wait for, however fast the robot's time passes
  io::Gateway gateway;
  std::vector<canopen::DriveSetup> setups;
  Handover handover;
  RealtimeSide realtime;
  std::optional<io::LogWriter> log;
  io::RunInfo run;
  std::optional<BlackBox> black_box;
  Neighbour neighbour{run, options.parameters.lcm};
  LoopReport loop;
  Mode last_mode = Mode::kDisconnected;
  Status last_status = Status::kOk;
  std::uint64_t commands_lost = 0, readings_lost = 0, records_lost = 0, events_lost = 0, sends_failed = 0;
  std::uint64_t readings_heard = 0, readings_before = 0, cycles_before = 0;
  bool log_failed = false;
  std::array<std::uint32_t, kMaxTendons> serials{}, serials_told{};
  Refusals refusals;
  std::map<Status, std::string> why_refused;  // where the status alone does not explain it
  std::map<int, std::string> last_of_drive;   // last error event of each drive, by node id
  std::uint32_t sender_in_control = 0;  // sender of the last accepted target, or the one that commissions
  std::uint32_t heard_sequence = 0;
  TimeNs disarm_again_ns = 0;
};

Daemon::Daemon(const DaemonOptions& options, can::CanPort& port, rt::Timebase& time)
    : state_(std::make_unique<State>(options, port, time)) {}

Daemon::~Daemon() = default;

io::Gateway& Daemon::gateway() { return state_->gateway; }

void Daemon::RequestStop() noexcept {
  state_->handover.stop_requested.store(true, std::memory_order_relaxed);
}

void Daemon::Log(Status status, const std::string& text) { state_->messages.Post(status, "daemon", text); }

void Daemon::RefuseOthers(TimeNs listen_ns) { state_->ListenForOthers(listen_ns); }

void Daemon::Run(const std::function<bool()>& stop) {
  State& s = *state_;
  if (!s.options.log_path.empty()) s.log.emplace(s.gateway, s.options.log_path, s.clock);
  s.gateway.PublishRun(s.run);  // a log begins with what its cycles belong to
  s.handover.served_ns.store(s.machine.Now(), std::memory_order_relaxed);
  const WatchdogFeeder feeder(s.handover.tick);
  std::promise<std::string> ready;
  std::thread realtime([&] { s.realtime.Run(ready); });
  {
    const StopAndJoin join(realtime, s.handover.stop_requested);
    const std::string problems = ready.get_future().get();
    if (!problems.empty()) {
      if (s.options.parameters.realtime.required) {
        throw std::runtime_error("real-time rights are missing and realtime.required is true: " + problems);
      }
      s.Event(Status::kDegraded, "realtime", problems);
    }
    if (s.black_box) {
      const std::string problem = s.black_box->CheckFolder();
      if (!problem.empty()) s.Event(Status::kDegraded, "black box", problem);
    }
    s.TellCommissioning();
    s.Serve(stop);
  }
  s.Publish();
  while (s.black_box && s.black_box->full()) s.WriteBlackBox();
  if (!s.handover.disarmed_in_time.load(std::memory_order_relaxed)) {
    s.Event(Status::kDegraded, "daemon",
            "tensions were still ramping down when time was up: drives were disabled at once");
  }
  s.Event(Status::kOk, "timing", s.loop.LatencyText());
  s.Event(Status::kOk, "daemon", "stopped");
  s.gateway.Handle(0);
}

}  // namespace tendril::daemon
