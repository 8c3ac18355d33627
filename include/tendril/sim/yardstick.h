// What the numbers of effects are measured by on a robot, from 30 mm and a gram to metres and kilograms.
// Knows the robot file; knows no effect.
#pragma once

#include <optional>
#include <string_view>

#include "tendril/core/robot.h"

namespace tendril::sim {

/// A quantity of the robot file that a parameter's bounds and its plainly visible deviation are in proportion
/// to.
enum class Yardstick {
  kNone,          // a ratio, a direction, a time of electronics or of a material: alike on every robot
  kLength,        // m: the whole robot
  kPerLength,     // 1/m
  kTipForce,      // N: what bends the robot at its tip by a radian or so, EI / L^2, and its weight
  kTipMass,       // kg: what weighs as much; without gravity the robot's own mass
  kTipStiffness,  // N/m: kTipForce over the length
  kUnitBend,      // rad: a unit's share of the section's largest bend
  kUnitMoment,    // N·m: what bends a unit by that much
  kTension,       // N: the largest at the base
  kMotorTorque,   // N·m: the motor's nominal torque
  kTorqueLimit,   // N·m: at the drive's current limit
  kSpool,         // m: its radius
  kTendonTravel,  // m: of a tendon from straight to the largest bend, and its stretch at the largest tension
  kMotorTravel,   // rad: of the motor along kTendonTravel
  kMotorSpeed,    // rad/s: of the motor while the body bends by 1 rad/s
};

/// Bounds follow `bound` and what is plainly seen follows `visible`. They differ for the two travels, where a
/// tendon may be off by as far as it goes, which is seen as soon as it changes tension or bend by a part of
/// their limits, travel and stretch as springs in series; and for what pulls at the tip, which may be some
/// times the robot's weight and is seen as soon as it moves the tip by a part of the length.
struct Measure {
  double bound = 0, visible = 0;
};

/// One tendon, one section (counted from 0), or, where empty, the mean of all.
struct Place {
  std::optional<int> tendon{}, section{};
};

/// Over that of the reference rig (the shipped rig_90mm), whose numbers the registry of effects holds: both 1
/// there. Also 1 where the robot does not have what it takes, as without actuation.
Measure OverReference(Yardstick yardstick, const RobotParameters& robot, const Place& place = {});

/// "robot length": for people.
std::string_view TextOf(Yardstick yardstick);

}  // namespace tendril::sim
