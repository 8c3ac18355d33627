// The master's cycle over all nodes. Knows frames and nodes; the sequence of each node is in node.cpp.
#include "tendril/canopen/master.h"

#include <algorithm>
#include <cstdarg>
#include <cstdio>
#include <stdexcept>

#include "bus_budget.h"
#include "bus_watch.h"
#include "node.h"
#include "tendril/canopen/wire.h"

namespace tendril::canopen {
namespace {

constexpr int kReceiveBatch = 64, kMaxBatches = 64;
// Leaves the rest of the second that service managers and users allow for a stop.
constexpr TimeNs kShutdownDisable_ns = 300 * kNsPerMs, kShutdownEnd_ns = 600 * kNsPerMs;
constexpr TimeNs kRepeatedEvent_ns = kNsPerS;  // at most one event of a kind in this time

/// Throws std::invalid_argument naming what does not fit.
void Check(const BusParameters& bus, std::span<const DriveSetup> drives) {
  if (drives.empty() || drives.size() > kMaxTendons) {
    throw std::invalid_argument("the CAN master takes 1.." + std::to_string(kMaxTendons) + " drives, not " +
                                std::to_string(drives.size()));
  }
  for (const DriveSetup& drive : drives) {
    const std::string who = "drive with node id " + std::to_string(drive.node_id);
    if (drive.node_id < kMinNodeId || drive.node_id >= kMasterNodeId) {
      throw std::invalid_argument(who + ": node ids are 1..126; 127 is the master's heartbeat");
    }
    if (std::count_if(drives.begin(), drives.end(),
                      [&](const DriveSetup& other) { return other.node_id == drive.node_id; }) > 1) {
      throw std::invalid_argument(who + ": every node id may be used once");
    }
    if (drive.rated_torque_uNm == 0 || drive.nominal_current_mA == 0 || drive.torque_constant_uNmpA == 0) {
      throw std::invalid_argument(who +
                                  ": nominal current, torque constant and rated torque must be positive");
    }
  }
  if (bus.bitrate_bps <= 0 || bus.cycle_ns <= 0) {
    throw std::invalid_argument("bus.bitrate_bps and bus.cycle_ns must be positive");
  }
  const BusBudget budget = ComputeBusBudget(bus, drives);
  if (budget.load > bus.max_load) {
    std::array<char, 320> text{};
    std::snprintf(
        text.data(), text.size(),
        "%d drives at bus.cycle_ns = %lld need %.0f %% of the CAN bus, more than bus.max_load = %.0f %%: at "
        "most %d drives fit this cycle",
        static_cast<int>(drives.size()), static_cast<long long>(bus.cycle_ns), 100 * budget.load,
        100 * bus.max_load, budget.max_drives_at_this_cycle);
    std::string line = text.data();
    if (budget.min_cycle_ns_for_these_drives > 0) {
      line += ", these drives fit bus.cycle_ns = " + std::to_string(budget.min_cycle_ns_for_these_drives) +
              " or longer";
    } else {
      line += ", these drives fit no cycle up to 1 s";
    }
    throw std::invalid_argument(line);
  }
  if (const std::string problem = FeedbackDeadlineProblem(bus, drives); !problem.empty()) {
    throw std::invalid_argument("bus.feedback_deadline_ns: " + problem);
  }
}

/// Bits of a cycle up to bus.max_load, less what statuswords and heartbeats may need.
int BitsForCyclicAndSdo(const BusParameters& bus, std::span<const DriveSetup> drives) {
  const BusBudget budget = ComputeBusBudget(bus, drives);
  const double bits_per_s =
      bus.max_load * bus.bitrate_bps - (budget.other_bits_per_s - budget.sdo_bits_per_s);
  return static_cast<int>(ToSeconds(bus.cycle_ns) * bits_per_s);
}

}  // namespace

struct Master::State {
  State(const BusParameters& bus_in, std::span<const DriveSetup> drives, can::CanPort& port_in)
      : port(port_in),
        interface(bus_in.interface),
        cycle_ns(bus_in.cycle_ns),
        heartbeat_ns(bus_in.heartbeat_ms * kNsPerMs),
        cycle_bits(BitsForCyclicAndSdo(bus_in, drives)) {
    bus_off_seen = port.counters().bus_off;
    node_of_id.fill(nullptr);
    nodes.reserve(drives.size());
    for (const DriveSetup& drive : drives) {
      nodes.push_back(std::make_unique<Node>(bus_in, drive, events));
      node_of_id[static_cast<std::size_t>(drive.node_id)] = nodes.back().get();
    }
  }

