// A master made of bare frames, written from the standards and not from the code under test, so that a
// mistake shared by our master and our emulator shows up. Knows the memory bus and the rack.
#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "tendril/can/memory_bus.h"
#include "tendril/emulator/drive_rack.h"

namespace tendril::emulator {

using Bytes = std::vector<std::uint8_t>;

inline std::uint64_t Number(const Bytes& bytes) {
  std::uint64_t v = 0;
  for (std::size_t i = 0; i < bytes.size(); ++i) v |= static_cast<std::uint64_t>(bytes[i]) << (8 * i);
  return v;
}

inline Bytes Little(std::uint64_t value, int bytes) {
  Bytes b;
  for (int i = 0; i < bytes; ++i) b.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
  return b;
}

/// Value or abort code of a transfer.
struct SdoResult {
  Bytes data;
  std::uint32_t abort = 0;
  std::uint64_t number() const { return Number(data); }
  std::string text() const { return {data.begin(), data.end()}; }
};

class RawMaster {
 public:
  explicit RawMaster(std::vector<EmulatedDriveParameters> drives = {Drive(1)})
      : bus_(clock_), port_(bus_.AddPort()), rack_(drives, bus_.AddPort()) {}

  static EmulatedDriveParameters Drive(int node) {
    EmulatedDriveParameters p;
    p.node_id = node;
    p.serial = 0x1234u + static_cast<std::uint32_t>(node);
    p.nominal_current_mA = 360;
    p.torque_constant_uNmpA = 19600;
    return p;
  }

  DriveRack& rack() { return rack_; }
  can::CanPort& port() { return port_; }
  can::MemoryBus& bus() { return bus_; }
  TimeNs now() const { return clock_.Now(); }

  void Send(std::uint32_t id, const Bytes& data, bool remote = false) {
    can::CanFrame f;
    f.id = id;
    f.remote = remote;
    f.size = static_cast<std::uint8_t>(data.size());
    std::copy(data.begin(), data.end(), f.data.begin());
    port_.Send(f);
  }

  /// Lets the rack work and returns what it sent since the last call.
  std::vector<can::CanFrame> Poll() {
    rack_.Poll(clock_.Now());
    std::vector<can::StampedFrame> got(512);
    got.resize(static_cast<std::size_t>(port_.Receive(got)));
    std::vector<can::CanFrame> frames;
    for (const auto& g : got) frames.push_back(g.frame);
    return frames;
  }

  /// Advances time in steps of 1 ms and returns everything that was sent.
  std::vector<can::CanFrame> Run(int ms) {
    std::vector<can::CanFrame> all;
    for (int i = 0; i < ms; ++i) {
      clock_.Advance(kNsPerMs);
      for (const auto& f : Poll()) all.push_back(f);
    }
    return all;
  }

  /// The contents of the frames with one identifier.
  static std::vector<Bytes> Of(std::uint32_t id, const std::vector<can::CanFrame>& frames) {
    std::vector<Bytes> out;
    for (const auto& f : frames) {
      if (f.id == id) out.emplace_back(f.data.begin(), f.data.begin() + f.size);
    }
    return out;
  }

  /// One SDO request and its answer; empty when the node does not answer.
  std::optional<Bytes> Exchange(const Bytes& request, int node = 1) {
    Send(0x600u + static_cast<std::uint32_t>(node), request);
    const auto answers = Of(0x580u + static_cast<std::uint32_t>(node), Poll());
    if (answers.empty()) return std::nullopt;
    EXPECT_EQ(answers.size(), 1u);
    EXPECT_EQ(answers.back().size(), 8u);
    return answers.back();
  }

  SdoResult Read(std::uint16_t index, std::uint8_t sub, int node = 1) {
    const auto first = Exchange({0x40, Low(index), High(index), sub, 0, 0, 0, 0}, node);
    if (!first) return {.data = {}, .abort = 0xDEAD};
    const Bytes& a = *first;
    if (a[0] == 0x80) return {.data = {}, .abort = AbortOf(a)};
    EXPECT_EQ(a[1] | a[2] << 8, index);
    EXPECT_EQ(a[3], sub);
    if (a[0] & 0x02) {  // expedited
      EXPECT_EQ(a[0] & 0xF1, 0x41);
      const int n = 4 - ((a[0] >> 2) & 3);
      return {.data = Bytes(a.begin() + 4, a.begin() + 4 + n), .abort = 0};
    }
    EXPECT_EQ(a[0], 0x41) << "segmented upload must name its size";
    const std::uint64_t size = Number(Bytes(a.begin() + 4, a.end()));
    SdoResult result;
    for (int segment = 0; segment < 100; ++segment) {
      const auto toggle = static_cast<std::uint8_t>(segment % 2 ? 0x10 : 0x00);
      const auto answer = Exchange({static_cast<std::uint8_t>(0x60 | toggle), 0, 0, 0, 0, 0, 0, 0}, node);
      if (!answer) return {.data = {}, .abort = 0xDEAD};
      const Bytes& s = *answer;
      if (s[0] == 0x80) return {.data = {}, .abort = AbortOf(s)};
      EXPECT_EQ(s[0] & 0xF0, toggle);
      const int n = 7 - ((s[0] >> 1) & 7);
      result.data.insert(result.data.end(), s.begin() + 1, s.begin() + 1 + n);
      if (s[0] & 0x01) break;
    }
    EXPECT_EQ(result.data.size(), size);
    return result;
  }

