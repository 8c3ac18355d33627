// The fuzz targets; see the header.
#include "fuzz_targets.h"

#include <algorithm>
#include <array>
#include <cstdlib>

#include "fake_node.h"
#include "tendril/canopen/emcy.h"
#include "tendril/canopen/pdo.h"
#include "tendril/canopen/sdo.h"
#include "tendril/canopen/wire.h"

namespace tendril::canopen::test {
namespace {

void Require(bool holds) {
  if (!holds) std::abort();
}

/// Bytes handed out one by one; zeros after the end.
class Source {
 public:
  explicit Source(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}
  int frames() const { return frames_; }
  bool empty() const { return at_ >= bytes_.size(); }
  std::uint8_t Byte() { return empty() ? std::uint8_t{0} : bytes_[at_++]; }
  can::CanFrame Frame(std::uint32_t id) {
    ++frames_;
    can::CanFrame frame;
    frame.id = id;
    const std::uint8_t head = Byte();
    frame.size = static_cast<std::uint8_t>(head < 0xE0 ? 8 : head % 9);
    frame.remote = head == 0xFF;
    for (int i = 0; i < frame.size; ++i) frame.data[static_cast<std::size_t>(i)] = Byte();
    return frame;
  }

 private:
  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = 0;
  int frames_ = 0;
};

}  // namespace

int FuzzSdoClient(std::span<const std::uint8_t> bytes) {
  Source source(bytes);
  SdoClient client(5);
  TimeNs now_ns = 0;
  std::array<std::uint8_t, 20> value{};
  while (!source.empty()) {
    const std::uint8_t choice = source.Byte();
    if (!client.busy()) {
      const ObjectAddress address{static_cast<std::uint16_t>(0x1000 + (choice & 3)), 0};
      if (choice & 4) {
        client.Download(address, std::span(value).first(1u + choice % value.size()), kNsPerMs);
      } else {
        client.Upload(address, kNsPerMs);
      }
    }
    if (client.pending() != nullptr && (choice & 8) == 0) {
      Require(client.pending()->id == 0x605 && client.pending()->size == 8);
      client.FrameSent(now_ns);
    }
    can::CanFrame reply = source.Frame(0x585);
    // Half of the replies answer the right object, or none would get far.
    if (choice & 16) {
      reply.data[1] = static_cast<std::uint8_t>(client.address().index);
      reply.data[2] = static_cast<std::uint8_t>(client.address().index >> 8);
      reply.data[3] = client.address().sub;
    }
    client.OnFrame(reply);
    now_ns += choice & 32 ? kNsPerMs / 4 : 0;
    client.Poll(now_ns);
    Require(client.data().size() <= SdoClient::kCapacity);
    Require(client.state() != SdoClient::State::kIdle);
    Require(client.state() == SdoClient::State::kAborted || client.state() == SdoClient::State::kTimedOut ||
            client.abort_code() == 0);
  }
  return source.frames();
}

int FuzzDecoders(std::span<const std::uint8_t> bytes) {
  Source source(bytes);
  while (!source.empty()) {
    const std::uint8_t low = source.Byte(), high = source.Byte();
    const can::CanFrame frame = source.Frame(static_cast<std::uint32_t>((high & 7) << 8 | low));
    const auto same = [&](const can::CanFrame& again) {
      Require(again.id == frame.id && again.size == frame.size &&
              std::equal(again.data.begin(), again.data.begin() + again.size, frame.data.begin()));
    };
    if (const auto nmt = ParseNmt(frame)) same(NmtFrame(nmt->command, nmt->node_id));
    if (const auto heartbeat = ParseHeartbeat(frame))
      same(HeartbeatFrame(heartbeat->node_id, heartbeat->state));
    if (const auto emcy = ParseEmcy(frame)) {
      same(EmcyFrame(*emcy));
      Require(FindEmcy(emcy->code).text[0] != '\0');
    }
    for (const bool request : {true, false}) {
      const SdoMessage message = request ? DecodeSdoRequest(frame) : DecodeSdoResponse(frame);
      if (message.kind == SdoKind::kUnknown) continue;
      Require(message.size <= 7 || message.kind == SdoKind::kInitiateDownload ||
              message.kind == SdoKind::kInitiateUpload);
      const can::CanFrame encoded = request ? EncodeSdoRequest(5, message) : EncodeSdoResponse(5, message);
      const SdoMessage again = request ? DecodeSdoRequest(encoded) : DecodeSdoResponse(encoded);
      Require(again.kind == message.kind);
      if (message.kind != SdoKind::kDownloadSegment && message.kind != SdoKind::kUploadSegment) {
        Require(again.address == message.address);
      } else {
        Require(again.toggle == message.toggle);
      }
    }
    for (const PdoLayout* pdo : {&kRpdoTorque, &kTpdoFeedback, &kTpdoStatus}) {
      const std::span entries(pdo->entries.data(), static_cast<std::size_t>(pdo->count));
      PdoValues values{};
      if (!DecodePdo(entries, {frame.data.data(), frame.size}, values)) {
        Require(frame.size < pdo->bytes());
        continue;
      }
      std::array<std::uint8_t, 8> data{};
      Require(EncodePdo(entries, values, data) == pdo->bytes());
      Require(std::equal(data.begin(), data.begin() + pdo->bytes(), frame.data.begin()));
    }
  }
  return source.frames();
}

int FuzzMaster(std::span<const std::uint8_t> bytes) {
  Source source(bytes);
  Rig rig(3);
  can::CanPort& stranger = rig.bus.AddPort();
  bool asked = false;
  rig.bus.SetFilter([&](can::CanFrame& frame) {
    const auto node = static_cast<std::size_t>(CobNode(frame.id));
    if (CobFunction(frame.id) == 0x200 && node >= 1 && node <= 3 && !frame.remote) {
      const auto torque = static_cast<std::int16_t>(frame.data[2] | (frame.data[3] << 8));
      const int command = frame.data[0] | (frame.data[1] << 8);
      Require(torque == 0 ||
              (asked && rig.master.feedback(static_cast<int>(node) - 1).state == DriveState::kEnabled));
      Require(command == 0x00 || command == 0x06 || command == 0x07 || command == 0x0F || command == 0x80);
    }
    return true;
  });
  rig.torques = {100, -100, 32767};
  rig.master.Start(rig.clock.Now());
  rig.Steps(300);
  while (!source.empty()) {
    const std::uint8_t choice = source.Byte();
    asked = (choice & 3) != 0;
    rig.request = asked ? DriveRequest::kEnable : DriveRequest::kDisable;
    if (choice == 0xF0) rig.master.ClearFaults(rig.clock.Now());
    constexpr std::array<std::uint32_t, 8> kBases = {0x080, 0x180, 0x280, 0x580, 0x700, 0x700, 0x280, 0x000};
    for (int i = 0; i < (choice >> 2) % 4; ++i) {
      const std::uint8_t which = source.Byte();
      const std::uint32_t id = kBases[which & 7] + (which >> 3) % 5;
      // Not as the master itself, whose frames no other node sends.
      if (id != 0x000) stranger.Send(source.Frame(id));
    }
    rig.Step();
    rig.events.clear();
    for (int i = 0; i < 3; ++i) {
      const DriveFeedback& feedback = rig.master.feedback(i);
      Require(feedback.state != DriveState::kEnabled ||
              DecodeStatusword(feedback.statusword) == DriveMachine::kOperationEnabled);
    }
  }
  return source.frames();
}

}  // namespace tendril::canopen::test
