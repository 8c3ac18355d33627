// SDO, expedited and segmented: the codec of both directions, the abort codes, and a passive client. Frames
// and time are passed in; knows no port and no object dictionary. No block transfer.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "tendril/can/can_port.h"
#include "tendril/canopen/wire.h"
#include "tendril/core/clock.h"

namespace tendril::canopen {

// ---- abort codes --------------------------------------------------------------------------------

namespace sdo_abort {
inline constexpr std::uint32_t kToggle = 0x05030000, kTimeout = 0x05040000, kCommand = 0x05040001,
                               kOutOfMemory = 0x05040005, kAccess = 0x06010000, kWriteOnly = 0x06010001,
                               kReadOnly = 0x06010002, kNoObject = 0x06020000, kNotMappable = 0x06040041,
                               kPdoLength = 0x06040042, kIncompatible = 0x06040043, kHardware = 0x06060000,
                               kLength = 0x06070010, kLengthHigh = 0x06070012, kLengthLow = 0x06070013,
                               kNoSubIndex = 0x06090011, kValueRange = 0x06090030, kValueHigh = 0x06090031,
                               kValueLow = 0x06090032, kGeneral = 0x08000000, kTransfer = 0x08000020,
                               kLocalControl = 0x08000021, kDeviceState = 0x08000022;
}  // namespace sdo_abort

/// One line for messages; "unknown abort code" for codes in no list.
const char* AbortText(std::uint32_t code) noexcept;

// ---- codec --------------------------------------------------------------------------------------

enum class SdoKind : std::uint8_t {
  kInitiateDownload,  // request: write begins;      response: accepted
  kDownloadSegment,   // request: next 1..7 bytes;   response: accepted
  kInitiateUpload,    // request: read begins;       response: expedited data, or the size of what follows
  kUploadSegment,     // request: send the next;     response: next 1..7 bytes
  kAbort,
  kUnknown,  // block transfer or no command specifier at all
};

/// A decoded SDO frame of either direction; only the members of its kind are valid.
struct SdoMessage {
  SdoKind kind = SdoKind::kUnknown;
  ObjectAddress address;         // initiate and abort
  bool expedited = false;        // initiate with data: in this frame
  bool size_indicated = false;   // initiate: `size` is valid
  std::uint32_t size = 0;        // initiate: whole transfer; segment: bytes in this one; expedited without
                                 // size_indicated: 4
  bool toggle = false;           // segment
  bool last = false;             // segment with data: no more follow
  std::uint32_t abort_code = 0;  // abort
  std::array<std::uint8_t, 7> data{};  // expedited (up to 4) and segment (up to 7)
};

/// `data` as a client (request) or a server (response) sent it. Frames with other than 8 bytes give kUnknown.
SdoMessage DecodeSdoRequest(const can::CanFrame& frame) noexcept;
SdoMessage DecodeSdoResponse(const can::CanFrame& frame) noexcept;
/// Frame with COB-ID 0x600 + node or 0x580 + node; kind must not be kUnknown.
can::CanFrame EncodeSdoRequest(int node_id, const SdoMessage& message) noexcept;
can::CanFrame EncodeSdoResponse(int node_id, const SdoMessage& message) noexcept;

// ---- client -------------------------------------------------------------------------------------

/// One transfer at a time with one server. Start it, send the frame of pending(), and pass in the node's SDO
/// responses and the time until state() is no longer kBusy.
class SdoClient {
 public:
  enum class State : std::uint8_t { kIdle, kBusy, kDone, kAborted, kTimedOut };
  static constexpr std::size_t kCapacity = 256;  // bytes of one value, both directions

  explicit SdoClient(int node_id) : node_id_(node_id) {}

  /// Begins reading; a transfer in progress is dropped. `timeout_ns` is for each response.
  void Upload(ObjectAddress address, TimeNs timeout_ns) noexcept;
  /// Begins writing `data` (1..kCapacity bytes, little-endian); up to 4 bytes go expedited.
  void Download(ObjectAddress address, std::span<const std::uint8_t> data, TimeNs timeout_ns) noexcept;
  /// The frame to send now; nullptr when there is none.
  const can::CanFrame* pending() const noexcept { return frame_waits_ ? &frame_ : nullptr; }
  /// The pending frame was sent; starts the time-out of the response.
  void FrameSent(TimeNs now_ns) noexcept;
  /// A frame on 0x580 + node. Unexpected replies (late, duplicated, of another object) are counted and
  /// discarded.
  void OnFrame(const can::CanFrame& frame) noexcept;
  /// Detects a time-out; the next frame then aborts the transfer at the server.
  void Poll(TimeNs now_ns) noexcept;
  /// Drops the transfer and its pending frame, for example after the node restarted.
  void Reset() noexcept;

  State state() const noexcept { return state_; }
  bool busy() const noexcept { return state_ == State::kBusy; }
  /// Of the last transfer.
  ObjectAddress address() const noexcept { return address_; }
  /// The server's abort code, or our own (toggle, out of memory); kTimeout after a time-out.
  std::uint32_t abort_code() const noexcept { return abort_code_; }
  /// Data of a finished upload.
  std::span<const std::uint8_t> data() const noexcept { return {buffer_.data(), size_}; }
  /// The same as a number (up to 8 bytes).
  std::uint64_t value() const noexcept;
  std::uint64_t stale_replies() const noexcept { return stale_; }

 private:
  void Queue(const SdoMessage& message) noexcept;
  void Fail(std::uint32_t code, bool tell_server) noexcept;
  void QueueSegment() noexcept;

  int node_id_;
  State state_ = State::kIdle;
  bool upload_ = false;
  bool segmented_ = false;
  bool toggle_ = false;
  bool frame_waits_ = false;
  ObjectAddress address_;
  std::uint32_t abort_code_ = 0;
  std::size_t size_ = 0;         // of the value: known so far (upload) or whole (download)
  std::size_t sent_ = 0;         // download: bytes handed out
  std::uint32_t announced_ = 0;  // upload: size announced by the server; 0: none
  TimeNs timeout_ns_ = 0, deadline_ns_ = 0;
  std::uint64_t stale_ = 0;
  can::CanFrame frame_;
  std::array<std::uint8_t, kCapacity> buffer_{};
};

}  // namespace tendril::canopen
