// The daemon's two threads and what passes between them; see the header.
#include "tendril/daemon/daemon.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <syslog.h>
#include <systemd/sd-daemon.h>
#include <systemd/sd-journal.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <future>
#include <map>
#include <mutex>
#include <optional>
#include <span>
#include <stdexcept>
#include <stop_token>
#include <thread>
#include <utility>

#include "tendril/canopen/master.h"
#include "tendril/config/config.h"
#include "tendril/control/controller.h"
#include "tendril/core/version.h"
#include "tendril/daemon/black_box.h"
#include "tendril/daemon/commissioning.h"
#include "tendril/daemon/control_cycle.h"
#include "tendril/daemon/messages.h"
#include "tendril/daemon/refusals.h"
#include "tendril/daemon/wiring.h"
#include "tendril/io/log.h"
#include "tendril/io/wire.h"
#include "tendril/rt/cyclic.h"
#include "tendril/rt/handoff.h"
#include "tendril/rt/usage.h"

namespace tendril::daemon {
namespace {

constexpr std::size_t kCommandQueue = 256;
constexpr std::size_t kTrackerQueue = 64;
constexpr std::size_t kRecordQueue = 1024;  // a second at 1 kHz
constexpr std::size_t kEventQueue = 256;
constexpr int kEventsPerCycle = 16;

// After the stop request: time for tensions to ramp down, then for the drives to be disabled. The rest of the
// 2 s is for joining the thread and closing the log.
constexpr TimeNs kDisarmWithin_ns = 1200 * kNsPerMs;
constexpr TimeNs kStopWithin_ns = 1850 * kNsPerMs;

constexpr int kLcmWait_ms = 1, kListen_ms = 50;
// A command thread that stalls this long cannot receive a disarm either.
constexpr TimeNs kUnattended_ns = kNsPerS;
constexpr std::size_t kStopQueue = 16;
// Black box cycles written between two polls of LCM: about a millisecond.
constexpr int kBlackBoxCycles = 200;
constexpr TimeNs kReportEvery_ns = kNsPerS;
constexpr TimeNs kStatisticsEvery_ns = 60 * kNsPerS;
constexpr std::size_t kMissesKept = 16;
// Another daemon's run record comes once a second.
constexpr TimeNs kOtherGone_ns = 3 * kNsPerS;
constexpr TimeNs kDisarmAgain_ns = 100 * kNsPerMs;

spdlog::level::level_enum LevelOf(Status status) {
  if (IsFault(status)) return spdlog::level::err;
  return status == Status::kOk ? spdlog::level::info : spdlog::level::warn;
}

std::int64_t EpochUs() {
  return std::chrono::duration_cast<std::chrono::microseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

double Us(TimeNs t_ns) { return static_cast<double>(t_ns) / static_cast<double>(kNsPerUs); }

// Writes a log line: under systemd with searchable fields (journalctl TENDRIL_STATUS=406), else as a plain
// message.
void Write(const Message& m) {
  static const bool journal = std::getenv("JOURNAL_STREAM") != nullptr;
  const spdlog::level::level_enum level = LevelOf(m.status);
  if (!journal) {
    spdlog::default_logger()->log(m.at, {}, level, fmt::format("{}: {}", m.source, m.text));
    return;
  }
  const int priority = level == spdlog::level::err    ? LOG_ERR
                       : level == spdlog::level::warn ? LOG_WARNING
                                                      : LOG_INFO;
  sd_journal_send("MESSAGE=%s: %s", m.source.c_str(), m.text.c_str(), "PRIORITY=%i", priority,
                  "TENDRIL_SOURCE=%s", m.source.c_str(), "TENDRIL_STATUS=%i", static_cast<int>(m.status),
                  "TENDRIL_REMEDY=%s", std::string(StatusRemedy(m.status)).c_str(), nullptr);
}

// Feeds systemd's watchdog, if any, while the tick advances. Runs in its own thread: the serving thread may
// wait for a log or a disk, and the loop then needs time to ramp the tensions down (318).
class WatchdogFeeder {
 public:
  explicit WatchdogFeeder(const std::atomic<std::uint64_t>& tick) {
    std::uint64_t within_us = 0;
    if (sd_watchdog_enabled(0, &within_us) <= 0) return;
    thread_ =
        std::jthread([&tick, every = std::chrono::microseconds(within_us / 4)](const std::stop_token& stop) {
          std::mutex mutex;
          std::unique_lock lock(mutex);
          std::condition_variable_any ended;
          std::uint64_t seen = 0;
          while (!ended.wait_for(lock, stop, every, [&stop] { return stop.stop_requested(); })) {
            const std::uint64_t now = tick.load(std::memory_order_relaxed);
            if (now != std::exchange(seen, now)) sd_notify(0, "WATCHDOG=1");
          }
        });
  }

 private:
  std::jthread thread_;
};

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

// A cycle as passed to the calling thread.
struct Published {
  CycleRecord record;
  can::CanCounters can;
  canopen::FrameFaults frame_faults;
  rt::ThreadUsage usage;  // cumulative
  std::array<std::uint32_t, kMaxTendons> serials{};
};

// The cause of a cycle that ended after the next one should have begun.
std::string CauseOfMiss(const CycleTiming& before, const rt::ThreadUsage& usage,
                        const rt::ThreadUsage& earlier) {
  const TimeNs rest_ns = before.total_ns - before.feedback_ns - before.compute_ns;
  const TimeNs most_ns = std::max({before.wake_latency_ns, before.feedback_ns, before.compute_ns, rest_ns});
  std::string cause = most_ns == before.wake_latency_ns ? "woken late"
                      : most_ns == before.feedback_ns   ? "the bus"
                      : most_ns == before.compute_ns    ? "the step"
                                                        : "sending and handing over";
  cause += fmt::format(", {:.0f} us", Us(most_ns));
  if (usage.major_faults + usage.minor_faults > earlier.major_faults + earlier.minor_faults) {
    cause += ", page faults";
  } else if (usage.involuntary_switches > earlier.involuntary_switches) {
    cause += ", preemption";
  }
  return cause;
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
        time(t),
        clock(t.clock()),
        port(p),
        gateway(o.parameters.lcm, ShapeOf(o.robot), clock),
        setups(DriveSetups(o.robot, o.parameters.bus)),
        master(o.parameters.bus, setups, p),
        controller(o.robot, o.parameters.controller, o.parameters.bus.cycle_ns),
        cycle(controller, master, clock, o.parameters.bus, [this](TimeNs deadline_ns) {
          return usage.Excuse([&] { return port.WaitUntil(deadline_ns); });
        }) {
    run = {config::ToYaml(o.robot),
           config::ToYaml(o.parameters),
           std::string(Version()),
           std::string(GitRevision()),
           EpochUs(),
           Identity(o)};
    if (o.parameters.black_box) {
      black_box.emplace(*o.parameters.black_box, o.parameters.lcm, ShapeOf(o.robot), run,
                        io::EpochOffsetUs(clock), o.parameters.bus.cycle_ns, controller);
    }
    gateway.OnCommand([this](const Command& c) {
      // Before the loop runs commands have no consumer, and a target would be outdated later; requests get an
      // answer.
      if (!ticks() && c.kind != CommandKind::kMode) return;
      heard_sequence = c.sequence;
      const Command checked = Checked(c);
      const bool pushed = (Stops(checked) ? stops : commands).TryPush(checked);
      if (!pushed && checked.mode == ModeRequest::kDisarm)
        disarm_waits.store(true, std::memory_order_relaxed);
    });
    gateway.OnTracker([this](const TrackerSample& s) {
      if (!ticks()) return;
      ++readings_heard;
      tracker.TryPush(s);
    });
    gateway.OnRun([this](const io::RunInfo& r) { HeardRun(r); });
    gateway.OnComplaint(
        [this](Status status, const std::string& text) { messages.Post(status, "gateway", text); });
  }

  // ---- real-time thread: everything from here to RealtimeThread's end ----

  enum class Phase { kRunning, kDisarming, kShutdown };

  bool Tick(const rt::CycleStart& start) {
    const TimeNs now_ns = clock.Now();
    if (phase == Phase::kRunning && stop_requested.load(std::memory_order_relaxed)) {
      phase = Phase::kDisarming;
      stop_ns = now_ns;
      disarm_pending = true;
    }
    if (phase == Phase::kShutdown) {
      master.Poll(now_ns);
      const bool done = master.Shutdown(now_ns);
      ForwardEvents();
      tick.store(start.cycle + 1, std::memory_order_relaxed);
      return !done && now_ns < stop_ns + kStopWithin_ns;
    }

    usage.Begin();
    cycle.Run(start, NextCommand(now_ns), NextTrackerSample(), published.record);
    published.can = port.counters();
    published.frame_faults = master.frame_faults();
    published.usage = usage.sum();  // up to the previous cycle
    for (int i = 0; i < master.drives(); ++i)
      published.serials[static_cast<std::size_t>(i)] = master.serial(i);
    records.TryPush(published);
    if (black_box) black_box->Add(published.record, controller);
    ForwardEvents();
    tick.store(start.cycle + 1, std::memory_order_relaxed);
    usage.End();

    if (phase == Phase::kDisarming && !disarm_pending) {
      const bool in_time = clock.Now() < stop_ns + kDisarmWithin_ns;
      if (!in_time || AllDisabled()) {
        disarmed_in_time.store(in_time, std::memory_order_relaxed);
        phase = Phase::kShutdown;
      }
    }
    return true;
  }

  Command NextCommand(TimeNs now_ns) {
    Command command;
    if (phase == Phase::kDisarming) {
      if (!disarm_pending) return command;
      // The daemon's own command passes the gate like any other, so that the log explains the stop.
      disarm_pending = false;
      command.kind = CommandKind::kMode;
      command.mode = ModeRequest::kStop;
    } else if (disarm_waits.exchange(false, std::memory_order_relaxed)) {
      command.mode = ModeRequest::kDisarm;
    } else if (CommandThreadStalled()) {
      command.mode = ModeRequest::kDisarm;
      canopen::BusEvent event{.time_ns = now_ns, .status = Status::kUnattended};
      std::snprintf(event.text.data(), event.text.size(), "%s", StatusText(Status::kUnattended).data());
      events.TryPush(event);
    } else {
      if (!stops.TryPop(command) && commands.TryPop(command)) DropOvertaken(command);
      if (command.kind != CommandKind::kNone) last_sequence = command.sequence;
      return command;
    }
    command.kind = CommandKind::kMode;
    command.sequence = last_sequence + 1;
    command.received_ns = now_ns;
    command.valid_for_ns = kNsPerS;
    return command;
  }

  // Of several waiting targets the last one counts.
  void DropOvertaken(Command& command) {
    while (command.kind != CommandKind::kMode) {
      const Command* next = commands.Peek();
      if (next == nullptr || next->kind != command.kind || next->sender != command.sender) return;
      commands.TryPop(command);
      overtaken.fetch_add(1, std::memory_order_relaxed);
    }
  }

  // True once each time the other thread stalls while drives are on.
  bool CommandThreadStalled() {
    if (machine.Now() - served_ns.load(std::memory_order_relaxed) < kUnattended_ns) {
      left_alone = false;
      return false;
    }
    const CycleOutput& out = published.record.output;
    const bool pulls =
        out.drive_request == DriveRequest::kEnable && out.mode != Mode::kSafeStop && out.mode != Mode::kFault;
    return pulls && !std::exchange(left_alone, true);
  }

  TrackerSample NextTrackerSample() {
    TrackerSample sample;
    tracker.TryPop(sample);
    return sample;
  }

  bool AllDisabled() const {
    const CycleRecord& record = published.record;
    if (record.output.drive_request == DriveRequest::kEnable) return false;
    return std::none_of(record.input.drive.begin(), record.input.drive.begin() + record.input.drives,
                        [](const DriveFeedback& d) { return d.state == DriveState::kEnabled; });
  }

  void ForwardEvents() {
    canopen::BusEvent event;
    for (int i = 0; i < kEventsPerCycle && master.TakeEvent(&event); ++i) events.TryPush(event);
    master_events_lost.store(master.events_lost(), std::memory_order_relaxed);
  }

  void RealtimeThread(std::promise<std::string>& ready) {
    const std::string problems = time.Enter(options.parameters.realtime);
    const bool refused = !problems.empty() && options.parameters.realtime.required;
    if (!refused) master.Start(clock.Now());
    ready.set_value(problems);
    if (refused) return;
    time.Run(options.parameters.bus.cycle_ns, [this](const rt::CycleStart& start) { return Tick(start); });
    finished.store(true, std::memory_order_release);
  }

  // ---- calling thread: LCM, log, systemd ----

  bool ticks() const { return tick.load(std::memory_order_relaxed) > 0; }

  // A request that leads to motion requires that this daemon is alone on its channels and that the robot is
  // commissioned; the record may have been written after the start. A refusal passes through the controller
  // as a request, so that the log explains it.
  Command Checked(Command c) {
    if (c.kind != CommandKind::kMode) return c;
    const bool moves = c.mode == ModeRequest::kArm || c.mode == ModeRequest::kHome;
    if ((moves || c.mode == ModeRequest::kCommission) && !other.empty())
      return Refused(c, ModeRequest::kNotAlone, Status::kNotAlone, OtherText());
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

  // ---- another daemon that hears the same commands ----

  void HeardRun(const io::RunInfo& r) {
    if (r.daemon == run.daemon && r.start_utime == run.start_utime) return;  // our own, looped back
    other = r.daemon.empty() ? "which does not say where it runs" : r.daemon;
    other_heard_ns = machine.Now();
  }

  std::string OtherText() const {
    const LcmParameters& lcm = options.parameters.lcm;
    return fmt::format(
        "another daemon ({}) answers on {}_* at {}: both would obey one command; stop one of them, or give "
        "each its own lcm.channel_prefix (or lcm.url)",
        other, lcm.channel_prefix, lcm.url);
  }

  void WatchOther(TimeNs now_ns) {
    if (other.empty()) return;
    if (machine.Now() - other_heard_ns > kOtherGone_ns) {
      Event(Status::kOk, "daemon",
            fmt::format("the other daemon ({}) is silent: this one may be armed again", other));
      other.clear();
      other_told = false;
      return;
    }
    if (!std::exchange(other_told, true))
      Event(Status::kAnotherDaemon, "daemon", OtherText() + "; disarmed, and nothing is armed until then");
    // Repeated until disarmed: a command from before may still be queued.
    if (!MayPull(last_mode) || now_ns < disarm_again_ns) return;
    disarm_again_ns = now_ns + kDisarmAgain_ns;
    Command disarm;
    disarm.kind = CommandKind::kMode;
    disarm.mode = ModeRequest::kDisarm;
    disarm.sequence = heard_sequence;  // leaves every sender's sequence unchanged
    disarm.received_ns = now_ns;
    disarm.valid_for_ns = kNsPerS;
    stops.TryPush(disarm);
  }

  void ListenForOthers(TimeNs listen_ns) {
    for (const TimeNs end_ns = machine.Now() + listen_ns; machine.Now() < end_ns && other.empty();)
      gateway.Handle(kListen_ms);
    if (!other.empty()) throw std::runtime_error(OtherText());
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
    while (!finished.load(std::memory_order_acquire)) {
      served_ns.store(machine.Now(), std::memory_order_relaxed);
      gateway.Handle(kLcmWait_ms);
      WatchOther(clock.Now());
      Publish();
      WriteBlackBox();
      const TimeNs now_ns = clock.Now();
      if (!ready_told && ticks()) {
        ready_told = true;
        sd_notify(0, "READY=1");
      }
      if (machine.Now() >= report_ns) {
        report_ns = machine.Now() + kReportEvery_ns;
        Report();
      }
      if (now_ns >= statistics_ns) {
        statistics_ns = now_ns + kStatisticsEvery_ns;
        TellStatistics();
      }
      if (stop()) stop_requested.store(true, std::memory_order_relaxed);
      if (!stop_told && stop_requested.load(std::memory_order_relaxed)) {
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

  std::string WhoseFault(const CycleOutput& out) const {
    const auto j = static_cast<std::size_t>(out.blamed_tendon) - 1;
    if (!IsFault(out.status) || j >= setups.size()) return {};
    return fmt::format(" (tendon {}, node {})", out.blamed_tendon, setups[j].node_id);
  }

  // Prefix to a drive fault that missed cycles of the daemon are likely to have caused.
  std::string MissedCyclesPrefix(const CycleOutput& out) const {
    const auto end = out.reported.end();
    if (std::find(out.reported.begin(), end, Status::kCyclesMissed) == end) return {};
    return fmt::format("{} of the daemon's own cycles were missed, correct that first (tendril rt-check): ",
                       last_timing.deadline_misses);
  }

  // The bus event of the drive for which `out` is not ready; empty if there was none.
  std::string WhyNotReadyText(const CycleRecord& r) const {
    for (std::size_t i = 0; i < static_cast<std::size_t>(r.input.drives); ++i) {
      const auto said = last_of_drive.find(setups[i].node_id);
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
    while (records.TryPop(next)) {
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
      Count(next);
      if (out.mode != last_mode || (out.status != last_status && IsFault(out.status))) {
        const Status cause = CauseOf(out), status = IsFault(cause) ? cause : Status::kOk;
        const std::string what =
            fmt::format("{}{}{}", MissedCyclesPrefix(out), StatusText(cause), WhoseFault(out));
        Event(status, "controller",
              fmt::format("{} -> {}: {} {}", ModeText(last_mode), ModeText(out.mode), static_cast<int>(cause),
                          what));
        if (IsFault(status)) statistics.last_fault = {EpochUs(), status, what};
      }
      last_mode = out.mode;
      last_status = out.status;
      last_timing = next.record.timing;
      last_usage = next.usage;
      serials = next.serials;
    }
    refusals.ReportDue(clock.Now(), [this](Status s, const std::string& text) { Event(s, "gate", text); });
    canopen::BusEvent event;
    while (events.TryPop(event)) {
      if (IsFault(event.status) && event.node_id != 0) last_of_drive[event.node_id] = event.text.data();
      if (event.status == Status::kOk) last_of_drive.erase(event.node_id);
      messages.Post(event.status, "bus", event.text.data());
      gateway.PublishEvent(event.time_ns, event.status, "bus", event.text.data());
    }
  }

  void Count(const Published& next) {
    const CycleRecord& r = next.record;
    wake_latency.Add(r.timing.wake_latency_ns);
    round_trip.Add(r.timing.feedback_ns);
    compute.Add(r.timing.compute_ns);
    total.Add(r.timing.total_ns);
    if (const std::uint64_t skipped = r.timing.deadline_misses - last_timing.deadline_misses; skipped > 0) {
      misses.push_back({r.input.cycle, skipped, CauseOfMiss(last_timing, next.usage, last_usage)});
      if (skipped > worst_miss.skipped) worst_miss = misses.back();
      if (misses.size() > kMissesKept) misses.pop_front();
    }
    statistics.drives.resize(static_cast<std::size_t>(r.input.drives));
    for (std::size_t i = 0; i < statistics.drives.size(); ++i) {
      DriveStatistics& drive = statistics.drives[i];
      const DriveFeedback& now = r.input.drive[i];
      drive.node_id = setups[i].node_id;
      drive.state = now.state;
      drive.statusword = now.statusword;
      drive.error_code = now.error_code;
      drive.serial = next.serials[i];
      drive.age_cycles = now.age_cycles;
      drive.worst_age_cycles = std::max(drive.worst_age_cycles, drive.age_cycles);
    }
    can = next.can;
    frame_faults = next.frame_faults;
  }

  void PublishStatistics() {
    LoopStatistics& s = statistics;
    const TimeNs now_ns = clock.Now();
    const double elapsed_s = ToSeconds(now_ns - s.time_ns);
    s.bus_load = elapsed_s > 0 ? static_cast<double>(can.bits - reported_bits) /
                                     options.parameters.bus.bitrate_bps / elapsed_s
                               : 0;
    reported_bits = can.bits;
    s.time_ns = now_ns;
    s.cycles = wake_latency.count();
    s.deadline_misses = last_timing.deadline_misses;
    s.wake_latency = wake_latency.Statistics();
    s.compute = compute.Statistics();
    s.round_trip = round_trip.Statistics();
    s.misses.assign(misses.begin(), misses.end());
    s.messages_ignored = gateway.counters().undecodable;
    s.publish_failed = gateway.counters().publish_failed;
    s.can_sent = can.sent;
    s.can_received = can.received;
    s.can_send_refused = can.send_refused;
    s.can_receive_dropped = can.receive_dropped;
    s.can_error_frames = can.error_frames;
    s.can_bus_off = can.bus_off;
    s.can_malformed = frame_faults.malformed;
    s.can_foreign = frame_faults.foreign;
    s.voluntary_switches = last_usage.voluntary_switches;
    s.involuntary_switches = last_usage.involuntary_switches;
    s.minor_faults = last_usage.minor_faults;
    s.major_faults = last_usage.major_faults;
    gateway.PublishStatistics(s);
    for (DriveStatistics& drive : s.drives) drive.worst_age_cycles = drive.age_cycles;
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
    PublishStatistics();
    ReportExchangedDrives();
    ReportMisses();
    ReportLosses("command(s) arrived faster than one per cycle",
                 commands.dropped() + stops.dropped() + overtaken.load(std::memory_order_relaxed),
                 commands_lost);
    // Either more than one per cycle over a whole second, or a burst after a pause of the sender.
    const std::uint64_t cycles = tick.load(std::memory_order_relaxed);
    const bool steadily = readings_heard - readings_before > cycles - cycles_before;
    readings_before = readings_heard;
    cycles_before = cycles;
    ReportLosses(steadily ? "tracker reading(s) arrived faster than one per cycle"
                          : "tracker reading(s) arrived in a burst, although fewer than cycles,",
                 tracker.dropped(), readings_lost);
    ReportLosses("cycle record(s) could not be published in time", records.dropped(), records_lost);
    ReportLosses("bus event(s) arrived too fast",
                 events.dropped() + master_events_lost.load(std::memory_order_relaxed), events_lost);
    ReportLosses("LCM message(s) could not be sent", gateway.counters().publish_failed, sends_failed);
    if (log && !log_failed && !log->error().empty()) {
      log_failed = true;
      Event(Status::kDegraded, "log", log->error() + "; control continues");
    }
    sd_notify(0, fmt::format("STATUS={}, {} {}; {} cycles, {} missed", ModeText(last_mode),
                             static_cast<int>(last_status), StatusText(last_status), wake_latency.count(),
                             last_timing.deadline_misses)
                     .c_str());
  }

  // Missed cycles are logged as well, because they otherwise look like drives that do not answer.
  void ReportMisses() {
    const std::uint64_t now = last_timing.deadline_misses;
    if (now == misses_told) return;
    const MissedCycles& worst = worst_miss;
    Event(Status::kCycleLate, "timing",
          fmt::format("{} cycle(s) missed, {} since start; most in a row {}, before cycle {}: {}",
                      now - misses_told, now, worst.skipped, worst.cycle, worst.cause));
    misses_told = now;
    worst_miss = {};
  }

  void ReportLosses(const char* what, std::uint64_t now, std::uint64_t& before) {
    if (now == before) return;
    Event(Status::kDegraded, "daemon",
          fmt::format("{} {} and were dropped, {} since start", now - before, what, now));
    before = now;
  }

  void TellStatistics() {
    const std::string text = fmt::format(
        "{} cycles, {} missed; median, 99 % and most: wake-up late by {:.1f}, {:.1f}, {:.1f} us; step "
        "{:.1f}, {:.1f}, "
        "{:.1f} us; cycle {:.1f}, {:.1f}, {:.1f} us",
        wake_latency.count(), last_timing.deadline_misses, Us(wake_latency.Percentile(0.5)),
        Us(wake_latency.Percentile(0.99)), Us(wake_latency.max_ns()), Us(compute.Percentile(0.5)),
        Us(compute.Percentile(0.99)), Us(compute.max_ns()), Us(total.Percentile(0.5)),
        Us(total.Percentile(0.99)), Us(total.max_ns()));
    Event(Status::kOk, "timing", text);
  }

  Messages messages{&Write};
  DaemonOptions options;
  rt::Timebase& time;
  const Clock& clock;
  const MonotonicClock machine;  // for what other programs wait for, however fast the robot's time passes
  can::CanPort& port;
  io::Gateway gateway;
  std::vector<canopen::DriveSetup> setups;
  canopen::Master master;
  control::Controller controller;
  ControlCycle cycle;
  std::optional<io::LogWriter> log;
  io::RunInfo run;
  std::optional<BlackBox> black_box;

  rt::Handoff<Command> commands{kCommandQueue}, stops{kStopQueue};
  rt::Handoff<TrackerSample> tracker{kTrackerQueue};
  rt::Handoff<Published> records{kRecordQueue};
  rt::Handoff<canopen::BusEvent> events{kEventQueue};
  std::atomic<bool> stop_requested{false}, finished{false}, disarmed_in_time{true};
  std::atomic<bool> disarm_waits{false};  // a disarm that did not fit into the queue
  std::atomic<std::uint64_t> tick{0}, master_events_lost{0}, overtaken{0};
  std::atomic<TimeNs> served_ns{0};

  // Used by the real-time thread.
  Phase phase = Phase::kRunning;
  TimeNs stop_ns = 0;
  bool disarm_pending = false, left_alone = false;
  std::uint32_t last_sequence = 0;
  rt::UsageMeter usage;
  Published published;

  // Used by the calling thread.
  rt::Histogram wake_latency, round_trip, compute, total;
  LoopStatistics statistics;
  std::deque<MissedCycles> misses;
  MissedCycles worst_miss;  // since last logged
  can::CanCounters can;
  canopen::FrameFaults frame_faults;
  std::uint64_t reported_bits = 0;
  rt::ThreadUsage last_usage;
  CycleTiming last_timing;
  Mode last_mode = Mode::kDisconnected;
  Status last_status = Status::kOk;
  std::uint64_t misses_told = 0, commands_lost = 0, readings_lost = 0, records_lost = 0, events_lost = 0,
                sends_failed = 0;
  std::uint64_t readings_heard = 0, readings_before = 0, cycles_before = 0;
  bool log_failed = false;
  std::array<std::uint32_t, kMaxTendons> serials{}, serials_told{};
  Refusals refusals;
  std::map<Status, std::string> why_refused;  // where the status alone does not explain it
  std::map<int, std::string> last_of_drive;   // last error event of each drive, by node id
  std::string other;                          // another daemon on our channels; empty: none
  bool other_told = false;
  std::uint32_t sender_in_control = 0;  // sender of the last accepted target, or the one that commissions
  std::uint32_t heard_sequence = 0;
  TimeNs other_heard_ns = 0, disarm_again_ns = 0;
};

Daemon::Daemon(const DaemonOptions& options, can::CanPort& port, rt::Timebase& time)
    : state_(std::make_unique<State>(options, port, time)) {}

Daemon::~Daemon() = default;

io::Gateway& Daemon::gateway() { return state_->gateway; }

void Daemon::RequestStop() noexcept { state_->stop_requested.store(true, std::memory_order_relaxed); }

void Daemon::Log(Status status, const std::string& text) { state_->messages.Post(status, "daemon", text); }

void Daemon::RefuseOthers(TimeNs listen_ns) { state_->ListenForOthers(listen_ns); }

void Daemon::Run(const std::function<bool()>& stop) {
  State& s = *state_;
  if (!s.options.log_path.empty()) s.log.emplace(s.gateway, s.options.log_path, s.clock);
  s.gateway.PublishRun(s.run);  // a log begins with what its cycles belong to
  s.served_ns.store(s.machine.Now(), std::memory_order_relaxed);
  const WatchdogFeeder feeder(s.tick);
  std::promise<std::string> ready;
  std::thread realtime([&] { s.RealtimeThread(ready); });
  {
    const StopAndJoin join(realtime, s.stop_requested);
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
  if (!s.disarmed_in_time.load(std::memory_order_relaxed)) {
    s.Event(Status::kDegraded, "daemon",
            "tensions were still ramping down when time was up: drives were disabled at once");
  }
  s.TellStatistics();
  s.Event(Status::kOk, "daemon", "stopped");
  s.gateway.Handle(0);
}

}  // namespace tendril::daemon
