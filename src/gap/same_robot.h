// Whether runs were recorded with the robot of the file used for the diagnosis, as far as the data identify
// their robot. Compares robot files only, not samples.
#pragma once

#include <stdexcept>
#include <string>
#include <vector>

#include "tendril/core/robot.h"
#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// Runs that identify another robot than the file does; no run of the set is used.
class OtherRobotError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The robot that all runs of a set must be of.
class RobotOfSet {
 public:
  /// `file`: where `robot` was read from, for messages.
  RobotOfSet(const RobotParameters& robot, std::string file, OtherRobot other);

  const RobotParameters& robot() const { return robot_; }

  /// Throws OtherRobotError, one line with every entry that differs, where `recorded` (from `where`) has
  /// another name, number of sections or tendons, encoder counts per turn, or a section length beyond
  /// plausible corrections (bounds of the effect unit_length). Other differences in gear, spool or drive, and
  /// differences that the user accepts, become notes.
  void Check(const RobotParameters& recorded, const std::string& where,
             std::vector<std::string>& notes) const;
  /// The same for a robot file's text; a text that cannot be read becomes a note, an empty one is ignored.
  void Check(const std::string& recorded_yaml, const std::string& where,
             std::vector<std::string>& notes) const;

 private:
  const RobotParameters& robot_;
  std::string file_;
  OtherRobot other_;
};

}  // namespace tendril::gap
