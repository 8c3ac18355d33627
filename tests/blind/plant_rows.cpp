// Torque targets in, true signals of the plant out, a row a millisecond: what the foreign plant is compared
// with. Knows the plant's interface only.
#include <cstdio>
#include <exception>
#include <iostream>
#include <sstream>
#include <string>
#include <vector>

#include "tendril/config/config.h"
#include "tendril/sim/plant.h"

namespace {

std::vector<Eigen::VectorXd> ReadTargets(int tendons) {
  std::vector<Eigen::VectorXd> rows;
  for (std::string line; std::getline(std::cin, line);) {
    std::istringstream in(line);
    Eigen::VectorXd row(tendons);
    for (int j = 0; j < tendons; ++j) {
      if (!(in >> row[j]))
        throw std::runtime_error("line " + std::to_string(rows.size() + 1) + ": too few numbers");
    }
    rows.push_back(row);
  }
  return rows;
}

int Run(const std::string& robot_file) {
  const tendril::RobotParameters robot = tendril::config::LoadRobot(robot_file);
  tendril::sim::PlantOptions options;
  options.sensor_noise = false;
  tendril::sim::Plant plant(robot, options);
  constexpr tendril::TimeNs kPeriod_ns = 1'000'000;
  const auto targets = ReadTargets(plant.tendons());
  for (const Eigen::VectorXd& target : targets) {
    for (const auto& t : plant.tendon()) {
      std::printf("%.9g %.9g %.9g %.9g ", t.motor_torque_Nm, t.motor_angle_rad, t.tension_motor_N,
                  t.tension_base_N);
    }
    const auto tip = plant.TipPose();
    const Eigen::Quaterniond q(tip.R_WA);
    std::printf("%.9g %.9g %.9g %.9g %.9g %.9g %.9g\n", tip.p_WA.x(), tip.p_WA.y(), tip.p_WA.z(), q.w(),
                q.x(), q.y(), q.z());
    // Sent at this row, it acts at the next one; what was sent before it acts until then.
    plant.Advance(kPeriod_ns);
    plant.SetTorque(target);
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    if (argc != 2) {
      std::fprintf(stderr, "usage: plant_rows ROBOT.yaml < targets (one row a millisecond, N m)\n");
      return 2;
    }
    return Run(argv[1]);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "plant_rows: %s\n", error.what());
    return 1;
  }
}
