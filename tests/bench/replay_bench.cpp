// Cost of the replay's cuts per simulated minute, beside the plant's, and of the body by its number of units.
#include <benchmark/benchmark.h>

#include "../sim/recording.h"

namespace tendril {
namespace {

using sim::Replay;

constexpr int kSamples = 12000;  // milliseconds: a whole round of the triangles
constexpr double kMinutes = kSamples / 60e3;

const test::Recording& Rounds(bool lively) {
  static const test::Recording slow = test::Record(test::Rig(), test::Triangles(test::Rig()), kSamples);
  static const test::Recording fast = test::Record(test::Rig(), test::Multisine(test::Rig()), kSamples);
  return lively ? fast : slow;
}

/// `run` does kMinutes of signals an iteration.
template <typename Run>
void PerMinute(benchmark::State& state, Run&& run) {
  for (auto _ : state) run();
  const double minutes = kMinutes * static_cast<double>(state.iterations());
  state.counters["s/minute"] =
      benchmark::Counter(minutes, benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
  state.counters["real_time_factor"] = benchmark::Counter(60 * minutes, benchmark::Counter::kIsRate);
}

enum Signals { kSlow, kFast };

void PlantItself(benchmark::State& state, Signals signals) {
  const RobotParameters robot = test::Rig();
  const Eigen::MatrixXd& torque = Rounds(signals == kFast).signals.torque_target_Nm;
  PerMinute(state, [&] {
    sim::Plant plant(robot);
    for (int i = 0; i < kSamples; ++i) {
      plant.SetTorque(torque.row(i).transpose());
      plant.Advance(kNsPerMs);
    }
  });
}

void C1(benchmark::State& state) {
  const Replay replay(test::Rig());
  const auto& r = Rounds(false);
  PerMinute(state, [&] { benchmark::DoNotOptimize(replay.ActualTorque(r.signals)); });
}
void C2(benchmark::State& state) {
  const Replay replay(test::Rig());
  const auto& r = Rounds(false);
  PerMinute(state, [&] { benchmark::DoNotOptimize(replay.CellFromTorque(r.signals, r.shortening_m)); });
}
void C3(benchmark::State& state) {
  const Replay replay(test::Rig());
  const auto& r = Rounds(false);
  PerMinute(state, [&] { benchmark::DoNotOptimize(replay.CellFromStretch(r.signals, r.shortening_m)); });
}

void Body(benchmark::State& state, Signals signals, Replay::DrivenBy by) {
  const Replay replay(test::Rig());
  const auto& r = Rounds(signals == kFast);
  PerMinute(state, [&] { benchmark::DoNotOptimize(replay.Body(r.signals, by)); });
}

/// The rig's robot as a chain of more units of the same length, as stiff and as heavy together, pulled by the
/// same tensions.
void BodyOfUnits(benchmark::State& state) {
  RobotParameters robot = test::Rig();
  auto& section = robot.body.sections[0];
  const double finer = static_cast<double>(state.range(0)) / section.units;
  section.units = static_cast<int>(state.range(0));
  section.unit_length_m /= finer;
  section.unit_mass_kg /= finer;
  section.disk_inertia_xx_kgm2 /= finer;
  section.disk_inertia_zz_kgm2 /= finer;
  section.bending_damping_Nms *= finer;
  const Replay replay(robot);
  const auto& r = Rounds(false);
  PerMinute(state, [&] { benchmark::DoNotOptimize(replay.Body(r.signals, Replay::DrivenBy::kCell)); });
  state.SetComplexityN(state.range(0));
}

/// A hypothesis that changes the pulleys needs its own table of the Capstan equation; the others reuse one.
void NewRobot(benchmark::State& state, double step) {
  RobotParameters robot = test::Rig();
  for (auto _ : state) {
    for (auto& t : robot.actuation->tendons) t.transmission.pulleys[0].alpha += step;
    benchmark::DoNotOptimize(Replay(robot));
  }
}

BENCHMARK_CAPTURE(PlantItself, slow, kSlow)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(PlantItself, fast, kFast)->Unit(benchmark::kMillisecond);
BENCHMARK(C1)->Unit(benchmark::kMillisecond);
BENCHMARK(C2)->Unit(benchmark::kMillisecond);
BENCHMARK(C3)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(Body, slow_by_cells, kSlow, Replay::DrivenBy::kCell)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(Body, slow_by_torques, kSlow, Replay::DrivenBy::kTorque)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(Body, slow_by_motors, kSlow, Replay::DrivenBy::kMotor)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(Body, fast_by_cells, kFast, Replay::DrivenBy::kCell)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(Body, fast_by_motors, kFast, Replay::DrivenBy::kMotor)->Unit(benchmark::kMillisecond);
BENCHMARK(BodyOfUnits)->RangeMultiplier(2)->Range(4, 32)->Unit(benchmark::kMillisecond)->Complexity();
BENCHMARK_CAPTURE(NewRobot, other_pulleys, 1e-7)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(NewRobot, same_pulleys, 0.0)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace tendril
