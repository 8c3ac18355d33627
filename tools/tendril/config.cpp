// `tendril config check`: validates a robot or daemon file and prints it resolved; for a daemon, the bus
// budget too. Knows nothing of the keys.
#include "tendril/config/config.h"

#include <fmt/core.h>
#include <fmt/ranges.h>
#include <sched.h>
#include <yaml-cpp/yaml.h>

#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include "commands.h"
#include "tendril/canopen/master.h"
#include "tendril/control/controller.h"
#include "tendril/control/reach.h"
#include "tendril/control/tension_loop_design.h"
#include "tendril/control/tip_feedback.h"
#include "tendril/daemon/wiring.h"
#include "tendril/model/held_directions.h"
#include "tendril/model/pull_cone.h"
#include "tendril/sim/effects.h"

namespace tendril::tools {
namespace {

constexpr double kLongDelay_s = 0.5;   // seven times that of the shipped files
constexpr double kSlowTip_s = 2;       // to be waited for threefold
constexpr double kHeldShare = 1. / 3;  // of the greatest bend; of two sections of 60 mm it is two fifths

std::string Remedy(const canopen::BusBudget& budget) {
  std::string remedy = fmt::format("at most {} drives fit this cycle", budget.max_drives_at_this_cycle);
  if (budget.min_cycle_ns_for_these_drives > 0) {
    remedy = fmt::format("set cycle_ns: {} or more, or {}", budget.min_cycle_ns_for_these_drives, remedy);
  }
  return remedy;
}

// Margins of the load cells' loops, as a comment; refuses what would not be stable.
std::string FeedbackComment(const DaemonParameters& daemon, const RobotParameters& robot,
                            const std::string& path) {
  if (!daemon.controller.tension_feedback) return "";
  const double period_s = ToSeconds(daemon.bus.cycle_ns);
  for (std::size_t j = 0; j < robot.actuation->tendons.size(); ++j) {
    if (robot.actuation->tendons[j].load_cell.place != LoadCellPlace::kNone) continue;
    throw config::ErrorAt(
        path, "controller.tension_feedback",
        fmt::format("on, but tendon {} has no load cell; accepted: off, or a load cell at every "
                    "tendon; correct the one or the robot file",
                    j + 1));
  }
  const control::TensionLoopGains gains = control::DesignTensionLoop(robot, period_s);
  if (!(gains.bandwidth_radps > 0)) {
    throw config::ErrorAt(
        path, "controller.tension_feedback",
        fmt::format(
            "on, but with a cycle of {} ns no gain leaves a gain margin of {:g} and a phase margin of {:g} "
            "degrees; accepted: a shorter bus.cycle_ns, or off; change one of the two",
            daemon.bus.cycle_ns, control::kLeastGainMargin, control::kLeastPhaseMargin_deg));
  }
  return fmt::format(
      "# tension feedback: bandwidth {:.2f} Hz, proportional {:.3f}, integral {:.2f} 1/s; gain margin "
      "{}{:.1f}, phase "
      "margin {:.0f} degrees\n",
      gains.bandwidth_radps / (2 * std::numbers::pi), gains.proportional, gains.integral_ps,
      gains.margins.gain >= control::kMostGainMargin ? "above " : "", gains.margins.gain,
      gains.margins.phase_deg);
}

// Bends that the tendons do not hold: goals beyond them are limited, which is rarely intended.
std::string ReachWarning(const DaemonParameters& daemon, const RobotParameters& robot) {
  const LimitParameters& limits = robot.limits;
  const model::Body body(robot.body);
  const bool every_way = model::PullsEveryWay(robot.body);
  const double holdable_rad =
      control::Reach(robot, body, control::CommandedLimits(limits), 0, true).holdable_rad();
  if (holdable_rad >= kHeldShare * limits.max_bending_rad) return "";
  const char* bases = body.sections() > 1 ? "the base section carries all others, and " : "";
  const std::string text = fmt::format(
      "{:g} is far beyond what {} can hold: {}{:g} of limits.max_tension_base_N ({:g} N) hold its {} {}; "
      "goals beyond it are limited (status 103) and motions near it are slow (110); shorten or lighten what "
      "is carried, thicken the backbone's base, or raise limits.max_tension_base_N",
      limits.max_bending_rad, robot.name, bases, control::kCommandedTensionShare, limits.max_tension_base_N,
      body.sections() > 1 ? "sections" : "section",
      holdable_rad > 0
          ? fmt::format("{} up to {:.2g} rad", every_way ? "in every direction" : "where its tendons pull it",
                        holdable_rad)
          : "not even straight");
  return config::ErrorAt(daemon.robot_file, "limits.max_bending_rad", text).what();
}

// A tip that takes long to come to its goal is taken for one that hunts.
std::string TipWarning(const DaemonParameters& daemon, const RobotParameters& robot,
                       const std::string& path) {
  if (!daemon.controller.tip_feedback || !robot.actuation->tracker) return "";
  const TrackerParameters& tracker = *robot.actuation->tracker;
  const double period_s = ToSeconds(daemon.bus.cycle_ns);
  const double slow_s = control::TipFeedback(tracker, robot.body.length_m(), period_s).time_constant_s();
  if (slow_s <= kSlowTip_s) return "";
  const std::string text = fmt::format(
      "on, but with tracker.rate_Hz {:g} and delay_s {:g} of {} it corrects with a time constant of {:.3g} "
      "s: the tip keeps moving for {:.3g} s after every move; take a tracker of {:g} Hz or more that is no "
      "later than {:g} s, or set off",
      tracker.rate_Hz, tracker.delay_s, robot.name, slow_s, 3 * slow_s, 10 / kSlowTip_s, kSlowTip_s / 5);
  return config::ErrorAt(path, "controller.tip_feedback", text).what();
}

// Keys of the resolved file that the file itself does not have, with the values that stand in.
void CollectLeftOut(const YAML::Node& resolved, const YAML::Node& given, const std::string& path,
                    std::string& found) {
  for (const auto& entry : resolved) {
    const std::string key = entry.first.Scalar(), at = path.empty() ? key : path + "." + key;
    const YAML::Node there = given.IsMap() ? given[key] : YAML::Node();
    if (!there.IsDefined() || there.IsNull()) {
      if (!found.empty()) found += ", ";
      found += at;
      if (entry.second.IsScalar()) found += ": " + entry.second.Scalar();
    } else if (entry.second.IsMap()) {
      CollectLeftOut(entry.second, there, at, found);
    }
  }
}

std::string LeftOutComment(const DaemonParameters& daemon, const std::string& path) {
  std::string found;
  CollectLeftOut(YAML::Load(config::ToYaml(daemon)), YAML::LoadFile(path), "", found);
  return found.empty() ? "" : "# not in the file, so at their defaults: " + found + "\n";
}

// As a comment, what a robot cannot be asked for.
std::string DirectionsComment(const RobotParameters& robot) {
  const std::string held = model::HeldDirections(robot.body);
  return held.empty() ? ""
                      : fmt::format(
                            "# directions of {}: {}; a bend or tip elsewhere is limited to the nearest one "
                            "that can be held (status 112)\n",
                            robot.name, held);
}

// Refuses what a drive's EDS file says that the drive cannot do.
std::vector<canopen::DriveSetup> Drives(const DaemonParameters& daemon, const RobotParameters& robot,
                                        const std::string& path) {
  try {
    return daemon::DriveSetups(robot, daemon.bus);
  } catch (const std::invalid_argument& e) {
    throw config::ErrorAt(path, "bus.nodes", e.what());
  }
}

void Check(const std::string& path) {
  if (config::KindOf(path) == "robot") {
    const RobotParameters robot = sim::LoadRobot(path);
    fmt::print("{}{}", config::ToYaml(robot), DirectionsComment(robot));
    return;
  }
  const DaemonParameters daemon = config::LoadDaemon(path);
  const RobotParameters robot = sim::LoadRobot(daemon.robot_file);
  config::CheckTogether(daemon, robot, path);
  const std::vector<canopen::DriveSetup> drives = Drives(daemon, robot, path);
  const canopen::BusBudget budget = canopen::ComputeBusBudget(daemon.bus, drives);
  if (budget.load > daemon.bus.max_load) {
    throw config::ErrorAt(
        path, "bus.cycle_ns",
        fmt::format("{:.1f} % of the bus needed by {} drives; accepted: up to {:.1f} % (bus.max_load); {}",
                    100 * budget.load, daemon.bus.nodes.size(), 100 * daemon.bus.max_load, Remedy(budget)));
  }
  if (const std::string problem = canopen::FeedbackDeadlineProblem(daemon.bus, drives); !problem.empty()) {
    throw config::ErrorAt(path, "bus.feedback_deadline_ns", problem);
  }
  const std::string feedback = FeedbackComment(daemon, robot, path);
  fmt::print("{}# {}\n{}{}{}", config::ToYaml(daemon), budget.ToString(), feedback, DirectionsComment(robot),
             LeftOutComment(daemon, path));  // still one YAML file
  const TrajectoryParameters& t = daemon.controller.trajectory;
  const double delay_s =
      t.max_rate_radps / t.max_acceleration_radps2 + t.max_acceleration_radps2 / t.max_jerk_radps3;
  if (delay_s > kLongDelay_s) {
    fmt::print(stderr,
               "warning: controller.trajectory: these limits delay every motion by {:.2g} s (max_rate / "
               "max_acceleration + max_acceleration / max_jerk); raise max_acceleration_radps2 or "
               "max_jerk_radps3, or lower the limit above it\n",
               delay_s);
  }
  // This may not be the computer that it is for.
  cpu_set_t cpus;
  if (const int cpu = daemon.realtime.cpu;
      cpu >= 0 && sched_getaffinity(0, sizeof(cpus), &cpus) == 0 && !CPU_ISSET_S(cpu, sizeof(cpus), &cpus)) {
    std::vector<int> mine;
    for (int i = 0; i < CPU_SETSIZE; ++i) {
      if (CPU_ISSET_S(i, sizeof(cpus), &cpus)) mine.push_back(i);
    }
    const config::ConfigError at =
        config::ErrorAt(path, "realtime.cpu",
                        fmt::format("{} is not available to programs here; accepted here: -1 (any), or {}; "
                                    "correct it, unless the daemon runs on another computer",
                                    cpu, fmt::join(mine, ", ")));
    fmt::print(stderr, "warning: {}\n", at.what());
  }
  if (const std::string line = ReachWarning(daemon, robot); !line.empty())
    fmt::print(stderr, "warning: {}\n", line);
  if (const std::string line = TipWarning(daemon, robot, path); !line.empty())
    fmt::print(stderr, "warning: {}\n", line);
  for (const std::string& line : config::Warnings(daemon, robot, path))
    fmt::print(stderr, "warning: {}\n", line);
}

}  // namespace

void AddConfigCommand(CLI::App& app) {
  CLI::App* group = app.add_subcommand("config", "Robot and daemon files");
  group->require_subcommand(1);
  CLI::App* check =
      group->add_subcommand("check",
                            "Validate a robot or daemon file and print it resolved; for a daemon, the bus "
                            "budget too, and on stderr a warning for each accepted value that makes no sense "
                            "on its robot, such as a guard that cannot trip");
  auto file = std::make_shared<std::string>();
  check->add_option("FILE", *file, "robot file (config/robots/*.yaml) or daemon file (config/tendrild.yaml)")
      ->required();
  check->callback([file] { Check(*file); });
}

}  // namespace tendril::tools
