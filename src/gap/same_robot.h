// Whether runs were recorded with the robot of the file that they are diagnosed with, as far as the data name
// their robot. Compares robot files only; looks at no sample.
#pragma once

#include <stdexcept>
#include <string>
#include <vector>

#include "tendril/core/robot.h"
#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// Runs that name another robot than the file does: no run of the set is used.
class OtherRobotError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The robot that all runs of a set have to be of.
class RobotOfSet {
 public:
  /// `file`: what `robot` was read from, for messages.
  RobotOfSet(const RobotParameters& robot, std::string file, OtherRobot other);

  const RobotParameters& robot() const { return robot_; }

  /// Throws OtherRobotError, one line with every entry that differs, where `recorded`, which `where` holds,
  /// has another name, number of sections or tendons, encoder counts per turn, or a section longer or shorter
  /// than a correction of the file makes it (bounds of the effect unit_length). What differs besides in gear,
  /// spool or drive, or is accepted by the user, becomes a note.
  void Check(const RobotParameters& recorded, const std::string& where,
             std::vector<std::string>& notes) const;
  /// The same of a robot file's text; one that cannot be read becomes a note, an empty one says nothing.
  void Check(const std::string& recorded_yaml, const std::string& where,
             std::vector<std::string>& notes) const;

 private:
  const RobotParameters& robot_;
  std::string file_;
  OtherRobot other_;
};

}  // namespace tendril::gap
