// The laws that effects add to a plant, collected before it is built: per tendon, for the body, for the
// sensors. Plant and Replay both take them from here, so an effect is written once.
#pragma once

#include <vector>

#include "body_laws.h"
#include "tendon_laws.h"

namespace tendril::sim {

class PlantLaws {
 public:
  explicit PlantLaws(int tendons) : tendon(static_cast<std::size_t>(tendons)), sensor(tendons) {}

  std::vector<TendonLaws> tendon;  // tendon_laws.h: from drive command to base tension
  BodyLaws body;                   // body_laws.h: along the disks, and on the units
  SensorLaws sensor;               // tendon_laws.h: encoder, load cell, tracker

  /// Laws of all entries of robot.effects that are laws (parameters are folded before, see FoldEffects).
  static PlantLaws Of(const RobotParameters& robot);
};

}  // namespace tendril::sim
