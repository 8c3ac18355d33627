// What the files of `tendril model` share: the robot option and checks that every row goes through.
// Knows nothing of the single evaluations.
#pragma once

#include <CLI/CLI.hpp>
#include <memory>
#include <span>
#include <string>

#include "tendril/io/csv.h"
#include "tendril/model/body.h"

namespace tendril::tools {

/// A subcommand of `tendril model` with its --robot FILE (required); `run(robot)` is called with the loaded
/// file.
CLI::App* AddModelEvaluation(CLI::App& model, const std::string& name, const std::string& description,
                             std::function<void(const RobotParameters&)> run);

/// Throws for the current row when a tension is negative: tendons only pull.
void RequirePulling(const io::CsvReader& rows, const Eigen::VectorXd& tension_N);
/// Throws for the current row when a unit is bent so far that its disks would cut through each other.
void RequireOpenDisks(const io::CsvReader& rows, const model::Body& body, const Eigen::VectorXd& q);

/// ik, inverse, inverse-tip.
void AddModelInverseCommands(CLI::App& model);

}  // namespace tendril::tools
