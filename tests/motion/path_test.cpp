// Paths through points and along arcs: they pass where they should, within every limit, and in hardly more
// than the least time there is.
#include "tendril/motion/path.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "tendril/config/config.h"
#include "tendril/core/tip_unit.h"
#include "tendril/motion/path_motion.h"

namespace tendril::motion {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kPi = std::numbers::pi;

RobotParameters Robot(const char* file = "rig_60mm.yaml") {
  return config::LoadRobot(std::string(TENDRIL_SOURCE_DIR "/config/robots/") + file);
}

motion::Spline Line(double length) {
  MatrixXd ends(2, 2);
  ends << 0, 0, 0.6 * length, 0.8 * length;
  return {VectorXd{{0, 1}}, ends};
}

// By differences of what is put out, not by its own derivatives.
void ExpectWithin(const motion::Motion& motion, const motion::PathLimits& limits) {
  constexpr double kStep_s = 1e-3;
  VectorXd before, rate_before, acceleration_before;
  double most_rate = 0, most_acceleration = 0, most_jerk = 0;
  for (int i = 0; i * kStep_s <= motion.duration_s(); ++i) {
    const VectorXd b = motion.At(i * kStep_s).bending_rad;
    VectorXd rate, acceleration;
    if (i > 0) rate = (b - before) / kStep_s;
    if (i > 1) acceleration = (rate - rate_before) / kStep_s;
    for (Eigen::Index k = 0; k + 1 < b.size(); k += 2) {
      if (i > 0) most_rate = std::max(most_rate, rate.segment<2>(k).norm());
      if (i > 1) most_acceleration = std::max(most_acceleration, acceleration.segment<2>(k).norm());
      if (i > 2) {
        const VectorXd jerk = (acceleration - acceleration_before) / kStep_s;
        most_jerk = std::max(most_jerk, jerk.segment<2>(k).norm());
      }
    }
    before = b;
    rate_before = rate;
    acceleration_before = acceleration;
  }
  EXPECT_LE(most_rate, limits.rate_radps * (1 + 1e-9));
  EXPECT_LE(most_acceleration, limits.acceleration_radps2 * (1 + 1e-6));
  EXPECT_LE(most_jerk, limits.jerk_radps3 * (1 + 1e-4));
  EXPECT_GT(std::max({most_rate / limits.rate_radps, most_acceleration / limits.acceleration_radps2,
                      most_jerk / limits.jerk_radps3}),
            0.9)
      << "and one of them is used";
}

TEST(Spline, IsTheCubicThatItIsGiven) {
  // Of zero second derivative at both ends: sums of x and of the natural spline's own building stones; a line
  // is one.
  const VectorXd knots{{0, 0.3, 1.1, 1.5, 2}};
  MatrixXd values(5, 1);
  for (int i = 0; i < 5; ++i) values(i, 0) = 3 - 2 * knots[i];
  const motion::Spline line(knots, values);
  for (double s = 0; s <= 2; s += 0.01) {
    EXPECT_NEAR(line.At(s).value[0], 3 - 2 * s, 1e-14);
    EXPECT_NEAR(line.At(s).first[0], -2, 1e-13);
    EXPECT_NEAR(line.At(s).second[0], 0, 1e-13);
  }
}

TEST(Spline, HasTwoContinuousDerivativesThatBelongTogether) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  VectorXd knots(8);
  MatrixXd values(8, 2);
  for (int i = 0; i < 8; ++i) {
    knots[i] = i + 0.3 * std::sin(i);
    values.row(i) << normal(random), normal(random);
  }
  const motion::Spline spline(knots, values);
  constexpr double kEps = 1e-6;
  for (int i = 1; i < 7; ++i) {
    EXPECT_NEAR((spline.At(knots[i]).value - values.row(i).transpose()).norm(), 0, 1e-12);
    const auto left = spline.At(knots[i] - kEps), right = spline.At(knots[i] + kEps);
    EXPECT_NEAR((left.first - right.first).norm(), 0, 1e-4);
    EXPECT_NEAR((left.second - right.second).norm(), 0, 1e-4);
  }
  for (double s = 0.1; s < 6.8; s += 0.13) {
    const auto a = spline.At(s - kEps), b = spline.At(s + kEps), p = spline.At(s);
    EXPECT_NEAR(((b.value - a.value) / (2 * kEps) - p.first).norm(), 0, 1e-7);
    EXPECT_NEAR(((b.first - a.first) / (2 * kEps) - p.second).norm(), 0, 1e-6);
  }
  EXPECT_EQ(spline.At(knots[0]).second.norm(), 0);
  EXPECT_NEAR(spline.At(knots[7]).second.norm(), 0, 1e-12);
}

