// Data sets from the simulator, as `tendril gap simulate` makes them.
#include <fmt/format.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/function.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "data_set.h"
#include "interruptible.h"
#include "module.h"
#include "tendril/experiment/excitation.h"
#include "tendril/experiment/experiment_run.h"
#include "tendril/experiment/planted_set.h"

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

}  // namespace

void AddSimulate(nb::module_& m) {
  m.def("simulate", &Simulate, nb::arg("robot"), nb::arg("effects"), nb::arg("set"), nb::arg("plan").none(),
        nb::arg("daemon"), nb::arg("seed"), nb::arg("repeats").none(), nb::arg("noise"),
        nb::arg("load_cell").none(), nb::arg("tracker"), nb::arg("jobs"), nb::arg("progress").none());
  m.def("families", [] {
    std::vector<std::string> names;
    for (const std::string_view family : Families()) names.emplace_back(family);
    return names;
  });
}

}  // namespace tendril::python
