// Queue of events: a ring of fixed size inside the object. Knows nothing of their meaning.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "tendril/canopen/master.h"

namespace tendril::canopen {

class EventRing {
 public:
  void Push(const BusEvent& event) noexcept {
    if (tail_ - head_ == kCapacity) {
      ++lost_;
      return;
    }
    events_[tail_++ % kCapacity] = event;
  }
  bool Pop(BusEvent* event) noexcept {
    if (head_ == tail_) return false;
    *event = events_[head_++ % kCapacity];
    return true;
  }
  std::uint64_t lost() const noexcept { return lost_; }

 private:
  static constexpr std::size_t kCapacity = 128;
  std::array<BusEvent, kCapacity> events_{};
  std::size_t head_ = 0, tail_ = 0;  // running counts, taken modulo the capacity
  std::uint64_t lost_ = 0;
};

}  // namespace tendril::canopen
