// What `tendril init` asks, and the robot and daemon that the answers make. Every question has a suggestion
// that follows from the answers before it, down to the shipped rig. Meanings, units and ranges are those of
// the files' descriptions. Knows nothing of terminals.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "tendril/config/keys.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"

namespace tendril::first_robot {

/// Something that may be asked, before any answer.
struct Item {
  std::string_view name;       // "length_m"; of an option --length
  std::string_view path{};     // of the key whose meaning and range it has; empty: it makes up several
  bool daemon_file = false;    // the key is the daemon file's, not the robot file's
  bool usual = false;          // asked at a terminal; the others keep their suggestion unless given
  bool per_section = false;    // one value for all sections, or one a section, base first, with commas
  std::string_view meaning{};  // in place of the key's
};
std::span<const Item> Items();
/// Meaning and unit in one line: "Backbone length of a section [m]".
std::string Described(const Item& item);

/// An item at the answers so far.
struct Question {
  const Item* item = nullptr;
  config::Key key{};  // its path is the item's name; ranges are what the answers so far leave
  std::string suggestion{};
};

struct Dialogue {
  /// The answer; the suggestion where none is to be asked for.
  std::function<std::string(const Question&)> answer;
  /// After an answer that is not accepted, with the whole line; throws where asking again makes no sense.
  std::function<void(const Question&, const std::string& line)> refused;
};

struct NewRobot {
  RobotParameters robot;  // `uncertain` has what answers said, also of a section's disk_diameter_m
  DaemonParameters daemon;
  std::vector<double> disk_diameter_m{};  // of the sections
};

/// Asks all, in the order of Items(). `robot_file`: as the daemon's file names it, from the robot's name.
NewRobot Ask(const Dialogue& dialogue, const std::function<std::string(const std::string& name)>& robot_file);

}  // namespace tendril::first_robot
