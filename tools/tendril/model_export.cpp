// `tendril model export`: the robot in the formats of other simulators. Knows no format.
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <system_error>

#include "commands.h"
#include "model.h"
#include "number_option.h"
#include "tendril/config/config.h"
#include "tendril/config/whole_file.h"
#include "tendril/exchange/robot_model.h"
#include "tendril/sim/effects.h"

namespace tendril::tools {
namespace {

struct ModelExport {
  std::string robot, mjcf, urdf, actuators = "auto";
  std::optional<double> friction_at_N, timestep_s;
  bool overwrite = false;
};

void CheckNew(const std::string& file, const ModelExport& o) {
  std::error_code none;
  if (file.empty()) return;
  if (std::filesystem::equivalent(file, o.robot, none))
    throw UsageError(file + " is the robot file itself; give another name");
  if (!o.overwrite && std::filesystem::is_regular_file(file, none))
    throw UsageError(file + " already exists; give another name, or --overwrite to replace it");
  config::CheckMayWrite(file);
}

void Write(const std::string& file, const char* format, const exchange::Exported& exported) {
  config::WriteWhole(file, exported.text);
  fmt::print(stderr, "{}: not carried by {}:\n", file, format);
  for (const std::string& line : exported.left_out) fmt::print(stderr, "  {}\n", line);
}

void ExportModel(const ModelExport& o) {
  if (o.mjcf.empty() && o.urdf.empty())
    throw UsageError("nothing to write; give --mjcf FILE, --urdf FILE, or both");
  const auto place = [](const std::string& file) {
    std::error_code none;  // then the names are compared as they are
    const std::filesystem::path whole =
        std::filesystem::weakly_canonical(std::filesystem::absolute(file), none);
    return none ? std::filesystem::path(file) : whole;
  };
  if (!o.mjcf.empty() && !o.urdf.empty() && place(o.mjcf) == place(o.urdf))
    throw UsageError("--mjcf and --urdf are one file; give two names");
  const RobotParameters robot = sim::FoldEffects(sim::LoadRobot(o.robot));
  config::RequireBendingOnly(robot.body, o.robot, "tendril model export");
  exchange::MjcfOptions options{{}, o.friction_at_N, o.timestep_s};
  if (o.actuators != "auto") options.actuators = exchange::ActuatorsOf(o.actuators);
  if (options.actuators == exchange::Actuators::kMotors && !robot.actuation)
    throw UsageError("--actuators motors: " + o.robot + " has no actuation; accepted: tensions");
  CheckNew(o.mjcf, o);
  CheckNew(o.urdf, o);
  if (!o.mjcf.empty()) Write(o.mjcf, "MJCF", exchange::Mjcf(robot, options));
  if (!o.urdf.empty()) Write(o.urdf, "URDF", exchange::Urdf(robot));
}

}  // namespace

void AddModelExportCommand(CLI::App& model) {
  auto o = std::make_shared<ModelExport>();
  CLI::App* command =
      model.add_subcommand("export",
                           "The robot for other simulators, and on stderr what their format cannot carry: "
                           "MJCF for MuJoCo with tendons, "
                           "actuators and friction, URDF for ROS with the kinematic chain and its inertias");
  command->add_option("--robot", o->robot, "robot file (config/robots/*.yaml)")->required();
  command->add_option("--mjcf", o->mjcf, "write MJCF")->option_text("FILE");
  command->add_option("--urdf", o->urdf, "write URDF")->option_text("FILE");
  command
      ->add_option(
          "--actuators", o->actuators,
          "of the MJCF: tensions at the base [N], or motors [N m] with gears, spools, elastic tendons and "
          "constant friction; auto: motors where the robot file has them, one a tendon")
      ->check(CLI::IsMember({"auto", "motors", "tensions"}))
      ->capture_default_str();
  command
      ->add_option(
          "--friction-at", o->friction_at_N,
          "tension at the base [N] at which constant friction is as wide as that of pulleys and gears, "
          "which grows with the tension; default: limits.min_tension_N")
      ->check(NumberFrom(0, 1e4, "give newtons"));
  command
      ->add_option(
          "--timestep", o->timestep_s,
          "of the MJCF [s]; default: 1, 2 or 5 times a power of ten, by the robot's highest frequency")
      ->check(NumberFrom(1e-7, 0.1, "give seconds"));
  command->add_flag("--overwrite", o->overwrite, "replace files that are there");
  command->callback([o] { ExportModel(*o); });
}

}  // namespace tendril::tools
