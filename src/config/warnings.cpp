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

const std::string kGuards = "controller.guards.";

std::string Of(const Bound& b) { return fmt::format("tendon {}", b.tendon); }

// All remarks on one pair of files, in the order in which they are printed.
class Check {
 public:
  Check(const DaemonParameters& daemon, const RobotParameters& robot, const std::string& daemon_path)
      : daemon_(daemon), robot_(robot), daemon_path_(daemon_path) {}

  std::vector<std::string> Run() {
    Url();
    GuardsOfFeedback();
    GuardsOfMotion();
    OtherBounds();
    Jerks();
    TakeUp();
    TorqueNoise();
    RobotLimits();
    RobotDamping();
    CellResolution();
    CellNoise();
    DriveCurrent();
    Network();
    Feedbacks();
    States();
    return lines_;
  }

 private:
  void Url();
  void GuardsOfFeedback();
  void GuardsOfMotion();
  void OtherBounds();
  void Jerks();
  void TakeUp();
  void TorqueNoise();
  void RobotLimits();
  void RobotDamping();
  void CellResolution();
  void CellNoise();
  void DriveCurrent();
  void Network();
  void Feedbacks();
  void States();

  // At a key of the daemon's file.
  void Say(const std::string& key, double value, const std::string& what, const std::string& why,
           const std::string& remedy) {
    const std::string text = fmt::format("{:g} {} {}: {}; {}", value, what, robot_.name, why, remedy);
    lines_.emplace_back(ErrorAt(daemon_path_, key, text).what());
  }
  // At a key of the robot's file.
  void SayRobot(const std::string& key, double value, const std::string& why, const std::string& remedy) {
    lines_.emplace_back(
        ErrorAt(daemon_.robot_file, key, fmt::format("{:g}: {}; {}", value, why, remedy)).what());
  }
  // Cannot trip from `bound` on, late from kLate of it; suggests the usual value, or half of the bound if
  // that is smaller.
  void Below(const std::string& key, double value, double bound, double usual_value, const std::string& why,
             bool whole = false) {
    if (value <= kLate * bound) return;
    double suggested = std::min(usual_value, 0.5 * bound);
    if (whole) suggested = std::max(1., std::floor(suggested));
    const double digit = std::pow(10, std::floor(std::log10(suggested)) - 1);
    const std::string what =
        value < bound ? fmt::format("is {:.0f} % of a value that cannot trip on", 100 * value / bound)
                      : "cannot trip on";
    Say(key, value, what, why,
        fmt::format("set {:g} (below {:.4g})", digit * std::floor(suggested / digit + 1e-9), kLate * bound));
  }

  const DaemonParameters& daemon_;
  const RobotParameters& robot_;
  const std::string& daemon_path_;
  const GuardParameters& guard_ = daemon_.controller.guards;
  const TakeUpParameters& take_up_ = daemon_.controller.take_up;
  const LimitParameters& limits_ = robot_.limits;
  const std::vector<TendonDriveParameters>& tendons_ = robot_.actuation->tendons;
  const GuardParameters usual_;
  const double cycle_s_ = ToSeconds(daemon_.bus.cycle_ns);
  const double heartbeat_cycles_ = 1e-3 * daemon_.bus.heartbeat_timeout_ms / cycle_s_;
  const Scale scale_ = ScaleOf(robot_);
  std::vector<std::string> lines_;
};

void Check::Url() {
  if (!daemon_.lcm.url.starts_with("udpm://")) {
    lines_.emplace_back(
        ErrorAt(daemon_path_, "lcm.url",
                "'" + daemon_.lcm.url +
                    "' reaches no program outside the daemon's own process; set udpm://ADDRESS:PORT?ttl=N")
            .what());
  }
}

