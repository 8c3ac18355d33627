// Detects two servers with the same node id by their replies to SDO requests. Knows no time: requests and
// replies are passed in as they appear on the bus.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <utility>

#include "tendril/canopen/sdo.h"

namespace tendril::canopen {

class ReplyWatch {
 public:
  /// kAlike: a repeated equal reply, from two servers or one frame received twice. kDifferent: two servers.
  enum class Surplus : std::uint8_t { kNone, kAlike, kDifferent };

  /// A request to the server, from any client. Segments are not watched: their replies name no object.
  void OnRequest(const can::CanFrame& frame) noexcept {
    const SdoMessage request = DecodeSdoRequest(frame);
    if (request.kind != SdoKind::kInitiateUpload && request.kind != SdoKind::kInitiateDownload) return;
    if (!Same(last_, request)) {
      if (!before_.twice) in_a_row_ = last_.twice ? 1 : 0;
      before_ = std::exchange(last_, {.kind = request.kind, .address = request.address});
    }
    ++last_.unanswered;
  }

  /// A reply of the server. A second reply to a request that was repeated or answered late is not counted.
  Surplus OnReply(const can::CanFrame& frame) noexcept {
    const SdoMessage reply = DecodeSdoResponse(frame);
    for (Exchange* exchange : {&last_, &before_}) {
      if (!Same(*exchange, reply)) continue;
      const Data given = std::exchange(exchange->reply, frame.data);
      const bool first = !std::exchange(exchange->answered, true);
      if (exchange->unanswered > 0) {
        --exchange->unanswered;
        return Surplus::kNone;
      }
      if (first) return Surplus::kNone;
      if (!std::exchange(exchange->twice, true)) ++in_a_row_;
      values_ = {ValueOf(given), ValueOf(frame.data)};
      return given == frame.data ? Surplus::kAlike : Surplus::kDifferent;
    }
    return Surplus::kNone;
  }

  /// Consecutive requests that were answered more than once.
  int in_a_row() const noexcept { return in_a_row_; }
  /// Data bytes of the reply before the last surplus reply, and of that reply itself.
  std::pair<std::uint32_t, std::uint32_t> values() const noexcept { return values_; }

 private:
  using Data = std::array<std::uint8_t, 8>;
  struct Exchange {
    SdoKind kind = SdoKind::kUnknown;
    ObjectAddress address;
    int unanswered = 0;
    bool answered = false, twice = false;
    Data reply{};
  };

  static bool Same(const Exchange& exchange, const SdoMessage& message) noexcept {
    if (exchange.kind == SdoKind::kUnknown || exchange.address != message.address) return false;
    return exchange.kind == message.kind || message.kind == SdoKind::kAbort;
  }
  static std::uint32_t ValueOf(const Data& data) noexcept {
    return Get<std::uint32_t>(std::span(data).last<4>());
  }

  Exchange last_, before_;  // a second reply may come after the next request
  int in_a_row_ = 0;
  std::pair<std::uint32_t, std::uint32_t> values_;
};

}  // namespace tendril::canopen
