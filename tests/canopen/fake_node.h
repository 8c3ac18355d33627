// A scripted drive on a memory bus: a dictionary that answers expedited SDO, a CiA 402 state, two TPDOs, and
// knobs to misbehave. Deliberately simpler than the emulator and independent of it.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <set>
#include <vector>

#include "support/test_bus.h"
#include "tendril/can/memory_bus.h"
#include "tendril/canopen/cia402.h"
#include "tendril/canopen/emcy.h"
#include "tendril/canopen/master.h"
#include "tendril/canopen/wire.h"
#include "tendril/core/clock.h"

namespace tendril::canopen::test {

constexpr std::uint32_t Key(std::uint16_t index, std::uint8_t sub) {
  return (static_cast<std::uint32_t>(index) << 8) | sub;
}

struct Write {
  std::uint32_t key;
  std::uint32_t value;  // as it was on the wire
  friend bool operator==(const Write&, const Write&) = default;
};

class FakeNode {
 public:
  FakeNode(can::MemoryBus& bus, int id) : id_(id), port_(bus.AddPort()) {
    const auto n = static_cast<std::uint32_t>(id);
    Set(0x1000, 0, 0x00020192);
    Set(0x1018, 1, 0xFB);
    Set(0x1018, 2, 0x60500000);
    Set(0x1018, 3, 0x01700000);
    Set(0x1018, 4, 4711 + n);
    Set(0x6502, 0, 0x3A5);
    Set(0x6076, 0, 7056);
    Set(0x603F, 0, 0);
    for (std::uint16_t i = 0; i < 4; ++i) {
      Set(static_cast<std::uint16_t>(0x1400 + i), 1, 0x200u + 0x100u * i + n);
      Set(static_cast<std::uint16_t>(0x1800 + i), 1, (i == 0 ? 0x40000180u : 0xC0000180u + 0x100u * i) + n);
    }
  }

  int id() const { return id_; }
  void Set(std::uint16_t index, std::uint8_t sub, std::uint32_t value) { objects[Key(index, sub)] = value; }
  std::uint32_t Get(std::uint16_t index, std::uint8_t sub) { return objects[Key(index, sub)]; }

  std::map<std::uint32_t, std::uint32_t> objects;
  std::vector<Write> writes;
  std::map<std::uint32_t, std::uint32_t> abort_write, abort_read;  // key -> abort code
  std::map<std::uint32_t, std::uint32_t> shows;  // key -> what reading gives, whatever was written
  std::set<std::uint32_t> mute;                  // no answer to these
  bool powered = true;                           // false: hears and says nothing
  bool says_boot_up = true;
  bool sends_feedback = true;
  bool sends_heartbeat = true;
  bool accepts_fault_reset = true;
  bool obeys = true;      // false: its state stays whatever the controlword
  TimeNs inhibit_ns = 0;  // of the statusword's TPDO

  DriveMachine machine = DriveMachine::kSwitchOnDisabled;
  std::uint16_t extra_bits = 0;  // of the statusword
  NmtState nmt = NmtState::kPreOperational;
  std::int32_t position = 0;
  std::int16_t torque = 0, analog = 0;

  // what it received
  std::vector<std::uint16_t> controlwords;  // each new one, when it acted
  std::int16_t target = 0;                  // in force since the last SYNC
  std::int16_t largest_target_while_off = 0;
  int resets = 0, starts = 0, stops = 0, syncs = 0, sdo_requests = 0;

  std::uint16_t Statusword() const { return static_cast<std::uint16_t>(EncodeState(machine) | extra_bits); }
  void SendFrame(const can::CanFrame& frame) { port_.Send(frame); }
  void SayBootUp() {
    nmt = NmtState::kPreOperational;
    port_.Send(HeartbeatFrame(id_, NmtState::kBootUp));
  }
  void SayEmcy(std::uint16_t code, std::uint8_t error_register) {
    port_.Send(EmcyFrame({.node_id = id_, .code = code, .error_register = error_register, .vendor = {}}));
  }