  /// Expedited write of up to four bytes; 0 or the abort code.
  std::uint32_t Write(std::uint16_t index, std::uint8_t sub, std::uint64_t value, int bytes, int node = 1) {
    Bytes request{static_cast<std::uint8_t>(0x23 | (4 - bytes) << 2), Low(index), High(index), sub};
    for (std::uint8_t b : Little(value, 4)) request.push_back(b);
    for (int i = bytes; i < 4; ++i) request[static_cast<std::size_t>(4 + i)] = 0;
    const auto answer = Exchange(request, node);
    if (!answer) return 0xDEAD;
    if ((*answer)[0] == 0x80) return AbortOf(*answer);
    EXPECT_EQ((*answer)[0], 0x60);
    return 0;
  }

  /// Segmented write, whatever the length.
  std::uint32_t WriteSegmented(std::uint16_t index, std::uint8_t sub, const Bytes& data, int node = 1) {
    Bytes start{0x21, Low(index), High(index), sub};
    for (std::uint8_t b : Little(data.size(), 4)) start.push_back(b);
    auto answer = Exchange(start, node);
    if (!answer) return 0xDEAD;
    if ((*answer)[0] == 0x80) return AbortOf(*answer);
    EXPECT_EQ((*answer)[0], 0x60);
    bool toggle = false;
    for (std::size_t at = 0; at < data.size();) {
      const std::size_t n = std::min<std::size_t>(7, data.size() - at);
      const bool last = at + n == data.size();
      Bytes segment(8, 0);
      segment[0] = static_cast<std::uint8_t>((toggle ? 0x10 : 0) | (7 - n) << 1 | (last ? 1 : 0));
      std::copy_n(data.begin() + static_cast<std::ptrdiff_t>(at), n, segment.begin() + 1);
      answer = Exchange(segment, node);
      if (!answer) return 0xDEAD;
      if ((*answer)[0] == 0x80) return AbortOf(*answer);
      EXPECT_EQ((*answer)[0], toggle ? 0x30 : 0x20);
      toggle = !toggle;
      at += n;
    }
    return 0;
  }

  void Nmt(std::uint8_t command, int node = 1) { Send(0x000, {command, static_cast<std::uint8_t>(node)}); }
  void Sync() { Send(0x080, {}); }

  /// RPDO1: controlword and torque, as remapped by MapTorque.
  void Command(std::uint16_t controlword, std::int16_t torque_permille, int node = 1) {
    Bytes b = Little(controlword, 2);
    for (std::uint8_t x : Little(static_cast<std::uint16_t>(torque_permille), 2)) b.push_back(x);
    Send(0x200u + static_cast<std::uint32_t>(node), b);
  }

  /// The remapping in the order that the drive demands: torque in RPDO1 and feedback in TPDO1, both at SYNC.
  void MapTorque(int node = 1) {
    const auto n = static_cast<std::uint32_t>(node);
    Remap(0x1400, 0x1600, 0x200u + n, 1, {0x60400010, 0x60710010}, node);
    Remap(0x1800, 0x1A00, 0x40000180u + n, 1, {0x60640020, 0x60770010, 0x31600110}, node);
    EXPECT_EQ(Write(0x6060, 0, 10, 1, node), 0u);
    EXPECT_EQ(Read(0x6061, 0, node).number(), 10u);
  }

  void Remap(std::uint16_t communication, std::uint16_t mapping, std::uint32_t cob, std::uint8_t type,
             const std::vector<std::uint32_t>& entries, int node = 1) {
    EXPECT_EQ(Write(communication, 1, cob | 0x80000000u, 4, node), 0u);
    EXPECT_EQ(Write(communication, 2, type, 1, node), 0u);
    EXPECT_EQ(Write(mapping, 0, 0, 1, node), 0u);
    for (std::size_t i = 0; i < entries.size(); ++i) {
      EXPECT_EQ(Write(mapping, static_cast<std::uint8_t>(i + 1), entries[i], 4, node), 0u);
    }
    EXPECT_EQ(Write(mapping, 0, entries.size(), 1, node), 0u);
    EXPECT_EQ(Write(communication, 1, cob, 4, node), 0u);
  }

  std::uint16_t Statusword(int node = 1) {
    return static_cast<std::uint16_t>(Read(0x6041, 0, node).number());
  }
  std::uint16_t State(int node = 1) { return Statusword(node) & 0x6F; }

  /// Boot-up, mapping, operational, enabled by SDO.
  void Enable(int node = 1) {
    Poll();
    MapTorque(node);
    Nmt(0x01, node);
    for (std::uint16_t controlword : {0x06, 0x07, 0x0F})
      EXPECT_EQ(Write(0x6040, 0, controlword, 2, node), 0u);
    EXPECT_EQ(State(node), 0x27);
  }

 private:
  static std::uint8_t Low(std::uint16_t v) { return static_cast<std::uint8_t>(v); }
  static std::uint8_t High(std::uint16_t v) { return static_cast<std::uint8_t>(v >> 8); }
  static std::uint32_t AbortOf(const Bytes& b) {
    return static_cast<std::uint32_t>(Number(Bytes(b.begin() + 4, b.end())));
  }

  SimulatedClock clock_{1'000'000};
  can::MemoryBus bus_;
  can::CanPort& port_;
  DriveRack rack_;
};

}  // namespace tendril::emulator
