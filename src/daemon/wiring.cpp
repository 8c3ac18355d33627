// From configuration to drive set-ups; see the header.
#include "tendril/daemon/wiring.h"

#include <cmath>
#include <stdexcept>
#include <string>

namespace tendril::daemon {
namespace {

// Units of the bus: integers in millionths or thousandths.
std::uint32_t Scaled(double value, double scale) {
  return static_cast<std::uint32_t>(std::lround(value * scale));
}

}  // namespace

std::vector<canopen::DriveSetup> DriveSetups(const RobotParameters& robot, const BusParameters& bus) {
  if (!robot.actuation) {
    throw std::invalid_argument("robot '" + robot.name +
                                "' has no actuation: a body alone cannot be driven; choose a " +
                                "robot file with motors and drives, for example config/robots/rig_90mm.yaml");
  }
  std::vector<canopen::DriveSetup> setups;
  int tendon = 0;
  for (const TendonDriveParameters& t : robot.actuation->tendons) {
    if (!robot.actuation->HasDrive(tendon++)) continue;
    canopen::DriveSetup setup;
    const NodeParameters* pulls = nullptr;
    for (const NodeParameters& node : bus.nodes) {
      if (node.tendon == tendon) pulls = &node;
    }
    if (pulls == nullptr) {
      throw std::invalid_argument("tendon " + std::to_string(tendon) + " of robot '" + robot.name +
                                  "' has no drive: add it to bus.nodes");
    }
    setup.node_id = pulls->node_id;
    setup.profile = canopen::ProfileOf(*pulls);
    setup.nominal_current_mA = Scaled(t.motor.nominal_current_A, 1e3);
    setup.output_current_limit_mA = Scaled(t.drive.current_limit_A, 1e3);
    setup.torque_constant_uNmpA = Scaled(t.motor.torque_constant_NmpA, 1e6);
    setup.rated_torque_uNm = Scaled(t.drive.rated_torque_Nm, 1e6);
    if (const std::string problem = canopen::Unsupported(bus, setup); !problem.empty()) {
      throw std::invalid_argument(
          problem + "; accepted: a drive that can be node " + std::to_string(setup.node_id) +
          "; correct its keys in bus.nodes, or take another drive or a newer EDS file");
    }
    setups.push_back(setup);
  }
  return setups;
}

io::RobotShape ShapeOf(const RobotParameters& robot) {
  return {static_cast<int>(robot.body.sections.size()), robot.body.units(), robot.body.tendons()};
}

}  // namespace tendril::daemon
