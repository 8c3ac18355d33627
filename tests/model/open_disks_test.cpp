// Shapes that disks allow: as far as the tendon on the inner side has length left.
#include "tendril/model/open_disks.h"

#include <gtest/gtest.h>

#include <numbers>

#include "bodies.h"

namespace tendril::model {
namespace {

Eigen::VectorXd Bent(const Body& body, int unit, double u, double v) {
  Eigen::VectorXd q = Eigen::VectorXd::Zero(body.dof());
  q[2 * unit] = u;
  q[2 * unit + 1] = v;
  return q;
}

TEST(OpenDisks, StraightIsOpen) {
  const Body body(test::TwoSections());
  EXPECT_FALSE(FirstClosedUnit(body, Eigen::VectorXd::Zero(body.dof())));
}

// A tendon at radius r has l - r theta cos left within a unit of length l: 5.625 rad of 22.5 mm over 4 mm.
TEST(OpenDisks, AUnitClosesWhereItsInnerTendonHasNoLengthLeft) {
  const Body body(test::PaperBody());
  const double closes_rad = 0.0225 / 0.004;
  EXPECT_FALSE(FirstClosedUnit(body, Bent(body, 2, 0.999 * closes_rad, 0)));
  EXPECT_EQ(FirstClosedUnit(body, Bent(body, 2, 1.001 * closes_rad, 0)), 2);
  // Away from the only tendon on this side it goes on to a whole turn: cos 60 deg of the two others.
  EXPECT_FALSE(FirstClosedUnit(body, Bent(body, 2, -1.001 * closes_rad, 0)));
  EXPECT_EQ(FirstClosedUnit(body, Bent(body, 2, -2.001 * std::numbers::pi, 0)), 2);
}

TEST(OpenDisks, TendonsOfSectionsAboveRunThroughAndTheFirstUnitIsNamed) {
  BodyParameters parameters = test::TwoSections();
  parameters.sections[1].tendons = test::Around(3, 0.02);  // wide, through units of 20 mm
  const Body body(parameters);
  EXPECT_EQ(FirstClosedUnit(body, Bent(body, 1, 1.01, 0)), 1);
  EXPECT_FALSE(FirstClosedUnit(body, Bent(body, 3, 1.01, 0)));  // of 25 mm
  EXPECT_EQ(FirstClosedUnit(body, Bent(body, 1, 1.01, 0) + Bent(body, 4, 7, 0)), 1);
}

}  // namespace
}  // namespace tendril::model
