// Programs of identification experiments from plan, robot and limits.
// Knows the controller's static model, nothing of buses, messages or files of data.
#include "tendril/experiment/excitation.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "allowance.h"
#include "families.h"
#include "tendril/gap/data_set.h"
#include "tendril/model/held_directions.h"
#include "track.h"

namespace tendril::experiment {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kLongest_s = 600;

struct Family {
  std::string_view name;
  double amplitude_rad, duration_s, shortest_s;
};
constexpr Family kFamilies[] = {
    {"triangle", 1.8, 24, 4},  {"cocontraction", 0.9, 24, 6}, {"circle", 1.4, 14, 3}, {"steps", 1.6, 10, 4},
    {"multisine", 1.0, 13, 3}, {"ladder", 1.4, 14, 4},        {"hold", 1.4, 60, 4},   {"sway", 1.3, 6, 4},
};
constexpr auto kNames = [] {
  std::array<std::string_view, std::size(kFamilies)> names{};
  for (std::size_t i = 0; i < names.size(); ++i) names[i] = kFamilies[i].name;
  return names;
}();

const Family& FamilyOf(std::string_view name) {
  const auto* found = std::find_if(std::begin(kFamilies), std::end(kFamilies),
                                   [name](const Family& f) { return f.name == name; });
  if (found == std::end(kFamilies)) {
    throw std::invalid_argument(
        fmt::format("there is no experiment '{}'; accepted: {}", name, fmt::join(kNames, ", ")));
  }
  return *found;
}

MatrixXd Own(Allowance& allowance, const PlannedRun& run, const RobotParameters& robot,
             const ControllerParameters& controller) {
  const bool tension = run.targets == PlannedRun::Targets::kTension;
  const int columns = tension ? allowance.tendons() : 2 * allowance.sections();
  const char* key = tension ? "tension_N" : "bending_rad";
  const VectorXd start = tension ? VectorXd::Constant(columns, allowance.least_N()) : VectorXd::Zero(columns);
  const double most_rate =
      kRateShare * (tension ? controller.pretension_ramp_Nps : controller.trajectory.max_rate_radps);
  Track track(start);
  const auto speed_over = [&](const VectorXd& change) {
    return tension ? change.cwiseAbs().maxCoeff() : SectionNorm(change);
  };
  for (const Waypoint& w : run.waypoints) {
    if (static_cast<int>(w.value.size()) != columns) {
      throw std::invalid_argument(
          fmt::format("{}: the target at t_s = {} has {} values of {}; this robot needs {}", run.family,
                      w.t_s, w.value.size(), key, columns));
    }
    const VectorXd to = Eigen::Map<const VectorXd>(w.value.data(), columns);
    if (!tension && !allowance.Pulled(to)) {
      throw std::invalid_argument(fmt::format("{}: the bend at t_s = {} cannot be held: {}; change it",
                                              run.family, w.t_s, model::HeldDirections(robot.body)));
    }
    if (!tension && !allowance.Allowed(to, allowance.least_N(), false)) {
      throw std::invalid_argument(
          fmt::format("{}: the bend at t_s = {} needs more than {:.0f} % of the robot's bending or tension "
                      "limits; bend less",
                      run.family, w.t_s, 100 * kBaseShare));
    }
    if (tension && (to.minCoeff() < robot.limits.min_tension_N ||
                    to.maxCoeff() > kCommandShare * robot.limits.max_tension_base_N)) {
      throw std::invalid_argument(
          fmt::format("{}: the tensions at t_s = {} leave {} to {:.2f} N; change them", run.family, w.t_s,
                      robot.limits.min_tension_N, kCommandShare * robot.limits.max_tension_base_N));
    }
    const double seconds = w.t_s - track.end_s(), change = speed_over(to - track.end());
    if (!(seconds > 0) || change / seconds > most_rate) {
      throw std::invalid_argument(
          fmt::format("{}: reaching the target at t_s = {} in {:.3g} s would need {:.3g} {}; at most {:.3g}: "
                      "give it more time",
                      run.family, w.t_s, seconds,
                      seconds > 0 ? change / seconds : std::numeric_limits<double>::infinity(),
                      tension ? "N/s" : "rad/s", most_rate));
    }
    track.Line(to, seconds);
  }
  track.Line(start, std::max(0.5, speed_over(start - track.end()) / std::min(1.0, most_rate)));
  if (track.end_s() > kLongest_s) {
    throw std::invalid_argument(
        fmt::format("{}: targets later than {} s; split the run", run.family, kLongest_s));
  }
  return track.Sample(static_cast<int>(std::ceil(track.end_s() / kStep_s)) + 1);
}

Targets ShapesOf(Allowance& allowance, const PlannedRun& run, const RobotParameters& robot,
                 const ControllerParameters& controller) {
  const Family& family = FamilyOf(run.family);
  if (!(run.duration_s >= family.shortest_s && run.duration_s <= kLongest_s)) {
    throw std::invalid_argument(fmt::format("{}: duration_s is {}; accepted: {} to {} s", run.family,
                                            run.duration_s, family.shortest_s, kLongest_s));
  }
  const double most = robot.limits.max_bending_rad * allowance.sections();
  if (!(run.amplitude_rad > 0 && run.amplitude_rad <= most)) {
    throw std::invalid_argument(fmt::format("{}: amplitude_rad is {}; accepted: above 0 to {} rad",
                                            run.family, run.amplitude_rad, most));
  }
  const Asked asked{.amplitude_rad = run.amplitude_rad,
                    .active_s = run.duration_s - kStillBefore_s - kRestAfter_s,
                    .largest_N = robot.limits.max_tension_base_N,
                    .seed = run.seed,
                    .controller = controller};
  return FamilyTargets(run.family, allowance, asked);
}

}  // namespace

