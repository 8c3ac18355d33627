// The paper's zero-tension motion (section 3.1) has constant energy: a minute of it with SUNDIALS at tight
// tolerance.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "bodies.h"
#include "tendril/model/simulate.h"

namespace tendril::model {
namespace {

using Eigen::VectorXd;

TEST(EnergyDrift, OfAMinuteWithoutTensionStaysBelowABillionth) {
  const Body body(test::PaperBody());
  Body::Workspace workspace(body);
  VectorXd q(8);
  q << 0.26, 0.05, 0.26, 0.05, 0.26, 0.05, 0.26, 0.05;
  const VectorXd still = VectorXd::Zero(8);
  // Relative to the energy that moves: the weight's potential has an arbitrary zero.
  const double rest = body.EnergyOf(still, still, workspace).total();
  const double start = body.EnergyOf(q, still, workspace).total() - rest;
  double drift = 0, fastest = 0;
  int samples = 0;
  Simulate(body, {Eigen::Vector2d(0, 60), Eigen::MatrixXd::Zero(3, 2)}, q, still, 0.05, 1e-12,
           [&](double, ConstVectorRef at, ConstVectorRef speed) {
             drift = std::max(drift, std::abs(body.EnergyOf(at, speed, workspace).total() - rest - start));
             fastest = std::max(fastest, speed.norm());
             ++samples;
           });
  EXPECT_EQ(samples, 1201);
  EXPECT_GT(fastest, 1);  // it does move
  RecordProperty("relative_drift_e12", std::to_string(1e12 * drift / start));
  EXPECT_LT(drift / start, 1e-9);
}

}  // namespace
}  // namespace tendril::model