// Least times from rest to rest over a straight way within rate, acceleration and jerk, from an independent
// source: ruckig 0.19.4 (PyPI), one degree of freedom, Trajectory.duration.
struct Golden {
  double way_rad, rate, acceleration, jerk, least_s;
};
constexpr Golden kGolden[] = {
    {1, 0.5, 2, 20, 2.350000000},       {0.1, 0.5, 2, 20, 0.558257569},    {0.01, 0.5, 2, 20, 0.251984210},
    {1, 8, 160, 8000, 0.195000000},     {0.1, 8, 160, 8000, 0.073680630},  {0.01, 8, 160, 8000, 0.034199519},
    {0.001, 8, 160, 8000, 0.015874011}, {1, 0.5, 160, 8000, 2.015811388},  {2, 2, 4, 400, 1.510000000},
    {0.3, 1, 50, 100, 0.500000000},     {1.5, 0.7, 1.3, 2.9, 3.129594543},
};
class LeastTime : public testing::TestWithParam<Golden> {};

TEST_P(LeastTime, OfAStraightWayIsMetWithinOnePercent) {
  const Golden& g = GetParam();
  const motion::PathTiming timing(Line(g.way_rad), {g.rate, g.acceleration, g.jerk});
  EXPECT_GT(timing.duration_s(), g.least_s * (1 - 1e-9)) << "nothing is faster than the least time";
  EXPECT_LT(timing.duration_s(), g.least_s * 1.01);
  RecordProperty("ratio", std::to_string(timing.duration_s() / g.least_s));
}

INSTANTIATE_TEST_SUITE_P(Ways, LeastTime, testing::ValuesIn(kGolden));

TEST(PathTiming, NeverTurnsBackOnAStraightWayAndArrives) {
  for (const double way : {0.001, 0.05, 0.5, 2.0}) {
    const motion::PathTiming timing(Line(way), {2, 40, 2000});
    double last = 0;
    for (double t = 0; t <= timing.duration_s(); t += 1e-3) {
      const auto p = timing.At(t);
      EXPECT_GE(p.s, last - 1e-12) << way;
      EXPECT_GE(p.rate, -1e-9) << way;
      EXPECT_LE(p.s, 1) << way;
      last = p.s;
    }
    const auto end = timing.At(timing.duration_s());
    EXPECT_NEAR(end.s, 1, 1e-12);
    EXPECT_NEAR(end.rate, 0, 1e-9);
    EXPECT_NEAR(end.acceleration, 0, 1e-5);
  }
}

// Rest, out to a point, back on the same way: at the turn the way stands still on the curve while its bend is
// greatest. Least time within rate v and acceleration a: gather speed, cruise, turn round at -a, cruise,
// stop.
TEST(PathTiming, ThereAndBackTakesItsLeastTime) {
  const motion::PathLimits limits{2, 40, 2000};
  for (const double way : {0.2, 1.0}) {
    MatrixXd points(3, 2);
    points << 0, 0, way, 0, 0, 0;
    const motion::PathTiming timing(motion::ThroughPoints(points, Robot()), limits);
    const double v = limits.rate_radps, a = limits.acceleration_radps2, least_s = 2 * (way / v + v / a);
    EXPECT_GT(timing.bound_s(), least_s * 0.98) << way;
    EXPECT_LT(timing.bound_s(), least_s * 1.02) << way;
    EXPECT_LT(timing.duration_s(), least_s + 0.25) << way << " within jerk as well";
  }
  MatrixXd points(3, 2);
  points << 0, 0, 1, 0, 0.5, 0;
  EXPECT_LT(motion::PathTiming(motion::ThroughPoints(points, Robot()), limits).duration_s(), 1.2);
}

