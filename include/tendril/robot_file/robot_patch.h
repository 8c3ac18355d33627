// A robot file with effects folded in, edited as by hand: numbers changed in place, laws added at the end,
// comments and order kept. Knows nothing of where the effects come from.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tendril/core/robot.h"

namespace tendril::robot_file {

struct RobotPatch {
  std::string text;       // the new file
  RobotParameters robot;  // its contents
};

/// `text` is the file, `path` its name for errors. `heading` becomes comment lines at its top, one each. The
/// result, read back, is the original with the effects folded in: verified to a relative 1e-9. Throws
/// std::invalid_argument for effects that do not fit the robot, std::runtime_error when the file's layout
/// cannot be edited.
RobotPatch PatchRobot(const std::string& text, const std::string& path,
                      const std::vector<EffectSetting>& effects, const std::vector<std::string>& heading);

/// The same for other numbers: those in which `after` differs from the file, a robot of the same layout. Effects
/// at the end of its list that the file does not have are folded in.
RobotPatch PatchNumbers(const std::string& text, const std::string& path, const RobotParameters& after,
                        const std::vector<std::string>& heading);

/// The lines that differ, with - and +, and some context.
std::string DiffLines(const std::string& before, const std::string& after);

/// Largest relative difference of any number of two robots of equal layout, with their effects folded in;
/// infinity when other things differ.
double RobotDifference(const RobotParameters& a, const RobotParameters& b);

struct KeyDifference {
  std::string key, left, right;  // "nothing" where one robot lacks the key
};
/// The first key in which the resolved files differ by more than round-off, effects as they are listed; the
/// robots' names may differ. Empty when there is none.
std::optional<KeyDifference> FirstDifference(const RobotParameters& left, const RobotParameters& right);

}  // namespace tendril::robot_file
