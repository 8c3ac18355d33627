// The CAN bus in memory: one ring of frames per port, filled in the order of sending. Knows no socket and no
// time but the clock it was given.
#include "tendril/can/memory_bus.h"

#include <algorithm>

namespace tendril::can {

struct MemoryBus::State {
  explicit State(const Clock& c) : clock(c) {}

  void Broadcast(const CanFrame& frame, const Port* except) noexcept;
  void BroadcastError(const CanFrame& error, const Port* except) noexcept;

  const Clock& clock;
  std::vector<std::unique_ptr<Port>> ports;
  Filter filter;
  CanCounters totals;
  bool off = false;
};

class MemoryBus::Port final : public CanPort {
 public:
  explicit Port(State& bus) : bus_(bus), ring_(kCapacity) {}

  bool Send(const CanFrame& frame) noexcept override {
    if (bus_.off) {
      ++counters_.send_refused;
      ++bus_.totals.send_refused;
      return false;
    }
    if (frame.error) {
      bus_.BroadcastError(frame, this);
      return true;
    }
    const auto bits = static_cast<std::uint64_t>(WorstCaseBits(frame));
    ++counters_.sent;
    counters_.bits += bits;
    ++bus_.totals.sent;
    bus_.totals.bits += bits;
    CanFrame on_wire = frame;
    if (!bus_.filter || bus_.filter(on_wire)) bus_.Broadcast(on_wire, this);
    return true;
  }

  int Receive(std::span<StampedFrame> frames) noexcept override {
    const std::size_t n = std::min(frames.size(), tail_ - head_);
    for (std::size_t i = 0; i < n; ++i) frames[i] = ring_[(head_ + i) % kCapacity];
    head_ += n;
    return static_cast<int>(n);
  }

  bool WaitUntil(TimeNs) noexcept override { return head_ != tail_; }
  bool up() const noexcept override { return !off_ && !bus_.off; }
  bool bus_off() const noexcept override { return !up(); }
  void Restart() noexcept override { off_ = bus_.off; }
  const CanCounters& counters() const noexcept override { return counters_; }

  void Deliver(const CanFrame& frame) noexcept {
    if (tail_ - head_ == kCapacity) {
      ++counters_.receive_dropped;
      ++bus_.totals.receive_dropped;
      return;
    }
    ring_[tail_++ % kCapacity] = {frame, bus_.clock.Now()};
    if (frame.error) {
      ++counters_.error_frames;
      if (frame.id & kErrorBusOff) {
        ++counters_.bus_off;
        off_ = true;
      }
      if (frame.id & kErrorRestarted) off_ = false;
    } else {
      ++counters_.received;
      counters_.bits += static_cast<std::uint64_t>(WorstCaseBits(frame));
      ++bus_.totals.received;
    }
  }

 private:
  static constexpr std::size_t kCapacity = 8192;
  State& bus_;
  std::vector<StampedFrame> ring_;
  std::size_t head_ = 0, tail_ = 0;  // running counts, taken modulo the capacity
  bool off_ = false;                 // state of the last error frame
  CanCounters counters_;
};

void MemoryBus::State::Broadcast(const CanFrame& frame, const Port* except) noexcept {
  for (const auto& port : ports) {
    if (port.get() != except) port->Deliver(frame);
  }
}

void MemoryBus::State::BroadcastError(const CanFrame& error, const Port* except) noexcept {
  ++totals.error_frames;
  if (error.id & kErrorBusOff) ++totals.bus_off;
  Broadcast(error, except);
}

MemoryBus::MemoryBus(const Clock& clock) : state_(std::make_unique<State>(clock)) {}
MemoryBus::~MemoryBus() = default;

CanPort& MemoryBus::AddPort() {
  state_->ports.push_back(std::make_unique<Port>(*state_));
  return *state_->ports.back();
}

void MemoryBus::SetFilter(Filter filter) { state_->filter = std::move(filter); }

void MemoryBus::SetBusOff(bool off) {
  if (off == state_->off) return;
  state_->off = off;
  CanFrame frame;
  frame.error = true;
  frame.size = 8;
  frame.id = off ? kErrorBusOff : kErrorRestarted;
  state_->BroadcastError(frame, nullptr);
}

const CanCounters& MemoryBus::totals() const { return state_->totals; }

}  // namespace tendril::can
