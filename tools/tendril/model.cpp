// `tendril model`: the body's equations evaluated row by row, CSV in, CSV out, so that any other program can
// check them. Knows no equation and no evaluation itself.
#include "model.h"

#include <iostream>
#include <memory>

#include "commands.h"
#include "tendril/config/config.h"
#include "tendril/model/coordinate_names.h"
#include "tendril/model/open_disks.h"

namespace tendril::tools {

io::CsvReader Stdin(Names required, std::vector<Names> optional) {
  return {std::cin, "stdin", std::move(required), std::move(optional)};
}

Names StrainColumns(const model::Body& body, std::string_view prefix) {
  Names names = model::CoordinateNames(body);
  for (std::string& name : names) name.insert(0, prefix);
  return names;
}

CLI::App* AddBendingEvaluation(CLI::App& model, const std::string& name, const std::string& description,
                               std::function<void(const RobotParameters&)> run) {
  CLI::App* command = model.add_subcommand(name, description);
  auto file = std::make_shared<std::string>();
  command->add_option("--robot", *file, "robot file (config/robots/*.yaml) whose units only bend")
      ->required();
  command->callback([file, name, run = std::move(run)] {
    const RobotParameters robot = config::LoadRobot(*file);
    config::RequireBendingOnly(robot.body, *file, "tendril model " + name);
    run(robot);
  });
  return command;
}

CLI::App* AddModelEvaluation(CLI::App& model, const std::string& name, const std::string& description,
                             std::function<void(const RobotParameters&)> run) {
  CLI::App* command = model.add_subcommand(name, description);
  auto file = std::make_shared<std::string>();
  command->add_option("--robot", *file, "robot file (config/robots/*.yaml)")->required();
  command->callback([file, run = std::move(run)] { run(config::LoadRobot(*file)); });
  return command;
}

Eigen::Vector3d TipOf(const io::CsvReader& rows) {
  constexpr double kFarthest_m = 1e6;
  const Eigen::Vector3d tip = Cursor(rows.required()).Take(3);
  if (tip.cwiseAbs().maxCoeff() > kFarthest_m) throw rows.Error("x,y,z must lie within 1e6 m of the base");
  return tip;
}

void RequirePulling(const io::CsvReader& rows, const Eigen::VectorXd& tension_N) {
  for (Eigen::Index j = 0; j < tension_N.size(); ++j) {
    if (tension_N[j] < 0) {
      throw rows.Error(fmt::format("T{} = {} N: tendons only pull; give 0 or more", j + 1, tension_N[j]));
    }
  }
}

void RequireOpenDisks(const io::CsvReader& rows, const model::Body& body, const Eigen::VectorXd& q) {
  if (const std::string why = model::WhyDisksClose(body, q); !why.empty()) throw rows.Error(why);
}

void AddModelCommand(CLI::App& app) {
  CLI::App* model = app.add_subcommand(
      "model",
      "Evaluate the model row by row: CSV with a header on stdin, CSV on stdout, SI units; or export it");
  model->require_subcommand(1);
  AddModelDynamicsCommands(*model);
  AddModelStaticsCommands(*model);
  AddModelForwardCommand(*model);
  AddModelReachCommand(*model);
  AddModelInverseCommands(*model);
  AddModelSimulateCommand(*model);
  AddModelExportCommand(*model);
}

}  // namespace tendril::tools
