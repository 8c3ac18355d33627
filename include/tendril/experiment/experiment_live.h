// Identification experiments on a running daemon over LCM, in real time, recorded from its cycle messages.
// Knows nothing of what is behind the daemon.
#pragma once

#include <atomic>
#include <optional>
#include <string>

#include "tendril/experiment/experiment_run.h"

namespace tendril::experiment {

struct LiveOptions {
  std::string lcm_url, channel_prefix;
  std::optional<RobotParameters> robot;  // nominal; empty: the daemon's own
  /// Arm before every run and disarm after it. Otherwise, the daemon must be running already and stays so.
  bool arm = false;
};

/// As RunSet, on the daemon's robot. `planned` is called after planning and before anything moves, with the
/// runs to come and remarks on them (empty: none). On any exit, a robot armed here is disarmed; otherwise it
/// holds.
ExperimentSet RunLiveSet(const Plan& plan, const LiveOptions& options, const std::atomic<bool>* stop,
                         const std::function<void(const std::string& remark)>& planned,
                         const SetProgress& progress);

}  // namespace tendril::experiment