class Through : public testing::TestWithParam<const char*> {};

TEST_P(Through, RandomPointsWithinEveryLimitAndWithoutStopping) {
  const RobotParameters robot = Robot(GetParam());
  const int sections = static_cast<int>(robot.body.sections.size());
  std::mt19937 random(11);
  std::uniform_real_distribution<double> bend(-0.7, 0.7);
  double worst_ratio = 0;
  for (const motion::PathLimits& limits :
       {motion::PathLimits{0.5, 2, 20}, motion::PathLimits{8, 160, 8000}, motion::PathLimits{2, 4, 400}}) {
    MatrixXd points(6, 2 * sections);
    for (Eigen::Index i = 0; i < points.size(); ++i) points.data()[i] = bend(random);
    const motion::Spline curve = motion::ThroughPoints(points, robot);
    const auto motion = motion::MakePathMotion("via", {curve}, limits, robot);
    ExpectWithin(*motion, limits);
    for (int i = 0; i < points.rows(); ++i) {
      double nearest = HUGE_VAL, rate_there = 0;
      for (double t = 0; t <= motion->judged_until_s(); t += 1e-3) {
        const Command c = motion->At(t);
        const double gap = (c.bending_rad - points.row(i).transpose()).norm();
        if (gap < nearest) {
          nearest = gap;
          rate_there = c.bending_rate_radps.norm();
        }
      }
      EXPECT_LT(nearest, limits.rate_radps * 1.1e-3) << "point " << i;
      if (i > 0 && i + 1 < points.rows()) {
        EXPECT_GT(rate_there, 0.02 * limits.rate_radps) << "point " << i;
      }
    }
    const motion::PathTiming timing(curve, limits);
    worst_ratio = std::max(worst_ratio, timing.duration_s() / timing.bound_s());
    EXPECT_GE(timing.duration_s(), timing.bound_s() * (1 - 1e-3));
  }
  RecordProperty("worst_ratio_to_least_time_without_jerk", std::to_string(worst_ratio));
  EXPECT_LT(worst_ratio, 1.25);
}

INSTANTIATE_TEST_SUITE_P(Robots, Through, testing::Values("rig_60mm.yaml", "two_section.yaml"));

TEST(Through, TheSamePointTwiceIsRefused) {
  MatrixXd points(3, 2);
  points << 0, 0, 0.2, 0.1, 0.2, 0.1;
  EXPECT_THROW(motion::ThroughPoints(points, Robot()), motion::PathError);
}

TEST(Through, ACurveThatBendsTooFarIsRefused) {
  MatrixXd points(4, 2);
  points << 0, 0, 2.55, 0, 2.55, 0.5, 0, 0.2;
  EXPECT_THROW(motion::ThroughPoints(points, Robot()), motion::PathError);
}

TEST(Arc, ByThreePointsIsTheCircleThroughThem) {
  const Vector3d centre(0.01, -0.02, 0.05);
  const Vector3d x = Vector3d(1, 2, 0.5).normalized(), y = x.unitOrthogonal();
  const auto at = [&](double a) { return Vector3d(centre + 0.03 * (std::cos(a) * x + std::sin(a) * y)); };
  for (const auto& [through, to] : {std::pair{1.0, 2.0}, {3.0, 5.0}, {0.2, 6.0}, {-1.0, -2.0}}) {
    const motion::TipPath arc = motion::ArcThrough(at(0), at(through), at(to));
    for (double u = 0; u <= 1; u += 0.05)
      EXPECT_LT((arc(u) - at(u * to)).norm(), 1e-12) << through << " " << to;
  }
}

TEST(Arc, ThreePointsOnALineAreRefused) {
  EXPECT_THROW(motion::ArcThrough({0, 0, 0}, {0, 0, 1}, {0, 0, 2}), motion::PathError);
  EXPECT_THROW(motion::ArcThrough({0, 0, 0}, {0, 0, 1}, {0, 0, 1}), motion::PathError);
  EXPECT_THROW(motion::ArcAround({0, 0, 0}, {0, 0, 0}, {1, 0, 0}, 1), motion::PathError);
  EXPECT_THROW(motion::ArcAround({0, 0, 0}, {0, 0, 1}, {1, 0, 0.1}, 1), motion::PathError);
}

