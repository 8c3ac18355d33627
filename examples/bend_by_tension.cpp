// bend_by_tension ROBOT.yaml TENSION_N...: where the tip stands at rest under these tendon tensions at the
// base.
#include <cstdlib>
#include <exception>
#include <iostream>

#include "tendril/config/config.h"
#include "tendril/model/body.h"
#include "tendril/model/statics.h"

int main(int argc, char** argv) try {
  if (argc < 2) {
    std::cerr << "usage: bend_by_tension ROBOT.yaml TENSION_N...\n";
    return 2;
  }
  const tendril::RobotParameters robot = tendril::config::LoadRobot(argv[1]);
  const tendril::model::Body body(robot.body);
  if (argc - 2 != body.tendons()) {
    std::cerr << robot.name << " has " << body.tendons() << " tendons; " << argc - 2
              << " tensions are given\n";
    return 2;
  }
  Eigen::VectorXd tension_N(body.tendons());
  for (int j = 0; j < body.tendons(); ++j) tension_N[j] = std::atof(argv[2 + j]);

  using tendril::model::StaticsResult;
  const auto rest = tendril::model::SolveStatics(body, tension_N, Eigen::Vector3d::Zero());
  if (rest.result != StaticsResult::kConverged) {
    std::cerr << "no stable equilibrium; the load was followed to " << 100 * rest.load_fraction << " %\n";
    return 1;
  }
  std::cout << "tip [mm]: " << 1e3 * body.TipPose(rest.q).p_WA.transpose() << '\n';
  return 0;
} catch (const std::exception& e) {
  std::cerr << e.what() << '\n';
  return 1;
}
