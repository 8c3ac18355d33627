// `tendril follow`: streams a motion to a running daemon in real time. The motions and the streaming are
// motion's.
#include <fmt/format.h>

#include <cstdio>
#include <memory>

#include "commands.h"
#include "follow_motions.h"
#include "lcm_options.h"
#include "number_option.h"
#include "stop_signals.h"
#include "tendril/config/config.h"
#include "tendril/motion/follower.h"
#include "tendril/motion/requested_motion.h"

namespace tendril::tools {
namespace {

struct FollowOptions {
  LcmOptions lcm;
  motion::MotionRequest request;
  std::string robot, config;
  bool dry_run = false;
  std::string from;       // stream: the prefix of its channels
  double delay_s = 0.15;  // stream
};

std::unique_ptr<motion::Motion> Requested(const FollowOptions& options, const motion::Subject& subject) {
  return motion::MakeRequestedMotion(options.request, subject.robot, subject.daemon.controller.trajectory,
                                     [](const std::string& line) { fmt::print(stderr, "{}\n", line); });
}

// What would be done, from the daemon's file alone.
void DryRun(const FollowOptions& options) {
  motion::Subject subject;
  subject.daemon = config::LoadDaemon(options.config);
  subject.robot = config::LoadRobot(options.robot.empty() ? subject.daemon.robot_file : options.robot);
  const auto motion = Requested(options, subject);
  fmt::print("{}\n{:.3f} s in all, each target {:.0f} ms ahead; nothing was sent\n", motion->description(),
             motion->duration_s(), 1e3 * subject.LeadS());
}

void Run(const FollowOptions& options) {
  if (options.dry_run == options.config.empty()) {
    throw UsageError(
        "--dry-run and --config belong together: a running daemon publishes its own configuration");
  }
  const bool samples = options.request.kind == "stream";
  if (options.dry_run) {
    if (samples) throw UsageError("stream: cannot be planned in advance; leave --dry-run out");
    DryRun(options);
    return;
  }
  CatchStopSignals();
  motion::Follower follower({.lcm_url = options.lcm.url,
                             .channel_prefix = options.lcm.prefix,
                             .robot_file = options.robot,
                             .stopped_by = StoppedBy,
                             .tell =
                                 [](const std::string& line) {
                                   fmt::print("{}\n", line);
                                   std::fflush(stdout);
                                 },
                             .progress = [](const std::string& line) { fmt::print(stderr, "{}\n", line); }});
  if (samples) {
    follower.FollowSamples(options.from, options.delay_s, options.request.nearest);
  } else {
    follower.Follow(*Requested(options, follower.subject()));
  }
}

}  // namespace

void AddFollowCommand(CLI::App& app) {
  auto o = std::make_shared<FollowOptions>();
  CLI::App* follow =
      app.add_subcommand("follow", "Move the robot of a running, armed daemon through a motion in real time")
          ->fallthrough(false);
  follow->require_subcommand(1);
  follow->add_option("--robot", o->robot, "robot file for planning the motion, instead of the daemon's own");
  follow->add_flag("--dry-run", o->dry_run, "plan and report only; needs --config, and no daemon");
  follow->add_option("--config", o->config, "for --dry-run: the daemon's file");
  AddOperatorOptions(*follow, o->lcm);

  const auto run = [o] { Run(*o); };
  AddPlannedMotions(*follow, o->request, run);
  CLI::App* stream = AddMotion(*follow, o->request, "stream",
                               "Samples that another program sends, joined into a smooth motion", run);
  stream
      ->add_option(
          "--from", o->from,
          "they come as command_tip_t on FROM_COMMAND_TIP or command_bending_t on FROM_COMMAND_BENDING")
      ->required();
  stream
      ->add_option("--delay", o->delay_s,
                   "how far behind [s]; at least the time between two samples, or the robot stops at each")
      ->check(NumberFrom(0.001, 10, "give seconds"))
      ->capture_default_str();
  AddNearest(*stream, o->request);
}

}  // namespace tendril::tools
