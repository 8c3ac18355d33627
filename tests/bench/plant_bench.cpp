// Cost of the plant: one simulated millisecond under a controller's torques, with the solver's steps and
// evaluations of the equations of motion per millisecond and the factor over real time.
#include <benchmark/benchmark.h>

#include "sim/motions.h"
#include "tendril/sim/plant.h"

namespace tendril {
namespace {

const std::vector<EffectSetting> kDrivetrainLaws{
    {"stribeck", "all", {{"torque_Nm", 1e-4}}}, {"cogging", "all", {{"amplitude_Nm", 1e-4}}},
    {"command_delay", "all", {{"s", 0.0023}}},  {"tendon_creep", "all", {{"fraction", 0.2}}},
    {"backlash", "all", {{"rad", 0.1}}},        {"spool_growth", "all", {{"m_per_rad", 1e-4}}}};

const std::vector<EffectSetting> kBodyLaws{{"backbone_hysteresis", "all", {{"moment_Nm", 1e-3}}},
                                           {"superelastic", "all", {{"softening", 0.3}}},
                                           {"routing_friction", "all", {{"mu", 0.15}}},
                                           {"contact", "all", {{"stiffness_Npm", 100}, {"gap_m", 0.02}}}};

/// Of NiTi wire, damped so that no mode rings for long.
RobotParameters WithAllStrains(RobotParameters robot) {
  for (SectionParameters& s : robot.body.sections) {
    s.torsion = s.extension = s.shear = true;
    s.poissons_ratio = 0.33;
    s.torsional_damping_Nms = 1e-5;
    s.axial_damping_Nspm = 5;
    s.shear_damping_Nspm = 0.1;
  }
  return robot;
}

void Run(benchmark::State& state, const RobotParameters& robot) {
  const test::CircleTorque circle(robot);
  sim::Plant plant(robot);
  for (auto _ : state) {
    state.PauseTiming();
    const Eigen::VectorXd torque = circle.At(ToSeconds(plant.time_ns()));
    state.ResumeTiming();
    plant.SetTorque(torque);
    plant.Advance(kNsPerMs);
  }
  const auto c = plant.counters();
  const double ms = static_cast<double>(state.iterations());
  state.counters["steps/ms"] = static_cast<double>(c.solver_steps) / ms;
  state.counters["rhs/ms"] = static_cast<double>(c.rhs_evaluations) / ms;
  state.counters["jacobians/ms"] = static_cast<double>(c.jacobian_evaluations) / ms;
  state.counters["real_time_factor"] = benchmark::Counter(1e-3 * ms, benchmark::Counter::kIsRate);
}

void Millisecond(benchmark::State& state, const char* file, const std::vector<EffectSetting>& effects = {}) {
  RobotParameters robot = test::Rig(file);
  robot.effects = effects;
  Run(state, robot);
}

void MillisecondOfAllStrains(benchmark::State& state) { Run(state, WithAllStrains(test::Rig())); }

// A whole number of turns of the circle.
BENCHMARK_CAPTURE(Millisecond, four_units_three_tendons, "rig_90mm")->Iterations(12000);
BENCHMARK_CAPTURE(Millisecond, four_tendons, "four_tendon_90mm")->Iterations(12000);
BENCHMARK_CAPTURE(Millisecond, two_sections_six_tendons, "two_section")->Iterations(12000);
BENCHMARK_CAPTURE(Millisecond, drivetrain_laws, "rig_90mm", kDrivetrainLaws)->Iterations(12000);
BENCHMARK_CAPTURE(Millisecond, body_laws, "rig_90mm", kBodyLaws)->Iterations(12000);
BENCHMARK(MillisecondOfAllStrains)->Iterations(12000);
BENCHMARK_CAPTURE(Millisecond, all_strains_eight_units, "rod_90mm")->Iterations(12000);

}  // namespace
}  // namespace tendril
