// How far tensions can hold a bend: against the bend at which an allocation of its own reaches the limit, and
// for robots of more tendons, of more sections, and mounted sideways.
#include "tendril/control/reach.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "support/rig_file.h"

namespace tendril::control {
namespace {

using test::Rig;

// Greatest tension that holds the arc at rest with none above the limit; infinite where there is none.
double MostTension(const model::Body& body, const BendingVector& us_vs, double min_N) {
  UnitVector q(body.dof()), unit_Nm(body.dof());
  BendingVector force_Nm(2 * body.sections());
  Eigen::MatrixXd per_tension(2 * body.sections(), body.tendons());
  body.SpreadBending(us_vs, q);
  body.StaticForce(q, Eigen::Vector3d::Zero(), unit_Nm);
  body.ProjectForce(unit_Nm, force_Nm);
  model::SectionForcePerTension(body, us_vs, per_tension);
  double least = INFINITY;
  for (double most_N = min_N + 0.01; most_N < 20; most_N += 0.01) {
    model::TensionAllocator allocator(body.tendons(), 2 * body.sections());
    if (allocator.Allocate(per_tension, force_Nm, min_N, most_N).status != Status::kOk) continue;
    least = most_N;
    break;
  }
  return least;
}

TEST(Reach, EndsWhereTensionsDo) {
  for (const char* name : {"rig_60mm", "rig_90mm", "four_tendon_90mm", "two_section"}) {
    for (const bool sideways : {false, true}) {
      RobotParameters robot = Rig(name);
      if (sideways) robot.body.gravity_W_mps2 = {9.81, 0, 0};
      const model::Body body(robot.body);
      Reach reach(robot, body, robot.limits, 0.1, true);
      int limited = 0;
      for (int i = 0; i < 12; ++i) {
        SCOPED_TRACE(std::string(name) + (sideways ? " sideways " : " ") + std::to_string(i));
        const double way = 0.55 * i;
        BendingVector asked(2 * body.sections());
        for (int k = 0; k < body.sections(); ++k)
          asked.segment<2>(2 * k) << 2.6 * std::cos(way + k), 2.6 * std::sin(way + k);
        BendingVector given = asked, again = asked, less = 0.3 * asked;
        const Status status = reach.Limit(given);
        EXPECT_EQ(reach.Limit(again), status);
        EXPECT_EQ(again, given);
        const double most_N = MostTension(body, given, robot.limits.min_tension_N);
        EXPECT_LT(most_N, robot.limits.max_tension_base_N + 0.011);
        if (status == Status::kOk) {
          EXPECT_EQ(given, asked);
          continue;
        }
        ++limited;
        EXPECT_EQ(status, Status::kLimitedTensionMax);
        EXPECT_GT(most_N, 0.97 * robot.limits.max_tension_base_N) << "no farther back than it must";
        EXPECT_LT((given / given.norm() - asked / asked.norm()).norm(), 1e-12) << "in the same plane";
        EXPECT_EQ(reach.Limit(given), Status::kOk);
        EXPECT_EQ(reach.Limit(less), Status::kOk);
      }
      if (std::string(name) == "rig_60mm") {
        EXPECT_GT(limited, 6);
      }
    }
  }
}

// The trajectory differentiates moving goals twice. Where another tendon reaches its bound there is a corner.
TEST(Reach, OfAMovingGoalHasNoStepsAndFewCorners) {
  for (const char* name : {"rig_60mm", "two_section"}) {
    SCOPED_TRACE(name);
    const RobotParameters robot = Rig(name);
    const model::Body body(robot.body);
    Reach reach(robot, body, robot.limits, 0.1, true);
    constexpr double kStep_rad = 1e-4;
    BendingVector before, given;
    int limited = 0, corners = 0;
    double largest_rad = 0;
    for (int i = 0; i < 2000; ++i) {
      BendingVector asked(2 * body.sections());
      for (int k = 0; k < body.sections(); ++k)
        asked.segment<2>(2 * k) << 2.6 * std::cos(kStep_rad * i + k), 2.6 * std::sin(kStep_rad * i + k);
      limited += reach.Limit(asked) != Status::kOk;
      const BendingVector last = given;
      given = asked;
      if (i >= 1) largest_rad = std::max(largest_rad, (given - last).norm());
      if (i >= 2) corners += (given - 2 * last + before).norm() > 1e-6;
      before = last;
    }
    EXPECT_GT(limited, 500);
    EXPECT_LT(largest_rad, 10 * kStep_rad);
    EXPECT_LT(corners, 10);
  }
}

// A robot that cannot even be held straight has no bend to be brought back to.
TEST(Reach, LeavesAloneWhatCannotBeHeldAtAll) {
  RobotParameters robot = Rig("rig_90mm");
  robot.body.gravity_W_mps2 = {9.81, 0, 0};
  robot.body.tip_payload_kg = 1;
  const model::Body body(robot.body);
  Reach reach(robot, body, robot.limits, 0.1, true);
  BendingVector bend(2);
  bend << 1, 0;
  EXPECT_EQ(reach.Limit(bend), Status::kOk);
  EXPECT_EQ(bend[0], 1);
}

RobotParameters WithTendons(const std::vector<double>& angles_rad) {
  RobotParameters robot = Rig("rig_60mm");
  robot.body.sections[0].tendons.clear();
  for (const double angle : angles_rad) robot.body.sections[0].tendons.push_back({angle, 0.004});
  robot.actuation->tendons.resize(angles_rad.size());
  return robot;
}

// What tendons do not pull is brought to the nearest that they do: in the plane of a pair, on one side of a
// single one, and no straighter than the least tension leaves it.
TEST(Reach, OfFewTendonsIsTheNearestThatTheyHold) {
  const double pi = std::numbers::pi;
  struct Case {
    std::vector<double> tendons_rad;
    Eigen::Vector2d asked, given;
    Status status;
  };
  for (const Case& c : {Case{{0, pi}, {1.2, 0}, {1.2, 0}, Status::kOk},
                        Case{{0, pi}, {-1.2, 0.7}, {-1.2, 0}, Status::kLimitedDirection},
                        Case{{0, pi}, {0, 0}, {0, 0}, Status::kOk},
                        Case{{pi / 2, -pi / 2}, {0.5, 1}, {0, 1}, Status::kLimitedDirection},
                        Case{{0}, {1.2, 0}, {1.2, 0}, Status::kOk},
                        Case{{0}, {-1.2, 0.3}, {0.069, 0}, Status::kLimitedDirection},
                        Case{{0, pi / 2}, {0.9, 0.8}, {0.9, 0.8}, Status::kOk}}) {
    const RobotParameters robot = WithTendons(c.tendons_rad);
    const model::Body body(robot.body);
    Reach reach(robot, body, robot.limits, 0.1, true);
    EXPECT_GT(reach.holdable_rad(), 1.3);
    BendingVector bend = c.asked;
    EXPECT_EQ(reach.Limit(bend), c.status) << c.asked.transpose();
    EXPECT_LT((bend - c.given).norm(), 3e-3) << c.asked.transpose() << " -> " << bend.transpose();
    BendingVector again = bend;
    EXPECT_EQ(reach.Limit(again), Status::kOk) << "what was given is held";
    EXPECT_LT((again - bend).norm(), 1e-8);
  }
  const RobotParameters pair = WithTendons({0, pi});
  const model::Body body(pair.body);
  Reach reach(pair, body, pair.limits, 0.1, true);
  BendingVector far(2);
  far << 2.6, 0;
  EXPECT_EQ(reach.Limit(far), Status::kLimitedTensionMax);
  EXPECT_NEAR(MostTension(body, far, pair.limits.min_tension_N), pair.limits.max_tension_base_N, 0.02);
  EXPECT_NEAR(reach.holdable_rad(), 0.95 * far[0], 1e-6);
}

// A pair that lies level sags across its plane, and is held as it sags.
TEST(Reach, OfAPairMountedSidewaysSags) {
  RobotParameters robot = WithTendons({0, std::numbers::pi});
  robot.body.gravity_W_mps2 = {0, -9.81, 0};
  const model::Body body(robot.body);
  Reach reach(robot, body, robot.limits, 0.1, true);
  BendingVector bend(2);
  bend << 1, 0;
  EXPECT_EQ(reach.Limit(bend), Status::kLimitedDirection);
  EXPECT_NEAR(bend[0], 1, 0.05);
  EXPECT_LT(bend[1], -0.05);
  EXPECT_LT(MostTension(body, bend, robot.limits.min_tension_N), robot.limits.max_tension_base_N);
}

}  // namespace
}  // namespace tendril::control
