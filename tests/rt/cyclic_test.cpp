// The deadline grid keeps its phase whatever happens, and the histogram agrees with sorting.
#include "tendril/rt/cyclic.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <random>
#include <thread>
#include <vector>

#include "tendril/rt/usage.h"

namespace tendril::rt {
namespace {

using testing::HasSubstr;

TEST(DeadlineGrid, OnTimeMovesOnePeriod) {
  DeadlineGrid grid(1000, 100);
  EXPECT_EQ(grid.Advance(1040), 0U);
  EXPECT_EQ(grid.next_ns(), 1100);
}

TEST(DeadlineGrid, LateByTwoAndAHalfPeriodsSkipsTwoWholeOnesAndKeepsThePhase) {
  DeadlineGrid grid(1000, 100);
  EXPECT_EQ(grid.Advance(1250), 2U);
  EXPECT_EQ(grid.next_ns(), 1300);
}

TEST(DeadlineGrid, ExactlyOnTheNextPointIsNotLateAndOneNanosecondAfterIs) {
  DeadlineGrid grid(1000, 100);
  EXPECT_EQ(grid.Advance(1100), 0U);
  EXPECT_EQ(grid.next_ns(), 1100);
  DeadlineGrid late(1000, 100);
  EXPECT_EQ(late.Advance(1101), 1U);
  EXPECT_EQ(late.next_ns(), 1200);
}

// Points served and points missed are all points there are: nothing is lost or counted twice, and every point
// is a whole number of periods from the start, before and after zero.
TEST(DeadlineGrid, NoPointIsLostOrCountedTwice) {
  constexpr TimeNs kStart = -123'456'789, kPeriod = 1'000'000;
  DeadlineGrid grid(kStart, kPeriod);
  std::mt19937_64 random(1);
  std::exponential_distribution<double> late(1.5);
  TimeNs now = kStart;
  TimeNs served = 0, missed = 0;
  for (int i = 0; i < 10'000; ++i) {
    now = std::max(now, grid.next_ns()) + static_cast<TimeNs>(late(random) * kPeriod);
    const TimeNs point = grid.next_ns();
    missed += static_cast<TimeNs>(grid.Advance(now));
    ++served;
    ASSERT_GT(grid.next_ns(), point);
    ASSERT_GE(grid.next_ns(), now);
    ASSERT_EQ((grid.next_ns() - kStart) % kPeriod, 0);
  }
  EXPECT_EQ((grid.next_ns() - kStart) / kPeriod, served + missed);
  EXPECT_GT(missed, 1000);
}

TEST(RunCyclic, APausedCycleIsFollowedByWholeSkipsOnTheSameGrid) {
  constexpr TimeNs kPeriod = 5 * kNsPerMs;
  std::vector<CycleStart> starts;
  RunCyclic(kPeriod, [&](const CycleStart& start) {
    starts.push_back(start);
    if (starts.size() == 3) std::this_thread::sleep_for(std::chrono::nanoseconds(3 * kPeriod));
    return starts.size() < 6;
  });
  ASSERT_EQ(starts.size(), 6U);
  EXPECT_GE(starts[3].missed, 2U);
  for (std::size_t i = 1; i < starts.size(); ++i) {
    EXPECT_EQ(starts[i].cycle, i);
    EXPECT_GE(starts[i].wake_latency_ns, 0);
    EXPECT_EQ(starts[i].grid_ns - starts[i - 1].grid_ns,
              (static_cast<TimeNs>(starts[i].missed) + 1) * kPeriod);
  }
}

TEST(Histogram, PercentilesAreNeverBelowTheExactOnesAndAtMostAnEighthAbove) {
  std::mt19937_64 random(2);
  std::lognormal_distribution<double> latency(std::log(20e3), 1.5);
  Histogram histogram;
  std::vector<TimeNs> values;
  for (int i = 0; i < 20'000; ++i) {
    values.push_back(static_cast<TimeNs>(latency(random)));
    histogram.Add(values.back());
  }
  std::sort(values.begin(), values.end());
  EXPECT_EQ(histogram.count(), values.size());
  EXPECT_EQ(histogram.max_ns(), values.back());
  for (const double share : {0.0, 0.001, 0.1, 0.5, 0.9, 0.99, 0.999, 0.9999, 1.0}) {
    const auto rank = static_cast<std::size_t>(std::ceil(share * static_cast<double>(values.size())));
    const TimeNs exact = values[std::max<std::size_t>(rank, 1) - 1];
    EXPECT_GE(histogram.Percentile(share), exact) << share;
    EXPECT_LE(static_cast<double>(histogram.Percentile(share)), static_cast<double>(exact) * 1.125) << share;
  }
}

TEST(Histogram, SmallValuesAreExactAndExtremesAreKept) {
  Histogram histogram;
  EXPECT_EQ(histogram.Percentile(0.5), 0);
  for (TimeNs v = 0; v < 16; ++v) histogram.Add(v);
  for (int v = 0; v < 16; ++v) EXPECT_EQ(histogram.Percentile((v + 1) / 16.0), v);
  histogram.Add(-5);
  EXPECT_EQ(histogram.Percentile(2.0 / 17), 0);
  histogram.Add(3600 * kNsPerS);
  EXPECT_EQ(histogram.Percentile(1), 3600 * kNsPerS);
}

TEST(Histogram, PublishedBinsHoldEveryValueBelowTheirEdgeAndNoOther) {
  Histogram histogram;
  std::array<std::uint64_t, kLatencyBins> expected{};
  for (TimeNs v : {0L, 1L, 1023L, 1024L, 2047L, 2048L, 1'000'000L, (1L << 30) - 1, 1L << 30, 1L << 40}) {
    histogram.Add(v);
    int bin = 0;
    while (v >= LatencyBinBelow_ns(bin)) ++bin;
    ++expected[static_cast<std::size_t>(bin)];
  }
  EXPECT_EQ(histogram.Statistics().counts, expected);
  EXPECT_EQ(histogram.Statistics().max_ns, 1L << 40);
}

// A wait that is excused is a switch the thread asked for, and still none of its cycle's; one that is not,
// is.
TEST(UsageMeter, CountsWhatIsNotExcused) {
  const auto sleep = [] {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
    return true;
  };
  UsageMeter meter;
  meter.Begin();
  EXPECT_TRUE(meter.Excuse(sleep));
  meter.End();
  EXPECT_EQ(meter.sum().voluntary_switches, 0U);
  sleep();
  EXPECT_EQ(meter.sum().voluntary_switches, 0U) << "outside the cycle";
  meter.Begin();
  sleep();
  meter.End();
  EXPECT_EQ(meter.sum().voluntary_switches, 1U);
}

TEST(EnterRealtime, ImpossibleSettingsAreNamedWithTheirRemedy) {
  std::thread([] {
    RealtimeParameters p;
    p.lock_memory = false;
    p.priority = 1000;
    p.cpu = 100'000;
    const std::string problems = EnterRealtime(p);
    EXPECT_THAT(problems, HasSubstr("priority 1000 is not set"));
    EXPECT_THAT(problems, HasSubstr("LimitRTPRIO=1000"));
    EXPECT_THAT(problems, HasSubstr("not bound to cpu 100000"));
  }).join();
}

TEST(EnterRealtime, NothingAskedNothingToComplainAbout) {
  std::thread([] {
    RealtimeParameters p;
    p.lock_memory = false;
    EXPECT_EQ(EnterRealtime(p), "");
  }).join();
}

}  // namespace
}  // namespace tendril::rt