  void Poll(TimeNs now_ns) {
    std::array<can::StampedFrame, 64> frames;
    for (int n = 1; n > 0;) {
      n = port_.Receive(frames);
      for (int i = 0; i < n; ++i) {
        if (powered) Handle(frames[static_cast<std::size_t>(i)].frame);
      }
    }
    if (!powered) return;
    const TimeNs period_ns = static_cast<TimeNs>(objects[Key(0x1017, 0)]) * kNsPerMs;
    if (period_ns > 0 && sends_heartbeat && now_ns >= next_heartbeat_ns_) {
      port_.Send(HeartbeatFrame(id_, nmt));
      next_heartbeat_ns_ = now_ns + period_ns;
    }
    if (nmt == NmtState::kOperational && Statusword() != told_statusword_ && now_ns >= next_status_ns_) {
      next_status_ns_ = now_ns + inhibit_ns;
      told_statusword_ = Statusword();
      can::CanFrame frame;
      frame.id = TpdoCobId(2, id_);
      frame.size = 2;
      PutLe(frame.data, told_statusword_, 2);
      port_.Send(frame);
    }
  }

 private:
  void Handle(const can::CanFrame& frame) {
    if (frame.error) return;
    const auto n = static_cast<std::uint32_t>(id_);
    if (frame.id == 0 && (frame.data[1] == 0 || frame.data[1] == n)) OnNmt(frame.data[0]);
    if (frame.id == 0x600 + n) OnSdo(frame);
    if (nmt != NmtState::kOperational) return;
    if (frame.id == 0x200 + n) rpdo_ = frame;
    if (frame.id == 0x080) OnSync();
  }

  void OnNmt(std::uint8_t command) {
    if (command == 0x82 || command == 0x81) {
      ++resets;
      objects[Key(0x1016, 1)] = objects[Key(0x1017, 0)] = 0;
      nmt = NmtState::kPreOperational;
      rpdo_.size = 0;
      if (says_boot_up) SayBootUp();
    } else if (command == 0x01) {
      ++starts;
      nmt = NmtState::kOperational;
      told_statusword_ = 0xFFFF;
    } else if (command == 0x02) {
      ++stops;
      nmt = NmtState::kStopped;
    }
  }

  void OnSdo(const can::CanFrame& request) {
    ++sdo_requests;
    const std::uint16_t index = static_cast<std::uint16_t>(request.data[1] | (request.data[2] << 8));
    const std::uint32_t key = Key(index, request.data[3]);
    if (mute.count(key)) return;
    can::CanFrame reply;
    reply.id = 0x580 + static_cast<std::uint32_t>(id_);
    reply.size = 8;
    reply.data = {0, request.data[1], request.data[2], request.data[3], 0, 0, 0, 0};
    const bool is_write = (request.data[0] >> 5) == 1;
    const bool is_read = (request.data[0] >> 5) == 2;
    if (!is_write && !is_read) return;
    const auto& aborts = is_write ? abort_write : abort_read;
    if (const auto at = aborts.find(key); at != aborts.end()) {
      reply.data[0] = 0x80;
      PutLe({reply.data.data() + 4, 4}, at->second, 4);
    } else if (is_write) {
      const int bytes = 4 - ((request.data[0] >> 2) & 3);
      const auto value = static_cast<std::uint32_t>(GetLe({request.data.data() + 4, 4}, bytes));
      writes.push_back({key, value});
      objects[key] = value;
      if (key == Key(0x6040, 0)) Command(static_cast<std::uint16_t>(value));
      if (key == Key(0x6060, 0)) objects[Key(0x6061, 0)] = value;
      reply.data[0] = 0x60;
    } else {
      if (key == Key(0x6041, 0)) objects[key] = Statusword();
      const auto shown = shows.find(key);
      reply.data[0] = 0x42;  // expedited, no size named: the client must know the width
      PutLe({reply.data.data() + 4, 4}, shown != shows.end() ? shown->second : objects[key], 4);
    }
    port_.Send(reply);
  }

