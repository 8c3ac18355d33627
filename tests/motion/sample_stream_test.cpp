// Samples become an even motion: through each of them, a fixed time later, never faster than between two of
// them, and at rest on the last.
#include "tendril/motion/sample_stream.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace tendril::motion {
namespace {

using Eigen::VectorXd;

VectorXd V(double a) { return VectorXd{{a, -2 * a}}; }

TEST(SampleStream, AStraightMotionComesOutStraightWhateverTheSpacing) {
  constexpr TimeNs kDelay = 120 * kNsPerMs;
  motion::SampleStream stream(kDelay);
  std::mt19937 random(2);
  std::uniform_int_distribution<TimeNs> spacing(20 * kNsPerMs, 100 * kNsPerMs);
  TimeNs next = 0;
  for (TimeNs now = 0; now < 5 * kNsPerS; now += kNsPerMs) {
    if (now >= next) {
      stream.Add(now, V(0.3 * ToSeconds(now)), kNsPerS);
      next = now + spacing(random);
    }
    const auto p = stream.At(now);
    if (now < 2 * kDelay) continue;
    EXPECT_NEAR(p.value[0], 0.3 * ToSeconds(now - kDelay), 1e-12);
    EXPECT_NEAR(p.rate[0], 0.3, 1e-9);
    EXPECT_NEAR(p.rate[1], -0.6, 1e-9);
  }
}

TEST(SampleStream, PassesEverySampleOneDelayLater) {
  motion::SampleStream stream(100 * kNsPerMs);
  for (int i = 0; i < 20; ++i) stream.Add(i * 50 * kNsPerMs, V(std::sin(i)), kNsPerS);
  for (int i = 0; i < 20; ++i) EXPECT_NEAR(stream.At((i * 50 + 100) * kNsPerMs).value[0], std::sin(i), 1e-12);
}

TEST(SampleStream, RestsOnTheLastSampleAndExpires) {
  motion::SampleStream stream(100 * kNsPerMs);
  stream.Add(0, V(0), 300 * kNsPerMs);
  stream.Add(50 * kNsPerMs, V(1), 300 * kNsPerMs);
  const auto end = stream.At(200 * kNsPerMs);
  EXPECT_EQ(end.value[0], 1);
  EXPECT_EQ(end.rate.norm(), 0);
  EXPECT_FALSE(stream.Expired(350 * kNsPerMs));
  EXPECT_TRUE(stream.Expired(351 * kNsPerMs));
}

TEST(SampleStream, AShortValidityDoesNotCutOffTheMotionToTheLastSample) {
  motion::SampleStream stream(100 * kNsPerMs);
  stream.Add(0, V(0), 10 * kNsPerMs);
  EXPECT_FALSE(stream.Expired(100 * kNsPerMs));
  EXPECT_TRUE(stream.Expired(101 * kNsPerMs));
}

TEST(SampleStream, AfterAPauseItDoesNotJump) {
  motion::SampleStream stream(100 * kNsPerMs);
  stream.Add(0, V(0), 10 * kNsPerS);
  stream.Add(50 * kNsPerMs, V(0.1), 10 * kNsPerS);
  VectorXd last = stream.At(50 * kNsPerMs).value;
  for (TimeNs now = 51 * kNsPerMs; now < 4 * kNsPerS; now += kNsPerMs) {
    if (now == 3 * kNsPerS) stream.Add(now, V(1), 10 * kNsPerS);
    const auto p = stream.At(now);
    EXPECT_LE((p.value - last).norm(), V(0.9).norm() / 100 * 1.001) << now;
    last = p.value;
  }
  EXPECT_EQ(last[0], 1);
}

TEST(SampleStream, OfTwoAtOnceTheLaterCounts) {
  motion::SampleStream stream(100 * kNsPerMs);
  stream.Add(0, V(0), kNsPerS);
  stream.Add(0, V(1), kNsPerS);
  EXPECT_EQ(stream.At(0).value[0], 1);
}

}  // namespace
}  // namespace tendril::motion
