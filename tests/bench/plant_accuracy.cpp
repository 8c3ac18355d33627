// Integration error of the plant in units of each sensor's noise: rms change over a turn of a circle when the
// tolerance is halved. Prints one JSON object a line, from which tools/results makes a table.
#include <cmath>
#include <cstdio>
#include <numbers>
#include <string>
#include <vector>

#include "sim/motions.h"
#include "tendril/sim/effects.h"
#include "tendril/sim/plant.h"

namespace tendril {
namespace {

constexpr int kTurn_s = 12;

sim::PlantOptions Tolerances(double times) {
  const sim::PlantOptions defaults;
  return {.relative_tolerance = times * defaults.relative_tolerance,
          .absolute_tolerance = times * defaults.absolute_tolerance};
}

struct Shares {
  double encoder = 0, cell = 0, tracker = 0;  // rms change over noise
};

/// For one circle at `speed` times its usual speed, with `times` the default tolerances.
Shares HalfTheTolerance(const RobotParameters& robot, double speed, double times) {
  const test::CircleTorque circle(robot);
  sim::Plant plant(robot, Tolerances(times)), finer(robot, Tolerances(0.5 * times));
  const auto tendons = static_cast<double>(plant.tendon().size());
  const int milliseconds = static_cast<int>(1000 * kTurn_s / speed);
  double encoder = 0, cell = 0, tracker = 0;
  for (int ms = 0; ms < milliseconds; ++ms) {
    const Eigen::VectorXd torque = circle.At(speed * ms * 1e-3);
    for (sim::Plant* p : {&plant, &finer}) {
      p->SetTorque(torque);
      p->Advance(kNsPerMs);
    }
    for (std::size_t j = 0; j < plant.tendon().size(); ++j) {
      const auto &a = plant.tendon()[j], &b = finer.tendon()[j];
      encoder += std::pow(a.motor_angle_rad - b.motor_angle_rad, 2) / tendons;
      cell += std::pow(a.tension_motor_N - b.tension_motor_N, 2) / tendons;
    }
    tracker += (plant.TipPose().p_WA - finer.TipPose().p_WA).squaredNorm() / 3;
  }
  const auto rms = [&](double sum) { return std::sqrt(sum / milliseconds); };
  const TendonDriveParameters& sensors = robot.actuation->tendons.front();
  const double count_rad = 2 * std::numbers::pi / sensors.drive.encoder_counts_per_turn;
  return {rms(encoder) / (count_rad / std::sqrt(12.0)), rms(cell) / sensors.load_cell.noise_N,
          rms(tracker) / robot.actuation->tracker->position_noise_m};
}

const std::vector<std::string> kLaws{"",
                                     "pulley_coulomb N=0.1",
                                     "spool_growth m_per_rad=1e-4",
                                     "slack m=5e-4",
                                     "backlash rad=0.1",
                                     "tendon_creep fraction=0.2",
                                     "cogging amplitude_Nm=3e-5",
                                     "cogging amplitude_Nm=1e-4",
                                     "backbone_hysteresis moment_Nm=1e-3",
                                     "routing_friction mu=0.15",
                                     "command_delay s=0.0023"};

void Print(const std::string& law, double speed) {
  RobotParameters robot = test::Rig();
  if (!law.empty()) robot.effects.push_back(sim::ParseEffect(law, robot));
  for (const double times : {1.0, 0.1}) {
    const Shares s = HalfTheTolerance(robot, speed, times);
    std::printf(
        "{\"law\": \"%s\", \"speed\": %g, \"tolerance\": %g, \"encoder\": %.4g, \"cell\": %.4g, \"tracker\": "
        "%.4g}\n",
        law.c_str(), speed, times, s.encoder, s.cell, s.tracker);
    std::fflush(stdout);
  }
}

}  // namespace
}  // namespace tendril

int main() {
  for (const double speed : {1.0, 3.0}) {
    for (const std::string& law : tendril::kLaws) tendril::Print(law, speed);
  }
}
