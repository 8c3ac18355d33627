// The fuzz targets; see the header.
#include "targets.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <optional>
#include <vector>

#include "canopen/fake_node.h"
#include "emulator/sdo_server.h"
#include "tendril/canopen/emcy.h"
#include "tendril/canopen/epos4.h"
#include "tendril/canopen/pdo.h"
#include "tendril/canopen/sdo.h"
#include "tendril/canopen/wire.h"
#include "tendril/emulator/drive_rack.h"

namespace tendril::fuzz {
namespace {

using canopen::ObjectAddress;
using canopen::SdoKind;
using canopen::SdoMessage;

void Require(bool holds, const char* what) {
  if (holds) return;
  std::fprintf(stderr, "does not hold: %s\n", what);
  std::abort();
}

/// Bytes handed out one by one; zeros after the end.
class Source {
 public:
  explicit Source(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}
  int frames() const { return frames_; }
  bool empty() const { return at_ >= bytes_.size(); }
  std::uint8_t Byte() { return empty() ? std::uint8_t{0} : bytes_[at_++]; }
  /// Mostly as long as `usual`, else of any length or a remote frame.
  can::CanFrame Frame(std::uint32_t id, int usual = 8) {
    ++frames_;
    can::CanFrame frame;
    frame.id = id;
    const std::uint8_t head = Byte();
    frame.size = static_cast<std::uint8_t>(head < 0xE0 ? usual : head % 9);
    frame.remote = head == 0xFF;
    for (int i = 0; i < frame.size; ++i) frame.data[static_cast<std::size_t>(i)] = Byte();
    return frame;
  }

 private:
  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = 0;
  int frames_ = 0;
};

bool Same(const can::CanFrame& a, const can::CanFrame& b) {
  return a.id == b.id && a.size == b.size && a.remote == b.remote &&
         std::equal(a.data.begin(), a.data.begin() + a.size, b.data.begin());
}

// ---- SDO ----------------------------------------------------------------------------------------

/// What decodes, encodes to a frame of the same meaning.
void CheckSdoCodec(const can::CanFrame& frame, bool request) {
  const SdoMessage message = request ? canopen::DecodeSdoRequest(frame) : canopen::DecodeSdoResponse(frame);
  if (message.kind == SdoKind::kUnknown) return;
  Require(frame.size == 8 && !frame.remote, "SDO frames have 8 bytes");
  const bool initiates =
      message.kind == SdoKind::kInitiateDownload || message.kind == SdoKind::kInitiateUpload;
  Require(message.size <= 7 || initiates, "a segment has at most 7 bytes");
  const can::CanFrame encoded =
      request ? canopen::EncodeSdoRequest(5, message) : canopen::EncodeSdoResponse(5, message);
  const SdoMessage again = request ? canopen::DecodeSdoRequest(encoded) : canopen::DecodeSdoResponse(encoded);
  Require(again.kind == message.kind, "the kind survives");
  if (message.kind == SdoKind::kDownloadSegment || message.kind == SdoKind::kUploadSegment) {
    Require(again.toggle == message.toggle, "the toggle bit survives");
  } else {
    Require(again.address == message.address, "the address survives");
  }
}

int RunSdoClient(std::span<const std::uint8_t> bytes) {
  Source source(bytes);
  canopen::SdoClient client(5);
  using State = canopen::SdoClient::State;
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
      Require(client.pending()->id == 0x605 && client.pending()->size == 8, "requests are SDO frames");
      client.FrameSent(now_ns);
    }
    can::CanFrame reply = source.Frame(0x585);
    // Half of the replies answer the right object, or none would get far.
    if (choice & 16) {
      reply.data[1] = static_cast<std::uint8_t>(client.address().index);
      reply.data[2] = static_cast<std::uint8_t>(client.address().index >> 8);
      reply.data[3] = client.address().sub;
    }
    CheckSdoCodec(reply, false);
    client.OnFrame(reply);
    now_ns += choice & 32 ? kNsPerMs / 4 : 0;
    client.Poll(now_ns);
    Require(client.data().size() <= canopen::SdoClient::kCapacity, "values stay within the buffer");
    Require(client.state() != State::kIdle, "a transfer ends for a reason");
    Require(
        client.state() == State::kAborted || client.state() == State::kTimedOut || client.abort_code() == 0,
        "an abort code only with an abort");
  }
  return source.frames();
}

