// Which ways a section's tendons bend it, and what the allocation makes of forces elsewhere.
#include "tendril/model/pull_cone.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "tendril/config/config.h"
#include "tendril/model/inverse.h"

namespace tendril::model {
namespace {

using Kind = PullCone::Kind;

constexpr double kDeg = std::numbers::pi / 180;

BodyParameters WithTendons(const std::vector<double>& angles_deg) {
  BodyParameters body = config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_60mm.yaml").body;
  body.sections[0].tendons.clear();
  for (const double angle : angles_deg) body.sections[0].tendons.push_back({angle * kDeg, 0.004});
  return body;
}

TEST(PullCone, IsWhatTendonsPullTogether) {
  struct Case {
    std::vector<double> tendons_deg;
    Kind kind;
    double from_deg, width_deg;
  };
  for (const Case& c : {Case{{40}, Kind::kRay, 40, 0}, Case{{-90, 90}, Kind::kLine, 90, 180},
                        Case{{0, 179.91}, Kind::kLine, 0, 180},  // 3.14 for pi
                        Case{{300, 20}, Kind::kWedge, 300, 80}, Case{{0, 90, 180}, Kind::kHalfPlane, 0, 180},
                        Case{{0, 120, 240}, Kind::kPlane, 0, 360}, Case{{0, 178, 269}, Kind::kPlane, 0, 360},
                        Case{{0, 60, 120}, Kind::kWedge, 0, 120}}) {
    const PullCone cone = PullConeOf(WithTendons(c.tendons_deg), 0);
    EXPECT_EQ(cone.kind, c.kind) << c.tendons_deg.front();
    EXPECT_EQ(PullsEveryWay(WithTendons(c.tendons_deg)), c.kind == Kind::kPlane);
    EXPECT_NEAR(cone.from_rad, c.from_deg * kDeg, 1e-9);
    EXPECT_NEAR(cone.width_rad, c.width_deg * kDeg, 1e-9);
    // The nearest of a cone: itself where it is in it, and the error at right angles to it.
    for (int i = 0; i < 36; ++i) {
      const Eigen::Vector2d bend(std::cos(10 * i * kDeg), std::sin(10 * i * kDeg)), near = cone.Nearest(bend);
      EXPECT_LT((cone.Nearest(near) - near).norm(), 1e-12);
      EXPECT_NEAR(near.dot(bend - near), 0, 1e-12);
      for (const double tendon : c.tendons_deg) {
        const Eigen::Vector2d pulled(std::cos(tendon * kDeg), std::sin(tendon * kDeg));
        EXPECT_LT((cone.Nearest(pulled) - pulled).norm(), 3e-3);
        EXPECT_LT(pulled.dot(bend - near), 3e-3) << "no tendon comes nearer";
      }
    }
  }
}

// An angle that a file rounds: 3.1416 or 3.14 for pi.
TEST(PullCone, HolesThatCountAsOppositeOrEqualAreAligned) {
  for (const std::vector<double>& tendons_deg :
       {std::vector<double>{40}, {0, 180.0004}, {40, 219.91}, {10, 10.3, 190}}) {
    BodyParameters body = WithTendons(tendons_deg);
    const BodyParameters file = body;
    AlignHoles(body);
    const PullCone cone = PullConeOf(file, 0);
    const Eigen::Vector2d across(-std::sin(cone.from_rad), std::cos(cone.from_rad));
    for (std::size_t j = 0; j < tendons_deg.size(); ++j) {
      const double angle = body.sections[0].tendons[j].angle_rad;
      EXPECT_LT(std::abs(across.dot(Eigen::Vector2d(std::cos(angle), std::sin(angle)))), 1e-14);
      EXPECT_NEAR(angle, file.sections[0].tendons[j].angle_rad, 0.01);
    }
  }
  for (const std::vector<double>& tendons_deg :
       {std::vector<double>{0, 120, 240}, {0, 60}, {0, 90, 180}, {0, 178}}) {
    BodyParameters body = WithTendons(tendons_deg);
    const BodyParameters file = body;
    AlignHoles(body);
    for (std::size_t j = 0; j < tendons_deg.size(); ++j)
      EXPECT_EQ(body.sections[0].tendons[j].angle_rad, file.sections[0].tendons[j].angle_rad);
  }
}

TEST(PullCone, RestsAsTheLeastTensionBendsIt) {
  const Body one(WithTendons({0})), pair(WithTendons({0, 180})), three(WithTendons({0, 120, 240}));
  const auto wound = [](const Body& body) {
    Eigen::VectorXd shortening_m(body.tendons());
    body.TendonShortening(RestShape(body, 0.3), shortening_m);
    return shortening_m;
  };
  const Eigen::VectorXd wound_m = wound(one);
  ASSERT_EQ(wound_m.size(), 1);
  // 0.3 N at 4 mm against 4 units of E pi r^4 / 4 l = 0.0753 N m/rad bends by 0.064 rad; weight adds to it.
  EXPECT_GT(wound_m[0], 0.004 * 0.064);
  EXPECT_LT(wound_m[0], 0.004 * 0.075);
  EXPECT_LT(wound(pair).norm(), 1e-9);
  EXPECT_LT(wound(three).norm(), 1e-9);
}

TEST(TensionAllocation, OfOneTendonOrAPairComesAsNearAsTheyPull) {
  struct Case {
    std::vector<double> tendons_deg;
    Eigen::Vector2d force_Nm;
    std::vector<double> tension_N;
    Status status, bound;
  };
  constexpr double r = 0.004;
  for (const Case& c :
       {Case{{0}, {2 * r, 0}, {2}, Status::kOk, Status::kOk},
        Case{{0}, {2 * r, r}, {2}, Status::kLimitedTensionMax, Status::kOk},
        Case{{0}, {-2 * r, 0}, {0.3}, Status::kLimitedTensionMax, Status::kLimitedTensionMin},
        Case{{0}, {9 * r, 0}, {8}, Status::kLimitedTensionMax, Status::kLimitedTensionMax},
        Case{{0, 180}, {2 * r, 0}, {2.3, 0.3}, Status::kOk, Status::kOk},
        Case{{0, 180}, {-2 * r, r}, {0.3, 2.3}, Status::kLimitedTensionMax, Status::kOk},
        Case{{0, 180}, {-9 * r, 0}, {0.3, 8}, Status::kLimitedTensionMax, Status::kLimitedTensionMax}}) {
    const auto tendons = static_cast<int>(c.tendons_deg.size());
    Eigen::MatrixXd jacobian(2, tendons);
    for (int j = 0; j < tendons; ++j) {
      const double angle = c.tendons_deg[static_cast<std::size_t>(j)] * kDeg;
      jacobian.col(j) << r * std::cos(angle), r * std::sin(angle);
    }
    const auto given = TensionAllocator(tendons, 2).Allocate(jacobian, c.force_Nm, 0.3, 8);
    EXPECT_EQ(given.status, c.status) << c.force_Nm.transpose();
    EXPECT_EQ(given.bound, c.bound) << c.force_Nm.transpose();
    for (int j = 0; j < tendons; ++j)
      EXPECT_NEAR(given.tension_N[j], c.tension_N[static_cast<std::size_t>(j)], 1e-6)
          << c.force_Nm.transpose();
  }
}

}  // namespace
}  // namespace tendril::model