  void Report(TimeNs now_ns, Status status, const char* text) noexcept;
  bool Send(const can::CanFrame& frame, TimeNs now_ns) noexcept;
  [[gnu::format(printf, 3, 4)]] void ReportRefused(TimeNs now_ns, const char* format, ...) noexcept;
  void WatchBus(TimeNs now_ns) noexcept;
  void Drain(TimeNs now_ns) noexcept;
  void Dispatch(const can::CanFrame& frame, TimeNs now_ns) noexcept;
  static const char* MastersOwn(std::uint32_t id, const Node* node) noexcept;
  struct Expected {
    const char* what = "";
    int bytes = 0;
  };
  static bool Deliver(Node& node, const can::CanFrame& frame, TimeNs now_ns, Expected* expected) noexcept;
  void Foreign(const can::CanFrame& frame, const char* what, TimeNs now_ns) noexcept;
  void Malformed(const can::CanFrame& frame, const char* what, int bytes, TimeNs now_ns) noexcept;
  void SendSync(TimeNs now_ns) noexcept;
  void SendHeartbeat(TimeNs now_ns) noexcept;
  void SendPending(TimeNs now_ns) noexcept;
  void SendRpdos(TimeNs now_ns, DriveRequest request, std::span<const std::int16_t> torques) noexcept;

  can::CanPort& port;
  std::string interface;
  TimeNs cycle_ns, heartbeat_ns;
  int cycle_bits;      // that SYNC, PDOs of each SYNC and SDO may use of a cycle
  int sdo_credit = 0;  // bits that SDO may use now
  EventRing events;
  std::vector<std::unique_ptr<Node>> nodes;
  std::array<Node*, 128> node_of_id{};
  std::array<can::StampedFrame, kReceiveBatch> batch{};
  std::array<can::CanFrame, kMaxTendons> rpdos{};

  bool running = false;
  BusWatch watch;
  bool went_off = false;           // the last failure was bus-off, not the interface
  bool restart_heard = false;      // since WatchBus
  std::uint64_t bus_off_seen = 0;  // of the port's count
  FrameFaults faults;
  TimeNs next_malformed_event_ns = 0, next_foreign_event_ns = 0;
  std::size_t first_node = 0;  // node whose pending frame is sent first
  TimeNs next_heartbeat_ns = 0;
  std::uint64_t dropped_told = 0;
  TimeNs next_refused_event_ns = 0, next_dropped_event_ns = 0;