/// A few values of every kind of length; notes what was asked of it.
class Shelf final : public emulator::SdoObjects {
 public:
  static constexpr std::array<std::size_t, 8> kSizes = {1, 2, 4, 5, 7, 14, 100, 256};

  std::uint32_t Read(ObjectAddress address, std::span<std::uint8_t> to, std::size_t* size) override {
    if (address.index != 0x2000) return canopen::sdo_abort::kNoObject;
    if (address.sub >= kSizes.size()) return canopen::sdo_abort::kNoSubIndex;
    *size = kSizes[address.sub];
    Require(to.size() >= *size, "the buffer holds every value");
    for (std::size_t i = 0; i < *size; ++i) to[i] = static_cast<std::uint8_t>(i);
    return 0;
  }
  std::uint32_t Write(ObjectAddress address, std::span<const std::uint8_t> from, bool) override {
    Require(from.size() <= 256, "no more bytes than the buffer has");
    for (const std::uint8_t byte : from) sum_ += byte;  // every byte can be read
    if (address.index != 0x2000) return canopen::sdo_abort::kNoObject;
    return address.sub < kSizes.size() ? 0 : canopen::sdo_abort::kNoSubIndex;
  }

 private:
  std::uint64_t sum_ = 0;
};

int RunSdoServer(std::span<const std::uint8_t> bytes) {
  Source source(bytes);
  Shelf shelf;
  emulator::SdoServer server(5, shelf);
  while (!source.empty()) {
    const std::uint8_t choice = source.Byte();
    can::CanFrame request = source.Frame(0x605);
    if (choice & 1) {
      request.data[1] = 0x00;
      request.data[2] = 0x20;
      request.data[3] = (choice >> 1) & 7;
    }
    CheckSdoCodec(request, true);
    const SdoKind asked = canopen::DecodeSdoRequest(request).kind;
    can::CanFrame response;
    const bool answered = server.Answer(request, &response);
    Require(answered == (asked != SdoKind::kAbort), "one answer to each request, none to an abort");
    if (!answered) continue;
    const SdoMessage reply = canopen::DecodeSdoResponse(response);
    Require(response.id == 0x585 && response.size == 8, "answers are SDO frames");
    Require(reply.kind == asked || reply.kind == SdoKind::kAbort, "an answer is of the request's kind");
    Require(reply.kind != SdoKind::kAbort ||
                std::string_view(canopen::AbortText(reply.abort_code)) != "unknown abort code",
            "abort codes are CiA 301's");
  }
  return source.frames();
}

// ---- small decoders -----------------------------------------------------------------------------

int RunPdo(std::span<const std::uint8_t> bytes) {
  Source source(bytes);
  while (!source.empty()) {
    std::array<canopen::MappingEntry, 8> entries{};
    std::size_t count = 0;
    int mapped_bytes = 0;
    const std::uint8_t wanted = source.Byte();
    for (; count < 1u + wanted % entries.size(); ++count) {
      const std::uint8_t shape = source.Byte();
      const int width = 1 + shape % 8;
      if (mapped_bytes + width > 8) break;
      mapped_bytes += width;
      entries[count].bits = static_cast<std::uint8_t>(8 * width);
      entries[count].is_signed = (shape & 0x80) != 0;
    }
    const std::span used(entries.data(), count);
    const can::CanFrame frame = source.Frame(0x181);
    std::array<std::int64_t, 8> values{};
    const bool decoded = canopen::DecodePdo(used, {frame.data.data(), frame.size}, values);
    Require(decoded == (frame.size >= mapped_bytes), "decodes when all mapped bytes came, and only then");
    if (!decoded) continue;
    for (std::size_t i = 0; i < count; ++i) {
      if (entries[i].bits == 64) continue;
      const std::int64_t range = std::int64_t{1} << entries[i].bits;
      Require(entries[i].is_signed ? values[i] >= -range / 2 && values[i] < range / 2
                                   : values[i] >= 0 && values[i] < range,
              "a value is in its type's range");
    }
    std::array<std::uint8_t, 8> data{};
    Require(canopen::EncodePdo(used, values, data) == mapped_bytes, "as many bytes as mapped");
    Require(std::equal(data.begin(), data.begin() + mapped_bytes, frame.data.begin()), "the same bytes");
  }
  return source.frames();
}

