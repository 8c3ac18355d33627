// Takes measurement errors of single runs out of a set before it is diagnosed.
#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "evaluator.h"
#include "tendril/gap/data_set.h"
#include "tendril/gap/diagnose.h"

namespace tendril::gap {

/// Finds and removes measurement errors by comparing the runs with each other and with the model.
class MeasurementCheck {
 public:
  /// `degradations`: lines of what was removed are added. `compared`: the given set compares runs with
  /// earlier ones.
  MeasurementCheck(DataSet& set, std::vector<std::string>& degradations, const DiagnoseOptions& options,
                   int threads, bool compared);

  /// Runs with a far larger model error than the others, including those left out, and the ratio.
  const std::map<std::string, double>& missed() const { return missed_; }

  /// The comparable runs, with the set and its degradations reduced accordingly. Throws std::runtime_error
  /// where nothing can be compared.
  Evaluator PrepareComparable();

 private:
  void ReportDeviatingRuns();
  bool MaskFrozenMotors(const Evaluator& evaluator);
  bool LeaveOutDeviatingRuns(const Evaluator& evaluator);

  DataSet& set_;
  std::vector<std::string>& degradations_;
  const DiagnoseOptions& options_;
  int threads_;
  bool compared_;
  std::size_t runs_,
      left_out_ = 0;  // number of runs at first; of those left out since because they deviate from the others
  std::map<std::string, double> missed_;  // as returned by FindDeviatingRuns
  std::optional<std::pair<DataSet, std::vector<std::string>>> before_leaving_out_;
};

}  // namespace tendril::gap
