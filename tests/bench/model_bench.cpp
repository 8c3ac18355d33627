// Cost of the body's dynamics against the number of units: what the integrator and the tick pay. The
// recursions are O(N): time per unit stays the same.
#include <benchmark/benchmark.h>

#include "../model/bodies.h"
#include "tendril/model/body.h"

namespace tendril::model {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// A body of `units` units in a bent, moving state.
struct Case {
  explicit Case(int units) : body(test::PaperBody(units)), workspace(body), n(body.dof()) {
    test::Random random(1);
    q = random.Vector(n, -0.7, 0.7);
    dq = random.Vector(n, -5, 5);
    force = random.Vector(n, -0.02, 0.02);
    ddq = VectorXd::Zero(n);
  }
  Body body;
  Body::Workspace workspace;
  int n;
  VectorXd q, dq, force, ddq, tension = Eigen::Vector3d(3, 1, 0.3);
};

template <class Call>
void Measure(benchmark::State& state, Call call) {
  Case c(static_cast<int>(state.range(0)));
  for (auto _ : state) {
    call(c);
    benchmark::DoNotOptimize(c.ddq.data());
    benchmark::ClobberMemory();
  }
  state.counters["per_unit"] = benchmark::Counter(static_cast<double>(state.iterations() * state.range(0)),
                                                  benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

void ForwardDynamics(benchmark::State& state) {
  Measure(state, [](Case& c) { c.body.ForwardDynamics(c.q, c.dq, c.force, c.ddq, c.workspace); });
}

void InverseDynamics(benchmark::State& state) {
  Measure(state, [](Case& c) { c.body.InverseDynamics(c.q, c.dq, c.force, c.ddq, c.workspace); });
}

void TendonForce(benchmark::State& state) {
  Measure(state, [](Case& c) { c.body.TendonForce(c.q, c.tension, c.ddq); });
}

BENCHMARK(ForwardDynamics)->Arg(4)->Arg(8)->Arg(16)->Arg(32);
BENCHMARK(InverseDynamics)->Arg(4)->Arg(8)->Arg(16)->Arg(32);
BENCHMARK(TendonForce)->Arg(4)->Arg(8)->Arg(16)->Arg(32);

}  // namespace
}  // namespace tendril::model