int RunEmcy(std::span<const std::uint8_t> bytes) {
  Source source(bytes);
  while (!source.empty()) {
    const std::uint8_t low = source.Byte();
    const can::CanFrame frame = source.Frame(low < 0xF8 ? 0x080u + low % 128 : 0x100u * (low & 7));
    const auto emcy = canopen::ParseEmcy(frame);
    Require(emcy.has_value() == (frame.id > 0x080 && frame.id < 0x100 && frame.size == 8 && !frame.remote),
            "an EMCY is a data frame of 8 bytes on 0x081..0x0FF");
    if (!emcy) continue;
    Require(Same(canopen::EmcyFrame(*emcy), frame), "it encodes to the same frame");
    const canopen::EmcyInfo& info = canopen::FindEmcy(canopen::Epos4Profile()->emcy, emcy->code);
    Require(info.text[0] != '\0' && info.cause[0] != '\0', "every code has a text");
  }
  return source.frames();
}

int RunNmt(std::span<const std::uint8_t> bytes) {
  constexpr std::array<int, 5> kCommands = {0x01, 0x02, 0x80, 0x81, 0x82};
  Source source(bytes);
  while (!source.empty()) {
    const std::uint8_t low = source.Byte();
    const can::CanFrame frame = source.Frame(low < 0xC0 ? 0 : low & 0x3Fu, 2);
    const auto nmt = canopen::ParseNmt(frame);
    const bool known = std::find(kCommands.begin(), kCommands.end(), frame.data[0]) != kCommands.end();
    Require(nmt.has_value() ==
                (frame.id == 0 && frame.size == 2 && !frame.remote && known && frame.data[1] <= 127),
            "an NMT message is one of five commands to nodes 0..127");
    if (nmt)
      Require(Same(canopen::NmtFrame(nmt->command, nmt->node_id), frame), "it encodes to the same frame");
  }
  return source.frames();
}

int RunHeartbeat(std::span<const std::uint8_t> bytes) {
  constexpr std::array<int, 4> kStates = {0x00, 0x04, 0x05, 0x7F};
  Source source(bytes);
  while (!source.empty()) {
    const std::uint8_t low = source.Byte();
    const can::CanFrame frame = source.Frame(0x680u + low, 1);
    const auto heartbeat = canopen::ParseHeartbeat(frame);
    const bool known = std::find(kStates.begin(), kStates.end(), frame.data[0]) != kStates.end();
    Require(heartbeat.has_value() ==
                (frame.id > 0x700 && frame.id < 0x780 && frame.size == 1 && !frame.remote && known),
            "a heartbeat is one of four states on 0x701..0x77F");
    if (heartbeat) {
      Require(Same(canopen::HeartbeatFrame(heartbeat->node_id, heartbeat->state), frame),
              "it encodes to the same frame");
      Require(canopen::NmtStateText(heartbeat->state)[0] != '\0', "every state has a text");
    }
  }
  return source.frames();
}

// ---- master -------------------------------------------------------------------------------------

/// One master a process: each input boots it afresh, which is a property of its own.
class Storm {
 public:
  Storm() : rig_(kDrives), stranger_(rig_.bus.AddPort()) {
    rig_.torques = {100, -100, 32767};
    rig_.bus.SetFilter([this](const can::CanFrame& frame) {
      CheckRpdo(frame);
      return true;
    });
  }

