#include "tendril/motion/path_motion.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "tendril/model/bending_model.h"

namespace tendril::motion {
namespace {

using Eigen::VectorXd;

// Rest at the end, so that the arrival is visible.
constexpr double kRestAfter_s = 0.5;
constexpr double kLimitLook_s = 0.001;
constexpr int kMostLimitLooks = 200000;
constexpr double kMoving = 0.01;  // share of the greatest rate that counts as rest

Command BendingTarget(const VectorXd& bending_rad, const VectorXd& rate_radps) {
  Command target;
  target.kind = CommandKind::kBending;
  target.bending_rad = bending_rad;
  target.bending_rate_radps = rate_radps;
  return target;
}

class BendingMotion : public Motion {
 public:
  explicit BendingMotion(const RobotParameters& robot) : model_(model::BendingModel(robot.body)) {}
  Eigen::Vector3d TipAt(double t_s) const override {
    VectorXd q(model_.dof());
    model_.SpreadBending(At(t_s).bending_rad, q);
    return model_.TipPose(q).p_WA;
  }

 private:
  model::Body model_;
};

class PathMotion final : public BendingMotion {
 public:
  PathMotion(std::string name, const std::vector<Spline>& curves, const PathLimits& limits,
             const RobotParameters& robot)
      : BendingMotion(robot), curves_(curves) {
    name_ = std::move(name);
    double bound_s = 0;
    for (const Spline& curve : curves_) {
      timings_.emplace_back(curve, limits);
      judged_until_s_ += timings_.back().duration_s();
      bound_s += timings_.back().bound_s();
    }
    duration_s_ = judged_until_s_ + kRestAfter_s;
    description_ = fmt::format(
        "{}: {:.3f} s within {:g} rad/s, {:g} rad/s^2, {:g} rad/s^3 of a section's bend ({:.3f} s without "
        "the limit "
        "of jerk)",
        name_, judged_until_s_, limits.rate_radps, limits.acceleration_radps2, limits.jerk_radps3, bound_s);
  }

  Command At(double t_s) const override {
    std::size_t i = 0;
    for (; i + 1 < curves_.size() && t_s > timings_[i].duration_s(); ++i) t_s -= timings_[i].duration_s();
    const PathTiming::Point at = timings_[i].At(t_s);
    const Spline::Point point = curves_[i].At(at.s);
    return BendingTarget(point.value, point.first * at.rate);
  }

 private:
  std::vector<Spline> curves_;
  std::vector<PathTiming> timings_;
};

class TableMotion final : public BendingMotion {
 public:
  TableMotion(std::string name, const Spline& table, const PathLimits& limits, const RobotParameters& robot)
      : BendingMotion(robot), table_(table) {
    name_ = std::move(name);
    const double whole_s = table_.end() - table_.begin();
    judged_until_s_ = whole_s;
    duration_s_ = whole_s + kRestAfter_s;
    double stretch = 0, at_s = 0;
    LimitUse worst;
    const auto look = [&](double t_s) {
      const Spline::Point p = table_.At(t_s);
      const LimitUse use = UseOf(limits, p.first, p.second, p.third);
      if (use.stretch() > stretch) {
        stretch = use.stretch();
        worst = use;
        at_s = t_s;
      }
    };
    const int looks = std::clamp(static_cast<int>(whole_s / kLimitLook_s), 100, kMostLimitLooks);
    for (int i = 0; i <= looks; ++i) look(table_.begin() + whole_s * i / looks);
    for (const double knot_s : table_.knots()) look(knot_s);
    if (stretch > 1 + 1e-9) {
      throw std::runtime_error(fmt::format(
          "{}: at t = {:.4g} s it needs {:.3g} rad/s, {:.3g} rad/s^2 and {:.3g} rad/s^3 of a section's bend; "
          "accepted: up to {:g}, {:g} and {:g}; slow it down with --stretch {:.3g}, or give smoother or "
          "fewer rows",
          name_, at_s, worst.rate * limits.rate_radps, worst.acceleration * limits.acceleration_radps2,
          worst.jerk * limits.jerk_radps3, limits.rate_radps, limits.acceleration_radps2, limits.jerk_radps3,
          std::ceil(stretch * 101) / 100));
    }
    description_ = fmt::format("{}: {} rows in {:.3f} s, {:.0f} % of what the limits allow", name_,
                               table_.knots().size(), whole_s, 100 * stretch);
    const double begins = table_.At(table_.begin()).first.norm(), ends = table_.At(table_.end()).first.norm();
    if (std::max(begins, ends) > kMoving * limits.rate_radps) {
      description_ += fmt::format("; it begins at {:.3g} and ends at {:.3g} rad/s, which the robot smooths",
                                  begins, ends);
    }
  }

  Command At(double t_s) const override {
    const double whole_s = table_.end() - table_.begin();
    const bool ended = t_s >= whole_s;
    const Spline::Point p = table_.At(table_.begin() + std::min(t_s, whole_s));
    return BendingTarget(p.value, ended ? VectorXd::Zero(p.first.size()) : p.first);
  }

 private:
  Spline table_;
};

}  // namespace

std::unique_ptr<Motion> MakePathMotion(std::string name, const std::vector<Spline>& curves,
                                       const PathLimits& limits, const RobotParameters& robot) {
  return std::make_unique<PathMotion>(std::move(name), curves, limits, robot);
}

std::unique_ptr<Motion> MakeTableMotion(std::string name, const Spline& table, const PathLimits& limits,
                                        const RobotParameters& robot) {
  return std::make_unique<TableMotion>(std::move(name), table, limits, robot);
}

}  // namespace tendril::motion
