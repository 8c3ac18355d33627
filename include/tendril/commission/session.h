// A commissioning from the files to the record: everything that can be refused is, before a motor pulls.
// Knows its operator only as answers.
#pragma once

#include <atomic>
#include <functional>
#include <string>
#include <vector>

#include "tendril/commission/commission.h"

namespace tendril::commission {

struct SessionCall {
  std::string config;                       // the file that the daemon runs with
  std::string lcm_url, channel_prefix;      // empty: the file's
  std::vector<double> seen_rad{};           // directions in tendon order, instead of asking; may be empty
  bool write = false;                       // findings into the files
  const std::atomic<bool>* stop = nullptr;  // ends every wait
};

struct Operator {
  /// Before motors pull with at most this much; throws to cancel.
  std::function<void(double pull_N)> consent;
  /// Asked where the call has no directions.
  AskDirection direction;
  std::function<void(const std::string&)> progress;  // a line for each step
  std::function<void(const std::string&)> tell;      // findings, and what was written: text of several lines
};

/// Returns the path of the record, which tendrild arms by. Throws UsageError for directions that do not fit
/// the robot, std::runtime_error with the remedy where the robot is not commissioned.
std::string RunSession(const SessionCall& call, const Operator& person);

}  // namespace tendril::commission
