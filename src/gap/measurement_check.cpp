// Repeats the preparation until no run deviates any more; see the header.
#include "measurement_check.h"

#include <fmt/core.h>

#include <limits>
#include <stdexcept>
#include <tuple>

#include "comparable.h"
#include "frozen_motors.h"
#include "measured_wrong.h"

namespace tendril::gap {

MeasurementCheck::MeasurementCheck(DataSet& set, std::vector<std::string>& degradations,
                                   const DiagnoseOptions& options, int threads, bool compared)
    : set_(set),
      degradations_(degradations),
      options_(options),
      threads_(threads),
      compared_(compared),
      runs_(set.runs.size()) {}

Evaluator MeasurementCheck::PrepareComparable() {
  for (;;) {
    if (compared_ && !Compared(set_)) {
      throw std::runtime_error(
          fmt::format("no run is left that can be compared with one from before{}; accepted: runs with the "
                      "same commands from before and after the change, recorded in the same way",
                      degradations_.empty() ? "" : " (" + degradations_.back() + ")"));
    }
    try {
      Evaluator evaluator(set_, {threads_, options_.delta_N, options_.delta_m, options_.seed});
      if (options_.progress) options_.progress("comparing the runs with the model and with each other", 0);
      if (MaskFrozenMotors(evaluator) || LeaveOutDeviatingRuns(evaluator)) continue;
      ReportDeviatingRuns();
      return evaluator;
    } catch (const RunError& error) {
      if (set_.runs.size() == 1) throw;
      degradations_.push_back(fmt::format("left out: {}", error.what()));
      LeaveOut(set_, error.run);
    } catch (const std::runtime_error&) {
      // The runs that remain without the deviating ones cannot be compared.
      if (!before_leaving_out_) throw;
      std::tie(set_, degradations_) = *std::exchange(before_leaving_out_, std::nullopt);
    }
  }
}

void MeasurementCheck::ReportDeviatingRuns() {
  for (const Run& run : set_.runs) {
    if (const auto missed = missed_.find(run.name); missed != missed_.end()) {
      degradations_.push_back(
          fmt::format("{}: its model error is {:.0f} times that of the other runs: what was different then?",
                      run.name, missed->second));
    }
  }
}

bool MeasurementCheck::MaskFrozenMotors(const Evaluator& evaluator) {
  const std::vector<FrozenMotor> frozen = FindFrozenMotors(set_, evaluator);
  for (const FrozenMotor& motor : frozen) {
    Run& run = set_.runs[motor.run];
    auto x = run.motor_position_rad.col(motor.tendon);
    degradations_.push_back(fmt::format(
        "{}: motor position {} stays at {:.4g} rad from {:.4g} s to {:.4g} s while its tension changes "
        "({:.3g} N) or contradicts a motor at rest: the encoder stopped; taken as missing there",
        run.name, motor.tendon + 1, x[motor.from], run.time_s[motor.from] - run.time_s[0],
        run.time_s[motor.to - 1] - run.time_s[0], motor.tension_N));
    x.segment(motor.from, motor.to - motor.from).setConstant(kNoReading);
  }
  return !frozen.empty();
}

bool MeasurementCheck::LeaveOutDeviatingRuns(const Evaluator& evaluator) {
  const std::vector<DeviatingRun> odd = FindDeviatingRuns(set_, evaluator, missed_, threads_);
  // Judged by the majority of the runs.
  if (odd.empty() || 2 * (left_out_ + odd.size()) > runs_) return false;
  left_out_ += odd.size();
  before_leaving_out_.emplace(set_, degradations_);
  for (auto one = odd.rbegin(); one != odd.rend(); ++one) {
    degradations_.push_back(
        fmt::format("left out: {}: with {} most of its gap disappears, and the other runs have no such "
                    "gap; correct its file and diagnose again",
                    set_.runs[one->run].name, one->with));
    LeaveOut(set_, one->run);
  }
  return true;
}

}  // namespace tendril::gap
