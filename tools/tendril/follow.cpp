// `tendril follow`: streams a motion to a running daemon in real time. Knows the command line's
// words; the motions and the streaming are motion's. Most of it is options, a paragraph for each motion.
#include <fmt/format.h>

#include <csignal>
#include <cstdio>
#include <memory>

#include "commands.h"
#include "lcm_options.h"
#include "number_option.h"
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

volatile std::sig_atomic_t interrupted = 0;

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
  std::signal(SIGINT, [](int signal) { interrupted = signal; });
  std::signal(SIGTERM, [](int signal) { interrupted = signal; });
  motion::Follower follower(
      {.lcm_url = options.lcm.url,
       .channel_prefix = options.lcm.prefix,
       .robot_file = options.robot,
       .stopped_by =
           [] { return interrupted == 0         ? std::string()
                       : interrupted == SIGTERM ? "SIGTERM"
                                                : "Ctrl-C"; },
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

using Options = std::shared_ptr<FollowOptions>;

CLI::App* AddMotion(CLI::App& follow, const Options& o, const char* name, const char* description) {
  CLI::App* sub = follow.add_subcommand(name, description)->fallthrough();
  sub->footer("The options of `tendril follow` can be given here too.");
  sub->callback([o, name] {
    o->request.kind = name;
    Run(*o);
  });
  return sub;
}

void AddTips(CLI::App& sub, const Options& o, const char* what) {
  sub.add_option("--tip", o->request.tips, what)->allow_extra_args(false)->option_text("X,Y,Z [m] ...");
}
void AddNearest(CLI::App& sub, const Options& o) {
  sub.add_flag("--nearest", o->request.nearest,
               "replace points out of reach by the nearest that the tip can reach");
}
void AddPathLimits(CLI::App& sub, const Options& o) {
  sub.add_option("--speed", o->request.speed_radps,
                 "of a section's bend at most [rad/s]; 0: the daemon's default_speed_radps")
      ->check(NumberFrom(0, 1e3, "leave it out for the daemon's own"));
  sub.add_option("--acceleration", o->request.acceleration_radps2, "[rad/s^2]; 0: that speed in 0.25 s")
      ->check(NumberFrom(0, 1e6, "leave it out for that speed in 0.25 s"));
  sub.add_option("--jerk", o->request.jerk_radps3, "[rad/s^3]; 0: that acceleration in 0.1 s")
      ->check(NumberFrom(0, 1e9, "leave it out for that acceleration in 0.1 s"));
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
  AddLcmOptions(*follow, o->lcm);

  AddMotion(*follow, o, "circle", "The paper's tip circle, as in `tendril demo`");
  AddMotion(*follow, o, "planar", "The paper's bend in a plane");
  AddMotion(*follow, o, "fast_circle", "The circle at one revolution per second");
  AddMotion(*follow, o, "square", "A square of the tip, at rest in its corners");
  AddMotion(*follow, o, "spiral", "A spiral of the tip, outwards and back");

  CLI::App* via = AddMotion(*follow, o, "via", "Through points without stopping, as fast as limits allow");
  AddTips(*via, o, "a point for the tip; repeat");
  via->add_option("--bend", o->request.bends, "a point as bends of all sections; repeat")
      ->allow_extra_args(false)
      ->option_text("U,V,... [rad] ...");
  via->add_option("--points", o->request.points,
                  "points as CSV: columns tip_x_m,tip_y_m,tip_z_m or us_1,vs_1,us_2,...");
  AddNearest(*via, o);
  AddPathLimits(*via, o);

  CLI::App* line = AddMotion(*follow, o, "line", "Straight lines of the tip, at rest in each corner");
  AddTips(*line, o, "a corner; repeat");
  AddNearest(*line, o);
  AddPathLimits(*line, o);

  CLI::App* arc = AddMotion(*follow, o, "arc", "An arc of the tip: by three points, or around a centre");
  AddTips(*arc, o, "three points in the order in which they are passed; with --centre: where it starts");
  arc->add_option("--centre", o->request.centre, "of the arc")->option_text("X,Y,Z [m]");
  arc->add_option("--normal", o->request.normal, "of its plane; right-handed")
      ->option_text("X,Y,Z")
      ->capture_default_str();
  arc->add_option("--angle", o->request.angle_deg,
                  "by which it turns [deg]; may be negative or more than 360")
      ->check(NumberFrom(-7200, 7200, "give degrees"));
  AddNearest(*arc, o);
  AddPathLimits(*arc, o);

  CLI::App* csv = AddMotion(*follow, o, "csv", "Through the rows of a table at their times");
  csv->add_option(
         "file", o->request.points,
         "CSV: columns t_s and tip_x_m,tip_y_m,tip_z_m or us_1,vs_1,us_2,...; the first row is the start")
      ->required();
  csv->add_option("--stretch", o->request.stretch, "times are multiplied by this")
      ->check(NumberFrom(0.01, 1000, "give 1 for the table's own times"))
      ->capture_default_str();
  AddNearest(*csv, o);

  CLI::App* stream =
      AddMotion(*follow, o, "stream", "Samples that another program sends, joined into a smooth motion");
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
  AddNearest(*stream, o);
}

}  // namespace tendril::tools
