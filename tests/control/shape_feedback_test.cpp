// What tendons show of a robot that is not as its file says, on a section whose bend answers a moment at
// once: it reaches its reference, tracks it around a circle, and stands at rest.
#include "tendril/control/shape_feedback.h"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <numbers>
#include <random>
#include <string>

#include "tendril/config/config.h"
#include "tendril/model/inverse.h"

namespace tendril::control {
namespace {

constexpr double kFriction_Nm = 1e-4;

// A section that bends by the reference and the added moment, times `softer`, and turned by `turned`
// as friction turns it behind a motion.
class Section {
 public:
  explicit Section(std::complex<double> softer)
      : robot_(config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_60mm.yaml")),
        body_(robot_.body),
        softer_(softer),
        feedback_(body_, 0.3, kFriction_Nm, 1e-3) {}

  double Stiffness() const { return body_.unit_stiffness_Nm(0) / body_.units(); }
  ShapeFeedback& feedback() { return feedback_; }
  double hold_Nm = HUGE_VAL, stick_rad = 0;
  BendingVector bend() const { return bend_; }

  /// One cycle; the noise is of the tendons' displacement. The bend's error.
  double Step(const BendingVector& wanted, double noise_m = 0, bool acts = true, bool at_limit = false) {
    const BendingVector m = feedback_.moment_Nm() / Stiffness();
    const std::complex<double> pulled = softer_ * std::complex<double>(wanted[0] + m[0], wanted[1] + m[1]);
    // It sticks until it is pulled far enough, then overshoots.
    const std::complex<double> off = pulled - std::complex<double>(bend_[0], bend_[1]);
    if (std::abs(off) >= stick_rad)
      bend_ += (stick_rad > 0 ? 1.8 : 1.0) * Eigen::Vector2d(off.real(), off.imag());
    TendonVector wanted_m = Shortening(wanted), shown_m = Shortening(bend_);
    for (int j = 0; j < 3; ++j) shown_m[j] += noise_m * normal_(random_);
    Eigen::MatrixXd per_tension(2, 3);
    model::SectionForcePerTension(body_, wanted, per_tension);
    feedback_.Step(wanted, wanted_m, shown_m, TendonVector::Ones(shown_m.size()), per_tension,
                   BendingMatrix::Identity(2, 2) / Stiffness(), hold_Nm, acts, at_limit);
    return (wanted - bend_).norm();
  }

 private:
  TendonVector Shortening(const BendingVector& bend) {
    UnitVector q(body_.dof());
    TendonVector d(3);
    body_.SpreadBending(bend, q);
    body_.TendonShortening(q, d);
    return d;
  }

  RobotParameters robot_;
  model::Body body_;
  std::complex<double> softer_;
  ShapeFeedback feedback_;
  BendingVector bend_ = BendingVector::Zero(2);
  std::mt19937 random_{1};
  std::normal_distribution<double> normal_;
};

BendingVector Bend(double rad, double way) {
  BendingVector b(2);
  b << rad * std::cos(way), rad * std::sin(way);
  return b;
}

TEST(ShapeFeedback, ComesToWhereItIsWanted) {
  for (const double rad : {0.2, 1.2}) {
    Section section(0.75);
    double error = 0;
    for (int i = 0; i < 3000; ++i) error = section.Step(Bend(rad, 0.4));
    EXPECT_LT(error, 1.01 * kFriction_Nm / section.Stiffness()) << "of " << 0.25 * rad;
  }
}

// Whatever grows with the bend and turns with it is learned once.
TEST(ShapeFeedback, KeepsItWhileTheRobotIsLedRound) {
  Section section(std::polar(0.75, -0.2));
  double late = 0;
  for (int i = 0; i < 8000; ++i) {
    const double t = 1e-3 * i, error = section.Step(Bend(1, 2 * std::numbers::pi * t));
    if (t > 6) late = std::max(late, error);
  }
  EXPECT_LT(late, 0.02) << "a turn a second; 0.3 without, and 0.26 with an integral that does not turn";
}

// Noise of encoders and cells moves nothing at rest, and a small error that dry friction leaves neither.
TEST(ShapeFeedback, StandsAtRest) {
  Section section(0.8);
  for (int i = 0; i < 4000; ++i) section.Step(Bend(1, 0), 2e-6);
  const BendingVector moment = section.feedback().moment_Nm();
  int changes = 0;
  for (int i = 0; i < 20000; ++i) {
    const BendingVector before = section.feedback().moment_Nm();
    section.Step(Bend(1, 0), 2e-6);
    changes += section.feedback().moment_Nm() != before;
  }
  EXPECT_EQ(changes, 0);
  EXPECT_NEAR(moment[0] / section.Stiffness(), 0.25, 0.01);
}

// A robot that something holds fast is not pushed without end.
TEST(ShapeFeedback, HasABound) {
  Section section(0);
  for (int i = 0; i < 20000; ++i) section.Step(Bend(1, 0));
  EXPECT_LE(section.feedback().moment_Nm().norm(),
            section.Stiffness() * 2 * ShapeFeedback::kMaxShare + 1e-12);
  EXPECT_GT(section.feedback().moment_Nm().norm(), 0.5 * section.Stiffness());
  section.feedback().Reset();
  EXPECT_EQ(section.feedback().moment_Nm().norm(), 0);
}

// What friction may hold is all that a robot at rest is pushed by: pushed by more, it would leap once it
// moves.
TEST(ShapeFeedback, PushesNoHarderThanFrictionHolds) {
  Section section(0);
  section.hold_Nm = 3e-3;
  for (int i = 0; i < 20000; ++i) section.Step(Bend(0.4, 0));
  EXPECT_LT(section.feedback().moment_Nm().norm(), section.hold_Nm * 1.01);
  EXPECT_GT(section.feedback().moment_Nm().norm(), section.hold_Nm * 0.99);
}

// A robot that sticks and slips past its reference is left alone after a few times.
TEST(ShapeFeedback, DoesNotHunt) {
  Section section(0.8);
  section.stick_rad = 0.1;
  for (int i = 0; i < 40000; ++i) section.Step(Bend(1, 0));
  const BendingVector moment_Nm = section.feedback().moment_Nm();
  double error = 0;
  for (int i = 0; i < 20000; ++i) error = section.Step(Bend(1, 0));
  EXPECT_EQ((section.feedback().moment_Nm() - moment_Nm).norm(), 0);
  EXPECT_LT(error, 0.2);
}

// Where tensions are at their limit a correction that asks for more of them fades.
TEST(ShapeFeedback, FadesWhereTensionsEnd) {
  Section section(0.8);
  for (int i = 0; i < 3000; ++i) section.Step(Bend(1, 0));
  const double known = section.feedback().moment_Nm().norm();
  for (int i = 0; i < 300; ++i) section.Step(Bend(1, 0), 0, true, true);
  EXPECT_NEAR(section.feedback().moment_Nm().norm(), known / std::numbers::e, 0.01 * known) << "after tau";
}

TEST(ShapeFeedback, KeepsWhatItKnowsWhileItDoesNotAct) {
  Section section(0.8);
  for (int i = 0; i < 3000; ++i) section.Step(Bend(1, 0));
  const double known = section.feedback().moment_Nm().norm();
  for (int i = 0; i < 1000; ++i) section.Step(Bend(1, 0), 1e-3, false);
  EXPECT_EQ(section.feedback().moment_Nm().norm(), known);
}

}  // namespace
}  // namespace tendril::control