void Check::GuardsOfFeedback() {
  Below(
      kGuards + "max_missing_cycles", guard_.max_missing_cycles, heartbeat_cycles_, 5,
      fmt::format("a drive counts as lost without its heartbeat after {:g} cycles (bus.heartbeat_timeout_ms)",
                  heartbeat_cycles_),
      true);
  if (SlackFound(robot_, guard_, cycle_s_) < kFound) {
    double noise_N = 0;
    for (const TendonDriveParameters& t : robot_.actuation->tendons)
      noise_N = std::max(noise_N, t.load_cell.noise_N);
    Say(kGuards + "slack_tension_N", guard_.slack_tension_N, "cannot trip on",
        fmt::format("the load cell's noise ({:g} N rms) repeatedly lifts the reading of a slack tendon above "
                    "it within max_slack_s",
                    noise_N),
        fmt::format("set {:.2g} or more, below limits.min_tension_N ({:g})",
                    std::clamp(5 * noise_N, 0.1 * limits_.min_tension_N, 0.5 * limits_.min_tension_N),
                    limits_.min_tension_N));
  }
}

void Check::GuardsOfMotion() {
  // Without friction the base carries the tension that a cell before the pulleys shows.
  Below(kGuards + "tension_margin", guard_.tension_margin,
        scale_.shown_N.value / std::min(limits_.max_tension_motor_N, limits_.max_tension_base_N) - 1,
        usual_.tension_margin,
        fmt::format("{} shows no more than {:.3g} N", Of(scale_.shown_N), scale_.shown_N.value));
  Below(kGuards + "confirm_cycles", guard_.confirm_cycles,
        scale_.way_m.value / guard_.max_displacement_rate_mps / cycle_s_, usual_.confirm_cycles,
        fmt::format("at max_displacement_rate_mps {} travels all of its {:.3g} m before a guard is confirmed",
                    Of(scale_.way_m), scale_.way_m.value),
        true);
  Below(kGuards + "tension_disagreement_N", guard_.tension_disagreement_N, limits_.max_tension_motor_N,
        usual_.tension_disagreement_N,
        "no tension within limits.max_tension_motor_N differs by so much from a dead cell's reading");
  Below(kGuards + "stuck_torque_change_N", guard_.stuck_torque_change_N, scale_.torque_N.value,
        usual_.stuck_torque_change_N,
        fmt::format("the torque of {} changes by no more than {:.3g} N", Of(scale_.torque_N),
                    scale_.torque_N.value));
  Below(kGuards + "max_displacement_jump_m", guard_.max_displacement_jump_m, scale_.way_m.value,
        usual_.max_displacement_jump_m,
        fmt::format("from straight to limits.max_bending_rad {} goes {:.3g} m", Of(scale_.way_m),
                    scale_.way_m.value));
  Below(kGuards + "max_displacement_rate_mps", guard_.max_displacement_rate_mps,
        guard_.max_displacement_jump_m / cycle_s_, usual_.max_displacement_rate_mps,
        "such a speed already trips max_displacement_jump_m in one cycle");
  Below(kGuards + "max_following_error_m", guard_.max_following_error_m, scale_.way_m.value,
        usual_.max_following_error_m,
        fmt::format("from straight to limits.max_bending_rad {} goes {:.3g} m", Of(scale_.way_m),
                    scale_.way_m.value));
  Below(kGuards + "max_bending_excess_rad", guard_.max_bending_excess_rad,
        2 * std::numbers::pi - limits_.max_bending_rad, usual_.max_bending_excess_rad,
        "a section would have to close to a circle");
  Below(kGuards + "max_estimator_residual_m", guard_.max_estimator_residual_m, scale_.unexplained_m.value,
        usual_.max_estimator_residual_m,
        fmt::format("{} wrong by all of its section's bend leaves {:.3g} m unexplained",
                    Of(scale_.unexplained_m), scale_.unexplained_m.value));
}