  int Run(std::span<const std::uint8_t> bytes) {
    Source source(bytes);
    BootAfresh();
    while (!source.empty()) {
      const std::uint8_t choice = source.Byte();
      asked_ = (choice & 3) != 0;
      rig_.request = asked_ ? DriveRequest::kEnable : DriveRequest::kDisable;
      if (choice == 0xF0) rig_.master.ClearFaults(rig_.clock.Now());
      if (choice == 0xF1) rig_.bus.SetBusOff(source.Byte() & 1);
      if (choice == 0xF2) rig_.nodes[source.Byte() % kDrives]->powered = (source.Byte() & 1) != 0;
      constexpr std::array<std::uint32_t, 8> kBases = {0x080, 0x180, 0x280, 0x580,
                                                       0x700, 0x700, 0x280, 0x000};
      for (int i = 0; i < (choice >> 2) % 16; ++i) {
        const std::uint8_t which = source.Byte();
        const std::uint32_t id = kBases[which & 7] + (which >> 3) % 5;
        // Not as the master itself, whose frames no other node sends.
        if (id != 0x000) stranger_.Send(source.Frame(id));
      }
      Step();
    }
    return source.frames();
  }

 private:
  static constexpr int kDrives = 3;

  void CheckRpdo(const can::CanFrame& frame) {
    const int node = canopen::CobNode(frame.id);
    if (canopen::CobFunction(frame.id) != 0x200 || node < 1 || node > kDrives || frame.remote) return;
    const auto torque = static_cast<std::int16_t>(frame.data[2] | (frame.data[3] << 8));
    const int command = frame.data[0] | (frame.data[1] << 8);
    Require(torque == 0 || (asked_ && rig_.master.feedback(node - 1).state == DriveState::kEnabled),
            "torque only on request and to a drive in operation enabled");
    Require(command == 0x00 || command == 0x06 || command == 0x07 || command == 0x0F || command == 0x80,
            "controlwords are the known ones");
  }

  void Step() {
    rig_.Step();
    rig_.events.clear();
    for (int i = 0; i < kDrives; ++i) {
      const DriveFeedback& feedback = rig_.master.feedback(i);
      Require(feedback.state != DriveState::kEnabled ||
                  canopen::DecodeStatusword(feedback.statusword) == canopen::DriveMachine::kOperationEnabled,
              "enabled is what the statusword says");
    }
  }

  void BootAfresh() {
    asked_ = false;
    rig_.request = DriveRequest::kDisable;
    rig_.bus.SetBusOff(false);
    for (auto& node : rig_.nodes) {
      node->powered = true;
      node->machine = canopen::DriveMachine::kSwitchOnDisabled;
    }
    rig_.Step();  // what still waits of the storm is heard before the reset, not during the boot
    rig_.master.Start(rig_.clock.Now());
    Require(rig_.StepUntil(DriveState::kReady, 3000), "after a storm the drives can be booted");
    rig_.events.clear();
  }

  canopen::test::Rig rig_;
  can::CanPort& stranger_;
  bool asked_ = false;
};

int RunMaster(std::span<const std::uint8_t> bytes) {
  static Storm storm;
  return storm.Run(bytes);
}

// ---- drive --------------------------------------------------------------------------------------

class Rack {
 public:
  Rack() : drives_port_(bus_.AddPort()), port_(bus_.AddPort()) { rack_.emplace(Parameters(), drives_port_); }

  int Run(std::span<const std::uint8_t> bytes) {
    Source source(bytes);
    Reset();
    while (!source.empty()) {
      const std::uint8_t choice = source.Byte();
      if (choice == 0x1F) {
        const std::uint8_t which = source.Byte();
        rack_->SetSto(which / 2 % rack_->drives(), which & 1);
      } else if (choice < 0x20) {
        clock_.Advance((1 + choice % 4) * kNsPerMs);
      } else {
        SendSomething(source, choice);
        if (choice & 1) continue;  // several frames at a time
      }
      Poll();
    }
    return source.frames();
  }

