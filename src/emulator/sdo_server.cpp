// SDO server of one node: one transfer at a time, a new initiate replaces the one under way.
// Knows nothing of what the objects mean.
#include "sdo_server.h"

#include <algorithm>

namespace tendril::emulator {

using canopen::SdoKind;
using canopen::SdoMessage;
namespace sdo_abort = canopen::sdo_abort;

bool SdoServer::Answer(const can::CanFrame& request, can::CanFrame* response) {
  const SdoMessage message = canopen::DecodeSdoRequest(request);
  if (message.kind == SdoKind::kAbort) {
    Reset();
    return false;
  }
  *response = canopen::EncodeSdoResponse(node_id_, Reply(message));
  return true;
}

SdoMessage SdoServer::Reply(const SdoMessage& request) {
  switch (request.kind) {
    case SdoKind::kInitiateUpload:
      return StartUpload(request);
    case SdoKind::kInitiateDownload:
      return StartDownload(request);
    case SdoKind::kUploadSegment:
      return NextUpload(request);
    case SdoKind::kDownloadSegment:
      return NextDownload(request);
    case SdoKind::kAbort:
    case SdoKind::kUnknown:
      break;
  }
  return Abort(request.address, sdo_abort::kCommand);
}

SdoMessage SdoServer::Abort(canopen::ObjectAddress address, std::uint32_t code) {
  Reset();
  SdoMessage reply;
  reply.kind = SdoKind::kAbort;
  reply.address = address;
  reply.abort_code = code;
  return reply;
}

SdoMessage SdoServer::StartUpload(const SdoMessage& request) {
  Reset();
  std::size_t size = 0;
  const std::uint32_t error = objects_.Read(request.address, buffer_, &size);
  if (error != 0) return Abort(request.address, error);
  SdoMessage reply;
  reply.kind = SdoKind::kInitiateUpload;
  reply.address = request.address;
  reply.size_indicated = true;
  reply.size = static_cast<std::uint32_t>(size);
  reply.expedited = size >= 1 && size <= 4;
  if (reply.expedited) {
    std::copy_n(buffer_.begin(), size, reply.data.begin());
    return reply;
  }
  transfer_ = Transfer::kUpload;
  address_ = request.address;
  toggle_ = false;
  size_ = size;
  sent_ = 0;
  return reply;
}

SdoMessage SdoServer::NextUpload(const SdoMessage& request) {
  if (transfer_ != Transfer::kUpload) return Abort({}, sdo_abort::kCommand);
  if (request.toggle != toggle_) return Abort(address_, sdo_abort::kToggle);
  const std::size_t n = std::min<std::size_t>(7, size_ - sent_);
  SdoMessage reply;
  reply.kind = SdoKind::kUploadSegment;
  reply.toggle = toggle_;
  reply.size = static_cast<std::uint32_t>(n);
  std::copy_n(buffer_.begin() + static_cast<std::ptrdiff_t>(sent_), n, reply.data.begin());
  sent_ += n;
  toggle_ = !toggle_;
  reply.last = sent_ == size_;
  if (reply.last) Reset();
  return reply;
}

SdoMessage SdoServer::StartDownload(const SdoMessage& request) {
  Reset();
  SdoMessage reply;
  reply.kind = SdoKind::kInitiateDownload;
  reply.address = request.address;
  if (request.expedited) {
    const std::span<const std::uint8_t> bytes(request.data.data(), std::min<std::size_t>(request.size, 4));
    const std::uint32_t error = objects_.Write(request.address, bytes, request.size_indicated);
    return error == 0 ? reply : Abort(request.address, error);
  }
  transfer_ = Transfer::kDownload;
  address_ = request.address;
  toggle_ = false;
  size_ = 0;
  announced_ = request.size_indicated ? request.size : 0;
  return announced_ > buffer_.size() ? Abort(address_, sdo_abort::kLengthHigh) : reply;
}

SdoMessage SdoServer::NextDownload(const SdoMessage& request) {
  if (transfer_ != Transfer::kDownload) return Abort({}, sdo_abort::kCommand);
  if (request.toggle != toggle_) return Abort(address_, sdo_abort::kToggle);
  const std::size_t n = std::min<std::size_t>(request.size, 7);
  if (size_ + n > buffer_.size()) return Abort(address_, sdo_abort::kLengthHigh);
  std::copy_n(request.data.begin(), n, buffer_.begin() + static_cast<std::ptrdiff_t>(size_));
  size_ += n;
  SdoMessage reply;
  reply.kind = SdoKind::kDownloadSegment;
  reply.toggle = toggle_;
  toggle_ = !toggle_;
  if (!request.last) return reply;
  if (announced_ != 0 && announced_ != size_) return Abort(address_, sdo_abort::kLength);
  const std::uint32_t error = objects_.Write(address_, {buffer_.data(), size_}, true);
  if (error != 0) return Abort(address_, error);
  Reset();
  return reply;
}

}  // namespace tendril::emulator
