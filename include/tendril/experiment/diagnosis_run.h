// A diagnosis as a program runs it: logs in; the data checked first, the next experiment from those that can
// be simulated, the time it took; its files out. Knows nothing of the command line.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "tendril/gap/data_set.h"
#include "tendril/gap/diagnose.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::experiment {

struct DiagnosedLogs {
  std::string robot;                      // the nominal robot file
  std::vector<std::string> logs, before;  // folders and files; `before`: of before the robot changed
  bool same_robot = false;                // other robots are noted, not refused
};
/// The runs, compared with those of before. Throws std::runtime_error with file and remedy.
gap::DataSet LoadDiagnosedLogs(const DiagnosedLogs& logs);

struct DiagnosisRun {
  gap::DiagnoseOptions options;  // without its menu
  bool next = true;              // look for the next experiment
  std::string daemon;            // daemon file whose controller would run it; empty: the one built in
  /// Called with what the check of the data found, before the diagnosis begins; may be empty.
  std::function<void(const std::vector<gap::HealthFinding>&)> checked;
};

/// As gap::Diagnose, with data_health and seconds filled in.
gap::Diagnosis RunDiagnosis(const gap::DataSet& set, DiagnosisRun run);

/// The next experiment's plan into a file of its own, in place of an earlier one.
void WriteNextPlan(const gap::Diagnosis& diagnosis, const std::filesystem::path& file);

/// The effects to leave out of the library: `without`, and where `only` names any, all that it does not name.
/// Throws UsageError when none is left to search for.
std::vector<std::string> LeftOut(const std::vector<std::string>& only, std::vector<std::string> without);

}  // namespace tendril::experiment
