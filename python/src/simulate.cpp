// Data sets from the simulator, as `tendril gap simulate` makes them.
#include <fmt/format.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/function.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "data_set.h"
#include "interruptible.h"
#include "module.h"
#include "rows.h"
#include "tendril/experiment/excitation.h"
#include "tendril/experiment/experiment_run.h"
#include "tendril/experiment/planted_set.h"
#include "tendril/sim/batch.h"
#include "tendril/sim/effects.h"

namespace tendril::python {
namespace {

namespace nb = nanobind;
using namespace experiment;

struct Request {
  RobotParameters robot;
  std::vector<std::string> effects;
  Plan plan;
  std::string daemon;
  std::uint64_t seed;
  std::optional<int> repeats;
  bool noise;
  int jobs;
};

/// The set, and a line on each effect that was given by its size.
struct Made {
  std::optional<ExperimentSet> set;
  std::vector<std::string> sizes;
};

void Make(Request r, Work& work, Made& made) {
  RobotParameters plant = r.robot;
  PlantedEffects effects = Plant(r.effects, r.robot, plant);
  if (r.repeats) RepeatEach(r.plan, *r.repeats);
  ExperimentOptions options{.controller_robot = r.robot,
                            .plant_robot = plant,
                            .daemon = DaemonOfExperiments(r.daemon),
                            .seed = r.seed,
                            .sensor_noise = r.noise,
                            .threads = r.jobs};
  const auto report = [&](const std::string& stage, double share) { work.Tell(stage, share); };
  SetAmounts(effects, r.plan, options, work.stop(), report);
  for (const auto& effect : effects.sized) {
    if (effect) made.sizes.push_back(SizeLine(*effect));
  }
  const std::vector<NamedRun> names = NameRuns(r.plan);
  made.set = RunSet(r.plan, options, work.stop(), [&](std::size_t run, double share, const Experiment* done) {
    work.Tell(names[run].name, done ? 1 : share);
  });
  if (!made.set->trouble.empty()) throw std::runtime_error("the set is not complete: " + made.set->trouble);
}

Plan PlanOf(const std::string& set, const std::optional<std::string>& file) {
  return file ? LoadPlan(*file) : NamedPlan(set);
}

std::pair<Set, std::vector<std::string>> Simulate(
    const RobotParameters& robot, const std::vector<std::string>& effects, const std::string& set,
    const std::optional<std::string>& plan, const std::string& daemon, std::uint64_t seed,
    std::optional<int> repeats, bool noise, const std::optional<std::string>& load_cell, bool tracker,
    int jobs, const nb::object& progress) {
  std::optional<LoadCellPlace> cell;
  if (load_cell) cell = LoadCellPlaceNamed(*load_cell);
  const Request request{WithSensors(robot, robot.name, cell, tracker),
                        effects,
                        PlanOf(set, plan),
                        daemon,
                        seed,
                        repeats,
                        noise,
                        jobs};
  const auto made = std::make_shared<Made>();
  const auto work = std::make_shared<Work>();
  Run(
      work, [=] { Make(request, *work, *made); }, progress);
  return {Set(std::move(made->set->data)), made->sizes};
}

/// Rows of all robots one below the other, by the names of PlantMotion, and why a robot's solver gave up.
struct Motions {
  Rows tip_m, bending_rad, tension_base_N, tension_motor_N, motor_angle_rad;
  std::vector<std::string> failed;
};

Motions Stacked(const std::vector<sim::PlantMotion>& each) {
  Motions all;
  const auto stack = [&](Eigen::MatrixXd sim::PlantMotion::*of) {
    Eigen::Index rows = 0;
    for (const sim::PlantMotion& motion : each) rows += (motion.*of).rows();
    Rows table(rows, each.empty() ? 0 : (each.front().*of).cols());
    Eigen::Index at = 0;
    for (const sim::PlantMotion& motion : each) {
      table.middleRows(at, (motion.*of).rows()) = motion.*of;
      at += (motion.*of).rows();
    }
    return table;
  };
  all.tip_m = stack(&sim::PlantMotion::tip_m);
  all.bending_rad = stack(&sim::PlantMotion::bending_rad);
  all.tension_base_N = stack(&sim::PlantMotion::tension_base_N);
  all.tension_motor_N = stack(&sim::PlantMotion::tension_motor_N);
  all.motor_angle_rad = stack(&sim::PlantMotion::motor_angle_rad);
  for (const sim::PlantMotion& motion : each) all.failed.push_back(motion.failed);
  return all;
}

/// One robot for each list of effects.
std::vector<RobotParameters> Variants(const RobotParameters& robot,
                                      const std::vector<std::vector<std::string>>& effects) {
  std::vector<RobotParameters> robots;
  for (const auto& texts : effects) {
    RobotParameters& made = robots.emplace_back(robot);
    for (const std::string& text : texts) made.effects.push_back(sim::ParseEffect(text, robot));
    sim::CheckEffects(made);
  }
  return robots;
}

std::tuple<Rows, Rows, Rows, Rows, Rows, std::vector<std::string>> SimulateTorques(
    const RobotParameters& robot, const std::vector<std::vector<std::string>>& effects, const Rows& torque_Nm,
    double step_s, double tolerance, int jobs, const nb::object& progress) {
  const auto made = std::make_shared<Motions>();
  sim::PlantOptions options;
  options.absolute_tolerance *= tolerance / options.relative_tolerance;
  options.relative_tolerance = tolerance;
  const auto work = std::make_shared<Work>();
  Run(
      work,
      [made, work, robots = Variants(robot, effects), program = sim::TorqueProgram{step_s, torque_Nm},
       options, jobs] {
        *made = Stacked(sim::SimulateEach(robots, program, options, jobs, work->stop(),
                                          [&](double share) { work->Tell("simulating", share); }));
      },
      progress);
  return {std::move(made->tip_m),           std::move(made->bending_rad),     std::move(made->tension_base_N),
          std::move(made->tension_motor_N), std::move(made->motor_angle_rad), std::move(made->failed)};
}

}  // namespace

void AddSimulate(nb::module_& m) {
  m.def("simulate", &Simulate, nb::arg("robot"), nb::arg("effects"), nb::arg("set"), nb::arg("plan").none(),
        nb::arg("daemon"), nb::arg("seed"), nb::arg("repeats").none(), nb::arg("noise"),
        nb::arg("load_cell").none(), nb::arg("tracker"), nb::arg("jobs"), nb::arg("progress").none());
  m.def("simulate_torques", &SimulateTorques, nb::arg("robot"), nb::arg("effects"), nb::arg("torque_Nm"),
        nb::arg("step_s"), nb::arg("tolerance"), nb::arg("jobs"), nb::arg("progress").none());
  m.def("families", [] {
    std::vector<std::string> names;
    for (const std::string_view family : Families()) names.emplace_back(family);
    return names;
  });
}

}  // namespace tendril::python
