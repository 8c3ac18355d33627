#include "tendril/motion/tension_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

#include "tendril/control/controller.h"
#include "tendril/control/reach.h"
#include "tendril/model/arc_tensions.h"
#include "tendril/model/bending_model.h"
#include "tendril/model/capstan.h"
#include "tendril/model/held_directions.h"

namespace tendril::motion {
namespace {

constexpr double kTensionLook_s = 0.002;
constexpr int kMostTensionLooks = 50000;

// One instant of a motion: bending, its rates, and the rate at which each tendon's path shortens.
struct Instant {
  Eigen::VectorXd bending_rad, rate_radps, acceleration_radps2;
  TendonVector shortening_mps, shortening_mps2;
};

class Check {
 public:
  explicit Check(const RobotParameters& robot)
      : robot_(model::ControlModel(robot)),
        body_(robot_.body),
        arcs_(body_, model::TendonPairs(robot_)),
        reach_(robot_, body_, control::CommandedLimits(robot_.limits), 0, true),
        tables_(model::MakeCapstanTables(robot.actuation->tendons, robot.limits.max_tension_motor_N)),
        q_(UnitVector::Zero(body_.dof())) {}

  Instant At(const Motion& motion, double t_s) {
    const double half_s = kTensionLook_s / 2;
    const double before_s = std::max(0.0, t_s - half_s),
                 after_s = std::min(motion.duration_s(), t_s + half_s);
    const Command now = motion.At(t_s), before = motion.At(before_s), after = motion.At(after_s);
    Instant i{now.bending_rad,
              now.bending_rate_radps,
              (after.bending_rate_radps - before.bending_rate_radps) / (after_s - before_s),
              {},
              {}};
    const TendonVector d0 = Shortening(before.bending_rad), d1 = Shortening(after.bending_rad),
                       d = Shortening(now.bending_rad);
    i.shortening_mps = (d1 - d0) / (after_s - before_s);
    i.shortening_mps2 = TendonVector::Zero(d.size());
    if (before_s > 0 && after_s < motion.duration_s())
      i.shortening_mps2 = (d1 - 2 * d + d0) / (half_s * half_s);
    return i;
  }

  /// Empty, or what is exceeded.
  std::string Problem(const Instant& at) {
    const LimitParameters& limits = robot_.limits;
    const double most_N = control::kCommandedTensionShare * limits.max_tension_base_N;
    const auto allocated =
        arcs_.Move(at.bending_rad, at.rate_radps, at.acceleration_radps2, limits.min_tension_N, most_N);
    BendingVector held_rad = at.bending_rad;
    if (reach_.Limit(held_rad) == Status::kLimitedDirection) return model::HeldDirections(robot_.body);
    if (allocated.bound == Status::kLimitedTensionMax) {
      return fmt::format(
          "a tendon needs more than {:.3g} N at the base ({:g} of limits.max_tension_base_N){}", most_N,
          control::kCommandedTensionShare,
          robot_.actuation->pairs.empty() ? "" : ", or a pair more than its pretension gives");
    }
    for (int j = 0; j < body_.tendons(); ++j) {
      const auto& t = robot_.actuation->tendons[static_cast<std::size_t>(j)];
      const model::CapstanTable& table = *tables_[static_cast<std::size_t>(j)];
      const double travel_m = t.SpoolTravelPerMotorRad(), base_N = allocated.tension_N[j];
      const bool pulls = at.shortening_mps[j] >= 0;
      const double motor_N = pulls ? table.Pull(base_N) : table.Release(base_N);
      if (motor_N > limits.max_tension_motor_N) {
        return fmt::format("tendon {} needs {:.3g} N on the motor's side; limits.max_tension_motor_N is {:g}",
                           j + 1, motor_N, limits.max_tension_motor_N);
      }
      const double rotor_Nm = t.motor.rotor_inertia_kgm2 * at.shortening_mps2[j] / travel_m;
      const double torque_Nm = rotor_Nm + motor_N * travel_m * std::pow(t.gear.efficiency, pulls ? -1 : 1) +
                               (pulls ? 1 : -1) * t.motor.coulomb_friction_Nm;
      const double most_Nm = t.motor.torque_constant_NmpA * t.drive.current_limit_A * t.motor.torque_scale;
      if (std::abs(torque_Nm) > most_Nm) {
        return fmt::format("motor {} needs {:.3g} mNm; actuation.drive.current_limit_A leaves {:.3g}", j + 1,
                           1e3 * torque_Nm, 1e3 * most_Nm);
      }
    }
    return "";
  }

 private:
  TendonVector Shortening(const Eigen::VectorXd& bending_rad) {
    TendonVector d(body_.tendons());
    body_.SpreadBending(bending_rad, q_);
    body_.TendonShortening(q_, d);
    return d;
  }

  RobotParameters robot_;
  model::Body body_;
  model::ArcTensions arcs_;
  control::Reach reach_;
  const std::vector<std::shared_ptr<const model::CapstanTable>> tables_;
  UnitVector q_;
};

}  // namespace

void RequireTensions(const Motion& motion, const RobotParameters& robot) {
  if (!robot.actuation || motion.Start().kind != CommandKind::kBending) return;
  Check check(robot);
  const double end_s = motion.duration_s();
  const int looks = std::clamp(static_cast<int>(end_s / kTensionLook_s), 1, kMostTensionLooks);
  for (int i = 0; i <= looks; ++i) {
    const double t_s = end_s * i / looks;
    const Instant at = check.At(motion, t_s);
    const std::string problem = check.Problem(at);
    if (problem.empty()) continue;
    throw std::runtime_error(
        fmt::format("{}: at t = {:.4g} s, bent by {:.3g} rad, {}; bend it less, or go slower (--speed and "
                    "--acceleration, of a table --stretch)",
                    motion.name(), t_s, at.bending_rad.norm(), problem));
  }
}

}  // namespace tendril::motion
