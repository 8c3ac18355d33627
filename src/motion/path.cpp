#include "tendril/motion/path.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

#include "tendril/core/tip_unit.h"
#include "tendril/model/bending_model.h"
#include "tendril/model/inverse.h"

namespace tendril::motion {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

// Points of the grid over a curve for its fastest run, and of the times at which limits are checked.
constexpr int kGrid = 400;
constexpr double kLook_s = 0.0005;
// Slowing down where a limit is exceeded: rounds, and grid points to either side.
constexpr int kRounds = 15, kReach = 6;
constexpr int kFewLooks = 4000, kMostLooks = 40000;
// Margin for the intervals between checks.
constexpr double kMargin = 1.002;
// Points per turn of a tip path that are converted to bending.
constexpr int kTipPoints = 240;
constexpr double kReachShare = 1e-3;  // share of the robot's length that counts as reached

}  // namespace

// ---- spline -----------------------------------------------------------------------------------------------

Spline::Spline(VectorXd knots, MatrixXd values) : knots_(std::move(knots)), values_(std::move(values)) {
  const Eigen::Index n = knots_.size(), d = values_.cols();
  if (n < 2 || values_.rows() != n) throw std::invalid_argument("a spline needs two rows or more");
  for (Eigen::Index i = 1; i < n; ++i) {
    if (!(knots_[i] > knots_[i - 1])) throw std::invalid_argument("a spline's knots must increase");
  }
  // Tridiagonal system of the second derivatives, those at the ends zero; diagonally dominant, so eliminated
  // as it is.
  seconds_ = MatrixXd::Zero(n, d);
  if (n < 3) return;
  VectorXd diagonal(n), upper(n);
  MatrixXd right = MatrixXd::Zero(n, d);
  diagonal[0] = 1;
  upper[0] = 0;
  for (Eigen::Index i = 1; i + 1 < n; ++i) {
    const double before = knots_[i] - knots_[i - 1], after = knots_[i + 1] - knots_[i];
    const double factor = before / diagonal[i - 1];
    diagonal[i] = 2 * (before + after) - (i > 1 ? factor * upper[i - 1] : 0);
    upper[i] = after;
    right.row(i) =
        6 * ((values_.row(i + 1) - values_.row(i)) / after - (values_.row(i) - values_.row(i - 1)) / before);
    if (i > 1) right.row(i) -= factor * right.row(i - 1);
  }
  for (Eigen::Index i = n - 2; i >= 1; --i) {
    seconds_.row(i) = (right.row(i) - upper[i] * seconds_.row(i + 1)) / diagonal[i];
  }
}

Spline::Point Spline::At(double s) const {
  const auto* first = knots_.data();
  const auto* above = std::upper_bound(first + 1, first + knots_.size() - 1, s);
  const Eigen::Index i = above - first - 1;
  const double h = knots_[i + 1] - knots_[i], b = (s - knots_[i]) / h, a = 1 - b;
  const auto y0 = values_.row(i), y1 = values_.row(i + 1), m0 = seconds_.row(i), m1 = seconds_.row(i + 1);
  Point p;
  p.value = (a * y0 + b * y1 + ((a * a * a - a) * m0 + (b * b * b - b) * m1) * h * h / 6).transpose();
  p.first = ((y1 - y0) / h + ((3 * b * b - 1) * m1 - (3 * a * a - 1) * m0) * h / 6).transpose();
  p.second = (a * m0 + b * m1).transpose();
  p.third = ((m1 - m0) / h).transpose();
  return p;
}

// ---- limits -----------------------------------------------------------------------------------------------

double LimitUse::stretch() const { return std::max({rate, std::sqrt(acceleration), std::cbrt(jerk)}); }

LimitUse UseOf(const PathLimits& limits, const VectorXd& rate, const VectorXd& acceleration,
               const VectorXd& jerk) {
  LimitUse use;
  for (Eigen::Index k = 0; k + 1 < rate.size(); k += 2) {
    use.rate = std::max(use.rate, rate.segment<2>(k).norm() / limits.rate_radps);
    use.acceleration =
        std::max(use.acceleration, acceleration.segment<2>(k).norm() / limits.acceleration_radps2);
    use.jerk = std::max(use.jerk, jerk.segment<2>(k).norm() / limits.jerk_radps3);
  }
  return use;
}

// ---- timing -----------------------------------------------------------------------------------------------

