// The CANopen wire below any protocol: COB-IDs, NMT, heartbeat and SYNC frames, little-endian numbers.
// Passive values and pure functions; knows no port, no time and no drive.
#pragma once

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <type_traits>

#include "tendril/can/can_port.h"

namespace tendril::canopen {

// ---- COB-IDs of the predefined connection set (CiA 301); those of a node have its id added ------

inline constexpr std::uint32_t kNmtCobId = 0x000;
inline constexpr std::uint32_t kSyncCobId = 0x080;
inline constexpr std::uint32_t kEmcyBase = 0x080;
inline constexpr std::uint32_t kSdoResponseBase = 0x580;  // server to client
inline constexpr std::uint32_t kSdoRequestBase = 0x600;   // client to server
inline constexpr std::uint32_t kHeartbeatBase = 0x700;

/// Default COB-ID of TPDO `number` (1..4) of a node: 0x180, 0x280, 0x380, 0x480 + node.
constexpr std::uint32_t TpdoCobId(int number, int node_id) {
  return 0x080u + 0x100u * static_cast<std::uint32_t>(number) + static_cast<std::uint32_t>(node_id);
}
/// Default COB-ID of RPDO `number` (1..4) of a node: 0x200, 0x300, 0x400, 0x500 + node.
constexpr std::uint32_t RpdoCobId(int number, int node_id) {
  return 0x100u + 0x100u * static_cast<std::uint32_t>(number) + static_cast<std::uint32_t>(node_id);
}

inline constexpr int kMinNodeId = 1, kMaxNodeId = 127;

/// A COB-ID split into its function (bits 7..10) and its node (0..127).
constexpr std::uint32_t CobFunction(std::uint32_t id) { return id & 0x780u; }
constexpr int CobNode(std::uint32_t id) { return static_cast<int>(id & 0x7Fu); }

/// Bit 31 of a PDO's COB-ID object: the PDO does not exist. Bit 30: no remote request allowed.
inline constexpr std::uint32_t kPdoInvalid = 0x80000000u;
inline constexpr std::uint32_t kPdoNoRtr = 0x40000000u;

/// One entry of the object dictionary.
struct ObjectAddress {
  std::uint16_t index = 0;
  std::uint8_t sub = 0;
  friend constexpr bool operator==(const ObjectAddress&, const ObjectAddress&) = default;
};

// ---- little-endian numbers ----------------------------------------------------------------------

/// Writes the lowest `bytes` bytes of `value` to the front of `to`, least significant first.
inline void PutLe(std::span<std::uint8_t> to, std::uint64_t value, int bytes) noexcept {
  for (int i = 0; i < bytes; ++i)
    to[static_cast<std::size_t>(i)] = static_cast<std::uint8_t>(value >> (8 * i));
}

/// Reads `bytes` bytes, least significant first, without sign.
inline std::uint64_t GetLe(std::span<const std::uint8_t> from, int bytes) noexcept {
  std::uint64_t value = 0;
  for (int i = 0; i < bytes; ++i)
    value |= static_cast<std::uint64_t>(from[static_cast<std::size_t>(i)]) << (8 * i);
  return value;
}

/// The same with the width and sign of a type: Get<std::int16_t>(data).
template <std::integral T>
T Get(std::span<const std::uint8_t> from) noexcept {
  return static_cast<T>(static_cast<std::make_unsigned_t<T>>(GetLe(from, static_cast<int>(sizeof(T)))));
}
template <std::integral T>
void Put(std::span<std::uint8_t> to, T value) noexcept {
  PutLe(to, static_cast<std::uint64_t>(static_cast<std::make_unsigned_t<T>>(value)),
        static_cast<int>(sizeof(T)));
}

/// `value`'s lowest `bits` bits (1..64) taken as a two's complement number.
constexpr std::int64_t SignExtend(std::uint64_t value, int bits) {
  const int shift = 64 - bits;
  return static_cast<std::int64_t>(value << shift) >> shift;
}

// ---- NMT, heartbeat, SYNC -----------------------------------------------------------------------

enum class NmtCommand : std::uint8_t {
  kStart = 0x01,
  kStop = 0x02,
  kEnterPreOperational = 0x80,
  kResetNode = 0x81,
  kResetCommunication = 0x82,
};

/// As carried by a heartbeat; kBootUp is sent once after a reset.
enum class NmtState : std::uint8_t {
  kBootUp = 0x00,
  kStopped = 0x04,
  kOperational = 0x05,
  kPreOperational = 0x7F
};

const char* NmtStateText(NmtState state) noexcept;

struct NmtMessage {
  NmtCommand command = NmtCommand::kStart;
  int node_id = 0;  // 0: all nodes
};

can::CanFrame NmtFrame(NmtCommand command, int node_id) noexcept;
can::CanFrame HeartbeatFrame(int node_id, NmtState state) noexcept;
can::CanFrame SyncFrame() noexcept;

/// Empty for any other frame and for malformed or unknown contents.
std::optional<NmtMessage> ParseNmt(const can::CanFrame& frame) noexcept;

struct Heartbeat {
  int node_id = 0;
  NmtState state = NmtState::kBootUp;
};
/// Empty for any other frame, for node 0 and for states undefined in CiA 301.
std::optional<Heartbeat> ParseHeartbeat(const can::CanFrame& frame) noexcept;
/// A data frame on 0x080; a SYNC counter byte is tolerated.
bool IsSync(const can::CanFrame& frame) noexcept;

}  // namespace tendril::canopen