 private:
  static constexpr std::array<int, 3> kNodes = {1, 5, 127};

  static std::vector<emulator::EmulatedDriveParameters> Parameters() {
    std::vector<emulator::EmulatedDriveParameters> drives;
    for (const int node : kNodes) {
      drives.push_back({.node_id = node, .nominal_current_mA = 360, .torque_constant_uNmpA = 19600});
    }
    return drives;
  }

  void SendSomething(Source& source, std::uint8_t choice) {
    constexpr std::array<std::uint32_t, 8> kBases = {0x000, 0x080, 0x200, 0x300, 0x600, 0x600, 0x180, 0x700};
    constexpr std::array<int, 8> kUsual = {2, 0, 4, 8, 8, 8, 8, 1};
    const std::size_t what = (choice >> 1) & 7;
    const int node = kNodes[(choice >> 4) % kNodes.size()];
    if (kBases[what] != 0x600) {
      const bool to_all = kBases[what] < 0x100 || (choice & 0x80);
      can::CanFrame frame = source.Frame(
          kBases[what] + static_cast<std::uint32_t>(to_all && what != 7 ? 0 : node), kUsual[what]);
      if (what == 0 && frame.size == 2) {  // commands and nodes that are there
        constexpr std::array<std::uint8_t, 8> kCommands = {0x01, 0x02, 0x80, 0x81, 0x82, 0x01, 0x01, 0x80};
        frame.data[0] = kCommands[frame.data[0] & 7];
        if (frame.data[1] & 1) frame.data[1] = static_cast<std::uint8_t>(node);
      }
      port_.Send(frame);
      return;
    }
    const bool aimed = what == 4;
    const auto table = canopen::Epos4Profile()->objects.entries();
    const std::size_t entry = aimed ? (source.Byte() | source.Byte() << 8) % table.size() : 0;
    can::CanFrame frame = source.Frame(0x600 + static_cast<std::uint32_t>(node));
    if (aimed) {  // an object that is there, in expedited form of the right length or as it came
      frame.data[1] = static_cast<std::uint8_t>(table[entry].index);
      frame.data[2] = static_cast<std::uint8_t>(table[entry].index >> 8);
      frame.data[3] = table[entry].sub;
      const int width = canopen::TypeBytes(table[entry].type);
      if (choice & 0x40 && width > 0) frame.data[0] = static_cast<std::uint8_t>(0x23 | (4 - width) << 2);
    }
    if (!frame.remote && canopen::DecodeSdoRequest(frame).kind != SdoKind::kAbort) ++requests_[node];
    port_.Send(frame);
  }

  void Poll() {
    // The sensors show something, and the motor turns as it likes.
    emulator::DriveSensors sensors;
    sensors.position_counts = static_cast<std::int32_t>(clock_.Now() / 1000);
    sensors.velocity_rpm = static_cast<std::int32_t>(clock_.Now() / kNsPerMs % 200) - 100;
    sensors.actual_torque_Nm = 0.01;
    for (int i = 0; i < rack_->drives(); ++i) rack_->SetSensors(i, sensors);
    rack_->Poll(clock_.Now());
    for (int i = 0; i < rack_->drives(); ++i) {
      const double torque_Nm = rack_->torque_Nm(i);
      Require(std::isfinite(torque_Nm), "torque is a number");
      Require(torque_Nm == 0 || rack_->enabled(i), "no torque without power");
    }
    Listen();
  }

  void Listen() {
    std::array<can::StampedFrame, 64> frames;
    for (int n = 1; n > 0;) {
      n = port_.Receive(frames);
      for (int i = 0; i < n; ++i) Check(frames[static_cast<std::size_t>(i)].frame);
    }
  }

