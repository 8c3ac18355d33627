// Faults as a list of orders, processed at each frame and each point in time. Knows frames and the rack's
// calls; nothing of a drive's inside.
#include "tendril/emulator/faults.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "tendril/canopen/wire.h"

namespace tendril::emulator {
namespace {

constexpr TimeNs kNever = std::numeric_limits<TimeNs>::max();
constexpr std::size_t kMostOrders = 1000;
constexpr std::size_t kMostLate = 8192;  // delayed frames of one direction; further ones are lost

TimeNs Ns(double seconds) { return static_cast<TimeNs>(std::llround(seconds * 1e9)); }

bool OfFrames(FaultKind kind) { return kind <= FaultKind::kCorrupt; }

/// Whether the fault is a state, which lasts from its begin to its end, rather than an event.
bool Lasts(FaultKind kind) {
  return kind == FaultKind::kDie || kind == FaultKind::kFreeze || kind == FaultKind::kStickSensor ||
         kind == FaultKind::kSto || kind == FaultKind::kBusOff;
}

/// Node of a frame's sender or receiver; 0 for broadcasts (SYNC, NMT to all).
int NodeOf(const can::CanFrame& frame) {
  if (frame.id == canopen::kNmtCobId) return frame.size < 2 ? 0 : frame.data[1];
  return canopen::CobNode(frame.id);
}

struct Order {
  FaultParameters fault;
  TimeNs begin_ns = 0, end_ns = kNever;
  std::mt19937_64 random;  // separate, so that faults draw independently of each other's frames
  int drive = -1;
  bool begun = false;
  std::int64_t taken = 0;

  bool Takes(const can::CanFrame& frame, FrameDirection direction) {
    if (!begun || !OfFrames(fault.kind) || frame.error) return false;
    if (fault.count > 0 && taken >= fault.count) return false;
    if (fault.direction != FrameDirection::kBoth && fault.direction != direction) return false;
    if (fault.cob_id && *fault.cob_id != frame.id) return false;
    if (fault.node != 0 && fault.node != NodeOf(frame)) return false;
    const double luck = static_cast<double>(random() >> 11) * 0x1p-53;
    if (luck >= fault.probability) return false;
    ++taken;
    return true;
  }
  bool over(TimeNs now_ns) const {
    if (!begun) return false;
    if (!OfFrames(fault.kind) && !Lasts(fault.kind)) return true;  // it happened
    return now_ns >= end_ns || (fault.count > 0 && taken >= fault.count);
  }
};

/// Delayed frames by arrival time; those of equal time in the order sent.
class LateFrames {
 public:
  void Add(const can::StampedFrame& frame) {
    frames_.insert(std::upper_bound(frames_.begin(), frames_.end(), frame.time_ns,
                                    [](TimeNs t, const can::StampedFrame& f) { return t < f.time_ns; }),
                   frame);
  }
  bool full() const { return frames_.size() >= kMostLate; }
  bool Due(TimeNs now_ns) const { return next_ns() <= now_ns; }
  TimeNs next_ns() const { return frames_.empty() ? kNever : frames_.front().time_ns; }
  can::StampedFrame Pop() {
    const can::StampedFrame frame = frames_.front();
    frames_.erase(frames_.begin());
    return frame;
  }
  void Clear() { frames_.clear(); }

 private:
  std::vector<can::StampedFrame> frames_;
};

}  // namespace

struct FaultInjector::State {
  State(can::CanPort& b, std::uint64_t s) : bus(b), seed(s) {}

  void Begin(const Order& order);
  /// Updates a lasting fault to the state required by the active orders, each of which has its own end.
  void Apply(const Order& order);
  void ApplyToDrive(const FaultParameters& fault, int drive);
  /// True when an active order requires this of the drive.
  bool Active(const FaultParameters& fault, int drive) const;
  void SetBusOff(bool off);
  /// Applies every fault to one frame. Calls `deliver(frame)` for each copy that arrives now, and queues the
  /// later ones.
  template <class Deliver>
  void Pass(can::StampedFrame frame, FrameDirection direction, Deliver deliver);