TEST(Arc, OfTheTipAboutTheRobotsAxisIsMetEverywhere) {
  const RobotParameters robot = Robot();
  const double theta = kPi / 3, l = robot.body.length_m();
  const Vector3d from(l / theta * (1 - std::cos(theta)), 0, l / theta * std::sin(theta));
  motion::TipSolver solver(robot, false);
  const motion::Spline curve = motion::AlongTip(motion::ArcAround({0, 0, from.z()}, {0, 0, 1}, from, 2 * kPi),
                                                "circle", solver, robot);
  const auto motion = motion::MakePathMotion("circle", {curve}, {1, 5, 50}, robot);
  ExpectWithin(*motion, {1, 5, 50});
  double turned = 0, last = 0;
  for (double t = 0; t <= motion->judged_until_s(); t += 0.01) {
    const Vector3d tip = motion->TipAt(t);
    EXPECT_NEAR(tip.head<2>().norm(), from.x(), 1e-6);
    EXPECT_NEAR(tip.z(), from.z(), 1e-6);
    const double angle = std::atan2(tip.y(), tip.x());
    turned += std::remainder(angle - last, 2 * kPi);
    last = angle;
  }
  EXPECT_NEAR(turned, 2 * kPi, 1e-3);
}

TEST(Arc, OfManyTurnsIsAsExactAsOfOne) {
  const RobotParameters robot = Robot();
  const double theta = 0.8, l = robot.body.length_m();
  const Vector3d from(l / theta * (1 - std::cos(theta)), 0, l / theta * std::sin(theta));
  motion::TipSolver solver(robot, false);
  const motion::PathLimits limits{2, 10, 100};
  const motion::Spline curve = motion::AlongTip(
      motion::ArcAround({0, 0, from.z()}, {0, 0, 1}, from, -20 * kPi), "circle", solver, robot);
  const auto motion = motion::MakePathMotion("circle", {curve}, limits, robot);
  ExpectWithin(*motion, limits);
  for (double t = 0; t <= motion->judged_until_s(); t += 0.0123) {
    EXPECT_NEAR(motion->TipAt(t).head<2>().norm(), from.x(), 1e-6);
    EXPECT_NEAR(motion->TipAt(t).z(), from.z(), 1e-6);
  }
  // The least time that a straight way of this length would take: at full speed but for gathering and losing
  // it.
  const double least_s = 20 * kPi * theta / limits.rate_radps +
                         limits.rate_radps / limits.acceleration_radps2 +
                         limits.acceleration_radps2 / limits.jerk_radps3;
  EXPECT_LT(motion->judged_until_s(), 1.02 * least_s);
}

TEST(Arc, OutOfReachIsNamedOrProjected) {
  const RobotParameters robot = Robot();
  motion::TipSolver strict(robot, false), nearest(robot, true);
  const motion::TipPath line = motion::LineTo({0.01, 0, 0.058}, {0.03, 0.01, 0.058});
  try {
    motion::AlongTip(line, "line", strict, robot);
    FAIL() << "a straight line leaves the surface that one section's tip can reach";
  } catch (const motion::PathError& e) {
    EXPECT_NE(std::string(e.what()).find("mm away"), std::string::npos) << e.what();
    EXPECT_NE(std::string(e.what()).find("--nearest"), std::string::npos);
  }
  EXPECT_NO_THROW(motion::AlongTip(line, "line", nearest, robot));
  EXPECT_GT(nearest.farthest_m(), 1e-3);
  for (motion::TipSolver* solver : {&strict, &nearest}) {
    try {
      solver->Solve({10, 0, 58}, "point 1");
      FAIL() << "58 m";
    } catch (const motion::PathError& e) {
      EXPECT_NE(std::string(e.what()).find("; millimetres? That would be 0.01 0 0.058 m"), std::string::npos)
          << e.what();
    }
  }
}

