// A backbone of length L has its tip at distance L from the base when straight, as at rest, and never
// farther. With d from the tip at rest and e the unit vector from base to tip at rest, |d + L e| <= L, which
// is -d.e >= |d|^2 / (2 L). Whether any e satisfies this for all d depends on the path alone: since e is
// free, neither the tracker's pose nor the tilt of the base matters. A uniformly bent section needs three
// quarters of its length for it, which tolerates a rest that is not quite straight.
#include "reach.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "health_signal.h"
#include "median.h"
#include "prepare.h"

namespace tendril::gap {
namespace {

using Points = std::vector<Eigen::Vector3d>;

constexpr double kRest_s = 0.5;  // initial rest of a run
// Readings per median: two of five may be outliers. The median scatters by 0.54 of one reading.
constexpr std::size_t kBlock = 5;
constexpr double kBlockScatter = 0.54;
constexpr std::size_t kMostPoints = 1000;  // more points add little
// Normal noise on three axes exceeds this many standard deviations once in a million.
constexpr double kNoise = 5.5;
// A robot at pretension may be bent by this angle, by weight or set; the chord of such an arc is 1 - angle^2
// / 24 of its length.
constexpr double kRestBend_rad = 0.2;

/// Tip path of a run.
struct Path {
  Eigen::Vector3d rest_m = Eigen::Vector3d::Zero();
  Points moved_m;      // relative to the rest position
  double noise_m = 0;  // uncertainty of each point
  double farthest_m = 0;
};

Eigen::Vector3d MedianOf(const Points& points, std::size_t from, std::size_t to) {
  Eigen::Vector3d middle;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> values;
    for (std::size_t i = from; i < to; ++i) values.push_back(points[i][axis]);
    middle[axis] = Median(values);
  }
  return middle;
}

/// The motors are where they leave the robot straight, according to the file's spools and holes.
bool BeginsStraight(const Run& run, const RobotParameters& robot) {
  if (!robot.actuation || run.motor_position_rad.rows() != run.time_s.size()) return false;
  std::size_t j = 0;
  for (const SectionParameters& section : robot.body.sections) {
    for (const TendonRoute& route : section.tendons) {
      const double travel_m = robot.actuation->tendons[j].SpoolTravelPerMotorRad();
      const auto column = static_cast<Eigen::Index>(j++);
      if (column >= run.motor_position_rad.cols()) return false;
      const auto rows = FiniteRows(run.motor_position_rad.col(column));
      if (rows.empty()) continue;  // a missing encoder does not make the others wrong
      const double pulled_m = travel_m * run.motor_position_rad(rows.front(), column);
      if (!(std::abs(pulled_m) <= kRestBend_rad * route.radius_m)) return false;
    }
  }
  return true;
}

/// Path of a recorded motion that begins at rest and straight; states at rest may begin anywhere.
std::optional<Path> PathOf(const Run& run, const RobotParameters& robot) {
  if (run.tip_m.cols() != 3 || run.tip_m.rows() != run.time_s.size()) return {};
  if (UsualStep(run) > kQuasiStatic_s || !BeginsStraight(run, robot)) return {};
  Points read;
  std::size_t resting = 0;
  for (Eigen::Index i = 0; i < run.tip_m.rows(); ++i) {
    if (!run.tip_m.row(i).allFinite()) continue;
    read.push_back(run.tip_m.row(i).transpose());
    resting += run.time_s[i] - run.time_s[0] <= kRest_s;
  }
  if (read.size() < 2 * kBlock || resting == 0) return {};
  // At rest only, since motion adds to the scatter.
  double noise_m = robot.actuation->tracker ? robot.actuation->tracker->position_noise_m : 0;
  for (int axis = 0; axis < 3; ++axis) {
    Eigen::VectorXd at_rest(static_cast<Eigen::Index>(resting));
    for (std::size_t i = 0; i < resting; ++i) at_rest[static_cast<Eigen::Index>(i)] = read[i][axis];
    noise_m = std::max(noise_m, Scatter(at_rest));
  }

  Path path;
  path.rest_m = MedianOf(read, 0, std::max(resting, kBlock));
  // Of the moving and the resting tip: a median scatters by sqrt(pi / 2) times the mean.
  const double rest_scatter = std::sqrt(std::numbers::pi / 2 / static_cast<double>(resting));
  path.noise_m = kNoise * noise_m * std::hypot(kBlockScatter, rest_scatter);
  const std::size_t step = std::max(kBlock, read.size() / kMostPoints);
  for (std::size_t i = 0; i + kBlock <= read.size(); i += step) {
    path.moved_m.emplace_back(MedianOf(read, i, i + kBlock) - path.rest_m);
    path.farthest_m = std::max(path.farthest_m, path.moved_m.back().norm());
  }
  return path;
}

/// True where no base direction fits a backbone of this length: then the convex hull of d / b, with b the
/// least allowed -d.e, comes nearer than 1 to the origin (Gilbert's algorithm for its nearest point).
bool Impossible(const Path& path, double length_m) {
  constexpr int kMostSteps = 20'000;  // if not decided by then, the path is assumed possible
  const double short_m = length_m * kRestBend_rad * kRestBend_rad / 24;
  Points hull;
  for (const Eigen::Vector3d& d : path.moved_m) {
    const double far_m = std::max(d.norm() - path.noise_m, 0.0);
    const double least_m = far_m * far_m / (2 * length_m) - path.noise_m - short_m;
    if (least_m > 0) hull.emplace_back(-d / least_m);
  }
  if (hull.empty()) return false;
  Eigen::Vector3d nearest = hull.front();
  for (int step = 0; step < kMostSteps; ++step) {
    if (nearest.norm() < 1) return true;
    const auto nearer = [&](const auto& a, const auto& b) { return a.dot(nearest) < b.dot(nearest); };
    const Eigen::Vector3d& toward = *std::min_element(hull.begin(), hull.end(), nearer);
    if (toward.dot(nearest) >= nearest.norm()) return false;  // all of the hull lies beyond that plane
    const Eigen::Vector3d way = nearest - toward;
    nearest -= std::min(nearest.dot(way) / way.squaredNorm(), 1.0) * way;
  }
  return false;
}

/// Largest length for which the path is impossible, given that it is impossible for `length_m`.
double NeededLength(const Path& path, double length_m) {
  double too_short_m = length_m, enough_m = 2 * length_m;
  while (Impossible(path, enough_m) && enough_m < 100 * length_m) {
    too_short_m = enough_m;
    enough_m *= 2;
  }
  for (int i = 0; i < 10; ++i) {
    const double middle_m = 0.5 * (too_short_m + enough_m);
    (Impossible(path, middle_m) ? too_short_m : enough_m) = middle_m;
  }
  return too_short_m;
}

}  // namespace

std::optional<PathBeyondReach> FindPathBeyondReach(const DataSet& set) {
  const double length_m = set.robot.body.length_m();
  std::vector<std::pair<const Run*, Path>> paths;
  double farthest_m = 0;
  for (const Run& run : set.runs) {
    auto path = PathOf(run, set.robot);
    if (!path) continue;
    farthest_m = std::max(farthest_m, path->farthest_m);
    paths.emplace_back(&run, std::move(*path));
  }
  // A run with little motion is possible for any robot and is not evidence for this one.
  std::erase_if(paths, [&](const auto& path) { return path.second.farthest_m < 0.5 * farthest_m; });
  std::optional<PathBeyondReach> found;
  std::size_t impossible = 0;
  for (const auto& [run, path] : paths) {
    if (!Impossible(path, length_m)) continue;
    ++impossible;
    const double needed_m = NeededLength(path, length_m);
    if (!found || needed_m > found->needed_m)
      found = PathBeyondReach{run->name, path.farthest_m, needed_m, path.rest_m.norm()};
  }
  return 2 * impossible > paths.size() ? found : std::nullopt;
}

}  // namespace tendril::gap
