// What both formats say of a robot's body: its units, the hinges of a unit, the holes of the tendons.
#pragma once

#include <Eigen/Core>
#include <array>
#include <string>
#include <vector>

#include "tendril/core/robot.h"
#include "tendril/model/body.h"

namespace tendril::exchange {

struct Unit {
  int number = 0;                    // along the whole robot, from 1
  double length_m = 0, mass_kg = 0;  // with the payload
  double inertia_xx_kgm2 = 0, inertia_zz_kgm2 = 0;
  double stiffness_Nm = 0, damping_Nms = 0;
  Eigen::Vector2d rest_rad{0, 0};
  double core_radius_m = 0;
  double limit_rad = 0;  // its share of limits.max_bending_rad
};

std::vector<Unit> UnitsOf(const RobotParameters& robot, const model::Body& body);

struct Hinge {
  const char* name;     // of the joint, after "unit3_"
  const char* follows;  // the hinge that it equals; null: none
  const char* axis;
  int direction;  // 0: u, 1: v
  bool at_end;    // of the unit, else at its beginning
};
inline constexpr std::array<Hinge, 4> kHinges = {{{"u", nullptr, "0 1 0", 0, false},
                                                  {"v", nullptr, "-1 0 0", 1, false},
                                                  {"v_end", "v", "-1 0 0", 1, true},
                                                  {"u_end", "u", "0 1 0", 0, true}}};

/// Distance of the first hinges from the unit's beginning, and of the last from its end, in unit lengths.
double HingePlace(const Unit& unit);
/// From the unit's beginning [m].
double Along(const Unit& unit, const Hinge& hinge);

/// Holes of a tendon (0-based) in the frames of the base disk and of each disk up to its last [m].
std::vector<Eigen::Vector3d> HolesOf(const model::Body& body, int tendon);

/// Radius of the disks as drawn: the tendons run within.
inline double DrawnDisk_m(const BodyParameters& body) { return 1.2 * body.largest_hole_m(); }

/// The comment at a file's top: what it is of, how it is meant, and what it leaves out.
std::vector<std::string> Heading(const RobotParameters& robot, const std::string& meaning,
                                 const std::vector<std::string>& left_out);

/// What no format of rigid bodies has of this robot.
std::vector<std::string> LeftOutOfBoth(const RobotParameters& robot);

}  // namespace tendril::exchange