// The curve on its grid, and the fastest run over it within rate and acceleration. x is the rate's square:
// over a step of the grid the acceleration along the curve is (x' - x) / (2 step).
struct PathTiming::Profile {
  Profile(const Spline& spline, const PathLimits& within) : curve(spline), limits(within) {
    // Denser towards the ends, where the run accelerates.
    for (int i = 0; i <= kGrid; ++i) {
      const double even = static_cast<double>(i) / kGrid, share = 0.5 * (1 - std::cos(M_PI * even));
      s.push_back(curve.begin() + (curve.end() - curve.begin()) * (0.7 * share + 0.3 * even));
      points.push_back(curve.At(s.back()));
    }
    most.assign(s.size(), HUGE_VAL);
  }

  // Accelerations along the curve that keep |second x + first w| <= most in every section; empty: low > high.
  std::pair<double, double> Allowed(std::size_t i, double x, double acceleration) const {
    double low = -HUGE_VAL, high = HUGE_VAL;
    const Spline::Point& p = points[i];
    for (Eigen::Index k = 0; k + 1 < p.first.size(); k += 2) {
      const Eigen::Vector2d first = p.first.segment<2>(k), second = p.second.segment<2>(k) * x;
      const double ff = first.squaredNorm(), fs = first.dot(second),
                   ss = second.squaredNorm() - acceleration * acceleration;
      if (ff < 1e-18) {
        if (ss > 0) return {1, -1};
        continue;
      }
      const double root2 = fs * fs - ff * ss;
      if (root2 < 0) return {1, -1};
      low = std::max(low, (-fs - std::sqrt(root2)) / ff);
      high = std::min(high, (-fs + std::sqrt(root2)) / ff);
    }
    return {low, high};
  }

  // The largest x for which `holds` is true, as it is at 0.
  template <class Holds>
  static double Largest(double most, Holds holds) {
    if (holds(most)) return most;
    // First its order of magnitude: where the curve reverses only its curvature bounds x, far below `most`.
    double good = 0, bad = most;
    for (int i = 0; i < 45 && good == 0; ++i) {
      const double lower = 1e-3 * bad;
      (holds(lower) ? good : bad) = lower;
    }
    for (int i = 0; i < 45; ++i) {
      const double middle = 0.5 * (good + bad);
      (holds(middle) ? good : bad) = middle;
    }
    return good;
  }

  std::vector<Knot> Run(double rate_share, double acceleration_share) const {
    const double rate = rate_share * limits.rate_radps,
                 acceleration = acceleration_share * limits.acceleration_radps2;
    const std::size_t n = s.size();
    std::vector<double> x(n);
    for (std::size_t i = 0; i < n; ++i) {
      double fastest = 1e-12;
      for (Eigen::Index k = 0; k + 1 < points[i].first.size(); k += 2)
        fastest = std::max(fastest, points[i].first.segment<2>(k).norm());
      const double cruise = std::min(most[i], rate * rate / (fastest * fastest));
      x[i] = Largest(cruise, [&](double at) {
        const auto [low, high] = Allowed(i, at, acceleration);
        return low <= high;
      });
    }
    x.front() = x.back() = 0;
    for (std::size_t i = n - 1; i-- > 0;) {
      const double twice = 2 * (s[i + 1] - s[i]);
      x[i] = Largest(x[i], [&](double at) {
        const auto [low, high] = Allowed(i, at, acceleration);
        // Just after a turn both are far below zero, and so would x have to be.
        return low <= high && at + twice * low <= x[i + 1] && at + twice * high >= 0;
      });
    }
    for (std::size_t i = 0; i + 1 < n; ++i) {
      const auto [low, high] = Allowed(i, x[i], acceleration);
      x[i + 1] = std::min(x[i + 1], x[i] + 2 * (s[i + 1] - s[i]) * std::max(low, high));
    }
    std::vector<Knot> knots{{0, s[0], 0, 0, 0}};
    for (std::size_t i = 0; i + 1 < n; ++i) {
      const double v = std::sqrt(x[i]), next = std::sqrt(x[i + 1]), step = s[i + 1] - s[i];
      const double dt = 2 * step / std::max(v + next, 1e-12);
      Knot& k = knots.back();
      k.acceleration = (next - v) / dt;
      knots.push_back({k.t + dt, s[i + 1], next, 0,
                       k.integral + k.s * dt + v * dt * dt / 2 + k.acceleration * dt * dt * dt / 6});
    }
    return knots;
  }

  const Spline& curve;
  PathLimits limits;
  std::vector<double> s, most;  // the grid, and an additional bound on x there
  std::vector<Spline::Point> points;
};