void Check::OtherBounds() {
  Below(kGuards + "max_torque_error_N", guard_.max_torque_error_N, scale_.torque_N.value,
        usual_.max_torque_error_N,
        fmt::format("the torque of {} is off by no more than {:.3g} N", Of(scale_.torque_N),
                    scale_.torque_N.value));
  Below(kGuards + "max_late_cycles", guard_.max_late_cycles, heartbeat_cycles_, usual_.max_late_cycles,
        fmt::format("the drives disable themselves after {:g} cycles without the daemon "
                    "(bus.heartbeat_timeout_ms)",
                    heartbeat_cycles_),
        true);
  Below(kGuards + "max_stream_silence_s", guard_.max_stream_silence_s, kSilence_s,
        usual_.max_stream_silence_s,
        "a sender that was silent for a minute could move the robot again without an operator");
  Below("controller.take_up.max_travel_m", take_up_.max_travel_m, take_up_.max_speed_mps * take_up_.timeout_s,
        TakeUpParameters{}.max_travel_m,
        "homing ends by take_up.timeout_s before a tendon has moved that far");
  Below("bus.heartbeat_timeout_ms", daemon_.bus.heartbeat_timeout_ms, 1e3 * kUnattended_s, 250,
        "a drive keeps pulling for this long after its daemon died; a hung daemon is ended after 2 s", true);
}

void Check::Jerks() {
  const double fastest_Nps = limits_.max_tension_base_N / kShortestRamp_s;
  if (const double ramp_Nps = daemon_.controller.pretension_ramp_Nps; ramp_Nps > fastest_Nps) {
    Say("controller.pretension_ramp_Nps", ramp_Nps, "N/s is a jerk on",
        fmt::format("a safe stop drops limits.max_tension_base_N within {:.2g} s",
                    limits_.max_tension_base_N / ramp_Nps),
        fmt::format("set {:.2g} (up to {:.4g})", limits_.max_tension_base_N / kRamp_s, fastest_Nps));
  }
}

void Check::TakeUp() {
  if (take_up_.pull_N <= scale_.held_N.value) {
    Say("controller.take_up.pull_N", take_up_.pull_N, "N cannot wind in the tendon on",
        fmt::format("friction of its motor and pretension take {:.3g} N of {}", scale_.held_N.value,
                    Of(scale_.held_N)),
        scale_.held_N.value < limits_.max_tension_motor_N
            ? fmt::format("set {:.2g} (above {:.4g})",
                          std::clamp(2 * scale_.held_N.value,
                                     std::min(TakeUpParameters{}.pull_N, limits_.max_tension_motor_N),
                                     limits_.max_tension_motor_N),
                          scale_.held_N.value)
            : fmt::format(
                  "limits.max_tension_motor_N ({:g}) allows no pull that can: correct gear.efficiency, "
                  "motor.coulomb_friction_Nm or limits.min_tension_N of the robot file",
                  limits_.max_tension_motor_N));
  }
  if (take_up_.max_speed_mps > guard_.max_displacement_rate_mps) {
    Say("controller.take_up.max_speed_mps", take_up_.max_speed_mps, "m/s trips a guard of",
        fmt::format("homing would wind faster than controller.guards.max_displacement_rate_mps ({:g})",
                    guard_.max_displacement_rate_mps),
        fmt::format("set {:g} (up to {:g})",
                    std::min(TakeUpParameters{}.max_speed_mps, 0.5 * guard_.max_displacement_rate_mps),
                    guard_.max_displacement_rate_mps));
  }
}

void Check::TorqueNoise() {
  if (guard_.max_torque_error_N < scale_.torque_noise_N.value) {
    Say(kGuards + "max_torque_error_N", guard_.max_torque_error_N, "N trips on noise on",
        fmt::format("the reported torque of {} stays off by up to {:.3g} N (its step of one per mille, and "
                    "its noise)",
                    Of(scale_.torque_noise_N), scale_.torque_noise_N.value),
        fmt::format("set {:g} (above {:.3g})",
                    std::max(usual_.max_torque_error_N, 2 * scale_.torque_noise_N.value),
                    scale_.torque_noise_N.value));
  }
}

