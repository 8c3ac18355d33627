// The controller's projection of a body that twists and stretches: the same robot as far as bending goes.
#include "tendril/model/bending_model.h"

#include <gtest/gtest.h>

#include "bodies.h"
#include "tendril/model/body.h"
#include "tendril/model/statics.h"

namespace tendril::model {
namespace {

RobotParameters Rod(double torsional_Nm2, double axial_N, int units_per_disk) {
  RobotParameters robot;
  robot.body = test::PaperBody(5 * units_per_disk, 0.018 / units_per_disk);
  SectionParameters& s = robot.body.sections[0];
  s.units_per_disk = units_per_disk;
  s.torsion = s.extension = true;
  s.torsional_stiffness_Nm2 = torsional_Nm2;
  s.axial_stiffness_N = axial_N;
  s.unit_mass_kg = 0.002 / units_per_disk;
  s.bending_damping_Nms = 1e-4 * units_per_disk;
  robot.body.gravity_W_mps2 = {0, 3, -9};
  robot.limits.min_tension_N = 0.3;
  robot.limits.max_tension_base_N = 3;
  return robot;
}

TEST(BendingModel, HasTheSameDisksWeightLengthStiffnessAndDamping) {
  const BodyParameters rod = Rod(1e-3, 1e4, 3).body, bending = BendingModel(rod);
  EXPECT_TRUE(bending.BendsOnly());
  EXPECT_EQ(bending.units(), 5);
  EXPECT_NEAR(bending.mass_kg(), rod.mass_kg(), 1e-15);
  EXPECT_NEAR(bending.length_m(), rod.length_m(), 1e-15);
  EXPECT_NEAR(bending.sections[0].UnitStiffness(), rod.sections[0].UnitStiffness() / 3, 1e-15);
  EXPECT_NEAR(bending.sections[0].bending_damping_Nms, 1e-4, 1e-18);
  const BodyParameters again = BendingModel(bending);
  EXPECT_EQ(again.units(), 5);
  EXPECT_EQ(again.sections[0].unit_length_m, bending.sections[0].unit_length_m);
}

TEST(BendingModel, ASpacingHasTheRestBendAndTheMeanStiffnessOfItsUnits) {
  BodyParameters rod = Rod(1e-3, 1e4, 2).body;
  rod.DeviationOf(3).rest_u_rad = 0.1;
  rod.DeviationOf(4).rest_u_rad = 0.2;
  rod.DeviationOf(4).stiffness_scale = 1.5;
  const BodyParameters bending = BendingModel(rod);
  ASSERT_EQ(bending.unit_deviations.size(), 1u);
  EXPECT_EQ(bending.unit_deviations[0].unit, 2);
  EXPECT_NEAR(bending.unit_deviations[0].rest_u_rad, 0.3, 1e-15);
  EXPECT_NEAR(bending.unit_deviations[0].stiffness_scale, 1.25, 1e-15);
}

TEST(BendingModel, ErrorOfTheTipIsThatOfTheMissingStrains) {
  EXPECT_LT(*WorstTipErrorOfBending(Rod(1e8, 1e14, 1)), 1e-9);
  // A backbone that a newton shortens by a hundredth: at 3.6 N of tension the 90 mm robot is about 3 mm
  // shorter.
  const double soft_m = *WorstTipErrorOfBending(Rod(1e8, 100, 1));
  EXPECT_GT(soft_m, 2e-3);
  EXPECT_LT(soft_m, 6e-3);
  // Gravity across the bend twists.
  EXPECT_GT(*WorstTipErrorOfBending(Rod(1e-4, 1e14, 1)), 1e-4);
}

TEST(UnseenBending, IsZeroWhereTheBodyOnlyBends) {
  RobotParameters robot = Rod(1e-3, 1e4, 1);
  robot.body = BendingModel(robot.body);
  EXPECT_EQ(UnseenBending(robot), Eigen::Matrix2d::Zero());
}

TEST(UnseenBending, VanishesWithTheOtherStrains) {
  EXPECT_LT(UnseenBending(Rod(1e8, 1e14, 1)).norm(), 1e-20);
}

// The tendons of a bent robot shorten a little in common, by an arc's height, so that those of one that
// shortens by compression seem to bend. The second moment goes with the square of the compliance.
TEST(UnseenBending, GoesWithTheSquareOfTheCompliance) {
  const Eigen::Matrix2d soft = UnseenBending(Rod(1e8, 100, 1)), stiffer = UnseenBending(Rod(1e8, 1000, 1));
  EXPECT_EQ(soft, soft.transpose());
  EXPECT_GT(soft.trace(), 1e-3);
  EXPECT_NEAR(soft.trace() / stiffer.trace(), 100, 25);
}

TEST(BendingModel, NoErrorWhereARobotHasNoEquilibrium) {
  RobotParameters robot = Rod(1e-3, 1e4, 1);
  robot.limits.max_tension_base_N = 1000;
  EXPECT_FALSE(WorstTipErrorOfBending(robot));
}

}  // namespace
}  // namespace tendril::model