TEST(TipUnit, IsAskedForOnlyWhereNoPathSlipsSoFar) {
  EXPECT_EQ(AskMillimetres({0, 0, 60}), "; millimetres? That would be 0 0 0.06 m");
  EXPECT_EQ(AskMillimetres({0, 0, 9}), "") << "of no robot in particular";
  EXPECT_EQ(AskMillimetres({0, -50, 9}, 0.06), "; millimetres? That would be 0 -0.05 0.009 m");
  EXPECT_EQ(AskMillimetres({0, 0, 0.6}, 0.06), "") << "a decimal place, as 0.6 mm it is no tip";
  EXPECT_EQ(AskMillimetres({0, 0, 1e5}, 0.06), "") << "not in millimetres either";
  EXPECT_EQ(AskMillimetres({0, 0, std::nan("")}), "");
}

TEST(Spline, ThatOvershootsIsRefusedWithItsPlace) {
  const RobotParameters robot = Robot();
  const double most = robot.limits.max_bending_rad;
  MatrixXd b(4, 2);
  b << 0, 0, 0, 0, most, 0, most, 0;
  const auto refused = [&](const VectorXd& knots) {
    try {
      motion::RequireWithinBend(motion::Spline(knots, b), robot, "rows");
    } catch (const motion::PathError& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  EXPECT_NE(refused(VectorXd{{0, 1, 2, 3}}).find("between rows 3 and 4"), std::string::npos);
  const std::string without_end = refused(VectorXd{{0, 1, 1 + 1e-13, 1e200}});
  EXPECT_NE(without_end.find("without end between rows"), std::string::npos) << without_end;
  EXPECT_EQ(without_end.find("inf"), std::string::npos);
}

TEST(Table, GoesThroughItsRowsAtTheirTimes) {
  const RobotParameters robot = Robot();
  VectorXd t(50);
  MatrixXd b(50, 2);
  for (int i = 0; i < 50; ++i) {
    t[i] = 2 + 0.1 * i;
    b.row(i) << 0.5 * std::sin(0.5 * t[i]), 0.3 * std::cos(0.7 * t[i]);
  }
  const auto motion = motion::MakeTableMotion("table", motion::Spline(t, b), {8, 160, 8000}, robot);
  for (int i = 0; i < 50; ++i)
    EXPECT_LT((motion->At(t[i] - 2).bending_rad - b.row(i).transpose()).norm(), 1e-12);
  for (double at = 0.5; at < 4.4; at += 0.013) {
    const Command c = motion->At(at);
    EXPECT_NEAR(c.bending_rad[0], 0.5 * std::sin(0.5 * (at + 2)), 1e-6) << "between the rows";
    EXPECT_NEAR(c.bending_rate_radps[0], 0.25 * std::cos(0.5 * (at + 2)), 1e-4);
  }
  EXPECT_EQ(motion->At(motion->duration_s()).bending_rate_radps.norm(), 0);
}

TEST(Table, TooFastIsRefusedWithTheFactorThatHelps) {
  const RobotParameters robot = Robot();
  VectorXd t(20);
  MatrixXd b(20, 2);
  for (int i = 0; i < 20; ++i) {
    t[i] = 0.05 * i;
    b.row(i) << 0.5 * std::sin(20 * t[i]), 0;
  }
  const motion::PathLimits limits{4, 160, 8000};
  std::string why;
  try {
    motion::MakeTableMotion("table", motion::Spline(t, b), limits, robot);
    FAIL() << "10 rad/s were asked for";
  } catch (const std::runtime_error& e) {
    why = e.what();
  }
  const auto at = why.find("--stretch ");
  ASSERT_NE(at, std::string::npos) << why;
  const double factor = std::stod(why.substr(at + 10));
  EXPECT_NO_THROW(motion::MakeTableMotion("table", motion::Spline(t * factor, b), limits, robot));
  EXPECT_ANY_THROW(motion::MakeTableMotion("table", motion::Spline(t * factor * 0.95, b), limits, robot));
}

}  // namespace
}  // namespace tendril::motion
