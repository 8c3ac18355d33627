// Plants beside each other; see the header.
#include "tendril/sim/batch.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <stdexcept>

#include "tendril/core/parallel.h"

namespace tendril::sim {
namespace {

void Check(const RobotParameters& robot, std::size_t number, const TorqueProgram& program) {
  if (!robot.actuation)
    throw std::invalid_argument(
        fmt::format("batch: robot {} ('{}') has no actuation", number + 1, robot.name));
  if (robot.body.tendons() != program.torque_Nm.cols())
    throw std::invalid_argument(fmt::format("batch: robot {} ('{}') has {} tendons, the torques are for {}",
                                            number + 1, robot.name, robot.body.tendons(),
                                            program.torque_Nm.cols()));
}

void Check(const TorqueProgram& program) {
  if (program.torque_Nm.rows() == 0) throw std::invalid_argument("batch: no torques; give at least one row");
  if (!program.torque_Nm.allFinite()) throw std::invalid_argument("batch: a torque is not finite");
  if (!(program.step_s >= 1e-5 && program.step_s <= 1))
    throw std::invalid_argument(fmt::format("batch: step of {} s; accepted: 1e-5 to 1", program.step_s));
}

void CheckSteps(const Plant& plant, Eigen::Index row, double most_per_row) {
  constexpr double kRowsAtFirst = 100;  // a start may be rough
  const auto steps = static_cast<double>(plant.counters().solver_steps);
  const double rows = static_cast<double>(row) + 1;
  if (steps <= most_per_row * (rows + kRowsAtFirst)) return;
  throw std::runtime_error(
      fmt::format("batch: too slow: {:.0f} solver steps in {:.0f} rows, more than {:.3g} a row", steps, rows,
                  most_per_row));
}

class Recorder {
 public:
  Recorder(const RobotParameters& robot, Eigen::Index steps) {
    const Eigen::Index m = robot.body.tendons();
    const auto sections = static_cast<Eigen::Index>(robot.body.sections.size());
    const double none = std::numeric_limits<double>::quiet_NaN();
    motion_.tip_m.setConstant(steps, 3, none);
    motion_.bending_rad.setConstant(steps, 2 * sections, none);
    for (auto* of : {&motion_.tension_base_N, &motion_.tension_motor_N, &motion_.motor_angle_rad})
      of->setConstant(steps, m, none);
    bending_.resize(2 * sections);
  }
  void Take(const Plant& plant, Eigen::Index row) {
    motion_.tip_m.row(row) = plant.TipPose().p_WA.transpose();
    plant.body().SumBending(plant.q(), bending_);
    motion_.bending_rad.row(row) = bending_.transpose();
    for (Eigen::Index j = 0; j < plant.tendons(); ++j) {
      const TendonState& tendon = plant.tendon()[static_cast<std::size_t>(j)];
      motion_.tension_base_N(row, j) = tendon.tension_base_N;
      motion_.tension_motor_N(row, j) = tendon.tension_motor_N;
      motion_.motor_angle_rad(row, j) = tendon.motor_angle_rad;
    }
  }
  PlantMotion& motion() { return motion_; }

 private:
  PlantMotion motion_;
  Eigen::VectorXd bending_;
};

}  // namespace

std::vector<PlantMotion> SimulateEach(std::span<const RobotParameters> robots, const TorqueProgram& program,
                                      const PlantOptions& options, int threads, const std::atomic<bool>* stop,
                                      const std::function<void(double share)>& progress,
                                      double most_steps_per_row) {
  Check(program);
  for (std::size_t i = 0; i < robots.size(); ++i) Check(robots[i], i, program);
  const Eigen::Index steps = program.torque_Nm.rows();
  const auto step_ns = static_cast<TimeNs>(std::llround(1e9 * program.step_s));
  std::vector<PlantMotion> motions(robots.size());
  std::atomic<Eigen::Index> done = 0;
  const Eigen::Index all = steps * static_cast<Eigen::Index>(robots.size());
  const auto simulate = [&](int i) {
    const auto at = static_cast<std::size_t>(i);
    Recorder recorder(robots[at], steps);
    try {
      Plant plant(robots[at], options);
      for (Eigen::Index row = 0; row < steps && !(stop && *stop); ++row) {
        plant.SetTorque(program.torque_Nm.row(row).transpose());
        plant.Advance(step_ns);
        recorder.Take(plant, row);
        CheckSteps(plant, row, most_steps_per_row);
        constexpr Eigen::Index kTellEvery = 256;
        const Eigen::Index now = ++done;
        if (progress && (now % kTellEvery == 0 || now == all))
          progress(static_cast<double>(now) / static_cast<double>(all));
      }
    } catch (const std::runtime_error& e) {
      recorder.motion().failed = e.what();
    }
    motions[at] = std::move(recorder.motion());
  };
  ParallelFor(static_cast<int>(robots.size()), threads, simulate);
  return motions;
}

}  // namespace tendril::sim
