// The motions of `tendril follow` as subcommands. Knows the command line's words for them, nothing of a
// daemon.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>

#include "tendril/motion/requested_motion.h"

namespace tendril::tools {

/// A motion: chosen, it is the kind of the request, which `run` follows and must keep alive.
CLI::App* AddMotion(CLI::App& follow, motion::MotionRequest& request, const char* name,
                    const char* description, const std::function<void()>& run);

/// Those that are planned in advance, with their options.
void AddPlannedMotions(CLI::App& follow, motion::MotionRequest& request, const std::function<void()>& run);

void AddNearest(CLI::App& motion, motion::MotionRequest& request);

}  // namespace tendril::tools