std::span<const std::string_view> Families() { return kNames; }

PlannedRun UsualRun(std::string_view family) {
  const Family& f = FamilyOf(family);
  PlannedRun run;
  run.family = family;
  run.amplitude_rad = f.amplitude_rad;
  run.duration_s = f.duration_s;
  return run;
}

Program MakeProgram(const PlannedRun& run, const RobotParameters& robot,
                    const ControllerParameters& controller) {
  if (!robot.actuation) {
    throw std::invalid_argument(
        "robot '" + robot.name +
        "' has no actuation (motors, drives, tendons): use a rig file such as rig_90mm.yaml");
  }
  gap::RequireAMotorForEachTendon(robot);
  Allowance allowance(robot, controller);
  const auto [active, tension] =
      run.targets == PlannedRun::Targets::kFamily
          ? ShapesOf(allowance, run, robot, controller)
          : Targets{Own(allowance, run, robot, controller), run.targets == PlannedRun::Targets::kTension};
  Program program;
  program.family = run.family;
  program.step_s = kStep_s;
  program.speed_radps = controller.trajectory.max_rate_radps;
  program.tension = tension;
  if (!program.tension) {
    double rate = 0;
    for (Eigen::Index i = 1; i < active.rows(); ++i) {
      rate = std::max(rate, SectionNorm((active.row(i) - active.row(i - 1)).transpose()) / kStep_s);
    }
    const double most = controller.trajectory.max_rate_radps;
    if (rate > most) {
      throw std::invalid_argument(
          fmt::format("{}: the bend would move at {:.2f} rad/s, the controller's limit is {}; "
                      "raise duration_s or lower amplitude_rad",
                      run.family, rate, most));
    }
  }
  const auto still = static_cast<Eigen::Index>(std::lround(kStillBefore_s / kStep_s));
  const auto rest = static_cast<Eigen::Index>(std::lround(kRestAfter_s / kStep_s));
  program.targets.resize(still + active.rows() - 1 + rest, active.cols());
  program.targets.topRows(still).rowwise() = active.row(0);
  program.targets.middleRows(still, active.rows() - 1) = active.topRows(active.rows() - 1);
  program.targets.bottomRows(rest).rowwise() = active.row(active.rows() - 1);
  if (tension) {
    // The tension added for the last motion's friction is removed.
    const double least_N = robot.limits.min_tension_N;
    for (Eigen::Index i = 0; i < rest; ++i) {
      const double left = 1 - Smooth(static_cast<double>(i + 1) / (0.7 * static_cast<double>(rest)));
      auto row = program.targets.row(program.targets.rows() - rest + i);
      row = (least_N + left * (row.array() - least_N)).matrix();
    }
    program.targets = RateLimited(program.targets, controller);
  }
  return program;
}

Command Program::At(double t_s) const {
  Command command;
  // Rounded: cycle times are sums of whole cycles, and rounding must not select the previous row.
  const auto row = std::min<Eigen::Index>(static_cast<Eigen::Index>(t_s / step_s + 1e-6), targets.rows() - 1);
  if (t_s < kStillBefore_s - 1e-9) return command;
  command.kind = tension ? CommandKind::kTension : CommandKind::kBending;
  if (tension) {
    command.tension_N = targets.row(row).transpose();
  } else {
    command.bending_rad = targets.row(row).transpose();
    command.speed_radps = speed_radps;
  }
  return command;
}

}  // namespace tendril::experiment
