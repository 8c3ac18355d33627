// `tendril config check`: validates a robot or daemon file and prints it resolved; for a daemon, the bus
// budget too. `tendril config schema`: what editors need. Knows nothing of the keys.
#include "tendril/config/config.h"
#include "tendril/config/schema.h"

#include <fmt/core.h>

#include <memory>
#include <string>

#include "commands.h"
#include "tendril/daemon/file_check.h"
#include "tendril/sim/effects.h"

namespace tendril::tools {
namespace {

void Check(const std::string& path) {
  if (config::KindOf(path) == "robot") {
    const RobotParameters robot = sim::LoadRobot(path);
    fmt::print("{}{}", config::ToYaml(robot), daemon::DirectionsComment(robot));
    return;
  }
  const DaemonParameters daemon = config::LoadDaemon(path);
  const RobotParameters robot = sim::LoadRobot(daemon.robot_file);
  fmt::print("{}", daemon::CheckedText(daemon, robot, path));
  for (const std::string& line : daemon::FileWarnings(daemon, robot, path))
    fmt::print(stderr, "warning: {}\n", line);
}

}  // namespace

void AddConfigCommand(CLI::App& app) {
  CLI::App* group = app.add_subcommand("config", "Robot and daemon files");
  group->require_subcommand(1);
  CLI::App* check =
      group->add_subcommand("check",
                            "Validate a robot or daemon file and print it resolved; for a daemon, the bus "
                            "budget too, and on stderr a warning for each accepted value that makes no sense "
                            "on its robot, such as a guard that cannot trip");
  auto file = std::make_shared<std::string>();
  check->add_option("FILE", *file, "robot file (config/robots/*.yaml) or daemon file (config/tendrild.yaml)")
      ->required();
  check->callback([file] { Check(*file); });

  CLI::App* schema = group->add_subcommand(
      "schema", "JSON Schema of the robot or daemon file, for completion and checks in editors");
  auto kind = std::make_shared<std::string>();
  schema->add_option("KIND", *kind, "robot or daemon")->required()->check(CLI::IsMember({"robot", "daemon"}));
  schema->footer(
      "An editor with yaml-language-server reads it for a file whose first lines name it:\n"
      "# yaml-language-server: $schema=PATH\n"
      "The installed copies are robot.schema.json and daemon.schema.json in share/tendril/schema.");
  schema->callback([kind] {
    fmt::print("{}", *kind == "robot" ? config::RobotFileSchema() : config::DaemonFileSchema());
  });
}

}  // namespace tendril::tools
