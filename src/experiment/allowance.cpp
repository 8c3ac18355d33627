#include "allowance.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "tendril/model/bending_model.h"

namespace tendril::experiment {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {
constexpr double kPi = std::numbers::pi;
}

double SectionNorm(const VectorXd& bending) {
  double largest = 0;
  for (Eigen::Index k = 0; k + 1 < bending.size(); k += 2)
    largest = std::max(largest, bending.segment<2>(k).norm());
  return largest;
}

Allowance::Allowance(const RobotParameters& robot, const ControllerParameters& controller)
    : robot_(model::ControlModel(robot)),
      body_(robot_.body),
      arcs_(body_),
      sections_(body_.sections()),
      tendons_(body_.tendons()),
      q_(VectorXd::Zero(body_.dof())),
      tables_(model::MakeCapstanTables(robot.actuation->tendons, robot.limits.max_tension_motor_N)) {
  for (int k = 0; k < sections_; ++k) cones_.push_back(model::PullConeOf(robot.body, k));
  for (std::size_t j = 0; j < tables_.size(); ++j) {
    law_.emplace_back(robot.actuation->tendons[j], robot.limits, controller.capstan_compensation,
                      control::Pulled(robot.actuation->tendons[j], robot.limits.min_tension_N, tables_[j]));
  }
}

VectorXd Allowance::Direction(double beta_rad, int pattern) const {
  VectorXd b = VectorXd::Zero(2 * sections_);
  for (int k = 0; k < sections_; ++k) {
    const model::PullCone& cone = cones_[static_cast<std::size_t>(k)];
    const double at_rad = beta_rad + cone.from_rad;
    const Eigen::Vector2d plane = cone.Nearest({std::cos(at_rad), std::sin(at_rad)});
    const auto& s = robot_.body.sections[static_cast<std::size_t>(k)];
    const double share = pattern == 0       ? s.units * s.unit_length_m / robot_.body.length_m()
                         : pattern == k + 1 ? 1.0
                                            : 0.0;
    b.segment<2>(2 * k) = share * plane;
  }
  return b;
}

void Allowance::IntoPulled(MatrixXd& rows) const {
  for (int k = 0; k < sections_; ++k) {
    const model::PullCone& cone = cones_[static_cast<std::size_t>(k)];
    if (cone.kind == model::PullCone::Kind::kPlane) continue;
    auto own = rows.middleCols(2 * k, 2);
    if (cone.kind != model::PullCone::Kind::kLine) {
      const double middle_rad = cone.from_rad + 0.5 * cone.width_rad;
      const Eigen::RowVector2d middle(std::cos(middle_rad), std::sin(middle_rad));
      own = (0.5 * own).rowwise() + 0.5 * own.rowwise().norm().maxCoeff() * middle;
    }
    for (Eigen::Index i = 0; i < own.rows(); ++i)
      own.row(i) = cone.Nearest(own.row(i).transpose()).transpose();
  }
}

bool Allowance::Pulled(const VectorXd& bending_rad) const {
  for (int k = 0; k < sections_; ++k) {
    const Eigen::Vector2d bend = bending_rad.segment<2>(2 * k);
    if ((cones_[static_cast<std::size_t>(k)].Nearest(bend) - bend).norm() > 2e-3) return false;
  }
  return true;
}

VectorXd Allowance::Tensions(const VectorXd& bending_rad, double level_N) {
  const auto r = arcs_.Hold(bending_rad, level_N, robot_.limits.max_tension_base_N);
  if (r.bound != Status::kOk && r.bound != Status::kLimitedTensionMin) return {};
  return r.tension_N;
}

bool Allowance::Allowed(const VectorXd& bending_rad, double level_N, bool commanded) {
  for (int k = 0; k < sections_; ++k) {
    if (bending_rad.segment<2>(2 * k).norm() > kBendingShare * robot_.limits.max_bending_rad) return false;
  }
  const VectorXd tension = Tensions(bending_rad, level_N);
  if (tension.size() == 0 || tension.maxCoeff() > kBaseShare * robot_.limits.max_tension_base_N) return false;
  for (int j = 0; j < tendons_; ++j) {
    const double torque = PullTorque(j, tension[j]);
    if (table(j).Pull(tension[j]) > kMotorShare * robot_.limits.max_tension_motor_N) return false;
    if (torque > kMotorShare * law_[static_cast<std::size_t>(j)].max_torque_Nm()) return false;
    if (commanded && CommandFor(j, torque) > kCommandShare * robot_.limits.max_tension_base_N) return false;
  }
  return true;
}

double Allowance::Share(const VectorXd& bending_rad, double level_N, bool commanded) {
  const auto allowed = [&](double share) { return Allowed(share * bending_rad, level_N, commanded); };
  constexpr double kCoarse = 0.125;
  double good = 0;
  while (good < 1 && allowed(std::min(1.0, good + kCoarse))) good = std::min(1.0, good + kCoarse);
  if (good >= 1) return 1;
  double bad = good + kCoarse;
  for (int i = 0; i < 8; ++i) {
    const double middle = 0.5 * (good + bad);
    (allowed(middle) ? good : bad) = middle;
  }
  return good;
}

VectorXd Allowance::Bend(double amplitude_rad, double beta_rad, int pattern, double level_N, bool commanded) {
  VectorXd b = amplitude_rad * Direction(beta_rad, pattern);
  // A section alone is limited to the bend that the other sections' share would leave it.
  if (pattern > 0) b *= 0.7;
  return Share(b, level_N, commanded) * b;
}

double Allowance::EveryPlane(double amplitude_rad) {
  double least = 1;
  for (int i = 0; i < 24; ++i)
    least = std::min(least, Share(amplitude_rad * Direction(i * kPi / 12), least_N(), false));
  return least * amplitude_rad;
}

MatrixXd Allowance::TensionCommands(const Path& path) {
  const Eigen::Index rows = path.bending_rad.rows();
  MatrixXd shortening(rows, tendons_), tension(rows, tendons_), command(rows, tendons_);
  const auto at = [&](Eigen::Index i) { return std::clamp<Eigen::Index>(i, 0, rows - 1); };
  const auto rate = [&](const MatrixXd& m, Eigen::Index i) -> VectorXd {
    return (m.row(at(i + 1)) - m.row(at(i - 1))).transpose() / (2 * kStep_s);
  };
  const auto acceleration = [&](const MatrixXd& m, Eigen::Index i) -> VectorXd {
    return (m.row(at(i + 1)) - 2 * m.row(i) + m.row(at(i - 1))).transpose() / (kStep_s * kStep_s);
  };
  VectorXd pulled(tendons_);
  for (Eigen::Index i = 0; i < rows; ++i) {
    body_.SpreadBending(path.bending_rad.row(i).transpose(), q_);
    body_.TendonShortening(q_, pulled);
    shortening.row(i) = pulled.transpose();
    tension.row(i) =
        arcs_
            .Move(path.bending_rad.row(i).transpose(), rate(path.bending_rad, i),
                  acceleration(path.bending_rad, i), path.level_N[i], robot_.limits.max_tension_base_N)
            .tension_N.transpose();
  }
  for (int j = 0; j < tendons_; ++j) {
    auto& law = law_[static_cast<std::size_t>(j)];
    const auto& drive = robot_.actuation->tendons[static_cast<std::size_t>(j)];
    law.Reset(tension(0, j), shortening(0, j));
    for (Eigen::Index i = 0; i < rows; ++i) {
      const double rotor = drive.motor.rotor_inertia_kgm2 *
                           (shortening(at(i + 1), j) - 2 * shortening(i, j) + shortening(at(i - 1), j)) /
                           (kStep_s * kStep_s) / drive.SpoolTravelPerMotorRad();
      command(i, j) =
          std::min(CommandFor(j, law.Step(tension(i, j), shortening(i, j), true).torque_Nm + rotor),
                   kCommandShare * robot_.limits.max_tension_base_N);
    }
  }
  return command;
}

double Allowance::CommandFor(int j, double torque_Nm) const {
  const auto& drive = robot_.actuation->tendons[static_cast<std::size_t>(j)];
  const double motor_N = torque_Nm / drive.SpoolTravelPerMotorRad();
  double low = least_N(), high = 2 * robot_.limits.max_tension_motor_N;
  if (table(j).BaseToMotor(low, 0) >= motor_N) return low;
  for (int i = 0; i < 50; ++i) {
    const double middle = 0.5 * (low + high);
    (table(j).BaseToMotor(middle, 0) < motor_N ? low : high) = middle;
  }
  return high;
}

double Allowance::PullTorque(int j, double tension_N) const {
  const auto& drive = robot_.actuation->tendons[static_cast<std::size_t>(j)];
  return table(j).Pull(tension_N) * drive.SpoolTravelPerMotorRad() / drive.gear.efficiency +
         drive.motor.coulomb_friction_Nm;
}

}  // namespace tendril::experiment
