// Whether a commissioning would count: the record is asked for, and is about what the daemon runs with.
#pragma once

#include <string>

#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"

namespace tendril::commission {

/// A robot and the daemon file that drives it.
struct Files {
  const RobotParameters& robot;
  const DaemonParameters& daemon;
};

/// Throws std::runtime_error with the remedy when the daemon file at `path` lets tendrild arm without the
/// record.
void RequireRecordAsked(const DaemonParameters& daemon, const std::string& path);

/// Throws std::runtime_error with the remedy when the running daemon has other wiring (nodes, directions,
/// motors, cells) than the files at `path`, pulls with less than they ask for, or would not ask for the
/// record.
void RequireSameFiles(const Files& running, const Files& files, const std::string& path);

}  // namespace tendril::commission
