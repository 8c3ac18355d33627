// NMT, heartbeat and SYNC frames.
// Knows no port, no time and no drive.
#include "tendril/canopen/wire.h"

namespace tendril::canopen {

const char* NmtStateText(NmtState state) noexcept {
  switch (state) {
    case NmtState::kBootUp:
      return "boot-up";
    case NmtState::kStopped:
      return "stopped";
    case NmtState::kOperational:
      return "operational";
    case NmtState::kPreOperational:
      return "pre-operational";
  }
  return "unknown NMT state";
}

can::CanFrame NmtFrame(NmtCommand command, int node_id) noexcept {
  can::CanFrame frame;
  frame.id = kNmtCobId;
  frame.size = 2;
  frame.data[0] = static_cast<std::uint8_t>(command);
  frame.data[1] = static_cast<std::uint8_t>(node_id);
  return frame;
}

can::CanFrame HeartbeatFrame(int node_id, NmtState state) noexcept {
  can::CanFrame frame;
  frame.id = kHeartbeatBase + static_cast<std::uint32_t>(node_id);
  frame.size = 1;
  frame.data[0] = static_cast<std::uint8_t>(state);
  return frame;
}

can::CanFrame SyncFrame() noexcept {
  can::CanFrame frame;
  frame.id = kSyncCobId;
  return frame;
}

std::optional<NmtMessage> ParseNmt(const can::CanFrame& frame) noexcept {
  if (frame.error || frame.remote || frame.id != kNmtCobId || frame.size != 2) return std::nullopt;
  switch (static_cast<NmtCommand>(frame.data[0])) {
    case NmtCommand::kStart:
    case NmtCommand::kStop:
    case NmtCommand::kEnterPreOperational:
    case NmtCommand::kResetNode:
    case NmtCommand::kResetCommunication:
      break;
    default:
      return std::nullopt;
  }
  if (frame.data[1] > kMaxNodeId) return std::nullopt;
  return NmtMessage{static_cast<NmtCommand>(frame.data[0]), frame.data[1]};
}

std::optional<Heartbeat> ParseHeartbeat(const can::CanFrame& frame) noexcept {
  if (frame.error || frame.remote || CobFunction(frame.id) != kHeartbeatBase || CobNode(frame.id) == 0 ||
      frame.size != 1) {
    return std::nullopt;
  }
  const auto state = static_cast<NmtState>(frame.data[0]);
  switch (state) {
    case NmtState::kBootUp:
    case NmtState::kStopped:
    case NmtState::kOperational:
    case NmtState::kPreOperational:
      return Heartbeat{CobNode(frame.id), state};
  }
  return std::nullopt;
}

bool IsSync(const can::CanFrame& frame) noexcept {
  return !frame.error && !frame.remote && frame.id == kSyncCobId && frame.size <= 1;
}

}  // namespace tendril::canopen