PathTiming::Knot PathTiming::Unaveraged(double t) const {
  if (t <= 0) return {t, knots_.front().s, 0, 0, knots_.front().s * t};
  if (t >= knots_.back().t) {
    const Knot& last = knots_.back();
    return {t, last.s, 0, 0, last.integral + last.s * (t - last.t)};
  }
  const auto above =
      std::upper_bound(knots_.begin(), knots_.end(), t, [](double at, const Knot& k) { return at < k.t; });
  const Knot& k = *(above - 1);
  const double d = t - k.t;
  return {t, k.s + d * (k.rate + d * k.acceleration / 2), k.rate + d * k.acceleration, k.acceleration,
          k.integral + d * (k.s + d * (k.rate / 2 + d * k.acceleration / 6))};
}

PathTiming::Point PathTiming::Averaged(double t) const {
  const Knot now = Unaveraged(t), before = Unaveraged(t - window_s_);
  return {(now.integral - before.integral) / window_s_, (now.s - before.s) / window_s_,
          (now.rate - before.rate) / window_s_, (now.acceleration - before.acceleration) / window_s_};
}

PathTiming::Point PathTiming::At(double t_s) const {
  Point p = Averaged(std::clamp(t_s, 0.0, duration_s_) / stretch_);
  p.s = std::clamp(p.s, knots_.front().s, knots_.back().s);
  p.rate /= stretch_;
  p.acceleration /= stretch_ * stretch_;
  p.jerk /= stretch_ * stretch_ * stretch_;
  return p;
}

/// Searches shares of the limits and a window for the least time.
struct PathTiming::Search {
  struct Choice {
    double rate, acceleration, window;  // shares of both limits; of acceleration over jerk
    double duration_s = HUGE_VAL;
  };

  PathTiming& timing;
  const Spline& curve;
  const PathLimits& limits;
  Profile& profile;
  Choice best{1, 1, 1};

  /// Computes the timing for a choice and its duration. `seen`: factors by which the grid's points must be
  /// slowed down.
  void Evaluate(Choice& c, bool dense, std::vector<double>* seen);
  void OnGrid();
  void AroundBest();
  /// Where a single place exceeds a limit, slows down only there.
  void SlowWhereNeeded();
};

void PathTiming::Search::Evaluate(Choice& c, bool dense, std::vector<double>* seen) {
  timing.knots_ = profile.Run(c.rate, c.acceleration);
  timing.window_s_ = c.window * c.acceleration * limits.acceleration_radps2 / limits.jerk_radps3;
  const double whole_s = timing.knots_.back().t + timing.window_s_;
  // The acceleration jumps at the knots, and the jerk there and one window later.
  std::vector<double> times;
  for (const Knot& k : timing.knots_) times.insert(times.end(), {k.t, k.t + timing.window_s_});
  if (dense) {
    const int looks = std::clamp(static_cast<int>(whole_s / kLook_s), kFewLooks, kMostLooks);
    for (int i = 0; i <= looks; ++i) times.push_back(whole_s * i / looks);
  }
  timing.stretch_ = 0;
  for (const double t : times) {
    const Point p = timing.Averaged(t);
    const Spline::Point q = curve.At(p.s);
    const double use =
        UseOf(limits, q.first * p.rate, q.second * p.rate * p.rate + q.first * p.acceleration,
              q.third * p.rate * p.rate * p.rate + 3 * q.second * p.rate * p.acceleration + q.first * p.jerk)
            .stretch();
    timing.stretch_ = std::max(timing.stretch_, use);
    if (seen) {
      const auto at = std::lower_bound(profile.s.begin(), profile.s.end() - 1, p.s) - profile.s.begin();
      (*seen)[static_cast<std::size_t>(at)] = std::max((*seen)[static_cast<std::size_t>(at)], use);
    }
  }
  timing.stretch_ *= kMargin;
  c.duration_s = timing.duration_s_ = timing.stretch_ * whole_s;
}

void PathTiming::Search::OnGrid() {
  for (double rate = 1; rate > 0.003; rate *= 0.62) {
    for (double acceleration = 1; acceleration > 0.02; acceleration *= 0.62) {
      for (const double window : {1.0, 2.0}) {
        Choice c{rate, acceleration, window};
        Evaluate(c, false, nullptr);
        if (c.duration_s < best.duration_s) best = c;
      }
    }
  }
}

void PathTiming::Search::AroundBest() {
  for (double step = 0.2; step > 0.01; step *= 0.6) {
    for (double Choice::*what : {&Choice::rate, &Choice::acceleration, &Choice::window}) {
      for (const double factor : {1 - step, 1 / (1 - step)}) {
        Choice c = best;
        c.*what *= factor;
        if (what != &Choice::window) c.*what = std::min(1.0, c.*what);
        Evaluate(c, false, nullptr);
        if (c.duration_s < best.duration_s) best = c;
      }
    }
  }
}

