#include "tendril/commission/same_files.h"

#include <fmt/format.h>

#include <stdexcept>

#include "tendril/daemon/commissioning.h"

namespace tendril::commission {

void RequireRecordAsked(const DaemonParameters& daemon, const std::string& path) {
  if (daemon.commissioning_required) return;
  throw std::runtime_error(path +
                           " has commissioning: not_required, so tendrild would arm without the record; "
                           "set commissioning: required there, restart tendrild, and commission");
}

void RequireSameFiles(const Files& running, const Files& files, const std::string& path) {
  if (daemon::WiringHash(running.robot, running.daemon.bus) !=
      daemon::WiringHash(files.robot, files.daemon.bus)) {
    throw std::runtime_error(
        path +
        " and its robot file are not what the daemon runs with (nodes, directions, motors or "
        "cells differ); restart tendrild, or name its file");
  }
  if (const double own_N = running.daemon.controller.take_up.pull_N;
      own_N < files.daemon.controller.take_up.pull_N) {
    throw std::runtime_error(fmt::format(
        "{}: controller.take_up.pull_N: {:g} is more than the {:g} that the daemon runs with and pulls at "
        "most; restart tendrild, or name its file",
        path, files.daemon.controller.take_up.pull_N, own_N));
  }
  if (!running.daemon.commissioning_required) {
    throw std::runtime_error(
        "the daemon runs with --simulated (or is a tendril sim without --commissioning), so it would arm "
        "without the record; restart it so that it requires the record");
  }
}

}  // namespace tendril::commission
