// `tendril config check`: validates a robot or daemon file and prints it resolved; for a daemon, the bus
// budget too. `tendril config schema`: what editors need; `tendril config dbc`: what bus monitors need. Knows
// nothing of the keys.
#include "tendril/config/config.h"

#include <fmt/core.h>

#include <memory>
#include <string>

#include "commands.h"
#include "tendril/config/schema.h"
#include "tendril/config/whole_file.h"
#include "tendril/daemon/file_check.h"
#include "tendril/daemon/wiring.h"
#include "tendril/exchange/dbc.h"
#include "tendril/first_robot/drawing.h"
#include "tendril/model/bending_model.h"
#include "tendril/sim/effects.h"

namespace tendril::tools {
namespace {

/// Anything else could be a file that the user still needs, such as the robot's own.
std::string DrawingNamed(const std::string& file) {
  return file.ends_with(".svg") ? "" : "'" + file + "' is not a drawing; accepted: a name that ends in .svg";
}

void Draw(const RobotParameters& robot, const std::string& file) {
  if (!file.empty()) config::WriteWhole(file, first_robot::Drawing(model::ControlModel(robot)));
}

void Check(const std::string& path, const std::string& drawing) {
  if (config::KindOf(path) == "robot") {
    const RobotParameters robot = sim::LoadRobot(path);
    Draw(robot, drawing);
    fmt::print("{}{}{}{}", config::ToYaml(robot), daemon::FiguresComment(robot),
               daemon::UncertaintyComment(robot), daemon::DirectionsComment(robot));
    return;
  }
  const DaemonParameters daemon = config::LoadDaemon(path);
  const RobotParameters robot = sim::LoadRobot(daemon.robot_file);
  const std::string checked = daemon::CheckedText(daemon, robot, path);
  Draw(robot, drawing);
  fmt::print("{}", checked);
  for (const std::string& line : daemon::FileWarnings(daemon, robot, path))
    fmt::print(stderr, "warning: {}\n", line);
}

void PrintDbc(const std::string& path) {
  const DaemonParameters daemon = config::LoadDaemon(path);
  const RobotParameters robot = sim::LoadRobot(daemon.robot_file);
  fmt::print("{}", exchange::Dbc(robot, daemon.bus, daemon::DriveSetups(robot, daemon.bus)));
}

void AddDbcCommand(CLI::App& group) {
  CLI::App* dbc = group.add_subcommand(
      "dbc",
      "CAN database (DBC) of a daemon's bus for monitors and other programs: PDOs, emergencies, SYNC, "
      "heartbeats, "
      "NMT and SDO of every node, with torques in Nm, angles in rad and load cells in N");
  auto file = std::make_shared<std::string>();
  dbc->add_option("FILE", *file, "daemon file (config/tendrild.yaml)")->required();
  dbc->callback([file] { PrintDbc(*file); });
}

}  // namespace

void AddConfigCommand(CLI::App& app) {
  CLI::App* group = app.add_subcommand("config", "Robot and daemon files");
  group->require_subcommand(1);
  CLI::App* check =
      group->add_subcommand("check",
                            "Validate a robot or daemon file and print it resolved, with what its numbers "
                            "amount to (stiffness, sag, frequencies, torque of a full bend) and of which the "
                            "file says how well they are "
                            "known ({value: 2.3e10, within: 10 %}); for a daemon, the bus "
                            "budget too, and on stderr a warning for each accepted value that makes no sense "
                            "on its robot, such as a guard that cannot trip");
  auto file = std::make_shared<std::string>();
  check->add_option("FILE", *file, "robot file (config/robots/*.yaml) or daemon file (config/tendrild.yaml)")
      ->required();
  auto drawing = std::make_shared<std::string>();
  check->add_option("--draw", *drawing, "write a side view of the robot, straight and fully bent, as SVG")
      ->option_text("FILE.svg")
      ->check(DrawingNamed);
  check->callback([file, drawing] { Check(*file, *drawing); });

  AddDbcCommand(*group);
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
