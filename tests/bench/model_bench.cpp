// Cost of the body's dynamics against the number of units: what the integrator and the tick pay. The
// recursions are O(N): time per unit stays the same.
#include <benchmark/benchmark.h>

#include "../model/bodies.h"
#include "tendril/model/body.h"

namespace tendril::model {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

BodyParameters Strained(int units) {
  BodyParameters body = test::PaperBody(units);
  body.sections[0].torsion = body.sections[0].extension = true;
  body.sections[0].poissons_ratio = 0.3;
  return body;
}

// A body in a bent, moving state.
struct Case {
  explicit Case(const BodyParameters& parameters) : body(parameters), workspace(body), n(body.dof()) {
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
void Measure(benchmark::State& state, Call call, BodyParameters (*make)(int)) {
  Case c(make(static_cast<int>(state.range(0))));
  for (auto _ : state) {
    call(c);
    benchmark::DoNotOptimize(c.ddq.data());
    benchmark::ClobberMemory();
  }
  state.counters["per_unit"] = benchmark::Counter(static_cast<double>(state.iterations() * state.range(0)),
                                                  benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

BodyParameters Bending(int units) { return test::PaperBody(units); }

void ForwardDynamics(benchmark::State& state) {
  Measure(
      state, [](Case& c) { c.body.ForwardDynamics(c.q, c.dq, c.force, c.ddq, c.workspace); }, Bending);
}

// Bending, torsion and extension.
void ForwardDynamicsOfAllStrains(benchmark::State& state) {
  Measure(
      state, [](Case& c) { c.body.ForwardDynamics(c.q, c.dq, c.force, c.ddq, c.workspace); }, Strained);
}

void InverseDynamics(benchmark::State& state) {
  Measure(
      state, [](Case& c) { c.body.InverseDynamics(c.q, c.dq, c.force, c.ddq, c.workspace); }, Bending);
}

void TendonForce(benchmark::State& state) {
  Measure(
      state, [](Case& c) { c.body.TendonForce(c.q, c.tension, c.ddq); }, Bending);
}

void TendonForceOfAllStrains(benchmark::State& state) {
  Measure(
      state, [](Case& c) { c.body.TendonForce(c.q, c.tension, c.ddq); }, Strained);
}

BENCHMARK(ForwardDynamics)->Arg(4)->Arg(8)->Arg(16)->Arg(32);
BENCHMARK(ForwardDynamicsOfAllStrains)->Arg(4)->Arg(8)->Arg(16)->Arg(32)->Arg(64);
BENCHMARK(InverseDynamics)->Arg(4)->Arg(8)->Arg(16)->Arg(32);
BENCHMARK(TendonForce)->Arg(4)->Arg(8)->Arg(16)->Arg(32);
BENCHMARK(TendonForceOfAllStrains)->Arg(4)->Arg(8)->Arg(16)->Arg(32)->Arg(64);

}  // namespace
}  // namespace tendril::model
