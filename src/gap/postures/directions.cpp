// One regression a section, of its end on the angles of all motors.
#include "directions.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <cmath>
#include <numbers>
#include <optional>

#include "../rotation.h"
#include "predict.h"
#include "tendril/model/body.h"

namespace tendril::gap {
namespace {

class Reading {
 public:
  Reading(const Postures& postures, const RobotParameters& robot)
      : postures_(postures),
        robot_(robot),
        body_(robot.body),
        R_(Rotation(PostureRobot::Of(robot).turn_rad)) {
    const Eigen::MatrixXd angles = postures.Stacked(&States::motor_rad);
    motors_ = angles.rowwise() - angles.colwise().mean();
    // Motors that turn together share what they do; those of a pair turn against each other.
    by_motors_.compute(motors_);
  }

  /// M x 2: x and y in the base's axes that a section's end moves by, past the section before, per radian;
  /// empty where no marker shows it.
  std::optional<Eigen::MatrixX2d> Response(int section) const {
    const std::optional<int> end = FirstFrom(EndDisk(section));
    if (!end) return std::nullopt;
    Eigen::MatrixX3d moved = Place(*end);
    if (const auto before = section > 0 ? FirstFrom(EndDisk(section - 1)) : std::nullopt;
        before && *before != *end)
      moved -= Place(*before);
    const Eigen::MatrixX3d in_base = moved * R_;
    return by_motors_.solve(in_base.leftCols<2>().rowwise() - in_base.leftCols<2>().colwise().mean());
  }

  /// By more than a step of its encoder.
  bool Turns(Eigen::Index motor) const {
    const double counts =
        robot_.actuation->tendons[static_cast<std::size_t>(motor)].drive.encoder_counts_per_turn;
    const double rms_rad = motors_.col(motor).norm() / std::sqrt(static_cast<double>(motors_.rows()));
    return rms_rad * counts > 2 * std::numbers::pi;
  }

 private:
  int EndDisk(int section) const {
    int disk = 0;
    while (body_.disk_unit(disk) + 1 < body_.end_unit(section)) ++disk;
    return disk;
  }

  /// The point that shows this disk's place, or else the next further out.
  std::optional<int> FirstFrom(int disk) const {
    for (std::size_t p = 0; p < postures_.points.size(); ++p) {
      if (!postures_.points[p].turn && postures_.points[p].disk >= disk) return static_cast<int>(p);
    }
    return std::nullopt;
  }

  Eigen::MatrixX3d Place(int point) const {
    return postures_.Stacked(&States::seen_m).middleCols<3>(3 * point);
  }

  const Postures& postures_;
  const RobotParameters& robot_;
  const model::Body body_;
  const Eigen::Matrix3d R_;
  Eigen::MatrixXd motors_;
  Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> by_motors_;
};

}  // namespace

std::vector<std::string> ReadDirections(const Postures& postures, RobotParameters& robot) {
  std::vector<std::string> lines;
  const RobotParameters as_filed = robot;
  std::optional<Reading> reading;
  Eigen::Index motor = 0;
  for (std::size_t k = 0; k < robot.body.sections.size(); ++k) {
    std::vector<TendonRoute>& tendons = robot.body.sections[k].tendons;
    std::string read, not_read;
    std::optional<Eigen::MatrixX2d> response;
    for (std::size_t j = 0; j < tendons.size(); ++j, ++motor) {
      const std::string key = fmt::format("body.sections[{}].tendons[{}].angle_rad", k + 1, j + 1);
      const auto known = robot.uncertain.find(key);
      if (known == robot.uncertain.end() || known->second.kind != Uncertainty::Kind::kUnknown) continue;
      if (!reading) reading.emplace(postures, as_filed);
      if (read.empty() && not_read.empty()) response = reading->Response(static_cast<int>(k));
      if (!response || !reading->Turns(motor)) {
        not_read += fmt::format("{}{}", not_read.empty() ? "" : ", ", j + 1);
        continue;
      }
      tendons[j].angle_rad = std::atan2((*response)(motor, 1), (*response)(motor, 0));
      read += fmt::format("{}{}: {:.2f} rad ({:.1f} mm)", read.empty() ? "" : ", ", j + 1,
                          tendons[j].angle_rad, 1e3 * response->row(motor).norm());
    }
    if (!read.empty())
      lines.push_back(
          fmt::format("section {}: unknown directions of tendons begin where a radian of their motors moves "
                      "the section's end: {}",
                      k + 1, read));
    if (!not_read.empty())
      lines.push_back(
          fmt::format("section {}: no direction can be read of tendons {}, whose motors stand still or whose "
                      "end has no marker: they begin with the file's",
                      k + 1, not_read));
  }
  return lines;
}

}  // namespace tendril::gap