void PathTiming::Search::SlowWhereNeeded() {
  std::vector<double> best_most = profile.most;
  const Choice evenly = best;
  for (Choice start : {evenly, Choice{1, 1, 1}, Choice{1, 1, 2}, Choice{1, 0.7, 1.4}, Choice{1, 0.5, 1},
                       Choice{1, 0.5, 2}, Choice{1, 0.3, 2}}) {
    profile.most.assign(profile.s.size(), HUGE_VAL);
    for (int round = 0; round < kRounds; ++round) {
      std::vector<double> seen(profile.s.size(), 0);
      Evaluate(start, false, &seen);
      if (start.duration_s < best.duration_s) {
        best = start;
        best_most = profile.most;
      }
      const int n = static_cast<int>(seen.size());
      for (int i = 0; i < n; ++i) {
        double worst = 1;
        for (int j = std::max(0, i - kReach); j <= std::min(n - 1, i + kReach); ++j)
          worst = std::max(worst, seen[static_cast<std::size_t>(j)]);
        const auto at = static_cast<std::size_t>(i);
        const double x = timing.knots_[at].rate * timing.knots_[at].rate;
        if (worst > 1 && x > 0) profile.most[at] = std::min(profile.most[at], x / (worst * worst));
      }
    }
  }
  profile.most = best_most;
}

PathTiming::PathTiming(const Spline& curve, const PathLimits& limits) {
  Profile profile(curve, limits);
  bound_s_ = profile.Run(1, 1).back().t;
  Search search{*this, curve, limits, profile};
  search.OnGrid();
  search.AroundBest();
  search.SlowWhereNeeded();
  search.Evaluate(search.best, true, nullptr);
}

// ---- points and tip paths ---------------------------------------------------------------------------------

void RequireWithinBend(const Spline& curve, const RobotParameters& robot, const char* knots) {
  const double most = robot.limits.max_bending_rad;
  double worst = 0, at = curve.begin();
  for (int i = 0; i <= 2000; ++i) {
    const double s = curve.begin() + (curve.end() - curve.begin()) * i / 2000;
    const VectorXd b = curve.At(s).value;
    for (Eigen::Index k = 0; k + 1 < b.size(); k += 2) {
      const double bend = b.segment<2>(k).norm();
      if (bend <= worst) continue;  // also for NaN
      worst = std::isfinite(bend) ? bend : HUGE_VAL;
      at = s;
    }
  }
  if (worst > most * (1 + 1e-9)) {
    const auto& all = curve.knots();
    const auto after = std::upper_bound(all.data() + 1, all.data() + all.size() - 1, at) - all.data();
    const std::string where = knots ? fmt::format("between {} {} and {}", knots, after, after + 1)
                                    : fmt::format("{:.0f} % of the way along",
                                                  100 * (at - curve.begin()) / (curve.end() - curve.begin()));
    throw PathError(fmt::format(
        "the path bends a section {} {}; accepted: up to limits.max_bending_rad = {:g} rad; give points that "
        "bend less or lie closer together",
        std::isfinite(worst) ? fmt::format("by {:.3f} rad", worst) : "without end", where, most));
  }
}

TipSolver::TipSolver(const RobotParameters& robot, bool nearest)
    : robot_(model::ControlModel(robot)),
      body_(robot_.body),
      nearest_(nearest),
      last_(BendingVector::Zero(2 * body_.sections())) {}

VectorXd TipSolver::Solve(const Vector3d& tip_W_m, const std::string& name) {
  const model::InverseKinematics kinematics(body_, robot_.limits.max_bending_rad);
  const model::IkSolution found = kinematics.Solve(tip_W_m, last_);
  distance_m_ = found.distance_m;
  if (!nearest_ && !(distance_m_ <= kReachShare * robot_.body.length_m())) {
    const Vector3d near = kinematics.Tip(found.us_vs);
    throw PathError(
        fmt::format("{}: the robot's tip cannot reach ({:.6g}, {:.6g}, {:.6g}) m: the nearest reachable "
                    "point is ({:.6g}, {:.6g}, {:.6g}), {:.2f} mm away{}; give reachable points, or accept "
                    "the nearest with --nearest",
                    name, tip_W_m.x(), tip_W_m.y(), tip_W_m.z(), near.x(), near.y(), near.z(),
                    1e3 * distance_m_, AskMillimetres(tip_W_m, robot_.body.length_m())));
  }
  const double most_m = kNearestShare * robot_.body.length_m();
  if (!(distance_m_ <= most_m)) {
    throw PathError(
        fmt::format("{}: ({:.6g}, {:.6g}, {:.6g}) m is {:.4g} m from any point that the tip can reach; "
                    "accepted with --nearest: up to {:g} m; give metres, in the base frame{}",
                    name, tip_W_m.x(), tip_W_m.y(), tip_W_m.z(), distance_m_, most_m,
                    AskMillimetres(tip_W_m, robot_.body.length_m())));
  }
  if (distance_m_ > kReachShare * robot_.body.length_m()) farthest_m_ = std::max(farthest_m_, distance_m_);
  last_ = found.us_vs;
  return last_;
}

