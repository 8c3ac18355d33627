#include "tendril/motion/requested_motion.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <numbers>
#include <stdexcept>

#include "tendril/core/usage_error.h"
#include "tendril/io/csv.h"
#include "tendril/motion/path.h"
#include "tendril/motion/path_motion.h"
#include "tendril/motion/tension_check.h"

namespace tendril::motion {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

// Along paths, by default: full speed in a quarter of a second, full acceleration in a tenth. The daemon's
// smoothing takes 0.0005 s^2 of the acceleration off a path; this leaves a milliradian at 0.5 rad/s.
constexpr double kGather_s = 0.25, kBuildUp_s = 0.1;
constexpr double kFarthest_m = 1000;  // of any point; squares of more would overflow somewhere

VectorXd Numbers(const std::string& text, const char* option, Eigen::Index count, const char* form) {
  std::vector<double> values;
  std::size_t from = 0;
  for (;;) {
    const std::size_t comma = std::min(text.find(',', from), text.size());
    const std::string word = text.substr(from, comma - from);
    const auto first = word.find_first_not_of(" +"), last = word.find_last_not_of(' ');
    double value = NAN;
    bool number = first != std::string::npos;
    if (number) {
      const char* begin = word.data() + first;
      const char* end = word.data() + last + 1;
      const auto [stopped, error] = std::from_chars(begin, end, value);
      number = error == std::errc() && stopped == end && std::isfinite(value);
    }
    if (!number)
      throw UsageError(fmt::format("{} {}: '{}' is not a number; give {}", option, text, word, form));
    values.push_back(value);
    if (comma == text.size()) break;
    from = comma + 1;
  }
  if (static_cast<Eigen::Index>(values.size()) != count) {
    throw UsageError(
        fmt::format("{} {}: {} numbers, accepted: {}; give {}", option, text, values.size(), count, form));
  }
  return Eigen::Map<const VectorXd>(values.data(), count);
}

Vector3d Point(const std::string& text, const char* option, const char* form = "X,Y,Z [m]") {
  const Vector3d point = Numbers(text, option, 3, form);
  if (point.cwiseAbs().maxCoeff() > kFarthest_m) {
    throw UsageError(
        fmt::format("{} {}: farther than {:g} m; accepted: {} within that; are these millimetres?", option,
                    text, kFarthest_m, form));
  }
  return point;
}

void RequireBend(const VectorXd& bending_rad, const RobotParameters& robot, const std::string& where) {
  for (Eigen::Index k = 0; k + 1 < bending_rad.size(); k += 2) {
    const double bend = bending_rad.segment<2>(k).norm();
    if (bend > robot.limits.max_bending_rad) {
      throw std::runtime_error(
          fmt::format("{}: section {} is bent by {:.4g} rad; accepted: up to limits.max_bending_rad = {:g} "
                      "rad; bend it less",
                      where, k / 2 + 1, bend, robot.limits.max_bending_rad));
    }
  }
}

using Remark = std::function<void(const std::string&)>;

void TellNearest(const TipSolver& solver, const Remark& remark) {
  if (solver.farthest_m() > 0) {
    remark(fmt::format("out of the tip's reach by up to {:.3g} mm: the nearest points are taken",
                       1e3 * solver.farthest_m()));
  }
}

/// Rows of a CSV as bendings; times too when `times` is given.
MatrixXd ReadPoints(const std::string& file, const RobotParameters& robot, bool nearest, VectorXd* times,
                    const Remark& remark) {
  std::ifstream in(file);
  if (!in) throw std::runtime_error(fmt::format("cannot read {}: name a CSV file", file));
  const int sections = static_cast<int>(robot.body.sections.size());
  const std::vector<std::string> tip{"tip_x_m", "tip_y_m", "tip_z_m"},
      bend = io::NumberedPairs("us_", "vs_", sections);
  io::CsvReader rows(in, file, times ? std::vector<std::string>{"t_s"} : std::vector<std::string>{},
                     {tip, bend});
  if (rows.has(0) == rows.has(1)) {
    throw rows.Error(fmt::format("{} targets; give the columns {} or {}{}",
                                 rows.has(0) ? "two kinds of" : "no", fmt::join(tip, ","),
                                 fmt::join(bend, ","), rows.has(0) ? ", not both" : ""));
  }
  TipSolver solver(robot, nearest);
  std::vector<VectorXd> points;
  std::vector<double> t_s;
  while (rows.Next()) {
    if (times) {
      if (!t_s.empty() && !(rows.required()[0] > t_s.back())) {
        throw rows.Error(
            fmt::format("t_s = {:g} comes after {:g}; accepted: times that increase from row to row",
                        rows.required()[0], t_s.back()));
      }
      t_s.push_back(rows.required()[0]);
    }
    const std::string where = fmt::format("{}: line {}", file, rows.line());
    if (rows.has(0)) {
      const auto p = rows.optional(0);
      if (std::max({std::abs(p[0]), std::abs(p[1]), std::abs(p[2])}) > kFarthest_m) {
        throw rows.Error(
            fmt::format("a point farther than {:g} m; accepted: metres within that", kFarthest_m));
      }
      points.push_back(solver.Solve({p[0], p[1], p[2]}, where));
    } else {
      const auto b = rows.optional(1);
      points.emplace_back(Eigen::Map<const VectorXd>(b.data(), 2 * sections));
      RequireBend(points.back(), robot, where);
    }
  }
  if (points.size() < 2) {
    throw std::runtime_error(fmt::format("{}: {} row{}; accepted: two or more", file, points.size(),
                                         points.size() == 1 ? "" : "s"));
  }
  TellNearest(solver, remark);
  MatrixXd bending(static_cast<Eigen::Index>(points.size()), 2 * sections);
  for (std::size_t i = 0; i < points.size(); ++i)
    bending.row(static_cast<Eigen::Index>(i)) = points[i].transpose();
  if (times) *times = Eigen::Map<const VectorXd>(t_s.data(), static_cast<Eigen::Index>(t_s.size()));
  return bending;
}

double Within(double asked, double usual, double most, const char* option, const char* key,
              const char* unit) {
  if (asked == 0) return std::min(usual, most);
  if (asked > most) {
    throw UsageError(fmt::format("{} {:g} {}: the daemon keeps trajectory.{} = {:g}; accepted: up to that",
                                 option, asked, unit, key, most));
  }
  return asked;
}

PathLimits AlongPaths(const MotionRequest& r, const TrajectoryParameters& d) {
  const double rate =
      Within(r.speed_radps, d.default_speed_radps, d.max_rate_radps, "--speed", "max_rate_radps", "rad/s");
  const double acceleration = Within(r.acceleration_radps2, rate / kGather_s, d.max_acceleration_radps2,
                                     "--acceleration", "max_acceleration_radps2", "rad/s^2");
  const double jerk = Within(r.jerk_radps3, acceleration / kBuildUp_s, d.max_jerk_radps3, "--jerk",
                             "max_jerk_radps3", "rad/s^3");
  return {rate, acceleration, jerk};
}

MatrixXd ViaPoints(const MotionRequest& r, const RobotParameters& robot, const Remark& remark) {
  if ((r.tips.empty() ? 0 : 1) + (r.bends.empty() ? 0 : 1) + (r.points.empty() ? 0 : 1) != 1)
    throw UsageError("via: give its points by --tip, by --bend or by --points, one of the three");
  if (!r.points.empty()) return ReadPoints(r.points, robot, r.nearest, nullptr, remark);
  const std::size_t count = r.tips.size() + r.bends.size();
  const Eigen::Index k2 = 2 * static_cast<Eigen::Index>(robot.body.sections.size());
  MatrixXd points(static_cast<Eigen::Index>(count), k2);
  TipSolver solver(robot, r.nearest);
  for (std::size_t i = 0; i < count; ++i) {
    const std::string where = fmt::format("point {}", i + 1);
    VectorXd bending;
    if (r.bends.empty()) {
      bending = solver.Solve(Point(r.tips[i], "--tip"), where);
    } else {
      bending = Numbers(r.bends[i], "--bend", k2, "U,V of every section [rad]");
      RequireBend(bending, robot, where);
    }
    points.row(static_cast<Eigen::Index>(i)) = bending.transpose();
  }
  // Only now, because a wrong value is reported first.
  if (count < 2) throw UsageError("via: one point is no path; give two or more, or use tendril send");
  TellNearest(solver, remark);
  return points;
}

std::vector<Spline> Lines(const MotionRequest& r, const RobotParameters& robot, const Remark& remark) {
  for (const std::string& tip : r.tips) Point(tip, "--tip");  // a wrong value is reported first
  if (r.tips.size() < 2) throw UsageError("line: give two or more corners by --tip X,Y,Z");
  std::vector<Spline> curves;
  TipSolver solver(robot, r.nearest);
  for (std::size_t i = 0; i + 1 < r.tips.size(); ++i) {
    curves.push_back(AlongTip(LineTo(Point(r.tips[i], "--tip"), Point(r.tips[i + 1], "--tip")),
                              fmt::format("line {}", i + 1), solver, robot));
  }
  TellNearest(solver, remark);
  return curves;
}

TipPath ArcPath(const MotionRequest& r) {
  if (r.centre.empty()) {
    if (r.tips.size() != 3 || r.angle_deg) {
      throw UsageError("arc: give three points by --tip, or one with --centre and --angle");
    }
    return ArcThrough(Point(r.tips[0], "--tip"), Point(r.tips[1], "--tip"), Point(r.tips[2], "--tip"));
  }
  if (r.tips.size() != 1 || !r.angle_deg)
    throw UsageError("arc: --centre needs one --tip, where it starts, and --angle");
  if (*r.angle_deg == 0) throw UsageError("arc: --angle 0 is not an arc; give the angle in degrees");
  return ArcAround(Point(r.centre, "--centre"), Point(r.normal, "--normal", "X,Y,Z"),
                   Point(r.tips[0], "--tip"), *r.angle_deg * std::numbers::pi / 180);
}

Spline Arc(const MotionRequest& r, const RobotParameters& robot, const Remark& remark) {
  TipSolver solver(robot, r.nearest);
  Spline curve = AlongTip(ArcPath(r), "arc", solver, robot);
  TellNearest(solver, remark);
  return curve;
}

std::unique_ptr<Motion> Planned(const MotionRequest& r, const RobotParameters& robot,
                                const TrajectoryParameters& limits, const Remark& remark) {
  if (r.kind == "csv") {
    VectorXd times;
    const MatrixXd bending = ReadPoints(r.points, robot, r.nearest, &times, remark);
    const Spline table(times * r.stretch, bending);
    RequireWithinBend(table, robot, "rows");
    return MakeTableMotion(r.points, table,
                           {limits.max_rate_radps, limits.max_acceleration_radps2, limits.max_jerk_radps3},
                           robot);
  }
  if (r.kind == "via")
    return MakePathMotion(r.kind, {ThroughPoints(ViaPoints(r, robot, remark), robot)}, AlongPaths(r, limits),
                          robot);
  if (r.kind == "line") return MakePathMotion(r.kind, Lines(r, robot, remark), AlongPaths(r, limits), robot);
  if (r.kind == "arc") return MakePathMotion(r.kind, {Arc(r, robot, remark)}, AlongPaths(r, limits), robot);
  return MakeMotion(r.kind, robot);
}

}  // namespace

std::unique_ptr<Motion> MakeRequestedMotion(const MotionRequest& r, const RobotParameters& robot,
                                            const TrajectoryParameters& limits, const Remark& remark) {
  std::unique_ptr<Motion> motion = Planned(r, robot, limits, remark);
  RequireTensions(*motion, robot);
  return motion;
}

}  // namespace tendril::motion
