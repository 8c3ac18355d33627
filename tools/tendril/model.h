// What the files of `tendril model` share: the robot option, columns of a row and checks that every row goes
// through. Knows nothing of the single evaluations.
#pragma once

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <Eigen/Core>
#include <cstdio>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "tendril/core/robot.h"
#include "tendril/io/csv.h"
#include "tendril/model/body.h"

namespace tendril::tools {

using Names = std::vector<std::string>;

/// u1,v1[,w1][,e1],u2,.. of the units, each name after `prefix` ("", "d", "dd").
Names StrainColumns(const model::Body& body, std::string_view prefix);
inline Names Positions(const model::Body& body) { return StrainColumns(body, ""); }
inline Names Velocities(const model::Body& body) { return StrainColumns(body, "d"); }
inline Names Tensions(int tendons) { return io::Numbered("T", tendons); }

io::CsvReader Stdin(Names required, std::vector<Names> optional = {});

/// Next `count` values of a row.
class Cursor {
 public:
  explicit Cursor(std::span<const double> values) : values_(values) {}
  Eigen::VectorXd Take(int count) {
    const Eigen::VectorXd taken = Eigen::Map<const Eigen::VectorXd>(values_.data(), count);
    values_ = values_.subspan(static_cast<std::size_t>(count));
    return taken;
  }

 private:
  std::span<const double> values_;
};

/// Rows whose target is out of reach: the first few by line, the rest as a number at the end.
class Unmet {
 public:
  void Add(const io::CsvReader& rows, const std::string& what) {
    if (++count_ <= kShown) fmt::print(stderr, "tendril: stdin: line {}: {}\n", rows.line(), what);
  }
  ~Unmet() {
    if (count_ > kShown) fmt::print(stderr, "tendril: {} rows with such a remark in total\n", count_);
  }

 private:
  static constexpr std::size_t kShown = 10;
  std::size_t count_ = 0;
};

/// A subcommand of `tendril model` with its --robot FILE (required); `run(robot)` is called with the loaded
/// file.
CLI::App* AddModelEvaluation(CLI::App& model, const std::string& name, const std::string& description,
                             std::function<void(const RobotParameters&)> run);
/// The same of what knows bending alone: refuses files with other strains.
CLI::App* AddBendingEvaluation(CLI::App& model, const std::string& name, const std::string& description,
                               std::function<void(const RobotParameters&)> run);

/// The required columns of a row that begin with x, y, z of a tip in metres. Throws for the current row when
/// it is so far away that distances would overflow.
Eigen::Vector3d TipOf(const io::CsvReader& rows);
/// Throws for the current row when a tension is negative: tendons only pull.
void RequirePulling(const io::CsvReader& rows, const Eigen::VectorXd& tension_N);
/// Throws for the current row when a unit is bent so far that its disks would cut through each other.
void RequireOpenDisks(const io::CsvReader& rows, const model::Body& body, const Eigen::VectorXd& q);

// Each adds its evaluations: accel, mass, energy; statics, frequencies; fk; ik; inverse, inverse-tip;
// simulate; export. Help lists them in the order in which they are added.
void AddModelDynamicsCommands(CLI::App& model);
void AddModelStaticsCommands(CLI::App& model);
void AddModelForwardCommand(CLI::App& model);
void AddModelReachCommand(CLI::App& model);
void AddModelInverseCommands(CLI::App& model);
void AddModelSimulateCommand(CLI::App& model);
void AddModelExportCommand(CLI::App& model);

}  // namespace tendril::tools
