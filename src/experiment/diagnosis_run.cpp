#include "tendril/experiment/diagnosis_run.h"

#include <algorithm>
#include <chrono>
#include <set>

#include "tendril/config/whole_file.h"
#include "tendril/core/usage_error.h"
#include "tendril/experiment/simulated_menu.h"
#include "tendril/gap/health.h"
#include "tendril/sim/effects.h"

namespace tendril::experiment {

gap::DataSet LoadDiagnosedLogs(const DiagnosedLogs& logs) {
  const auto other = logs.same_robot ? gap::OtherRobot::kNoted : gap::OtherRobot::kRefused;
  gap::DataSet set = gap::LoadLogs(logs.logs, logs.robot, other);
  if (!logs.before.empty()) gap::CompareWithBefore(set, gap::LoadLogs(logs.before, logs.robot, other));
  return set;
}

void WriteNextPlan(const gap::Diagnosis& diagnosis, const std::filesystem::path& file) {
  std::error_code none;  // of an earlier report
  std::filesystem::remove(file, none);
  if (!diagnosis.next.yaml.empty()) config::WriteWhole(file, diagnosis.next.yaml);
}

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
