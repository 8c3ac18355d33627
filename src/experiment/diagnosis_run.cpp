#include "tendril/experiment/diagnosis_run.h"

#include <algorithm>
#include <chrono>
#include <set>

#include "tendril/core/usage_error.h"
#include "tendril/experiment/simulated_menu.h"
#include "tendril/gap/health.h"
#include "tendril/sim/effects.h"

namespace tendril::experiment {

gap::Diagnosis RunDiagnosis(const gap::DataSet& set, DiagnosisRun run) {
  if (run.next && set.robot.actuation)
    run.options.menu = SimulatedMenu(set.robot, run.daemon, run.options.seed);
  if (run.options.progress) run.options.progress("checking the data", 0);
  std::vector<gap::HealthFinding> health = gap::CheckHealth(set);
  if (run.checked) run.checked(health);
  const auto begin = std::chrono::steady_clock::now();
  gap::Diagnosis diagnosis = gap::Diagnose(set, run.options);
  diagnosis.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  diagnosis.health = std::move(health);
  return diagnosis;
}

std::vector<std::string> LeftOut(const std::vector<std::string>& only, std::vector<std::string> without) {
  for (const sim::Effect& effect : sim::Effects()) {
    const bool named = std::find(only.begin(), only.end(), effect.name) != only.end();
    if (!only.empty() && !named) without.emplace_back(effect.name);
  }
  const std::set<std::string> all(without.begin(), without.end());
  if (all.size() == sim::Effects().size())
    throw UsageError("no effect is left to search for; accepted: at least one");
  return without;
}

}  // namespace tendril::experiment