void Check::RobotLimits() {
  if (limits_.max_tension_motor_N < limits_.max_tension_base_N) {
    SayRobot(
        "limits.max_tension_motor_N", limits_.max_tension_motor_N,
        fmt::format("friction takes some of it on the way to the base, so that limits.max_tension_base_N "
                    "({:g}) is never reached",
                    limits_.max_tension_base_N),
        fmt::format("set {:g} or more, or a lower limit of the base", limits_.max_tension_base_N));
  }
}

void Check::RobotDamping() {
  // Tension needed for damping at the default speed is not available for anything else.
  const double speed_radps = daemon_.controller.trajectory.default_speed_radps;
  const double room_N = limits_.max_tension_base_N - limits_.min_tension_N;
  for (std::size_t k = 0; k < robot_.body.sections.size(); ++k) {
    const SectionParameters& s = robot_.body.sections[k];
    double lever_m = INFINITY;
    for (const TendonRoute& route : s.tendons) lever_m = std::min(lever_m, route.radius_m);
    const double per_damping_N = speed_radps / (s.units * lever_m);
    const double damping_N = s.bending_damping_Nms * per_damping_N;
    if (damping_N <= kDampingShare * room_N) continue;
    SayRobot(fmt::format("body.sections[{}].bending_damping_Nms", k + 1), s.bending_damping_Nms,
             fmt::format("at controller.trajectory.default_speed_radps ({:g}) it takes {:.3g} N of a tendon, "
                         "of {:g} N between the limits",
                         speed_radps, damping_N, room_N),
             fmt::format("set {:.2g} or less, or controller.trajectory.default_speed_radps {:.2g} or less",
                         0.9 * kDampingShare * room_N / per_damping_N,
                         0.9 * kDampingShare * room_N / damping_N * speed_radps));
  }
}

void Check::CellResolution() {
  const auto step_N = [](const TendonDriveParameters& t) {
    return t.load_cell.place == LoadCellPlace::kNone ? 0 : t.load_cell.resolution_V / t.load_cell.gain_VpN;
  };
  const auto coarse = std::find_if(tendons_.begin(), tendons_.end(), [&](const TendonDriveParameters& t) {
    return step_N(t) > limits_.min_tension_N;
  });
  if (coarse != tendons_.end()) {
    SayRobot("actuation.load_cell.resolution_V", coarse->load_cell.resolution_V,
             fmt::format("one step of the cell is {:.3g} N, more than limits.min_tension_N ({:g})",
                         step_N(*coarse), limits_.min_tension_N),
             "use the analog input's step, or another gain_VpN");
  }
}

void Check::CellNoise() {
  // A single reading over the limit is a fault, so noise must not reach it.
  const double limit_N = std::min(limits_.max_tension_motor_N, limits_.max_tension_base_N);
  const double over_N = limit_N * (1 + guard_.tension_margin);
  const auto noise_N = [](const TendonDriveParameters& t) {
    return t.load_cell.place == LoadCellPlace::kNone ? 0 : t.load_cell.noise_N;
  };
  const auto noisy = std::max_element(tendons_.begin(), tendons_.end(),
                                      [&](const TendonDriveParameters& a, const TendonDriveParameters& b) {
                                        return noise_N(a) < noise_N(b);
                                      });
  if (const double most_N = kSurely * noise_N(*noisy); most_N > over_N - limit_N) {
    const bool never = most_N > over_N - limits_.min_tension_N;
    const double margin = 1.1 * most_N / limit_N;
    SayRobot(
        "actuation.load_cell.noise_N", noise_N(*noisy),
        fmt::format("single readings of tendon {} exceed {:.3g} N (the limit and "
                    "controller.guards.tension_margin){}, a fault (404)",
                    noisy - tendons_.begin() + 1, over_N,
                    never ? " at pretension already, so that the robot does not stay armed"
                          : " under tensions within the limits"),
        margin <= 1
            ? fmt::format("give the cell's rms noise, a tension_margin of {:.2g} or more, or a better cell",
                          margin)
            : std::string("give the cell's rms noise, or take a better cell"));
  }
}