  can::CanPort& bus;
  DriveRack* rack = nullptr;
  std::uint64_t seed, ordered = 0;
  TimeNs now_ns = 0;
  std::vector<Order> orders;
  LateFrames to_drives, from_drives;
  bool bus_off = false;
  FaultCounters counters;
};

FaultInjector::FaultInjector(can::CanPort& bus, std::uint64_t seed)
    : state_(std::make_unique<State>(bus, seed)) {}
FaultInjector::~FaultInjector() = default;

void FaultInjector::Attach(DriveRack& rack) noexcept { state_->rack = &rack; }

// ---- orders
// ----------------------------------------------------------------------------------------------------

void FaultInjector::Add(const FaultParameters& fault, TimeNs now_ns) {
  State& s = *state_;
  if (s.orders.size() >= kMostOrders) {
    throw std::invalid_argument("there are " + std::to_string(kMostOrders) +
                                " faults already; accepted: no more; wait until some are over");
  }
  Order order;
  order.fault = fault;
  if (fault.node != 0) {
    for (int i = 0; i < s.rack->drives(); ++i) {
      if (s.rack->node_id(i) == fault.node) order.drive = i;
    }
    if (order.drive < 0) {
      std::string text = "node " + std::to_string(fault.node) + " is none of the emulated drives; accepted:";
      for (int i = 0; i < s.rack->drives(); ++i)
        text.append(1, ' ').append(std::to_string(s.rack->node_id(i)));
      throw std::invalid_argument(text + "; correct the node");
    }
  }
  order.begin_ns = now_ns + Ns(fault.at_s);
  if (fault.for_s > 0) order.end_ns = order.begin_ns + Ns(fault.for_s);
  order.random.seed(s.seed + 0x9E3779B97F4A7C15u * ++s.ordered);
  s.orders.push_back(std::move(order));
}

void FaultInjector::Poll(TimeNs now_ns) {
  State& s = *state_;
  s.now_ns = now_ns;
  for (Order& order : s.orders) {
    if (!order.begun && now_ns >= order.begin_ns) {
      order.begun = true;
      s.Begin(order);
    }
  }
  const auto over = std::stable_partition(s.orders.begin(), s.orders.end(),
                                          [now_ns](const Order& order) { return !order.over(now_ns); });
  const std::vector<Order> ended(over, s.orders.end());
  s.orders.erase(over, s.orders.end());
  for (const Order& order : ended) s.Apply(order);
  while (s.from_drives.Due(now_ns)) {
    const can::CanFrame frame = s.from_drives.Pop().frame;
    s.bus.Send(frame);
  }
}

void FaultInjector::State::Begin(const Order& order) {
  switch (order.fault.kind) {
    case FaultKind::kReboot:
      // Without supply there is nothing to power-cycle.
      if (!Active({.kind = FaultKind::kDie}, order.drive)) rack->PowerCycle(order.drive);
      for (const Order& other : orders) {
        if (other.begun) ApplyToDrive(other.fault, order.drive);
      }
      return;
    case FaultKind::kEmcy:
      rack->InjectEmcy(order.drive, order.fault.code);
      return;
    case FaultKind::kStopHeartbeat:
      rack->StopHeartbeat(order.drive);
      return;
    default:
      Apply(order);
      return;
  }
}

bool FaultInjector::State::Active(const FaultParameters& fault, int drive) const {
  return std::any_of(orders.begin(), orders.end(), [&](const Order& order) {
    return order.begun && order.fault.kind == fault.kind && (order.drive < 0 || order.drive == drive) &&
           order.fault.sensor == fault.sensor;
  });
}

void FaultInjector::State::Apply(const Order& order) {
  if (order.fault.kind == FaultKind::kBusOff) {
    SetBusOff(Active(order.fault, -1));
    return;
  }
  if (!Lasts(order.fault.kind)) return;
  for (int drive = 0; drive < rack->drives(); ++drive) {
    if (order.drive < 0 || order.drive == drive) ApplyToDrive(order.fault, drive);
  }
}

void FaultInjector::State::ApplyToDrive(const FaultParameters& fault, int drive) {
  const bool active = Active(fault, drive);
  switch (fault.kind) {
    case FaultKind::kDie:
      rack->SetSupply(drive, !active);
      // A drive that returns starts afresh; other faults on it continue.
      if (!active) rack->SetFrozen(drive, Active({.kind = FaultKind::kFreeze}, drive));
      return;
    case FaultKind::kFreeze:
      rack->SetFrozen(drive, active);
      return;
    case FaultKind::kStickSensor:
      rack->StickSensor(drive, fault.sensor, active);
      return;
    case FaultKind::kSto:
      rack->SetSto(drive, active);
      return;
    default:
      return;
  }
}

void FaultInjector::State::SetBusOff(bool off) {
  if (off == bus_off) return;
  bus_off = off;
  to_drives.Clear();
  from_drives.Clear();
  can::CanFrame error;
  error.error = true;
  error.size = 8;
  error.id = off ? can::kErrorBusOff : can::kErrorRestarted;
  bus.Send(error);
}

// ---- frames
// ----------------------------------------------------------------------------------------------------

template <class Deliver>
void FaultInjector::State::Pass(can::StampedFrame frame, FrameDirection direction, Deliver deliver) {
  TimeNs late_ns = 0;
  int copies = 1;
  for (Order& order : orders) {
    if (!order.Takes(frame.frame, direction)) continue;
    switch (order.fault.kind) {
      case FaultKind::kDrop:
        ++counters.dropped;
        return;
      case FaultKind::kDelay:
        ++counters.delayed;
        late_ns += Ns(order.fault.delay_s);
        break;
      case FaultKind::kDuplicate:
        ++counters.duplicated;
        ++copies;
        break;
      case FaultKind::kCorrupt:
        if (frame.frame.size > 0) {
          const std::uint64_t bit = order.random() % (8u * frame.frame.size);
          frame.frame.data[bit / 8] = static_cast<std::uint8_t>(frame.frame.data[bit / 8] ^ (1u << bit % 8));
          ++counters.corrupted;
        }
        break;
      default:
        break;
    }
  }
  if (late_ns == 0) {
    for (int i = 0; i < copies; ++i) deliver(frame);
    return;
  }
  frame.time_ns = now_ns + late_ns;
  LateFrames& late = direction == FrameDirection::kToDrives ? to_drives : from_drives;
  for (int i = 0; i < copies; ++i) {
    if (late.full()) {
      ++counters.dropped;
    } else {
      late.Add(frame);
    }
  }
}

bool FaultInjector::Send(const can::CanFrame& frame) noexcept {
  State& s = *state_;
  if (s.bus_off) return false;
  bool sent = true;  // a frame lost to a fault counts as sent for its drive
  s.Pass({frame, s.now_ns}, FrameDirection::kFromDrives,
         [&](const can::StampedFrame& on_wire) { sent = s.bus.Send(on_wire.frame) && sent; });
  return sent;
}

int FaultInjector::SendAll(std::span<const can::CanFrame> frames) noexcept {
  // Without frame faults they are sent together.
  if (!state_->bus_off && state_->orders.empty()) return state_->bus.SendAll(frames);
  return can::CanPort::SendAll(frames);
}

int FaultInjector::Receive(std::span<can::StampedFrame> frames) noexcept {
  State& s = *state_;
  std::size_t n = 0;
  // All frames are queued by arrival time, so that delayed frames and copies fit into any batch.
  std::array<can::StampedFrame, 64> batch;
  while (n < frames.size()) {
    while (n < frames.size() && s.to_drives.Due(s.now_ns)) frames[n++] = s.to_drives.Pop();
    if (n == frames.size()) break;
    const int arrived = s.bus.Receive(batch);
    if (arrived == 0) break;
    for (int i = 0; i < arrived; ++i) {
      if (s.bus_off) continue;
      s.Pass(batch[static_cast<std::size_t>(i)], FrameDirection::kToDrives, [&](can::StampedFrame frame) {
        frame.time_ns = s.now_ns;
        s.to_drives.Add(frame);
      });
    }
  }
  return static_cast<int>(n);
}

bool FaultInjector::WaitUntil(TimeNs deadline_ns) noexcept {
  State& s = *state_;
  const TimeNs next_ns = std::min(s.to_drives.next_ns(), s.from_drives.next_ns());
  return s.bus.WaitUntil(std::min(deadline_ns, next_ns)) || s.to_drives.Due(s.now_ns);
}

bool FaultInjector::up() const noexcept { return !state_->bus_off && state_->bus.up(); }

const can::CanCounters& FaultInjector::counters() const noexcept { return state_->bus.counters(); }

const FaultCounters& FaultInjector::faults() const noexcept { return state_->counters; }

int FaultInjector::pending() const noexcept { return static_cast<int>(state_->orders.size()); }

}  // namespace tendril::emulator