  TimeNs shutdown_since_ns = -1, shutdown_cycle_ns = 0;
};

Master::Master(const BusParameters& bus, std::span<const DriveSetup> drives, can::CanPort& port) {
  Check(bus, drives);
  state_ = std::make_unique<State>(bus, drives, port);
}
Master::~Master() = default;

int Master::drives() const noexcept { return static_cast<int>(state_->nodes.size()); }

const DriveFeedback& Master::feedback(int drive) const noexcept {
  return state_->nodes[static_cast<std::size_t>(drive)]->feedback();
}

bool Master::bus_ok() const noexcept { return !state_->watch.down() && state_->port.up(); }
bool Master::interface_down() const noexcept {
  return !bus_ok() && !state_->went_off && !state_->port.bus_off();
}
std::uint32_t Master::serial(int drive) const noexcept {
  return state_->nodes[static_cast<std::size_t>(drive)]->serial();
}
bool Master::PopEvent(BusEvent* event) noexcept { return state_->events.Pop(event); }
const FrameFaults& Master::frame_faults() const noexcept { return state_->faults; }
std::uint64_t Master::events_lost() const noexcept { return state_->events.lost(); }

void Master::Start(TimeNs now_ns) noexcept {
  State& s = *state_;
  s.running = true;
  s.watch.TryAgain(now_ns);
  s.shutdown_since_ns = -1;
  s.next_heartbeat_ns = now_ns;
  for (auto& node : s.nodes) node->Boot(now_ns, false);
}

void Master::ClearFaults(TimeNs now_ns) noexcept {
  state_->watch.TryAgain(now_ns);
  for (auto& node : state_->nodes) node->ClearFault(now_ns);
}

// ---- one cycle ----------------------------------------------------------------------------------

void Master::BeginCycle(TimeNs now_ns) noexcept {
  State& s = *state_;
  if (!s.running) return;
  // Frames after the last cycle's end belong to that cycle: they are processed before this cycle's SYNC.
  s.Drain(now_ns);
  s.WatchBus(now_ns);
  s.SendSync(now_ns);
  s.SendHeartbeat(now_ns);
  for (auto& node : s.nodes) node->BeginCycle(now_ns);
  s.SendPending(now_ns);
}

bool Master::Poll(TimeNs now_ns) noexcept {
  State& s = *state_;
  s.Drain(now_ns);
  return std::all_of(s.nodes.begin(), s.nodes.end(), [](const auto& node) { return node->answered(); });
}

void Master::EndCycle(TimeNs now_ns, DriveRequest request,
                      std::span<const std::int16_t> torque_permille) noexcept {
  if (!state_->running) return;
  state_->SendRpdos(now_ns, request, torque_permille);
}

/// Torque and power off, then heartbeat monitoring off so that the drives do not take our silence for a
/// fault, then NMT stop.
bool Master::Shutdown(TimeNs now_ns) noexcept {
  State& s = *state_;
  if (!s.running) return true;
  if (s.shutdown_since_ns < 0) {
    s.shutdown_since_ns = now_ns;
    s.shutdown_cycle_ns = now_ns;
  }
  s.Drain(now_ns);
  s.WatchBus(now_ns);
  const TimeNs since_ns = now_ns - s.shutdown_since_ns;
  const bool off =
      std::none_of(s.nodes.begin(), s.nodes.end(), [](const auto& node) { return node->powered(); });
  bool released = true;
  if (off || since_ns >= kShutdownDisable_ns) {
    for (auto& node : s.nodes) released &= node->Release();
  } else {
    released = false;
  }
  if (released || since_ns >= kShutdownEnd_ns || s.watch.down()) {
    for (auto& node : s.nodes) {
      if (!s.watch.down() && node->started()) s.Send(NmtFrame(NmtCommand::kStop, node->id()), now_ns);
    }
    s.running = false;
    return true;
  }
  if (now_ns >= s.shutdown_cycle_ns) {
    s.shutdown_cycle_ns = now_ns + s.cycle_ns;
    s.SendSync(now_ns);
    s.SendHeartbeat(now_ns);
    for (auto& node : s.nodes) node->BeginCycle(now_ns);
    s.SendPending(now_ns);
    s.SendRpdos(now_ns, DriveRequest::kDisable, {});
  }
  return false;
}

// ---- frames out ---------------------------------------------------------------------------------

bool Master::State::Send(const can::CanFrame& frame, TimeNs now_ns) noexcept {
  if (port.Send(frame)) return true;
  ReportRefused(now_ns, "frame 0x%03X not sent, the interface's queue is full", frame.id);
  return false;
}

void Master::State::ReportRefused(TimeNs now_ns, const char* format, ...) noexcept {
  if (now_ns < next_refused_event_ns || watch.down()) return;
  next_refused_event_ns = now_ns + kRepeatedEvent_ns;
  EventText text{};
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(text.data(), text.size(), format, arguments);
  va_end(arguments);
  Report(now_ns, Status::kFrameNotSent, text.data());
}

void Master::State::SendSync(TimeNs now_ns) noexcept {
  const bool due = std::any_of(nodes.begin(), nodes.end(), [](const auto& node) { return node->started(); });
  if (!due || watch.down() || !Send(SyncFrame(), now_ns)) return;
  for (auto& node : nodes) node->OnSync();
}

void Master::State::SendHeartbeat(TimeNs now_ns) noexcept {
  if (watch.down() || heartbeat_ns <= 0 || now_ns < next_heartbeat_ns) return;
  Send(HeartbeatFrame(kMasterNodeId, NmtState::kOperational), now_ns);
  next_heartbeat_ns += heartbeat_ns;
  if (next_heartbeat_ns <= now_ns) next_heartbeat_ns = now_ns + heartbeat_ns;
}

/// NMT commands are sent at once. SDO requests share the bus's budget left by the other frames, nodes in
/// turn; unused budget accumulates until it covers a request and its response. So SDO delays a cycle's other
/// frames, which all have higher priority, by at most one frame.
void Master::State::SendPending(TimeNs now_ns) noexcept {
  if (watch.down()) return;
  int left = cycle_bits - can::WorstCaseBits(0);
  for (const auto& node : nodes) left -= node->started() ? PdoBits(node->pdos()) : 0;
  sdo_credit = std::min(sdo_credit + left, std::max(kSdoExchangeBits, left));
  const std::size_t first = first_node;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    const std::size_t at = (first + i) % nodes.size();
    const can::CanFrame* frame = nodes[at]->pending();
    if (frame == nullptr) continue;
    const bool sdo = frame->id != kNmtCobId;
    if (sdo && sdo_credit < kSdoExchangeBits) continue;
    if (!Send(*frame, now_ns)) break;  // the queue is full: retry in the next cycle
    nodes[at]->PendingSent(now_ns);
    sdo_credit -= sdo ? kSdoExchangeBits : can::WorstCaseBits(*frame);
    if (sdo) first_node = (at + 1) % nodes.size();
  }
}

