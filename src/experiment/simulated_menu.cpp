#include "tendril/experiment/simulated_menu.h"

#include <stdexcept>
#include <string_view>

#include "tendril/experiment/experiment_run.h"

namespace tendril::experiment {

gap::ExperimentMenu SimulatedMenu(const RobotParameters& nominal, const std::string& daemon_file,
                                  std::uint64_t seed) {
  gap::ExperimentMenu menu;
  const DaemonParameters daemon = DaemonOfExperiments(daemon_file);
  for (const std::string_view family : Families()) menu.families.emplace_back(family);
  menu.simulate = [nominal, daemon, seed](const std::string& family, const RobotParameters& plant) {
    const ExperimentOptions options{
        .controller_robot = nominal, .plant_robot = plant, .daemon = daemon, .seed = seed};
    PlannedRun planned = UsualRun(family);
    const Program program = MakeProgram(planned, nominal, daemon.controller);
    Experiment experiment = RunExperiment(program, family, options, seed, nullptr, {});
    if (!experiment.trouble.empty()) throw std::runtime_error(experiment.trouble);
    return experiment.run;
  };
  menu.plan = [](const std::string& family) {
    Plan plan;
    plan.name = "next";
    plan.runs.push_back(UsualRun(family));
    plan.runs.back().repeats = 1;
    return ToYaml(plan);
  };
  return menu;
}

}  // namespace tendril::experiment