Spline ThroughPoints(const MatrixXd& bending_rad, const RobotParameters& robot) {
  // Knots by the square root of the distance, which avoids loops between unevenly spaced points.
  VectorXd knots(bending_rad.rows());
  knots[0] = 0;
  for (Eigen::Index i = 1; i < bending_rad.rows(); ++i) {
    const double distance = (bending_rad.row(i) - bending_rad.row(i - 1)).norm();
    if (!(distance > 1e-6)) {
      throw PathError(fmt::format("points {} and {} are the same; leave one out", i, i + 1));
    }
    knots[i] = knots[i - 1] + std::sqrt(distance);
  }
  Spline curve(knots, bending_rad);
  RequireWithinBend(curve, robot, "points");
  return curve;
}

TipPath ArcAround(const Vector3d& centre, const Vector3d& normal, const Vector3d& from, double angle_rad) {
  const Vector3d axis = normal.normalized(), out = from - centre;
  const double radius = out.norm();
  if (!(normal.norm() > 0) || !(radius > 0)) {
    throw PathError("the arc's normal or radius is zero; give a direction, and a start beside the centre");
  }
  if (std::abs(axis.dot(out)) > 1e-3 * radius) {
    throw PathError(fmt::format(
        "the arc's start is {:.3g} mm off the plane through its centre; move one of them along the normal",
        1e3 * std::abs(axis.dot(out))));
  }
  return {[centre, axis, out, angle_rad](double u) -> Vector3d {
            return centre + Eigen::AngleAxisd(angle_rad * u, axis) * out;
          },
          std::max(1.0, std::abs(angle_rad) / (2 * M_PI))};
}

TipPath ArcThrough(const Vector3d& from, const Vector3d& through, const Vector3d& to) {
  const Vector3d a = through - from, b = to - from, normal = a.cross(b);
  const double n2 = normal.squaredNorm();
  if (!(n2 > 1e-8 * a.squaredNorm() * b.squaredNorm()) || !((to - through).norm() > 0)) {
    throw PathError(
        "the arc's three points lie on one line or on each other; move one of them aside, or use line");
  }
  const Vector3d centre =
      from + (b.squaredNorm() * normal.cross(a) + a.squaredNorm() * b.cross(normal)) / (2 * n2);
  const Vector3d axis = normal.normalized(), x = (from - centre).normalized(), y = axis.cross(x);
  // Right-handed about a x b the arc runs from the first point through the second to the third.
  double angle = std::atan2((to - centre).dot(y), (to - centre).dot(x));
  if (angle <= 0) angle += 2 * M_PI;
  return ArcAround(centre, normal, from, angle);
}

TipPath LineTo(const Vector3d& from, const Vector3d& to) {
  if (!((to - from).norm() > 0)) throw PathError("the line's ends are the same point; move one of them");
  return {[from, to](double u) -> Vector3d { return from + u * (to - from); }};
}

Spline AlongTip(const TipPath& path, const std::string& name, TipSolver& solver,
                const RobotParameters& robot) {
  MatrixXd bending;
  const int steps = static_cast<int>(std::ceil(kTipPoints * path.turns));
  VectorXd knots(steps + 1);
  for (int i = 0; i <= steps; ++i) {
    const double u = static_cast<double>(i) / steps;
    const VectorXd b = solver.Solve(path(u), fmt::format("{}, {:.0f} % of the way", name, 100 * u));
    if (i == 0) bending.resize(steps + 1, b.size());
    bending.row(i) = b.transpose();
    knots[i] = u;
  }
  if ((bending.rowwise() - bending.row(0)).cwiseAbs().maxCoeff() < 1e-6) {
    throw PathError(name + " does not move the robot; give points that lie apart");
  }
  Spline curve(knots, bending);
  RequireWithinBend(curve, robot);
  return curve;
}

}  // namespace tendril::motion