void Master::State::SendRpdos(TimeNs now_ns, DriveRequest request,
                              std::span<const std::int16_t> torques) noexcept {
  int n = 0;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    const std::int16_t torque = i < torques.size() ? torques[i] : std::int16_t{0};
    n += nodes[i]->MakeRpdo(now_ns, request, torque, &rpdos[static_cast<std::size_t>(n)]) ? 1 : 0;
  }
  if (n == 0 || watch.down()) return;
  const int sent = port.SendAll(std::span(rpdos).first(static_cast<std::size_t>(n)));
  if (sent < n) {
    ReportRefused(now_ns, "%d of %d torque frames not sent, the interface's queue is full", n - sent, n);
  }
}

// ---- frames in ----------------------------------------------------------------------------------

void Master::State::Drain(TimeNs now_ns) noexcept {
  for (int i = 0; i < kMaxBatches; ++i) {
    const int n = port.Receive(batch);
    for (int k = 0; k < n; ++k) Dispatch(batch[static_cast<std::size_t>(k)].frame, now_ns);
    if (n < kReceiveBatch) return;
  }
}

void Master::State::Dispatch(const can::CanFrame& frame, TimeNs now_ns) noexcept {
  if (frame.error && (frame.id & can::kErrorRestarted)) restart_heard = true;
  if (frame.error || frame.remote) return;  // WatchBus handles the state of the bus
  if (!running) return;
  Node* node = node_of_id[static_cast<std::size_t>(CobNode(frame.id))];
  if (const char* what = MastersOwn(frame.id, node)) {
    // Drives answer a SYNC of any sender.
    if (frame.id == kSyncCobId) {
      for (auto& any : nodes) any->OnSync();
    }
    if (node != nullptr && CobFunction(frame.id) == kSdoRequestBase) node->OnForeignSdoRequest(frame);
    return Foreign(frame, what, now_ns);
  }
  if (node == nullptr) return;
  Expected expected;
  const bool fits = Deliver(*node, frame, now_ns, &expected);
  if (!fits) Malformed(frame, expected.what, expected.bytes, now_ns);
}

/// A frame from one of our drives; false when its contents are not as expected. Other identifiers are
/// ignored.
bool Master::State::Deliver(Node& node, const can::CanFrame& frame, TimeNs now_ns,
                            Expected* expected) noexcept {
  const std::uint32_t function = CobFunction(frame.id);
  const DrivePdos& pdos = node.pdos();
  if (function == TpdoCobId(pdos.feedback.number, 0)) {
    *expected = {"TPDO", pdos.feedback.bytes()};
    return node.OnFeedback(frame, now_ns);
  }
  if (function == TpdoCobId(pdos.status.number, 0)) {
    *expected = {"TPDO", pdos.status.bytes()};
    return node.OnStatus(frame, now_ns);
  }
  switch (function) {
    case kSdoResponseBase:
      *expected = {"SDO response", 8};
      if (frame.size != 8) return false;
      node.OnSdo(frame, now_ns);
      return true;
    case kHeartbeatBase: {
      *expected = {"heartbeat", 1};
      const auto heartbeat = ParseHeartbeat(frame);
      if (heartbeat) node.OnHeartbeat(heartbeat->state, now_ns);
      return heartbeat.has_value();
    }
    case kEmcyBase: {
      *expected = {"EMCY", 8};
      const auto emcy = ParseEmcy(frame);
      if (emcy) node.OnEmcy(*emcy, now_ns);
      return emcy.has_value();
    }
    default:
      return true;
  }
}

/// Text for a frame that only the master sends; nullptr for other identifiers. `node`: the drive of ours that
/// the identifier belongs to, or nullptr.
const char* Master::State::MastersOwn(std::uint32_t id, const Node* node) noexcept {
  if (id == kNmtCobId) return "NMT command";
  if (id == kSyncCobId) return "SYNC";
  if (id == kHeartbeatBase + static_cast<std::uint32_t>(kMasterNodeId)) return "heartbeat of the master";
  if (node == nullptr) return nullptr;
  if (CobFunction(id) == RpdoCobId(node->pdos().torque.number, 0)) return "torque command";
  if (CobFunction(id) == kSdoRequestBase) return "SDO request";
  return nullptr;
}

