// SDO codec and client, after CiA 301: command specifier in bits 5..7 of the first byte.
// Knows no port and no object dictionary.
#include "tendril/canopen/sdo.h"

#include <algorithm>

namespace tendril::canopen {
namespace {

// Command specifiers: a client's (ccs) and a server's (scs) number the same services differently.
constexpr int kCcsDownloadSegment = 0, kCcsInitiateDownload = 1, kCcsInitiateUpload = 2,
              kCcsUploadSegment = 3;
constexpr int kScsUploadSegment = 0, kScsDownloadSegment = 1, kScsInitiateUpload = 2,
              kScsInitiateDownload = 3;
constexpr int kCsAbort = 4;

constexpr std::uint8_t kToggleBit = 0x10, kExpeditedBit = 0x02, kSizeBit = 0x01, kLastBit = 0x01;

std::uint8_t Specifier(int cs) { return static_cast<std::uint8_t>(cs << 5); }

ObjectAddress AddressOf(const can::CanFrame& frame) {
  return {static_cast<std::uint16_t>(frame.data[1] | (frame.data[2] << 8)), frame.data[3]};
}

void PutAddress(can::CanFrame& frame, ObjectAddress address) {
  frame.data[1] = static_cast<std::uint8_t>(address.index);
  frame.data[2] = static_cast<std::uint8_t>(address.index >> 8);
  frame.data[3] = address.sub;
}

std::span<const std::uint8_t> Tail(const can::CanFrame& frame) { return {frame.data.data() + 4, 4}; }

void DecodeInitiateData(const can::CanFrame& frame, SdoMessage& message) {
  const std::uint8_t command = frame.data[0];
  message.expedited = (command & kExpeditedBit) != 0;
  message.size_indicated = (command & kSizeBit) != 0;
  if (message.expedited) {
    message.size = message.size_indicated ? 4u - ((command >> 2) & 3u) : 4u;
    std::copy_n(frame.data.begin() + 4, 4, message.data.begin());
  } else if (message.size_indicated) {
    message.size = Get<std::uint32_t>(Tail(frame));
  }
}

void EncodeInitiateData(const SdoMessage& message, can::CanFrame& frame) {
  if (message.expedited) {
    frame.data[0] |= kExpeditedBit;
    if (message.size_indicated) {
      frame.data[0] |= static_cast<std::uint8_t>(kSizeBit | ((4u - message.size) << 2));
    }
    std::copy_n(message.data.begin(), std::min(message.size, 4u), frame.data.begin() + 4);
  } else if (message.size_indicated) {
    frame.data[0] |= kSizeBit;
    PutLe({frame.data.data() + 4, 4}, message.size, 4);
  }
}

void DecodeSegmentData(const can::CanFrame& frame, SdoMessage& message) {
  message.size = 7u - ((frame.data[0] >> 1) & 7u);
  message.last = (frame.data[0] & kLastBit) != 0;
  std::copy_n(frame.data.begin() + 1, 7, message.data.begin());
}

void EncodeSegmentData(const SdoMessage& message, can::CanFrame& frame) {
  frame.data[0] |= static_cast<std::uint8_t>(((7u - message.size) << 1) | (message.last ? kLastBit : 0));
  std::copy_n(message.data.begin(), std::min(message.size, 7u), frame.data.begin() + 1);
}

void EncodeToggle(const SdoMessage& message, can::CanFrame& frame) {
  if (message.toggle) frame.data[0] |= kToggleBit;
}

can::CanFrame EncodeAbort(const SdoMessage& message, can::CanFrame frame) {
  frame.data[0] = Specifier(kCsAbort);
  PutAddress(frame, message.address);
  PutLe({frame.data.data() + 4, 4}, message.abort_code, 4);
  return frame;
}

can::CanFrame EmptyFrame(std::uint32_t base, int node_id) {
  can::CanFrame frame;
  frame.id = base + static_cast<std::uint32_t>(node_id);
  frame.size = 8;
  return frame;
}

}  // namespace

const char* AbortText(std::uint32_t code) noexcept {
  switch (code) {
    case sdo_abort::kToggle:
      return "toggle bit not alternated";
    case sdo_abort::kTimeout:
      return "no answer in time";
    case sdo_abort::kCommand:
      return "command specifier not valid or unknown";
    case sdo_abort::kOutOfMemory:
      return "out of memory";
    case sdo_abort::kAccess:
      return "access not supported";
    case sdo_abort::kWriteOnly:
      return "read of a write-only object";
    case sdo_abort::kReadOnly:
      return "write to a read-only object";
    case sdo_abort::kNoObject:
      return "object does not exist";
    case sdo_abort::kNotMappable:
      return "object cannot be mapped to the PDO";
    case sdo_abort::kPdoLength:
      return "mapped objects exceed the PDO's length";
    case sdo_abort::kIncompatible:
      return "general parameter incompatibility";
    case sdo_abort::kHardware:
      return "access failed due to a hardware error";
    case sdo_abort::kLength:
      return "length of the value does not match";
    case sdo_abort::kLengthHigh:
      return "value too long";
    case sdo_abort::kLengthLow:
      return "value too short";
    case sdo_abort::kNoSubIndex:
      return "sub-index does not exist";
    case sdo_abort::kValueRange:
      return "value out of range";
    case sdo_abort::kValueHigh:
      return "value too high";
    case sdo_abort::kValueLow:
      return "value too low";
    case sdo_abort::kGeneral:
      return "general error";
    case sdo_abort::kTransfer:
      return "data cannot be transferred or stored";
    case sdo_abort::kLocalControl:
      return "data cannot be transferred because of local control";
    case sdo_abort::kDeviceState:
      return "data cannot be transferred in the present device state";
    default:
      return "unknown abort code";
  }
}

SdoMessage DecodeSdoRequest(const can::CanFrame& frame) noexcept {
  SdoMessage message;
  if (frame.size != 8 || frame.remote || frame.error) return message;
  message.address = AddressOf(frame);
  message.toggle = (frame.data[0] & kToggleBit) != 0;
  switch (frame.data[0] >> 5) {
    case kCcsDownloadSegment:
      message.kind = SdoKind::kDownloadSegment;
      DecodeSegmentData(frame, message);
      break;
    case kCcsInitiateDownload:
      message.kind = SdoKind::kInitiateDownload;
      DecodeInitiateData(frame, message);
      break;
    case kCcsInitiateUpload:
      message.kind = SdoKind::kInitiateUpload;
      break;
    case kCcsUploadSegment:
      message.kind = SdoKind::kUploadSegment;
      break;
    case kCsAbort:
      message.kind = SdoKind::kAbort;
      message.abort_code = Get<std::uint32_t>(Tail(frame));
      break;
    default:
      break;
  }
  return message;
}

SdoMessage DecodeSdoResponse(const can::CanFrame& frame) noexcept {
  SdoMessage message;
  if (frame.size != 8 || frame.remote || frame.error) return message;
  message.address = AddressOf(frame);
  message.toggle = (frame.data[0] & kToggleBit) != 0;
  switch (frame.data[0] >> 5) {
    case kScsUploadSegment:
      message.kind = SdoKind::kUploadSegment;
      DecodeSegmentData(frame, message);
      break;
    case kScsDownloadSegment:
      message.kind = SdoKind::kDownloadSegment;
      break;
    case kScsInitiateUpload:
      message.kind = SdoKind::kInitiateUpload;
      DecodeInitiateData(frame, message);
      break;
    case kScsInitiateDownload:
      message.kind = SdoKind::kInitiateDownload;
      break;
    case kCsAbort:
      message.kind = SdoKind::kAbort;
      message.abort_code = Get<std::uint32_t>(Tail(frame));
      break;
    default:
      break;
  }
  return message;
}

can::CanFrame EncodeSdoRequest(int node_id, const SdoMessage& message) noexcept {
  can::CanFrame frame = EmptyFrame(kSdoRequestBase, node_id);
  switch (message.kind) {
    case SdoKind::kInitiateDownload:
      frame.data[0] = Specifier(kCcsInitiateDownload);
      PutAddress(frame, message.address);
      EncodeInitiateData(message, frame);
      break;
    case SdoKind::kDownloadSegment:
      frame.data[0] = Specifier(kCcsDownloadSegment);
      EncodeToggle(message, frame);
      EncodeSegmentData(message, frame);
      break;
    case SdoKind::kInitiateUpload:
      frame.data[0] = Specifier(kCcsInitiateUpload);
      PutAddress(frame, message.address);
      break;
    case SdoKind::kUploadSegment:
      frame.data[0] = Specifier(kCcsUploadSegment);
      EncodeToggle(message, frame);
      break;
    case SdoKind::kAbort:
    case SdoKind::kUnknown:
      return EncodeAbort(message, frame);
  }
  return frame;
}

can::CanFrame EncodeSdoResponse(int node_id, const SdoMessage& message) noexcept {
  can::CanFrame frame = EmptyFrame(kSdoResponseBase, node_id);
  switch (message.kind) {
    case SdoKind::kInitiateDownload:
      frame.data[0] = Specifier(kScsInitiateDownload);
      PutAddress(frame, message.address);
      break;
    case SdoKind::kDownloadSegment:
      frame.data[0] = Specifier(kScsDownloadSegment);
      EncodeToggle(message, frame);
      break;
    case SdoKind::kInitiateUpload:
      frame.data[0] = Specifier(kScsInitiateUpload);
      PutAddress(frame, message.address);
      EncodeInitiateData(message, frame);
      break;
    case SdoKind::kUploadSegment:
      frame.data[0] = Specifier(kScsUploadSegment);
      EncodeToggle(message, frame);
      EncodeSegmentData(message, frame);
      break;
    case SdoKind::kAbort:
    case SdoKind::kUnknown:
      return EncodeAbort(message, frame);
  }
  return frame;
}

// ---- client -------------------------------------------------------------------------------------

void SdoClient::Queue(const SdoMessage& message) noexcept {
  frame_ = EncodeSdoRequest(node_id_, message);
  frame_waits_ = true;
}

void SdoClient::Upload(ObjectAddress address, TimeNs timeout_ns) noexcept {
  state_ = State::kBusy;
  upload_ = true;
  segmented_ = false;
  address_ = address;
  abort_code_ = 0;
  size_ = 0;
  announced_ = 0;
  timeout_ns_ = timeout_ns;
  SdoMessage message;
  message.kind = SdoKind::kInitiateUpload;
  message.address = address;
  Queue(message);
}

void SdoClient::Download(ObjectAddress address, std::span<const std::uint8_t> data,
                         TimeNs timeout_ns) noexcept {
  state_ = State::kBusy;
  upload_ = false;
  segmented_ = data.size() > 4;
  toggle_ = false;
  address_ = address;
  abort_code_ = 0;
  size_ = std::min(data.size(), kCapacity);
  sent_ = 0;
  timeout_ns_ = timeout_ns;
  std::copy_n(data.begin(), size_, buffer_.begin());
  SdoMessage message;
  message.kind = SdoKind::kInitiateDownload;
  message.address = address;
  message.expedited = !segmented_;
  message.size_indicated = true;
  message.size = static_cast<std::uint32_t>(size_);
  if (!segmented_) std::copy_n(data.begin(), size_, message.data.begin());
  Queue(message);
}

void SdoClient::FrameSent(TimeNs now_ns) noexcept {
  frame_waits_ = false;
  deadline_ns_ = now_ns + timeout_ns_;
}

void SdoClient::Fail(std::uint32_t code, bool tell_server) noexcept {
  state_ = State::kAborted;
  abort_code_ = code;
  frame_waits_ = false;
  if (!tell_server) return;
  SdoMessage message;
  message.kind = SdoKind::kAbort;
  message.address = address_;
  message.abort_code = code;
  frame_ = EncodeSdoRequest(node_id_, message);
  frame_waits_ = true;
}

void SdoClient::QueueSegment() noexcept {
  SdoMessage message;
  message.toggle = toggle_;
  if (upload_) {
    message.kind = SdoKind::kUploadSegment;
  } else {
    message.kind = SdoKind::kDownloadSegment;
    message.size = static_cast<std::uint32_t>(std::min<std::size_t>(7, size_ - sent_));
    std::copy_n(buffer_.begin() + static_cast<std::ptrdiff_t>(sent_), message.size, message.data.begin());
    sent_ += message.size;
    message.last = sent_ == size_;
  }
  Queue(message);
}

void SdoClient::OnFrame(const can::CanFrame& frame) noexcept {
  const SdoMessage reply = DecodeSdoResponse(frame);
  // A reply before the request was sent cannot be its answer.
  if (!busy() || frame_waits_) {
    ++stale_;
    return;
  }
  if (reply.kind == SdoKind::kAbort) {
    // A server that did not understand the command may name no object.
    if (reply.address == address_ || reply.address == ObjectAddress{}) {
      Fail(reply.abort_code, false);
    } else {
      ++stale_;
    }
    return;
  }
  const bool in_segments = segmented_ && (upload_ || sent_ > 0);
  const SdoKind expected = upload_ ? (in_segments ? SdoKind::kUploadSegment : SdoKind::kInitiateUpload)
                                   : (in_segments ? SdoKind::kDownloadSegment : SdoKind::kInitiateDownload);
  if (reply.kind != expected || (!in_segments && reply.address != address_)) {
    ++stale_;
    return;
  }
  if (in_segments && reply.toggle != toggle_) {
    Fail(sdo_abort::kToggle, true);
    return;
  }

  if (!upload_) {
    if (in_segments) toggle_ = !toggle_;
    if (segmented_ && sent_ < size_) {
      QueueSegment();
    } else {
      state_ = State::kDone;
    }
    return;
  }
  if (!in_segments) {
    if (reply.expedited) {
      std::copy_n(reply.data.begin(), reply.size, buffer_.begin());
      size_ = reply.size;
      state_ = State::kDone;
      return;
    }
    announced_ = reply.size_indicated ? reply.size : 0;
    if (announced_ > kCapacity) {
      Fail(sdo_abort::kOutOfMemory, true);
      return;
    }
    segmented_ = true;
    toggle_ = false;
    QueueSegment();
    return;
  }
  if (size_ + reply.size > kCapacity) {
    Fail(sdo_abort::kOutOfMemory, true);
    return;
  }
  std::copy_n(reply.data.begin(), reply.size, buffer_.begin() + static_cast<std::ptrdiff_t>(size_));
  size_ += reply.size;
  if (!reply.last) {
    toggle_ = !toggle_;
    QueueSegment();
  } else if (announced_ != 0 && size_ != announced_) {
    Fail(sdo_abort::kLength, true);
  } else {
    state_ = State::kDone;
  }
}

void SdoClient::Poll(TimeNs now_ns) noexcept {
  if (!busy() || frame_waits_ || now_ns < deadline_ns_) return;
  Fail(sdo_abort::kTimeout, true);
  state_ = State::kTimedOut;
}

void SdoClient::Reset() noexcept {
  state_ = State::kIdle;
  frame_waits_ = false;
}

std::uint64_t SdoClient::value() const noexcept {
  return GetLe(data(), static_cast<int>(std::min<std::size_t>(size_, 8)));
}

}  // namespace tendril::canopen