void Check::DriveCurrent() {
  constexpr double kMostOfRated = 5;
  const auto most_A = [](const TendonDriveParameters& t) {
    return kMostOfRated * t.drive.rated_torque_Nm / t.motor.torque_constant_NmpA;
  };
  const auto strong = std::find_if(tendons_.begin(), tendons_.end(), [&](const TendonDriveParameters& t) {
    return t.drive.current_limit_A > most_A(t);
  });
  if (strong != tendons_.end()) {
    SayRobot(
        "actuation.drive.current_limit_A", strong->drive.current_limit_A,
        fmt::format("that is {:.3g} times the motor's rated torque",
                    kMostOfRated * strong->drive.current_limit_A / most_A(*strong)),
        fmt::format("set {:g} or less, or correct rated_torque_Nm", std::floor(100 * most_A(*strong)) / 100));
  }
}

void Check::Network() {
  const std::size_t at = daemon_.lcm.url.find("ttl=");
  const int ttl = at == std::string::npos ? 0 : std::atoi(daemon_.lcm.url.c_str() + at + 4);
  const auto say = [&](const std::string& text) {
    lines_.emplace_back(ErrorAt(daemon_path_, "lcm.url", fmt::format("ttl={}: {}", ttl, text)).what());
  };
  if (ttl > 1) {
    say(fmt::format("commands to {} cross routers; set ttl=0 (this computer) or ttl=1 (its network)",
                    robot_.name));
  }
  if (ttl > 0 && daemon_.lcm.key_file.empty()) {
    say(fmt::format(
        "every computer of the network can command {}; set ttl=0, or lcm.key_file, so that commands "
        "must be signed",
        robot_.name));
  }
}

void Check::Feedbacks() {
  const auto behind = std::find_if(tendons_.begin(), tendons_.end(), [](const TendonDriveParameters& t) {
    return t.load_cell.place == LoadCellPlace::kRobotSide;
  });
  if (daemon_.controller.shape_feedback && behind != tendons_.end()) {
    const std::string text = fmt::format(
        "on, but the load cell of tendon {} of {} is on the robot's side: wide, fast goals have ended in a "
        "fault (412) then; set off, move the robot more slowly, or put the cells on the motor's side",
        behind - tendons_.begin() + 1, robot_.name);
    lines_.emplace_back(ErrorAt(daemon_path_, "controller.shape_feedback", text).what());
  }
  if (daemon_.controller.tension_feedback && robot_.body.sections.size() > 1) {
    const std::string text = fmt::format(
        "on, but {} has {} sections: if it matches its file, feedback may leave a soft robot farther from "
        "its goal than no feedback; compare the two, or set off (with shape_feedback and tip_feedback)",
        robot_.name, robot_.body.sections.size());
    lines_.emplace_back(ErrorAt(daemon_path_, "controller.tension_feedback", text).what());
  }
}

void Check::States() {
  if (const double every_s = daemon_.lcm.state_every_cycles * cycle_s_; every_s > kState_s) {
    Say("lcm.state_every_cycles", daemon_.lcm.state_every_cycles, "hides",
        fmt::format("a state comes every {:.3g} s, and `tendril status` waits for 2 s", every_s),
        fmt::format("set 1 (up to {:.0f})", kState_s / cycle_s_));
  }
}

}  // namespace

std::vector<std::string> Warnings(const DaemonParameters& daemon, const RobotParameters& robot,
                                  const std::string& daemon_path) {
  return Check(daemon, robot, daemon_path).Run();
}

}  // namespace tendril::config
