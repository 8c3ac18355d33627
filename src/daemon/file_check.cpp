// Each check names the key at fault, with its line.
#include "tendril/daemon/file_check.h"

#include <fmt/core.h>
#include <fmt/ranges.h>
#include <sched.h>

#include <numbers>
#include <stdexcept>

#include "tendril/canopen/master.h"
#include "tendril/config/config.h"
#include "tendril/config/keys.h"
#include "tendril/config/left_out.h"
#include "tendril/control/controller.h"
#include "tendril/control/reach.h"
#include "tendril/control/tension_loop_design.h"
#include "tendril/control/tip_feedback.h"
#include "tendril/core/clock.h"
#include "tendril/daemon/wiring.h"
#include "tendril/io/signature.h"
#include "tendril/model/bending_model.h"
#include "tendril/model/body.h"
#include "tendril/model/held_directions.h"
#include "tendril/model/pull_cone.h"

namespace tendril::daemon {
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
std::string ReachWarning(const DaemonParameters& daemon, const RobotParameters& file) {
  const RobotParameters robot = model::ControlModel(file);
  const LimitParameters& limits = robot.limits;
  const model::Body body(robot.body);
  const bool every_way = model::PullsEveryWay(robot.body);
  const double holdable_rad =
      control::Reach(robot, body, control::CommandedLimits(limits), 0, true).holdable_rad();
  if (holdable_rad >= kHeldShare * limits.max_bending_rad) return "";
  const bool pairs = !robot.actuation->pairs.empty();
  const char* bases = body.sections() > 1 ? "the base section carries all others, and " : "";
  const std::string text = fmt::format(
      "{:g} is far beyond what {} can hold: {}{:g} of limits.max_tension_base_N ({:g} N){} hold its {} {}; "
      "goals beyond it are limited (status 103) and motions near it are slow (110); shorten or lighten what "
      "is carried, thicken the backbone's base, or raise {}",
      limits.max_bending_rad, robot.name, bases, control::kCommandedTensionShare, limits.max_tension_base_N,
      pairs ? " and the pretension of its pairs" : "", body.sections() > 1 ? "sections" : "section",
      holdable_rad > 0
          ? fmt::format("{} up to {:.2g} rad", every_way ? "in every direction" : "where its tendons pull it",
                        holdable_rad)
      : pairs ? "straight only"
              : "not even straight",
      pairs ? "the pairs' pretension_N" : "limits.max_tension_base_N");
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

// Refuses what a drive's EDS file says that the drive cannot do.
std::vector<canopen::DriveSetup> Drives(const DaemonParameters& daemon, const RobotParameters& robot,
                                        const std::string& path) {
  try {
    return DriveSetups(robot, daemon.bus);
  } catch (const std::invalid_argument& e) {
    throw config::ErrorAt(path, "bus.nodes", e.what());
  }
}

// Limits of the trajectory that delay every motion.
std::string DelayWarning(const TrajectoryParameters& t) {
  const double delay_s =
      t.max_rate_radps / t.max_acceleration_radps2 + t.max_acceleration_radps2 / t.max_jerk_radps3;
  if (delay_s <= kLongDelay_s) return "";
  return fmt::format(
      "controller.trajectory: these limits delay every motion by {:.2g} s (max_rate / "
      "max_acceleration + max_acceleration / max_jerk); raise max_acceleration_radps2 or "
      "max_jerk_radps3, or lower the limit above it",
      delay_s);
}

// This may not be the computer that the file is for.
std::string CpuWarning(int cpu, const std::string& path) {
  cpu_set_t cpus;
  if (cpu < 0 || sched_getaffinity(0, sizeof(cpus), &cpus) != 0 || CPU_ISSET_S(cpu, sizeof(cpus), &cpus))
    return "";
  std::vector<int> mine;
  for (int i = 0; i < CPU_SETSIZE; ++i) {
    if (CPU_ISSET_S(i, sizeof(cpus), &cpus)) mine.push_back(i);
  }
  const std::string text = fmt::format(
      "{} is not available to programs here; accepted here: -1 (any), or {}; "
      "correct it, unless the daemon runs on another computer",
      cpu, fmt::join(mine, ", "));
  return config::ErrorAt(path, "realtime.cpu", text).what();
}

// The bus as a comment; refuses what it cannot carry in time.
std::string BusComment(const DaemonParameters& daemon, const RobotParameters& robot,
                       const std::string& path) {
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
  const double cycle_s = ToSeconds(daemon.bus.cycle_ns);
  return fmt::format("#   {:<20} {:.0f} of {:.0f} bits a cycle are cyclic, {:.0f} for all else\n# {}\n",
                     "bus", budget.cyclic_bits_per_s * cycle_s, daemon.bus.bitrate_bps * cycle_s,
                     budget.other_bits_per_s * cycle_s, budget.ToString());
}

std::string LeftOutComment(const DaemonParameters& daemon, const std::string& path) {
  const std::string keys = config::LeftOut(daemon, path);
  return keys.empty() ? "" : "# not in the file, so at their defaults: " + keys + "\n";
}

std::string KeyWarning(const LcmParameters& lcm, const std::string& path) {
  if (lcm.key_file.empty()) return "";
  try {
    io::LoadKey(lcm.key_file);
  } catch (const std::runtime_error& e) {
    return config::ErrorAt(path, "lcm.key_file", e.what()).what();
  }
  return "";
}

}  // namespace

std::string DirectionsComment(const RobotParameters& robot) {
  const std::string held = model::HeldDirections(robot.body);
  return held.empty() ? ""
                      : fmt::format(
                            "# directions of {}: {}; a bend or tip elsewhere is limited to the nearest one "
                            "that can be held (status 112)\n",
                            robot.name, held);
}

std::string UncertaintyComment(const RobotParameters& robot) {
  constexpr std::size_t kListed = 12;
  const std::size_t count = robot.uncertain.size();
  if (count == 0) return "";
  std::string text = fmt::format(
      "# uncertainty: the file says of {} {} how well {} known, by one standard deviation; of all others the "
      "usual "
      "one holds\n",
      count, count == 1 ? "number" : "numbers", count == 1 ? "it is" : "they are");
  std::size_t listed = 0;
  for (const auto& [key, uncertainty] : robot.uncertain) {
    if (++listed > kListed) return text + fmt::format("#   and {} more\n", count - kListed);
    const std::string number = key.substr(0, key.ends_with(']') ? key.rfind('[') : key.npos);
    const std::string unit =
        uncertainty.kind == Uncertainty::Kind::kAbsolute ? config::UnitOfKey(number) : "";
    text += fmt::format("#   {}: {}{}{}\n", key, UncertaintyText(uncertainty), unit.empty() ? "" : " ", unit);
  }
  return text;
}

std::string CheckedText(const DaemonParameters& daemon, const RobotParameters& robot,
                        const std::string& path) {
  config::CheckTogether(daemon, robot, path);
  const std::string bus = BusComment(daemon, robot, path);
  const std::string feedback = FeedbackComment(daemon, robot, path);
  return config::ToYaml(daemon) + FiguresComment(robot) + UncertaintyComment(robot) + bus + feedback +
         DirectionsComment(robot) + LeftOutComment(daemon, path);
}

std::vector<std::string> FileWarnings(const DaemonParameters& daemon, const RobotParameters& robot,
                                      const std::string& path) {
  std::vector<std::string> warnings;
  for (const std::string& line :
       {DelayWarning(daemon.controller.trajectory), CpuWarning(daemon.realtime.cpu, path),
        ReachWarning(daemon, robot), TipWarning(daemon, robot, path), KeyWarning(daemon.lcm, path)}) {
    if (!line.empty()) warnings.push_back(line);
  }
  const std::vector<std::string> of_values = config::Warnings(daemon, robot, path);
  warnings.insert(warnings.end(), of_values.begin(), of_values.end());
  return warnings;
}

}  // namespace tendril::daemon
