// Cost of the inverse side of a tick: table look-ups, allocation, inverse kinematics; and of building a
// table.
#include <benchmark/benchmark.h>

#include <cmath>
#include <numbers>
#include <random>

#include "tendril/model/capstan.h"
#include "tendril/model/inverse.h"

namespace tendril::model {
namespace {

TransmissionParameters Rig() {
  TransmissionParameters t;
  t.pulleys = {{CapstanLaw::kCumulative, std::numbers::pi, 10, 0.466, 0.67, 0}};
  return t;
}

std::vector<double> Tensions() {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(0.06, 11);
  std::vector<double> tensions(1024);
  for (double& t : tensions) t = uniform(random);
  return tensions;
}

void Pull(benchmark::State& state) {
  const CapstanTable table(Rig(), 12);
  const auto tensions = Tensions();
  std::size_t i = 0;
  for (auto _ : state) benchmark::DoNotOptimize(table.Pull(tensions[i++ % 1024]));
}

void Release(benchmark::State& state) {
  const CapstanTable table(Rig(), 12);
  const auto tensions = Tensions();
  std::size_t i = 0;
  for (auto _ : state) benchmark::DoNotOptimize(table.Release(tensions[i++ % 1024]));
}

void Build(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(CapstanTable(Rig(), 12));
}

void Solve(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(SolveCapstan(Rig().pulleys[0], 5));
}

/// Sections x tendons per section; the third argument scales the force (2: mostly out of reach).
void Allocate(benchmark::State& state) {
  const int sections = static_cast<int>(state.range(0)), each = static_cast<int>(state.range(1));
  Eigen::MatrixXd a = Eigen::MatrixXd::Zero(2 * sections, sections * each);
  for (int k = 0; k < sections; ++k) {
    for (int j = 0; j < each; ++j) {
      const double angle = 2 * std::numbers::pi * j / each + 0.4 * k;
      for (int i = 0; i <= k; ++i) {
        a.col(k * each + j).segment<2>(2 * i) = 0.004 * Eigen::Vector2d(std::cos(angle), std::sin(angle));
      }
    }
  }
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-4, 10);
  std::vector<Eigen::VectorXd> forces;
  for (int i = 0; i < 256; ++i) {
    Eigen::VectorXd t(a.cols());
    for (double& v : t) v = std::clamp(uniform(random), 0.3, 8.0);
    forces.push_back(static_cast<double>(state.range(2)) * a * t);
  }
  const TensionAllocator allocator(static_cast<int>(a.cols()), 2 * sections);
  std::size_t i = 0;
  for (auto _ : state) benchmark::DoNotOptimize(allocator.Allocate(a, forces[i++ % 256], 0.3, 8));
}

BENCHMARK(Pull);
BENCHMARK(Release);
BENCHMARK(Build)->Unit(benchmark::kMillisecond);
BENCHMARK(Solve)->Unit(benchmark::kMillisecond);
BENCHMARK(Allocate)
    ->Args({1, 3, 1})
    ->Args({1, 3, 2})
    ->Args({1, 4, 1})
    ->Args({2, 3, 1})
    ->Args({2, 3, 2})
    ->Args({4, 4, 1});

}  // namespace
}  // namespace tendril::model