  void Command(std::uint16_t word) {
    const DriveCommand command = DecodeControlword(word, last_word_);
    if (word != last_word_) controlwords.push_back(word);
    last_word_ = word;
    if (command == DriveCommand::kFaultReset && !accepts_fault_reset) return;
    if (obeys) machine = Apply(machine, command);
  }

  void OnSync() {
    ++syncs;
    if (rpdo_.size == 4) {
      Command(static_cast<std::uint16_t>(rpdo_.data[0] | (rpdo_.data[1] << 8)));
      target = static_cast<std::int16_t>(rpdo_.data[2] | (rpdo_.data[3] << 8));
      if (machine != DriveMachine::kOperationEnabled && target != 0) largest_target_while_off = target;
      rpdo_.size = 0;
    }
    if (!sends_feedback) return;
    can::CanFrame frame;
    frame.id = TpdoCobId(1, id_);
    frame.size = 8;
    PutLe({frame.data.data(), 4}, static_cast<std::uint32_t>(position), 4);
    PutLe({frame.data.data() + 4, 2}, static_cast<std::uint16_t>(torque), 2);
    PutLe({frame.data.data() + 6, 2}, static_cast<std::uint16_t>(analog), 2);
    port_.Send(frame);
  }

  int id_;
  can::CanPort& port_;
  can::CanFrame rpdo_;
  std::uint16_t last_word_ = 0;
  std::uint16_t told_statusword_ = 0xFFFF;
  TimeNs next_heartbeat_ns_ = 0, next_status_ns_ = 0;
};

/// Master and fake nodes on one bus in simulated time.
struct Rig {
  explicit Rig(int drives, const BusParameters& parameters)
      : bus(clock),
        port(bus.AddPort()),
        master(parameters, TestDrives(drives), port),
        cycle_ns(parameters.cycle_ns) {
    for (int i = 1; i <= drives; ++i) nodes.push_back(std::make_unique<FakeNode>(bus, i));
    torques.assign(static_cast<std::size_t>(drives), 0);
  }
  explicit Rig(int drives) : Rig(drives, TestBus(drives)) {}

  void PollNodes() {
    for (auto& node : nodes) node->Poll(clock.Now());
  }
  /// One cycle; true when every TPDO came.
  bool Step() {
    clock.Advance(cycle_ns);
    master.BeginCycle(clock.Now());
    PollNodes();
    const bool complete = master.Poll(clock.Now());
    master.EndCycle(clock.Now(), request, torques);
    BusEvent event;
    while (master.PopEvent(&event)) events.push_back(event);
    return complete;
  }
  void Steps(int n) {
    for (int i = 0; i < n; ++i) Step();
  }
  bool StepUntil(DriveState state, int limit = 4000) {
    for (int i = 0; i < limit; ++i) {
      Step();
      bool all = true;
      for (int k = 0; k < master.drives(); ++k) all &= master.feedback(k).state == state;
      if (all) return true;
    }
    return false;
  }
  /// Boots; then requests as given.
  bool Ready() {
    master.Start(clock.Now());
    return StepUntil(DriveState::kReady);
  }
  bool Enabled() {
    if (!Ready()) return false;
    request = DriveRequest::kEnable;
    return StepUntil(DriveState::kEnabled, 200);
  }
  std::vector<std::string> Texts(Status status) const {
    std::vector<std::string> texts;
    for (const BusEvent& event : events) {
      if (event.status == status) texts.emplace_back(event.text.data());
    }
    return texts;
  }

  SimulatedClock clock{kNsPerS};
  can::MemoryBus bus;
  can::CanPort& port;
  Master master;
  TimeNs cycle_ns;
  std::vector<std::unique_ptr<FakeNode>> nodes;
  DriveRequest request = DriveRequest::kDisable;
  std::vector<std::int16_t> torques;
  std::vector<BusEvent> events;
};

}  // namespace tendril::canopen::test
