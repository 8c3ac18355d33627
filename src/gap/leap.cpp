// See the header. A rotor with acceleration at most a is within a (t - t0)(t1 - t) / 2 of the straight line
// between its angles at t0 and t1; the tendon loads it like a spring, since the body moves more slowly.
#include "leap.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tendril::gap {
namespace {

// A real motion shows the full change that the spring predicts, an encoder error none; the threshold is half
// way.
constexpr double kConfirms = 0.5;
constexpr double kNoise = 5;  // standard deviations of a cell

using Signal = Eigen::Ref<const Eigen::VectorXd>;

/// Rows that follow each other, apart from rows without a reading, and the readings beside them.
struct Group {
  std::vector<Eigen::Index> rows;
  Eigen::Index before = -1, after = -1;
};

std::vector<Group> GroupsOf(const Signal& x, const std::vector<Eigen::Index>& rows) {
  std::vector<Group> groups;
  bool open = false;  // the last group may continue
  Eigen::Index last = -1;
  auto next = rows.begin();
  for (Eigen::Index i = 0; i < x.size(); ++i) {
    if (!std::isfinite(x[i])) continue;
    if (next != rows.end() && *next == i) {
      if (!open) groups.push_back({{}, last, -1});
      groups.back().rows.push_back(i);
      open = true;
      ++next;
    } else {
      if (open) groups.back().after = i;
      open = false;
    }
    last = i;
  }
  return groups;
}

/// Deviation of x from the straight line between its neighbours; NaN where one of the three is missing.
double OffLine(const Run& run, const Signal& x, const Group& group, Eigen::Index row) {
  if (group.before < 0 || group.after < 0) return kNoReading;
  const Eigen::VectorXd& t = run.time_s;
  const double part = (t[row] - t[group.before]) / (t[group.after] - t[group.before]);
  return x[row] - (1 - part) * x[group.before] - part * x[group.after];
}

Eigen::Index Farthest(const Run& run, const Signal& x, const Group& group) {
  return *std::max_element(group.rows.begin(), group.rows.end(), [&](Eigen::Index a, Eigen::Index b) {
    return std::abs(OffLine(run, x, group, a)) < std::abs(OffLine(run, x, group, b));
  });
}

/// Change of a tension by the tendon's spring when its motor turns; limited by slack when it pays out.
double SpringTension(const TendonDriveParameters& tendon, double turn_rad, double tension_N) {
  const double added_N = tendon.tendon.stiffness_Npm * tendon.SpoolTravelPerMotorRad() * turn_rad;
  return std::max(added_N, -std::max(tension_N, 0.0));
}

bool Has(const Run& run, const Eigen::MatrixXd& matrix, Eigen::Index tendon, const RobotParameters& robot) {
  return robot.actuation && tendon < static_cast<Eigen::Index>(robot.actuation->tendons.size()) &&
         tendon < matrix.cols() && matrix.rows() == run.time_s.size();
}

double Most(const Run& run, const Eigen::MatrixXd& matrix, Eigen::Index tendon) {
  double most = 0;
  if (tendon >= matrix.cols() || matrix.rows() != run.time_s.size()) return most;
  for (const double x : matrix.col(tendon)) {
    if (std::isfinite(x)) most = std::max(most, std::abs(x));
  }
  return most;
}

}  // namespace

std::vector<MotorLeap> MotorLeaps(const Run& run, Eigen::Index tendon, const RobotParameters& robot,
                                  const std::vector<Eigen::Index>& rows) {
  const auto x = run.motor_position_rad.col(tendon);
  const bool known = Has(run, run.motor_position_rad, tendon, robot);
  const bool cell = Has(run, run.tension_N, tendon, robot);
  const TendonDriveParameters its =
      known ? robot.actuation->tendons[static_cast<std::size_t>(tendon)] : TendonDriveParameters{};
  const double file_Nm = its.drive.current_limit_A * its.motor.torque_constant_NmpA;
  // The tendon pulls the rotor back.
  const double pull_Nm =
      its.gear.ratio > 0 ? Most(run, run.tension_N, tendon) * its.SpoolTravelPerMotorRad() : 0;
  const double possible_Nm = std::max(file_Nm, Most(run, run.torque_actual_Nm, tendon));
  std::vector<MotorLeap> leaps;
  for (const Group& group : GroupsOf(x, rows)) {
    MotorLeap leap{.rows = group.rows, .farthest = Farthest(run, x, group), .file_Nm = file_Nm};
    leap.off_rad = OffLine(run, x, group, leap.farthest);
    if (known && std::isfinite(leap.off_rad)) {
      double acceleration = 0;
      for (const Eigen::Index i : group.rows) {
        const double lever_s2 =
            (run.time_s[i] - run.time_s[group.before]) * (run.time_s[group.after] - run.time_s[i]);
        acceleration = std::max(acceleration, 2 * std::abs(OffLine(run, x, group, i)) / lever_s2);
      }
      leap.needed_Nm = std::max(acceleration * its.motor.rotor_inertia_kgm2 - pull_Nm, 0.0);
      const double seen_N =
          cell ? OffLine(run, run.tension_N.col(tendon), group, leap.farthest) : std::nan("");
      const double spring_N =
          cell ? SpringTension(its, leap.off_rad, run.tension_N(group.before, tendon)) : 0;
      const bool confirmed = std::abs(seen_N) > kNoise * its.load_cell.noise_N && seen_N * spring_N > 0 &&
                             std::abs(seen_N) > kConfirms * std::abs(spring_N);
      if (confirmed) leap.tension_N = seen_N;
      if (leap.needed_Nm <= file_Nm) {
        leap.kind = MotorLeap::Kind::kMotion;
      } else if (leap.needed_Nm <= possible_Nm || confirmed) {
        leap.kind = MotorLeap::Kind::kExceedsFile;
      }
    }
    leaps.push_back(std::move(leap));
  }
  return leaps;
}

std::vector<Eigen::Index> TensionsAlone(const Run& run, Eigen::Index tendon, const RobotParameters& robot,
                                        const std::vector<Eigen::Index>& rows) {
  if (!Has(run, run.motor_position_rad, tendon, robot)) return rows;
  const TendonDriveParameters& its = robot.actuation->tendons[static_cast<std::size_t>(tendon)];
  const auto x = run.tension_N.col(tendon);
  std::vector<Eigen::Index> alone;
  for (const Group& group : GroupsOf(x, rows)) {
    const Eigen::Index row = Farthest(run, x, group);
    const double seen_N = OffLine(run, x, group, row);
    const double turned_rad = OffLine(run, run.motor_position_rad.col(tendon), group, row);
    const double spring_N = its.tendon.stiffness_Npm * its.SpoolTravelPerMotorRad() * turned_rad;
    if (seen_N * spring_N > 0 && std::abs(spring_N) > kConfirms * std::abs(seen_N)) continue;
    alone.insert(alone.end(), group.rows.begin(), group.rows.end());
  }
  return alone;
}

}  // namespace tendril::gap
