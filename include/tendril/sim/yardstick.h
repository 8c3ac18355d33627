// Scales for the parameters of effects on a robot, from 30 mm and a gram to metres and kilograms. Knows the
// robot file; knows no effect.
#pragma once

#include <optional>
#include <string_view>

#include "tendril/core/robot.h"

namespace tendril::sim {

/// A quantity of the robot file to which a parameter's bounds and its clearly visible deviation are
/// proportional.
enum class Yardstick {
  kNone,          // a ratio, a direction, a time constant of electronics or material: equal on every robot
  kLength,        // m: the whole robot
  kPerLength,     // 1/m
  kTipForce,      // N: force at the tip that bends the robot by about a radian, EI / L^2, and its weight
  kTipMass,       // kg: mass of that weight; without gravity the robot's own mass
  kTipStiffness,  // N/m: kTipForce over the length
  kUnitBend,      // rad: a unit's share of the section's largest bend
  kUnitMoment,    // N·m: moment for that bend
  kTension,       // N: the largest at the base
  kMotorTorque,   // N·m: the motor's nominal torque
  kTorqueLimit,   // N·m: at the drive's current limit
  kSpool,         // m: its radius
  kTendonTravel,  // m: of a tendon from straight to the largest bend, and its stretch at the largest tension
  kMotorTravel,   // rad: of the motor along kTendonTravel
  kMotorSpeed,    // rad/s: of the motor while the body bends by 1 rad/s
};

/// `bound` scales the bounds, `visible` the clearly visible deviation. They differ for the two travels (a
/// tendon may be off by its full travel, but that is visible as soon as it changes tension or bend by a part
/// of their limits, with travel and stretch as springs in series), and for loads at the tip (some times the
/// robot's weight, but visible as soon as they move the tip by a part of the length).
struct Measure {
  double bound = 0, visible = 0;
};

/// One tendon or one section (from 0); where empty, the mean of all.
struct Place {
  std::optional<int> tendon{}, section{};
};

/// Ratio to the reference rig (the shipped rig_90mm), for which the registry of effects holds its numbers:
/// both 1 there. Also 1 where the robot lacks the quantity, as without actuation.
Measure OverReference(Yardstick yardstick, const RobotParameters& robot, const Place& place = {});

/// Text such as "robot length".
std::string_view TextOf(Yardstick yardstick);

}  // namespace tendril::sim
