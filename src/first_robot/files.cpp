// Resolved, with each key's meaning above it, and what to do about what nobody was asked.
#include "tendril/first_robot/files.h"

#include <fmt/format.h>

#include <regex>
#include <stdexcept>

#include "tendril/config/answer.h"
#include "tendril/config/config.h"
#include "tendril/config/whole_file.h"

namespace tendril::first_robot {
namespace {

std::string Head(const std::string& schema, const std::string& text) {
  return (schema.empty() ? "" : fmt::format("# yaml-language-server: $schema={}\n", schema)) + text +
         "# SI units; the unit of each number is the end of its key. Keys with a default may be left "
         "out.\n\n";
}

/// The disks' diameter in place of the inertias that follow from it.
std::string WithDiameters(std::string yaml, const NewRobot& made) {
  static const std::regex kInertias(R"(disk_inertia_xx_kgm2: \S+\n( *)disk_inertia_zz_kgm2: \S+)");
  for (std::size_t k = 0; k < made.disk_diameter_m.size(); ++k) {
    std::string number = fmt::format("{}", made.disk_diameter_m[k]);
    const auto said = made.robot.uncertain.find(fmt::format("body.sections[{}].disk_diameter_m", k + 1));
    if (said != made.robot.uncertain.end())
      number = fmt::format("{{value: {}, within: {}}}", number, UncertaintyText(said->second));
    yaml = std::regex_replace(yaml, kInertias, "disk_diameter_m: " + number,
                              std::regex_constants::format_first_only);
  }
  return yaml;
}

}  // namespace

std::string RobotFileText(const NewRobot& made, const std::string& schema) {
  const std::string head =
      "# Tendril robot file, written by `tendril init`.\n"
      "# Friction, damping, tendon stiffness, noise and pulleys that no answer gave are those of the shipped "
      "rig, in\n"
      "# proportion: measure them, or let `tendril gap diagnose` find them.\n"
      "# Any number may say how well it is known, as one standard deviation: {value: 2.3e10, within: 10 %}, "
      "or\n"
      "# within: 2e9 in its own unit, or known, or unknown. Of all others what is usual for their kind "
      "holds.\n";
  const std::string yaml = WithDiameters(config::ToYaml(made.robot), made);
  return Head(schema, head) + config::WithMeanings(yaml, config::RobotFileKeys());
}

std::string DaemonFileText(const NewRobot& made, const std::string& schema) {
  const std::string head = fmt::format(
      "# tendrild for {}, written by `tendril init`. Thresholds of the guards are those of the shipped\n"
      "# rig, in proportion to the tendons' travel and tension.\n",
      made.robot.name);
  return Head(schema, head) + config::WithMeanings(config::ToYaml(made.daemon), config::DaemonFileKeys());
}

FilePair FilesFor(const std::filesystem::path& folder, const std::string& name, bool replace) {
  FilePair files{folder / (name + ".yaml"), folder / (name + "_tendrild.yaml")};
  for (const auto& file : {files.robot, files.daemon}) {
    std::error_code none;  // what cannot be looked at is not there; making the folder says why
    if (!replace && std::filesystem::exists(file, none))
      throw std::runtime_error(file.string() +
                               " exists; give another --name, another folder, or --force to replace it");
  }
  return files;
}

void WriteFiles(const NewRobot& made, const FilePair& files, const FilePair& schemas) {
  for (const auto& file : {files.robot, files.daemon}) config::CheckMayWrite(file);
  config::WriteWhole(files.robot, RobotFileText(made, schemas.robot.string()));
  config::WriteWhole(files.daemon, DaemonFileText(made, schemas.daemon.string()));
}

}  // namespace tendril::first_robot
