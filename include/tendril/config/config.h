// Strict YAML to validated structs and back. Every refusal is one line: file:line: key: what is wrong, the
// accepted range with its unit, and the remedy. Knows nothing of what the numbers are used for.
#pragma once

#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "tendril/core/daemon.h"
#include "tendril/core/fault.h"
#include "tendril/core/robot.h"

namespace tendril::config {

/// An error in a configuration file; what() is the whole line.
class ConfigError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Robot file (config/robots/*.yaml). Throws ConfigError for unknown, missing and duplicate keys, wrong types
/// and values out of range.
RobotParameters LoadRobot(const std::string& path);
RobotParameters ParseRobot(const std::string& yaml, const std::string& name_for_errors);

/// Daemon file (config/tendrild.yaml); the robot file it names is resolved but not loaded.
DaemonParameters LoadDaemon(const std::string& path);
DaemonParameters ParseDaemon(const std::string& yaml, const std::string& name_for_errors);

/// Scenario file for tendril-plant (config/scenarios/*.yaml): the faults in the order of the file.
std::vector<FaultParameters> LoadScenario(const std::string& path);
/// One fault in one line: a kind, then the scenario's keys as key=value ("drop node=2 probability=0.1
/// for_s=5").
FaultParameters ParseFault(const std::string& text, const std::string& name_for_errors);

/// The resolved configuration with every value spelled out; parsing it gives the same struct again.
std::string ToYaml(const RobotParameters& robot);
std::string ToYaml(const DaemonParameters& daemon);

/// Checks that both files fit each other: every tendon has exactly one node, and all nodes differ. Throws
/// ConfigError.
void CheckTogether(const DaemonParameters& daemon, const RobotParameters& robot,
                   const std::string& daemon_path);

/// Refuses, at its `strains` or `units_per_disk`, a body that does more than bend unit by unit, for `what`
/// ("tendril model ik"), which knows bending alone. Throws ConfigError.
void RequireBendingOnly(const BodyParameters& body, const std::string& robot_path, std::string_view what);

/// Warnings for accepted values of the daemon file that make no sense on this robot (a guard that cannot
/// trip, or hardly; a ramp that is a jump): file, line, key, value, reason, and a value that does.
/// max_slack_s is never among them, since its range ends at a minute. Both files must fit each other.
std::vector<std::string> Warnings(const DaemonParameters& daemon, const RobotParameters& robot,
                                  const std::string& daemon_path);

/// An error at `key` ("bus.nodes", "effects[2]") of the file, with the key's line if the file can still be
/// read. `text` is the error, the accepted range and the remedy, separated by "; ".
ConfigError ErrorAt(const std::string& path, std::string_view key, const std::string& text);

/// "robot", "daemon" or "scenario", by the file's top-level keys. Throws ConfigError when it is none.
std::string KindOf(const std::string& path);

}  // namespace tendril::config
