// SDO server of one node: expedited and segmented transfers, both directions. Objects are accessed through
// two calls. Knows nothing of what the objects mean.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "tendril/canopen/sdo.h"

namespace tendril::emulator {

/// The served objects. Both return 0 or an abort code.
class SdoObjects {
 public:
  virtual ~SdoObjects() = default;
  /// Puts the value, little-endian, into `to` and its length into `size`.
  virtual std::uint32_t Read(canopen::ObjectAddress address, std::span<std::uint8_t> to,
                             std::size_t* size) = 0;
  /// `exact` is false when the client sent four bytes without stating how many of them are valid.
  virtual std::uint32_t Write(canopen::ObjectAddress address, std::span<const std::uint8_t> from,
                              bool exact) = 0;
};

class SdoServer {
 public:
  SdoServer(int node_id, SdoObjects& objects) : node_id_(node_id), objects_(objects) {}

  /// Answers a frame on 0x600 + node; false when none is due (the client's abort).
  bool Answer(const can::CanFrame& request, can::CanFrame* response);
  void SetNodeId(int node_id) noexcept { node_id_ = node_id; }
  /// Drops a transfer in progress.
  void Reset() noexcept { transfer_ = Transfer::kNone; }

 private:
  enum class Transfer : std::uint8_t { kNone, kUpload, kDownload };

  canopen::SdoMessage Reply(const canopen::SdoMessage& request);
  canopen::SdoMessage StartUpload(const canopen::SdoMessage& request);
  canopen::SdoMessage StartDownload(const canopen::SdoMessage& request);
  canopen::SdoMessage NextUpload(const canopen::SdoMessage& request);
  canopen::SdoMessage NextDownload(const canopen::SdoMessage& request);
  canopen::SdoMessage Abort(canopen::ObjectAddress address, std::uint32_t code);

  int node_id_;
  SdoObjects& objects_;
  Transfer transfer_ = Transfer::kNone;
  canopen::ObjectAddress address_;
  bool toggle_ = false;
  std::size_t size_ = 0;       // upload: of the value; download: received so far
  std::size_t sent_ = 0;       // upload
  std::size_t announced_ = 0;  // download: size announced by the client, 0 if none
  std::array<std::uint8_t, 256> buffer_{};
};

}  // namespace tendril::emulator
