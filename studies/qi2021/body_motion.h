// The body alone, without motors and pulleys: how it is mounted, bent and pulled in section 3. Knows the
// model room only.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "study.h"
#include "tendril/model/body.h"
#include "tendril/model/simulate.h"

namespace tendril::qi2021 {

/// Constant tensions from 0 on.
model::TensionProfile Constant(const Eigen::VectorXd& tension_N, double until_s);

/// The same bend of every unit.
Eigen::VectorXd Bent(const model::Body& body, double theta_rad, double beta_rad);

/// Energy of body and constant tensions: what is conserved without damping.
double TotalEnergy(const model::Body& body, const Eigen::VectorXd& tension_N, const Eigen::VectorXd& q,
                   const Eigen::VectorXd& dq, model::Body::Workspace& workspace);

/// Columns and rows of a motion's series: time, u of all units, v of all units.
std::vector<std::string> UnitColumns(const model::Body& body);
void PutState(Series& series, double t_s, const Eigen::VectorXd& q);

struct Placement {
  const char* name;
  Eigen::Vector3d gravity_direction;
};
/// The paper does not say how the robot is mounted. The straight robot points along +z, tendon 1 bends it to
/// +x.
inline const Placement kPlacements[] = {{"upright", {0, 0, -1}},
                                        {"hanging", {0, 0, 1}},
                                        {"horizontal, bends upwards", {-1, 0, 0}},
                                        {"horizontal, bends downwards", {1, 0, 0}},
                                        {"horizontal, bends sideways", {0, -1, 0}}};

BodyParameters Placed(BodyParameters p, const Placement& placement);

/// How long free and undamped motions are watched.
inline constexpr double kLongRun_s = 20;

}  // namespace tendril::qi2021