  void Check(const can::CanFrame& frame) {
    Require(frame.size <= 8 && !frame.remote && !frame.error, "drives send data frames");
    const int node = canopen::CobNode(frame.id);
    switch (canopen::CobFunction(frame.id)) {
      case 0x580: {
        const SdoMessage reply = canopen::DecodeSdoResponse(frame);
        Require(reply.kind != SdoKind::kUnknown, "SDO answers can be read");
        Require(reply.kind != SdoKind::kAbort ||
                    std::string_view(canopen::AbortText(reply.abort_code)) != "unknown abort code",
                "abort codes are CiA 301's");
        Require(--requests_[node] >= 0 || Renumbered(), "no answer without a request");
        last_reply_[node] = reply;
        return;
      }
      case 0x700:
        Require(canopen::ParseHeartbeat(frame).has_value(), "heartbeats can be read");
        return;
      case 0x000:
      case 0x600:
        Require(false, "drives are no masters");
        return;
      default:
        return;
    }
  }

  /// A drive took another node id, perhaps one that is taken.
  bool Renumbered() const {
    for (int i = 0; i < rack_->drives(); ++i) {
      if (rack_->node_id(i) != kNodes[static_cast<std::size_t>(i)]) return true;
    }
    return false;
  }

  /// As after power on, stored values included; each drive must then answer. Those with another node id are
  /// exchanged for new ones.
  void Reset() {
    for (int i = 0; i < rack_->drives(); ++i) {
      rack_->SetSto(i, false);
      rack_->PowerCycle(i);
    }
    if (Renumbered()) rack_.emplace(Parameters(), drives_port_);
    clock_.Advance(kNsPerMs);
    Poll();
    port_.Send(canopen::NmtFrame(canopen::NmtCommand::kResetNode, 0));
    Poll();
    Poll();
    requests_.clear();
    for (const int node : kNodes) {
      Ask(node, {0x1011, 1}, canopen::kSignatureLoad);
      Require(last_reply_[node].kind == SdoKind::kInitiateDownload, "defaults can be restored after a reset");
    }
    port_.Send(canopen::NmtFrame(canopen::NmtCommand::kResetNode, 0));
    Poll();
    Poll();
    for (const int node : kNodes) {
      Ask(node, {0x1000, 0}, std::nullopt);
      Require(last_reply_[node].kind == SdoKind::kInitiateUpload &&
                  canopen::GetLe(last_reply_[node].data, 4) == 0x00020192,
              "after a reset a drive answers as a new one");
    }
  }

  void Ask(int node, ObjectAddress address, std::optional<std::uint32_t> value) {
    SdoMessage message;
    message.kind = value ? SdoKind::kInitiateDownload : SdoKind::kInitiateUpload;
    message.address = address;
    if (value) {
      message.expedited = message.size_indicated = true;
      message.size = 4;
      canopen::PutLe(message.data, *value, 4);
    }
    ++requests_[node];
    last_reply_[node] = {};
    port_.Send(canopen::EncodeSdoRequest(node, message));
    Poll();
  }

  SimulatedClock clock_{kNsPerS};
  can::MemoryBus bus_{clock_};
  can::CanPort& drives_port_;
  can::CanPort& port_;
  std::optional<emulator::DriveRack> rack_;
  std::map<int, int> requests_;  // by node: not answered yet
  std::map<int, SdoMessage> last_reply_;
};

int RunDrive(std::span<const std::uint8_t> bytes) {
  static Rack rack;
  return rack.Run(bytes);
}

constexpr std::array<Target, 8> kTargets = {{{"SdoClient", RunSdoClient},
                                             {"SdoServer", RunSdoServer},
                                             {"Pdo", RunPdo},
                                             {"Emcy", RunEmcy},
                                             {"Nmt", RunNmt},
                                             {"Heartbeat", RunHeartbeat},
                                             {"Master", RunMaster},
                                             {"Drive", RunDrive}}};

}  // namespace

std::span<const Target> Targets() { return kTargets; }

const Target* FindTarget(std::string_view name) {
  for (const Target& target : kTargets) {
    if (target.name == name) return &target;
  }
  return nullptr;
}

}  // namespace tendril::fuzz
