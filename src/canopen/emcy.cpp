// Emergency frames and the look-up in a table of codes. Knows no drive and no node's state.
#include "tendril/canopen/emcy.h"

#include <algorithm>

#include "tendril/canopen/wire.h"

namespace tendril::canopen {

const EmcyInfo& FindEmcy(std::span<const EmcyInfo> table, std::uint16_t code) noexcept {
  for (const EmcyInfo& info : table) {
    if (code >= info.first && code <= info.last) return info;
  }
  return table.back();
}

can::CanFrame EmcyFrame(const EmcyMessage& message) noexcept {
  can::CanFrame frame;
  frame.id = kEmcyBase + static_cast<std::uint32_t>(message.node_id);
  frame.size = 8;
  PutLe(frame.data, message.code, 2);
  frame.data[2] = message.error_register;
  std::copy(message.vendor.begin(), message.vendor.end(), frame.data.begin() + 3);
  return frame;
}

std::optional<EmcyMessage> ParseEmcy(const can::CanFrame& frame) noexcept {
  if (frame.error || frame.remote || CobFunction(frame.id) != kEmcyBase || CobNode(frame.id) == 0 ||
      frame.size != 8) {
    return std::nullopt;
  }
  EmcyMessage message;
  message.node_id = CobNode(frame.id);
  message.code = Get<std::uint16_t>(frame.data);
  message.error_register = frame.data[2];
  std::copy(frame.data.begin() + 3, frame.data.end(), message.vendor.begin());
  return message;
}

}  // namespace tendril::canopen
