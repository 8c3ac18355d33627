// `tendril sim`: the daemon and a simulated robot in this process, on the usual LCM channels. Knows nothing
// of what is commanded.
#include <fmt/format.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <csignal>
#include <filesystem>
#include <memory>

#include "commands.h"
#include "effect_name.h"
#include "lcm_options.h"
#include "number_option.h"
#include "paths.h"
#include "seed_option.h"
#include "stop_signals.h"
#include "tendril/config/command_line.h"
#include "tendril/config/config.h"
#include "tendril/daemon/daemon.h"
#include "tendril/experiment/closed_loop.h"
#include "tendril/experiment/experiment_run.h"
#include "tendril/rig/plant_of.h"
#include "tendril/rig/simulated_robot.h"
#include "tendril/rt/paced_time.h"
#include "tendril/sim/effects.h"

namespace tendril::tools {
namespace {

struct SimOptions {
  std::string robot, plant, daemon, log;
  std::vector<std::string> effects;
  LcmOptions lcm;
  double speed = 1, duration_s = 0;
  std::uint64_t seed = 1;
  bool commissioning = false, headless = false;
};

// Another daemon says once a second that it is there.
constexpr TimeNs kListenForDaemons_ns = 1500 * kNsPerMs;

daemon::DaemonOptions Controller(const SimOptions& o) {
  daemon::DaemonOptions options;
  DaemonParameters& p = options.parameters;
  p = experiment::DaemonFile(o.daemon);
  std::string robot = o.robot;
  if (robot.empty()) robot = o.daemon.empty() ? ConfigFile("robots/rig_60mm.yaml") : p.robot_file;
  options.robot = sim::LoadRobot(robot);
  p.robot_file = std::filesystem::absolute(robot).lexically_normal().string();  // its record lies beside it
  if (!options.robot.actuation) {
    throw std::runtime_error(
        fmt::format("robot '{}' has no 'actuation' section (motors, drives, tendons); use a rig file such as "
                    "rig_90mm.yaml",
                    options.robot.name));
  }
  if (o.daemon.empty()) {
    p = experiment::FitBus(p, options.robot);
  } else {
    config::CheckTogether(p, options.robot, o.daemon);
  }
  p.bus.interface = "memory";
  p.lcm.url = o.lcm.url;
  p.lcm.channel_prefix = o.lcm.prefix;
  if (!o.commissioning) p.commissioning_required = false;
  if (!o.log.empty()) options.log_path = std::filesystem::absolute(o.log).string();
  return options;
}

void SetUpMessages(bool headless) {
  spdlog::set_default_logger(spdlog::stderr_color_mt("tendril sim"));
  spdlog::set_pattern("%H:%M:%S.%e %^%l%$: %v");
  if (headless) spdlog::set_level(spdlog::level::warn);
}

void RunSim(const SimOptions& o) {
  const daemon::DaemonOptions options = Controller(o);
  const RobotParameters plant = ReadFor("--effect", [&] {
    for (const std::string& effect : o.effects) CheckEffectNamed(effect);
    return rig::PlantOf(options.robot, options.parameters.bus, o.plant, o.effects);
  });
  SetUpMessages(o.headless);
  rt::PacedTime time(o.speed);
  rig::SimulatedRobot robot(plant, options.parameters, time.clock(), o.seed);
  // Also in cycles that do not wait for the drives, such as the last ones.
  time.AfterEachCycle([&robot] { robot.Answer(); });
  daemon::Daemon daemon(options, robot.port(), time);
  daemon.RefuseOthers(kListenForDaemons_ns);

  fmt::print("tendril sim: '{}', {} tendons, {:g} ms a cycle, on {}; Ctrl-C stops\n", options.robot.name,
             options.robot.body.tendons(), 1e3 * ToSeconds(options.parameters.bus.cycle_ns),
             options.parameters.lcm.url);
  if (!o.headless) fmt::print("in another terminal: tendril send arm && tendril follow circle\n");
  std::fflush(stdout);
  const std::atomic<bool>& stop = CatchStopSignals();
  std::signal(SIGPIPE, SIG_IGN);  // a reader of its messages may go away
  const TimeNs start_ns = time.clock().Now();
  double slipped_s = 0;
  daemon.Run([&] {
    for (const std::string& line : robot.TakeLines()) spdlog::warn("plant: {}", line);
    if (time.slipped_s() > slipped_s + 1) {
      slipped_s = time.slipped_s();
      spdlog::warn(
          "this machine is too slow for this speed: {:.1f} s behind so far; no cycle is missed, and a "
          "smaller --speed keeps pace",
          slipped_s);
    }
    return stop || (o.duration_s > 0 && ToSeconds(time.clock().Now() - start_ns) >= o.duration_s);
  });
  fmt::print("tendril sim: {:.1f} s simulated, {:.1f} s behind\n", ToSeconds(time.clock().Now() - start_ns),
             time.slipped_s());
}

}  // namespace

void AddSimCommand(CLI::App& app) {
  auto o = std::make_shared<SimOptions>();
  CLI::App* sim =
      app.add_subcommand("sim",
                         "A simulated robot to operate: daemon, drives and plant in one process on the usual "
                         "LCM channels, without CAN, real-time rights or a second program");
  sim->add_option("--robot", o->robot,
                  "the controller's robot file (default: rig_60mm.yaml, or that of --daemon)");
  sim->add_option("--plant", o->plant, "the simulated robot's file (default: the controller's)");
  sim->add_option("--effect", o->effects,
                  "what the simulated robot has and the controller's file has not, as in "
                  "\"tip_payload mass_kg=0.002\"; may be repeated (tendril gap explain)");
  sim->add_option("--daemon", o->daemon, "daemon file (default: the shipped one)");
  AddLcmOptions(*sim, o->lcm);
  sim->add_option("--speed", o->speed,
                  "of its time against this machine's; a busy machine falls behind and misses no cycle")
      ->capture_default_str()
      ->check(NumberFrom(0.01, 10, "1 is real time; faster, commands would expire between two"));
  sim->add_option("--duration", o->duration_s, "simulated time after which it stops [s]; 0: until Ctrl-C")
      ->capture_default_str()
      ->check(NumberFrom(0, 1e6, "give seconds"));
  sim->add_option("--log", o->log, "LCM log of all messages, for tendril replay and tendril gap diagnose");
  sim->add_option("--seed", o->seed, "of the sensors' noise")->capture_default_str()->check(Seed());
  sim->add_flag("--commissioning", o->commissioning,
                "arm only a robot that is commissioned, as the daemon file says");
  sim->add_flag("--headless", o->headless,
                "for scripts: a line at its start and one at its end, between them only warnings and errors");
  sim->callback([o] { RunSim(*o); });
}

}  // namespace tendril::tools
