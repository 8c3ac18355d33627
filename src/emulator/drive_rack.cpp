// Drives on one port: passes every frame to the drives, and the time after the frames. Knows nothing of the
// robot behind the motors.
#include "tendril/emulator/drive_rack.h"

#include <bitset>
#include <memory>
#include <stdexcept>
#include <string>

#include "drive.h"

namespace tendril::emulator {
namespace {

/// Frames sent by the drives during a Poll are queued, for two reasons: they go to the port in one call, and
/// the other drives of the rack must receive them, which no port does for its own frames.
class Outbox final : public can::CanPort {
 public:
  explicit Outbox(can::CanPort& port) : port_(port) {}

  void Reserve(std::size_t drives) {
    frames_.resize(64 + 16 * drives);
    senders_.resize(frames_.size());
  }
  /// The sender from now on; -1: none, frames go out directly.
  void SetSender(int drive) noexcept { sender_ = drive; }
  bool half_full() const noexcept { return size_ > frames_.size() / 2; }
  /// Sends everything, then calls `hear(frame, sender)` for each frame; frames sent in response follow.
  template <class Hear>
  void Flush(Hear hear) {
    std::size_t sent = 0, heard = 0;
    while (sent < size_) {
      port_.SendAll(std::span(frames_).subspan(sent, size_ - sent));
      for (sent = size_; heard < sent; ++heard) hear(frames_[heard], senders_[heard]);
    }
    size_ = 0;
  }

  bool Send(const can::CanFrame& frame) noexcept override {
    if (sender_ < 0 || size_ == frames_.size()) return port_.Send(frame);
    frames_[size_] = frame;
    senders_[size_++] = sender_;
    return true;
  }
  int Receive(std::span<can::StampedFrame> frames) noexcept override { return port_.Receive(frames); }
  bool WaitUntil(TimeNs deadline_ns) noexcept override { return port_.WaitUntil(deadline_ns); }
  bool up() const noexcept override { return port_.up(); }
  const can::CanCounters& counters() const noexcept override { return port_.counters(); }

 private:
  can::CanPort& port_;
  int sender_ = -1;
  std::size_t size_ = 0;
  std::vector<can::CanFrame> frames_;
  std::vector<int> senders_;
};

}  // namespace

struct DriveRack::State {
  explicit State(can::CanPort& p) : port(p) {}
  Drive& At(int drive) noexcept { return *drives[static_cast<std::size_t>(drive)]; }
  /// Calls `act` for each drive but `except`, as the sender of the frames that it then sends.
  template <class Act>
  void Each(int except, Act act) {
    for (int i = 0; i < static_cast<int>(drives.size()); ++i) {
      port.SetSender(i);
      if (i != except) act(At(i));
    }
    port.SetSender(-1);
  }
  void Hear(const can::CanFrame& frame, int sender, TimeNs now_ns) {
    const bool sync = canopen::IsSync(frame);
    Each(sender, [&](Drive& drive) { sync ? drive.OnSync(now_ns) : drive.OnFrame(frame, now_ns); });
  }
  void Flush(TimeNs now_ns) {
    port.Flush([&](const can::CanFrame& frame, int sender) { Hear(frame, sender, now_ns); });
  }

  Outbox port;
  std::vector<std::unique_ptr<Drive>> drives;
  std::array<can::StampedFrame, 64> batch{};
};

DriveRack::DriveRack(std::span<const EmulatedDriveParameters> drives, can::CanPort& port)
    : state_(std::make_unique<State>(port)) {
  std::bitset<canopen::kMaxNodeId + 1> taken;
  for (const EmulatedDriveParameters& parameters : drives) {
    const int id = parameters.node_id;
    if (id < canopen::kMinNodeId || id > canopen::kMaxNodeId) {
      throw std::invalid_argument("emulated drive: node id " + std::to_string(id) + " is not in 1..127");
    }
    if (taken.test(static_cast<std::size_t>(id))) {
      throw std::invalid_argument("emulated drive: node id " + std::to_string(id) + " is given twice");
    }
    taken.set(static_cast<std::size_t>(id));
    state_->drives.push_back(std::make_unique<Drive>(parameters, state_->port));
  }
  state_->port.Reserve(drives.size());
}

DriveRack::~DriveRack() = default;

int DriveRack::drives() const noexcept { return static_cast<int>(state_->drives.size()); }

int DriveRack::node_id(int drive) const noexcept { return state_->At(drive).node_id(); }

void DriveRack::SetSensors(int drive, const DriveSensors& sensors) noexcept {
  state_->At(drive).SetSensors(sensors);
}

int DriveRack::Poll(TimeNs now_ns) {
  State& s = *state_;
  int syncs = 0;
  while (true) {
    const int n = s.port.Receive(s.batch);
    for (int i = 0; i < n; ++i) {
      const can::CanFrame& frame = s.batch[static_cast<std::size_t>(i)].frame;
      if (canopen::IsSync(frame)) ++syncs;
      s.Hear(frame, -1, now_ns);
      if (s.port.half_full()) s.Flush(now_ns);
    }
    if (n < static_cast<int>(s.batch.size())) break;
  }
  s.Each(-1, [now_ns](Drive& drive) { drive.OnTime(now_ns); });
  s.Flush(now_ns);
  return syncs;
}

double DriveRack::torque_Nm(int drive) const noexcept { return state_->At(drive).torque_Nm(); }

bool DriveRack::enabled(int drive) const noexcept { return state_->At(drive).powered(); }

void DriveRack::InjectEmcy(int drive, std::uint16_t code) { state_->At(drive).InjectEmcy(code); }

void DriveRack::SetFrozen(int drive, bool frozen) noexcept { state_->At(drive).SetFrozen(frozen); }

void DriveRack::PowerCycle(int drive) noexcept { state_->At(drive).PowerCycle(); }

void DriveRack::SetSupply(int drive, bool on) noexcept { state_->At(drive).SetSupply(on); }

void DriveRack::StickSensor(int drive, DriveSensor sensor, bool stuck) noexcept {
  state_->At(drive).StickSensor(sensor, stuck);
}

void DriveRack::SetSto(int drive, bool active) { state_->At(drive).SetSto(active); }

void DriveRack::StopHeartbeat(int drive) noexcept { state_->At(drive).StopHeartbeat(); }

}  // namespace tendril::emulator
