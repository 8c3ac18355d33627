// Values within their range that make no sense on this robot: mainly guards, with the threshold from which
// each cannot trip. Knows what the guards compare, not how.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numbers>

#include "tendril/config/config.h"

namespace tendril::config {
namespace {

// Range of a drive's analog input.
constexpr double kInputEnd_V = 10;
// Longest time for a robot to pull, or wait for a motion, unattended.
constexpr double kUnattended_s = 2, kSilence_s = 60;
// Beyond this share of a threshold that cannot trip, a guard trips too late.
constexpr double kLate = 0.8;
// Faster changes of tension from end to end are jerks; states must come more often than programs wait for
// them.
constexpr double kShortestRamp_s = 0.1, kRamp_s = 4, kState_s = 1;
// Minimum probability of detecting a slack tendon.
constexpr double kFound = 1e-3;
// Share of the tension range, at the default speed.
constexpr double kDampingShare = 0.5;
// Standard deviations of noise that occur once in an hour of cycles.
constexpr double kSurely = 5;

struct Bound {
  double value = INFINITY;  // from this value on (or down, for lower limits) the guard cannot trip
  std::size_t tendon = 0;   // the tendon, from 1
  void Lower(double candidate, std::size_t at) {
    if (candidate >= value) return;
    value = candidate;
    tendon = at;
  }
};

struct Scale {
  Bound way_m, unexplained_m, shown_N, torque_N;
  Bound torque_noise_N{.value = 0};  // largest usual error of the reported torque
  Bound held_N{.value = 0};  // largest tension held by friction and pretension: a smaller pull moves nothing
};

// Number of bends that the section's tendons show: one where all lie on a line through its axis, else two.
double Explained(const SectionParameters& section) {
  const double first_rad = section.tendons.front().angle_rad;
  const bool line =
      std::all_of(section.tendons.begin(), section.tendons.end(), [&](const TendonRoute& route) {
        return std::abs(std::sin(route.angle_rad - first_rad)) < 0.01;  // tolerance of drilled holes
      });
  return line ? 1 : 2;
}

// For the tendon on which each is largest.
Scale ScaleOf(const RobotParameters& robot) {
  Scale scale;
  std::size_t at = 0;
  double sections = 0;
  for (const SectionParameters& section : robot.body.sections) {
    ++sections;
    for (const TendonRoute& route : section.tendons) {
      const TendonDriveParameters& t = robot.actuation->tendons[at++];
      const double own_m = route.radius_m * robot.limits.max_bending_rad;
      scale.way_m.Lower(own_m * sections, at);
      // Two bends explain the displacements of m tendons except for this share of a single tendon's error;
      // tendons on one line have one bend. With as many tendons as bends nothing remains at any threshold.
      const double share = 1 - Explained(section) / static_cast<double>(section.tendons.size());
      if (share > 0) scale.unexplained_m.Lower(own_m * share, at);
      const double travel_m = t.SpoolTravelPerMotorRad();
      const double friction_N = t.motor.coulomb_friction_Nm / travel_m;
      const double most_N = std::min(t.drive.current_limit_A * t.motor.torque_constant_NmpA / travel_m,
                                     robot.limits.max_tension_motor_N / t.gear.efficiency + friction_N);
      scale.torque_N.Lower(most_N + friction_N, at);
      const double per_mille_N = 1e-3 * t.drive.rated_torque_Nm / travel_m;
      const double noise_N = per_mille_N * (1 + 0.5 * t.drive.actual_torque_noise_permille);
      if (noise_N > scale.torque_noise_N.value) scale.torque_noise_N = {noise_N, at};
      const double held_N = friction_N + robot.limits.min_tension_N / t.gear.efficiency;
      if (held_N > scale.held_N.value) scale.held_N = {held_N, at};
      const bool cell = t.load_cell.place != LoadCellPlace::kNone;
      scale.shown_N.Lower(cell ? kInputEnd_V / t.load_cell.gain_VpN - t.load_cell.offset_N : most_N, at);
    }
  }
  return scale;
}

// Probability that a slack tendon's reading stays below the threshold for all of max_slack_s, on the noisiest
// cell.
double SlackFound(const RobotParameters& robot, const GuardParameters& g, double cycle_s) {
  double found = g.slack_tension_N > 0 ? 1 : 0;
  for (const TendonDriveParameters& t : robot.actuation->tendons) {
    if (t.load_cell.place == LoadCellPlace::kNone || t.load_cell.noise_N <= 0) continue;
    const double below = 0.5 * std::erfc(-g.slack_tension_N / t.load_cell.noise_N / std::numbers::sqrt2);
    found = std::min(found, std::pow(below, g.max_slack_s / cycle_s));
  }
  return found;
}

}  // namespace

std::vector<std::string> Warnings(const DaemonParameters& daemon, const RobotParameters& robot,
                                  const std::string& daemon_path) {
  std::vector<std::string> lines;
  const GuardParameters& g = daemon.controller.guards;
  const TakeUpParameters& take_up = daemon.controller.take_up;
  const GuardParameters usual;
  const LimitParameters& limits = robot.limits;
  const double cycle_s = ToSeconds(daemon.bus.cycle_ns);
  const double heartbeat_cycles = 1e-3 * daemon.bus.heartbeat_timeout_ms / cycle_s;
  const Scale scale = ScaleOf(robot);

  const auto say = [&](const std::string& key, double value, const std::string& what, const std::string& why,
                       const std::string& remedy) {
    const std::string text = fmt::format("{:g} {} {}: {}; {}", value, what, robot.name, why, remedy);
    lines.emplace_back(ErrorAt(daemon_path, key, text).what());
  };
  // Cannot trip from `bound` on, late from kLate of it; suggests the usual value, or half of the bound if
  // that is smaller.
  const auto below = [&](const std::string& key, double value, double bound, double usual_value,
                         const std::string& why, bool whole = false) {
    if (value <= kLate * bound) return;
    double suggested = std::min(usual_value, 0.5 * bound);
    if (whole) suggested = std::max(1., std::floor(suggested));
    const double digit = std::pow(10, std::floor(std::log10(suggested)) - 1);
    const std::string what =
        value < bound ? fmt::format("is {:.0f} % of a value that cannot trip on", 100 * value / bound)
                      : "cannot trip on";
    say(key, value, what, why,
        fmt::format("set {:g} (below {:.4g})", digit * std::floor(suggested / digit + 1e-9), kLate * bound));
  };
  if (!daemon.lcm.url.starts_with("udpm://")) {
    lines.emplace_back(
        ErrorAt(daemon_path, "lcm.url",
                "'" + daemon.lcm.url +
                    "' reaches no program outside the daemon's own process; set udpm://ADDRESS:PORT?ttl=N")
            .what());
  }
  const std::string guards = "controller.guards.";
  const auto of = [](const Bound& b) { return fmt::format("tendon {}", b.tendon); };

  below(
      guards + "max_missing_cycles", g.max_missing_cycles, heartbeat_cycles, 5,
      fmt::format("a drive counts as lost without its heartbeat after {:g} cycles (bus.heartbeat_timeout_ms)",
                  heartbeat_cycles),
      true);
  if (SlackFound(robot, g, cycle_s) < kFound) {
    double noise_N = 0;
    for (const TendonDriveParameters& t : robot.actuation->tendons)
      noise_N = std::max(noise_N, t.load_cell.noise_N);
    say(guards + "slack_tension_N", g.slack_tension_N, "cannot trip on",
        fmt::format("the load cell's noise ({:g} N rms) repeatedly lifts the reading of a slack tendon above "
                    "it within max_slack_s",
                    noise_N),
        fmt::format("set {:.2g} or more, below limits.min_tension_N ({:g})",
                    std::clamp(5 * noise_N, 0.1 * limits.min_tension_N, 0.5 * limits.min_tension_N),
                    limits.min_tension_N));
  }
  // Without friction the base carries the tension that a cell before the pulleys shows.
  below(guards + "tension_margin", g.tension_margin,
        scale.shown_N.value / std::min(limits.max_tension_motor_N, limits.max_tension_base_N) - 1,
        usual.tension_margin,
        fmt::format("{} shows no more than {:.3g} N", of(scale.shown_N), scale.shown_N.value));
  below(guards + "confirm_cycles", g.confirm_cycles,
        scale.way_m.value / g.max_displacement_rate_mps / cycle_s, usual.confirm_cycles,
        fmt::format("at max_displacement_rate_mps {} travels all of its {:.3g} m before a guard is confirmed",
                    of(scale.way_m), scale.way_m.value),
        true);
  below(guards + "tension_disagreement_N", g.tension_disagreement_N, limits.max_tension_motor_N,
        usual.tension_disagreement_N,
        "no tension within limits.max_tension_motor_N differs by so much from a dead cell's reading");
  below(guards + "stuck_torque_change_N", g.stuck_torque_change_N, scale.torque_N.value,
        usual.stuck_torque_change_N,
        fmt::format("the torque of {} changes by no more than {:.3g} N", of(scale.torque_N),
                    scale.torque_N.value));
  below(guards + "max_displacement_jump_m", g.max_displacement_jump_m, scale.way_m.value,
        usual.max_displacement_jump_m,
        fmt::format("from straight to limits.max_bending_rad {} goes {:.3g} m", of(scale.way_m),
                    scale.way_m.value));
  below(guards + "max_displacement_rate_mps", g.max_displacement_rate_mps,
        g.max_displacement_jump_m / cycle_s, usual.max_displacement_rate_mps,
        "such a speed already trips max_displacement_jump_m in one cycle");
  below(guards + "max_following_error_m", g.max_following_error_m, scale.way_m.value,
        usual.max_following_error_m,
        fmt::format("from straight to limits.max_bending_rad {} goes {:.3g} m", of(scale.way_m),
                    scale.way_m.value));
  below(guards + "max_bending_excess_rad", g.max_bending_excess_rad,
        2 * std::numbers::pi - limits.max_bending_rad, usual.max_bending_excess_rad,
        "a section would have to close to a circle");
  below(guards + "max_estimator_residual_m", g.max_estimator_residual_m, scale.unexplained_m.value,
        usual.max_estimator_residual_m,
        fmt::format("{} wrong by all of its section's bend leaves {:.3g} m unexplained",
                    of(scale.unexplained_m), scale.unexplained_m.value));
  below(guards + "max_torque_error_N", g.max_torque_error_N, scale.torque_N.value, usual.max_torque_error_N,
        fmt::format("the torque of {} is off by no more than {:.3g} N", of(scale.torque_N),
                    scale.torque_N.value));
  below(guards + "max_late_cycles", g.max_late_cycles, heartbeat_cycles, usual.max_late_cycles,
        fmt::format("the drives disable themselves after {:g} cycles without the daemon "
                    "(bus.heartbeat_timeout_ms)",
                    heartbeat_cycles),
        true);
  below(guards + "max_stream_silence_s", g.max_stream_silence_s, kSilence_s, usual.max_stream_silence_s,
        "a sender that was silent for a minute could move the robot again without an operator");
  below("controller.take_up.max_travel_m", take_up.max_travel_m, take_up.max_speed_mps * take_up.timeout_s,
        TakeUpParameters{}.max_travel_m,
        "homing ends by take_up.timeout_s before a tendon has moved that far");
  below("bus.heartbeat_timeout_ms", daemon.bus.heartbeat_timeout_ms, 1e3 * kUnattended_s, 250,
        "a drive keeps pulling for this long after its daemon died; a hung daemon is ended after 2 s", true);

  const double fastest_Nps = limits.max_tension_base_N / kShortestRamp_s;
  if (const double ramp_Nps = daemon.controller.pretension_ramp_Nps; ramp_Nps > fastest_Nps) {
    say("controller.pretension_ramp_Nps", ramp_Nps, "N/s is a jerk on",
        fmt::format("a safe stop drops limits.max_tension_base_N within {:.2g} s",
                    limits.max_tension_base_N / ramp_Nps),
        fmt::format("set {:.2g} (up to {:.4g})", limits.max_tension_base_N / kRamp_s, fastest_Nps));
  }
  if (take_up.pull_N <= scale.held_N.value) {
    say("controller.take_up.pull_N", take_up.pull_N, "N cannot wind in the tendon on",
        fmt::format("friction of its motor and pretension take {:.3g} N of {}", scale.held_N.value,
                    of(scale.held_N)),
        scale.held_N.value < limits.max_tension_motor_N
            ? fmt::format("set {:.2g} (above {:.4g})",
                          std::clamp(2 * scale.held_N.value,
                                     std::min(TakeUpParameters{}.pull_N, limits.max_tension_motor_N),
                                     limits.max_tension_motor_N),
                          scale.held_N.value)
            : fmt::format(
                  "limits.max_tension_motor_N ({:g}) allows no pull that can: correct gear.efficiency, "
                  "motor.coulomb_friction_Nm or limits.min_tension_N of the robot file",
                  limits.max_tension_motor_N));
  }
  if (take_up.max_speed_mps > g.max_displacement_rate_mps) {
    say("controller.take_up.max_speed_mps", take_up.max_speed_mps, "m/s trips a guard of",
        fmt::format("homing would wind faster than controller.guards.max_displacement_rate_mps ({:g})",
                    g.max_displacement_rate_mps),
        fmt::format("set {:g} (up to {:g})",
                    std::min(TakeUpParameters{}.max_speed_mps, 0.5 * g.max_displacement_rate_mps),
                    g.max_displacement_rate_mps));
  }
  if (g.max_torque_error_N < scale.torque_noise_N.value) {
    say(guards + "max_torque_error_N", g.max_torque_error_N, "N trips on noise on",
        fmt::format("the reported torque of {} stays off by up to {:.3g} N (its step of one per mille, and "
                    "its noise)",
                    of(scale.torque_noise_N), scale.torque_noise_N.value),
        fmt::format("set {:g} (above {:.3g})",
                    std::max(usual.max_torque_error_N, 2 * scale.torque_noise_N.value),
                    scale.torque_noise_N.value));
  }
  const auto say_robot = [&](const std::string& key, double value, const std::string& why,
                             const std::string& remedy) {
    lines.emplace_back(
        ErrorAt(daemon.robot_file, key, fmt::format("{:g}: {}; {}", value, why, remedy)).what());
  };
  if (limits.max_tension_motor_N < limits.max_tension_base_N) {
    say_robot(
        "limits.max_tension_motor_N", limits.max_tension_motor_N,
        fmt::format("friction takes some of it on the way to the base, so that limits.max_tension_base_N "
                    "({:g}) is never reached",
                    limits.max_tension_base_N),
        fmt::format("set {:g} or more, or a lower limit of the base", limits.max_tension_base_N));
  }
  // Tension needed for damping at the default speed is not available for anything else.
  const double speed_radps = daemon.controller.trajectory.default_speed_radps;
  const double room_N = limits.max_tension_base_N - limits.min_tension_N;
  for (std::size_t k = 0; k < robot.body.sections.size(); ++k) {
    const SectionParameters& s = robot.body.sections[k];
    double lever_m = INFINITY;
    for (const TendonRoute& route : s.tendons) lever_m = std::min(lever_m, route.radius_m);
    const double per_damping_N = speed_radps / (s.units * lever_m);
    const double damping_N = s.bending_damping_Nms * per_damping_N;
    if (damping_N <= kDampingShare * room_N) continue;
    say_robot(
        fmt::format("body.sections[{}].bending_damping_Nms", k + 1), s.bending_damping_Nms,
        fmt::format("at controller.trajectory.default_speed_radps ({:g}) it takes {:.3g} N of a tendon, "
                    "of {:g} N between the limits",
                    speed_radps, damping_N, room_N),
        fmt::format("set {:.2g} or less, or controller.trajectory.default_speed_radps {:.2g} or less",
                    0.9 * kDampingShare * room_N / per_damping_N,
                    0.9 * kDampingShare * room_N / damping_N * speed_radps));
  }
  const auto& tendons = robot.actuation->tendons;
  const auto step_N = [](const TendonDriveParameters& t) {
    return t.load_cell.place == LoadCellPlace::kNone ? 0 : t.load_cell.resolution_V / t.load_cell.gain_VpN;
  };
  const auto coarse = std::find_if(tendons.begin(), tendons.end(), [&](const TendonDriveParameters& t) {
    return step_N(t) > limits.min_tension_N;
  });
  if (coarse != tendons.end()) {
    say_robot("actuation.load_cell.resolution_V", coarse->load_cell.resolution_V,
              fmt::format("one step of the cell is {:.3g} N, more than limits.min_tension_N ({:g})",
                          step_N(*coarse), limits.min_tension_N),
              "use the analog input's step, or another gain_VpN");
  }
  // A single reading over the limit is a fault, so noise must not reach it.
  const double limit_N = std::min(limits.max_tension_motor_N, limits.max_tension_base_N);
  const double over_N = limit_N * (1 + g.tension_margin);
  const auto noise_N = [](const TendonDriveParameters& t) {
    return t.load_cell.place == LoadCellPlace::kNone ? 0 : t.load_cell.noise_N;
  };
  const auto noisy = std::max_element(tendons.begin(), tendons.end(),
                                      [&](const TendonDriveParameters& a, const TendonDriveParameters& b) {
                                        return noise_N(a) < noise_N(b);
                                      });
  if (const double most_N = kSurely * noise_N(*noisy); most_N > over_N - limit_N) {
    const bool never = most_N > over_N - limits.min_tension_N;
    const double margin = 1.1 * most_N / limit_N;
    say_robot(
        "actuation.load_cell.noise_N", noise_N(*noisy),
        fmt::format("single readings of tendon {} exceed {:.3g} N (the limit and "
                    "controller.guards.tension_margin){}, a fault (404)",
                    noisy - tendons.begin() + 1, over_N,
                    never ? " at pretension already, so that the robot does not stay armed"
                          : " under tensions within the limits"),
        margin <= 1
            ? fmt::format("give the cell's rms noise, a tension_margin of {:.2g} or more, or a better cell",
                          margin)
            : std::string("give the cell's rms noise, or take a better cell"));
  }
  constexpr double kMostOfRated = 5;
  const auto most_A = [](const TendonDriveParameters& t) {
    return kMostOfRated * t.drive.rated_torque_Nm / t.motor.torque_constant_NmpA;
  };
  const auto strong = std::find_if(tendons.begin(), tendons.end(), [&](const TendonDriveParameters& t) {
    return t.drive.current_limit_A > most_A(t);
  });
  if (strong != tendons.end()) {
    say_robot(
        "actuation.drive.current_limit_A", strong->drive.current_limit_A,
        fmt::format("that is {:.3g} times the motor's rated torque",
                    kMostOfRated * strong->drive.current_limit_A / most_A(*strong)),
        fmt::format("set {:g} or less, or correct rated_torque_Nm", std::floor(100 * most_A(*strong)) / 100));
  }
  if (const std::size_t at = daemon.lcm.url.find("ttl="); at != std::string::npos) {
    if (const int ttl = std::atoi(daemon.lcm.url.c_str() + at + 4); ttl > 1) {
      lines.emplace_back(
          ErrorAt(daemon_path, "lcm.url",
                  fmt::format("ttl={}: commands to {} cross routers; set ttl=0 (this computer) or "
                              "ttl=1 (its network)",
                              ttl, robot.name))
              .what());
    }
  }
  const auto behind = std::find_if(tendons.begin(), tendons.end(), [](const TendonDriveParameters& t) {
    return t.load_cell.place == LoadCellPlace::kRobotSide;
  });
  if (daemon.controller.shape_feedback && behind != tendons.end()) {
    const std::string text = fmt::format(
        "on, but the load cell of tendon {} of {} is on the robot's side: wide, fast goals have ended in a "
        "fault (412) then; set off, move the robot more slowly, or put the cells on the motor's side",
        behind - tendons.begin() + 1, robot.name);
    lines.emplace_back(ErrorAt(daemon_path, "controller.shape_feedback", text).what());
  }
  if (daemon.controller.tension_feedback && robot.body.sections.size() > 1) {
    const std::string text = fmt::format(
        "on, but {} has {} sections: if it matches its file, feedback may leave a soft robot farther from "
        "its goal than no feedback; compare the two, or set off (with shape_feedback and tip_feedback)",
        robot.name, robot.body.sections.size());
    lines.emplace_back(ErrorAt(daemon_path, "controller.tension_feedback", text).what());
  }
  if (const double every_s = daemon.lcm.state_every_cycles * cycle_s; every_s > kState_s) {
    say("lcm.state_every_cycles", daemon.lcm.state_every_cycles, "hides",
        fmt::format("a state comes every {:.3g} s, and `tendril status` waits for 2 s", every_s),
        fmt::format("set 1 (up to {:.0f})", kState_s / cycle_s));
  }
  return lines;
}

}  // namespace tendril::config
