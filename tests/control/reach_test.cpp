// How far tensions can hold a bend: against the bend at which an allocation of its own reaches the limit, and
// for robots of more tendons, of more sections, and mounted sideways.
#include "tendril/control/reach.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>

#include "tendril/config/config.h"

namespace tendril::control {
namespace {

RobotParameters Rig(const std::string& name) {
  return config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/" + name + ".yaml");
}

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

}  // namespace
}  // namespace tendril::control
