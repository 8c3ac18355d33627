// Cost of the CANopen master a cycle: SYNC, TPDOs decoded, bookkeeping, RPDOs encoded. The port costs next to
// nothing: it hands out prepared frames and forgets what is sent.
#include <benchmark/benchmark.h>

#include "canopen/fake_node.h"

namespace tendril::canopen {
namespace {

class ReplayPort final : public can::CanPort {
 public:
  explicit ReplayPort(can::CanPort& boot) : boot_(boot) {}

  bool Send(const can::CanFrame& frame) noexcept override {
    if (!replaying_) return boot_.Send(frame);
    last_ = frame;
    synced_ |= frame.id == 0x080;
    return true;
  }
  int Receive(std::span<can::StampedFrame> frames) noexcept override {
    if (!replaying_) return boot_.Receive(frames);
    if (!synced_) return 0;
    synced_ = false;
    std::copy(answers_.begin(), answers_.end(), frames.begin());
    return static_cast<int>(answers_.size());
  }
  bool WaitUntil(TimeNs) noexcept override { return false; }
  bool up() const noexcept override { return true; }
  const can::CanCounters& counters() const noexcept override { return counters_; }

  /// From now on every SYNC is answered by one feedback TPDO and one heartbeat of each drive.
  void Replay(int drives) {
    for (int id = 1; id <= drives; ++id) {
      can::StampedFrame feedback;
      feedback.frame.id = TpdoCobId(1, id);
      feedback.frame.size = 8;
      answers_.push_back(feedback);
      answers_.push_back({HeartbeatFrame(id, NmtState::kOperational), 0});
    }
    replaying_ = true;
  }

 private:
  can::CanPort& boot_;
  can::CanCounters counters_;
  can::CanFrame last_;
  std::vector<can::StampedFrame> answers_;
  bool replaying_ = false, synced_ = false;
};

void MasterCycle(benchmark::State& state) {
  const int drives = static_cast<int>(state.range(0));
  const TimeNs cycle_ns = drives <= 3 ? kNsPerMs : 5 * kNsPerMs;
  SimulatedClock clock{kNsPerS};
  can::MemoryBus bus(clock);
  std::vector<std::unique_ptr<test::FakeNode>> nodes;
  for (int id = 1; id <= drives; ++id) nodes.push_back(std::make_unique<test::FakeNode>(bus, id));
  ReplayPort port(bus.AddPort());
  Master master(TestBus(drives, cycle_ns), TestDrives(drives), port);
  const std::vector<std::int16_t> torques(static_cast<std::size_t>(drives), 123);
  DriveRequest request = DriveRequest::kDisable;
  const auto cycle = [&] {
    clock.Advance(cycle_ns);
    master.BeginCycle(clock.Now());
    for (auto& node : nodes) node->Poll(clock.Now());
    master.Poll(clock.Now());
    master.EndCycle(clock.Now(), request, torques);
  };
  master.Start(clock.Now());
  for (int i = 0; i < 1000; ++i) cycle();
  request = DriveRequest::kEnable;
  for (int i = 0; i < 100; ++i) cycle();
  if (master.feedback(drives - 1).state != DriveState::kEnabled) state.SkipWithError("drives not enabled");

  port.Replay(drives);
  for (auto _ : state) {
    clock.Advance(cycle_ns);
    master.BeginCycle(clock.Now());
    benchmark::DoNotOptimize(master.Poll(clock.Now()));
    master.EndCycle(clock.Now(), request, torques);
  }
  if (master.feedback(drives - 1).state != DriveState::kEnabled) state.SkipWithError("drives lost");
}
BENCHMARK(MasterCycle)->Arg(1)->Arg(3)->Arg(12);

}  // namespace
}  // namespace tendril::canopen