void Master::State::Foreign(const can::CanFrame& frame, const char* what, TimeNs now_ns) noexcept {
  ++faults.foreign;
  if (now_ns < next_foreign_event_ns) return;
  next_foreign_event_ns = now_ns + kRepeatedEvent_ns;
  EventText text{};
  std::snprintf(text.data(), text.size(),
                "%s 0x%03X came from another sender (%llu such frames since start): these drives accept one "
                "master only",
                what, frame.id, static_cast<unsigned long long>(faults.foreign));
  Report(now_ns, Status::kForeignFrame, text.data());
}

void Master::State::Malformed(const can::CanFrame& frame, const char* what, int bytes,
                              TimeNs now_ns) noexcept {
  ++faults.malformed;
  if (now_ns < next_malformed_event_ns) return;
  next_malformed_event_ns = now_ns + kRepeatedEvent_ns;
  std::array<char, 3 * 8 + 1> data{};
  for (std::size_t i = 0; i < frame.size; ++i) {
    std::snprintf(data.data() + 3 * i, 4, " %02X", frame.data[i]);
  }
  EventText text{};
  std::snprintf(text.data(), text.size(),
                "node %d: %s 0x%03X ignored: %d bytes,%s, expected %d with known contents (%llu such frames "
                "since start)",
                CobNode(frame.id), what, frame.id, frame.size, frame.size == 0 ? " none" : data.data(), bytes,
                static_cast<unsigned long long>(faults.malformed));
  Report(now_ns, Status::kFrameMalformed, text.data());
}

void Master::State::WatchBus(TimeNs now_ns) noexcept {
  EventText text{};
  // A bus-off that has ended already still lost frames, and state on the drives' side.
  const bool was_off = port.bus_off() || port.counters().bus_off != bus_off_seen;
  bus_off_seen = port.counters().bus_off;
  switch (watch.Update(now_ns, port.up() && !was_off, port.bus_off(), port.counters().received)) {
    case BusWatch::Order::kNone:
      // A restart by others after ours: drives that were unreachable may be reachable now.
      if (restart_heard && !watch.down()) {
        for (auto& node : nodes) node->OnBusUp(now_ns);
      }
      break;
    case BusWatch::Order::kTellDown:
      went_off = was_off;
      Report(now_ns, was_off ? Status::kBusOff : Status::kInterfaceDown,
             was_off ? "the CAN interface went bus-off: every drive is lost"
                     : "the CAN interface went down: every drive is lost until it is up again");
      for (auto& node : nodes) node->OnBusDown(now_ns);
      break;
    case BusWatch::Order::kAskRestart:
      port.Restart();
      if (port.up()) {
        std::snprintf(text.data(), text.size(), "bus-off: restart %d of %d requested: the interface runs",
                      watch.restarts(), BusWatch::kRestarts);
      } else {
        std::snprintf(
            text.data(), text.size(),
            "bus-off: restart %d of %d requested: not running yet; this process needs CAP_NET_ADMIN "
            "for it, or the interface restart-ms (ip link set %s type can restart-ms 100), or take it down "
            "and up by hand",
            watch.restarts(), BusWatch::kRestarts, interface.c_str());
      }
      Report(now_ns, port.up() ? Status::kOk : Status::kBusOff, text.data());
      break;
    case BusWatch::Order::kTellBack:
      went_off = false;
      Report(now_ns, Status::kOk, "the CAN interface is back: booting the drives, which stay disarmed");
      for (auto& node : nodes) node->OnBusUp(now_ns);
      break;
    case BusWatch::Order::kTellGivenUp:
      std::snprintf(text.data(), text.size(),
                    "the CAN bus did not stay on after %d restarts: given up until clear; check wiring, "
                    "termination, bit rate and that a drive has power",
                    BusWatch::kRestarts);
      Report(now_ns, Status::kBusOff, text.data());
      break;
  }
  restart_heard = false;
  const std::uint64_t dropped = port.counters().receive_dropped;
  if (dropped != dropped_told && now_ns >= next_dropped_event_ns) {
    next_dropped_event_ns = now_ns + kRepeatedEvent_ns;
    std::snprintf(text.data(), text.size(), "%llu received frames lost, the reader was too slow",
                  static_cast<unsigned long long>(dropped - dropped_told));
    Report(now_ns, Status::kFrameLost, text.data());
    dropped_told = dropped;
  }
}

void Master::State::Report(TimeNs now_ns, Status status, const char* text) noexcept {
  BusEvent event;
  event.time_ns = now_ns;
  event.status = status;
  std::snprintf(event.text.data(), event.text.size(), "%s", text);
  events.Push(event);
}

}  // namespace tendril::canopen
