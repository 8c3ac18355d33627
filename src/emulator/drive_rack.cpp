// Drives on one port: hands every frame to the drives and the time after the frames.
// Knows nothing of the robot behind the motors.
#include "tendril/emulator/drive_rack.h"

#include <bitset>
#include <memory>
#include <stdexcept>
#include <string>

#include "drive.h"

namespace tendril::emulator {
namespace {

/// What the drives send during a Poll goes to the port at once at its end: many frames, one system call.
class Outbox final : public can::CanPort {
 public:
  explicit Outbox(can::CanPort& port) : port_(port) {}

  void Open() noexcept { open_ = true; }
  void Close() noexcept {
    Flush();
    open_ = false;
  }

  bool Send(const can::CanFrame& frame) noexcept override {
    if (!open_) return port_.Send(frame);
    if (size_ == frames_.size()) Flush();
    frames_[size_++] = frame;
    return true;
  }
  int Receive(std::span<can::StampedFrame> frames) noexcept override { return port_.Receive(frames); }
  bool WaitUntil(TimeNs deadline_ns) noexcept override { return port_.WaitUntil(deadline_ns); }
  bool up() const noexcept override { return port_.up(); }
  const can::CanCounters& counters() const noexcept override { return port_.counters(); }

 private:
  void Flush() noexcept {
    if (size_ > 0) port_.SendAll(std::span(frames_).first(size_));
    size_ = 0;
  }

  can::CanPort& port_;
  bool open_ = false;
  std::size_t size_ = 0;
  std::array<can::CanFrame, 64> frames_{};
};

}  // namespace

struct DriveRack::State {
  explicit State(can::CanPort& p) : port(p) {}
  Drive& At(int drive) noexcept { return *drives[static_cast<std::size_t>(drive)]; }

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
}

DriveRack::~DriveRack() = default;

int DriveRack::drives() const noexcept { return static_cast<int>(state_->drives.size()); }

int DriveRack::node_id(int drive) const noexcept { return state_->At(drive).node_id(); }

void DriveRack::SetSensors(int drive, const DriveSensors& sensors) noexcept {
  state_->At(drive).SetSensors(sensors);
}

int DriveRack::Poll(TimeNs now_ns) {
  int syncs = 0;
  state_->port.Open();
  while (true) {
    const int n = state_->port.Receive(state_->batch);
    for (int i = 0; i < n; ++i) {
      const can::CanFrame& frame = state_->batch[static_cast<std::size_t>(i)].frame;
      const bool sync = canopen::IsSync(frame);
      if (sync) ++syncs;
      for (const auto& drive : state_->drives) {
        if (sync) {
          drive->OnSync(now_ns);
        } else {
          drive->OnFrame(frame, now_ns);
        }
      }
    }
    if (n < static_cast<int>(state_->batch.size())) break;
  }
  for (const auto& drive : state_->drives) drive->OnTime(now_ns);
  state_->port.Close();
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

void DriveRack::StopHeartbeat(int drive) noexcept { state_->At(drive).StopHeartbeat(); }

}  // namespace tendril::emulator
