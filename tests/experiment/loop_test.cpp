// The whole chain in simulated time: what sending ahead is worth, what `follow` makes of paths, and how far
// the estimate of bending is to be believed.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "tendril/config/config.h"
#include "tendril/experiment/closed_loop.h"
#include "tendril/experiment/motion_run.h"
#include "tendril/motion/path_motion.h"

namespace tendril::experiment {
namespace {

RobotParameters Robot(const char* file) {
  return config::LoadRobot(std::string(TENDRIL_SOURCE_DIR "/config/robots/") + file);
}

experiment::ClosedLoopOptions Options(const char* robot, bool equilibrium, bool look_ahead,
                                      std::uint64_t seed = 1) {
  experiment::ClosedLoopOptions o{.controller_robot = Robot(robot),
                                  .plant_robot = Robot(robot),
                                  .daemon = config::LoadDaemon(TENDRIL_SOURCE_DIR "/config/tendrild.yaml"),
                                  .plant = {.seed = seed},
                                  .log_path = ""};
  auto& c = o.daemon.controller;
  c.law = equilibrium ? ControlLaw::kEquilibrium : ControlLaw::kPaper;
  c.tension_feedback = equilibrium;
  c.trajectory.look_ahead = look_ahead;
  return o;
}

/// The circle of the tip at so many turns a second, as fast_circle but slower or faster.
class Turning final : public motion::Motion {
 public:
  Turning(const RobotParameters& robot, double turns_per_s)
      : fast_(motion::MakeMotion("fast_circle", robot)) {
    scale_ = turns_per_s;
    name_ = "turning";
    duration_s_ = fast_->duration_s() / scale_;
    judged_from_s_ = fast_->judged_from_s() / scale_;
    judged_until_s_ = fast_->judged_until_s() / scale_;
  }
  Command At(double t_s) const override {
    Command c = fast_->At(t_s * scale_);
    c.tip_velocity_W_mps *= scale_;
    return c;
  }
  Eigen::Vector3d TipAt(double t_s) const override { return fast_->TipAt(t_s * scale_); }

 private:
  std::unique_ptr<motion::Motion> fast_;
  double scale_;
};

struct Sent {
  double ahead_s, extrapolates_s;
};

/// As `tendril follow` does it: a command every 10 ms, from one lead before the motion on.
void Follow(experiment::ClosedLoop& loop, const motion::Motion& motion, const Sent& sent,
            const std::function<void(const CycleRecord&, double t_s)>& observe) {
  loop.ArmAndPretension();
  experiment::ApproachStart(loop, motion, [](const CycleRecord&, double) {});
  const double start_s = loop.now_s() + sent.ahead_s;
  const std::uint64_t every = experiment::CyclesOf(loop, 0.01);
  for (std::uint64_t step = 0; loop.now_s() - start_s < motion.duration_s(); ++step) {
    const double t_s = loop.now_s() - start_s;
    if (step % every == 0) loop.Send(motion.SentAhead(t_s, sent.ahead_s, sent.extrapolates_s));
    const CycleRecord& r = loop.Step();
    ASSERT_LT(static_cast<int>(r.output.status), 400) << StatusText(r.output.status) << " at " << t_s;
    observe(r, t_s);
  }
}

double TipRmsMm(const experiment::ClosedLoopOptions& options, const motion::Motion& motion,
                const Sent& sent) {
  experiment::ClosedLoop loop(options);
  double sum2 = 0;
  int count = 0;
  Follow(loop, motion, sent, [&](const CycleRecord&, double t_s) {
    if (t_s < motion.judged_from_s() || t_s > motion.judged_until_s()) return;
    sum2 += (loop.plant().TipPose().p_WA - motion.TipAt(t_s)).squaredNorm();
    ++count;
  });
  return 1e3 * std::sqrt(sum2 / count);
}

double LeadOf(const experiment::ClosedLoopOptions& options) {
  experiment::ClosedLoopOptions o = options;
  o.daemon.controller.trajectory.look_ahead = false;
  return experiment::ClosedLoop(o).sender_lead_s();
}

TEST(SentAhead, IsTheSameGoalWhetherTheControllerLooksAheadOrNot) {
  const Turning motion(Robot("rig_60mm.yaml"), 1);
  for (double t = -0.1; t < motion.duration_s(); t += 0.0371) {
    const Command plain = motion.SentAhead(t, 0.07, 0), moved = motion.SentAhead(t, 0.07, 0.07);
    EXPECT_EQ(plain.tip_velocity_W_mps, moved.tip_velocity_W_mps);
    EXPECT_LT((moved.tip_W_m + 0.07 * moved.tip_velocity_W_mps - plain.tip_W_m).norm(), 1e-15);
  }
  EXPECT_EQ(motion.SentAhead(-1, 0.07, 0.07).tip_W_m, motion.At(0).tip_W_m);
  EXPECT_TRUE(motion.SentAhead(motion.duration_s(), 0.07, 0.07).tip_velocity_W_mps.isZero(0));
}

TEST(SentAhead, FastCirclesAreFollowedManyTimesBetter) {
  struct Row {
    double turns_per_s, times_better;
  };
  for (const Row& row : {Row{0.5, 8}, Row{1, 10}}) {
    const experiment::ClosedLoopOptions looking = Options("rig_60mm.yaml", true, true);
    const Turning motion(looking.controller_robot, row.turns_per_s);
    const double lead_s = LeadOf(looking);
    const double extrapolated = TipRmsMm(looking, motion, {0, 0});
    const double ahead = TipRmsMm(looking, motion, {lead_s, lead_s});
    const double ahead_alone = TipRmsMm(Options("rig_60mm.yaml", true, false), motion, {lead_s, 0});
    const std::string name = std::to_string(row.turns_per_s).substr(0, 3) + "_Hz_";
    RecordProperty(name + "extrapolated_mm", std::to_string(extrapolated));
    RecordProperty(name + "sent_ahead_mm", std::to_string(ahead));
    RecordProperty(name + "lead_ms", std::to_string(1e3 * lead_s));
    printf(
        "%.1f turns/s: extrapolated by the daemon %.3f mm, sent ahead %.3f mm (look_ahead off: %.3f mm), "
        "lead %.1f ms\n",
        row.turns_per_s, extrapolated, ahead, ahead_alone, 1e3 * lead_s);
    EXPECT_LT(ahead * row.times_better, extrapolated);
    EXPECT_NEAR(ahead, ahead_alone, 0.1 * ahead_alone + 0.01);
  }
}

TEST(Followed, ViaPointsArePassedWithinTheLimitsOfTheReference) {
  const experiment::ClosedLoopOptions options = Options("rig_60mm.yaml", true, true);
  const RobotParameters& robot = options.controller_robot;
  Eigen::MatrixXd points(5, 2);
  points << 0.1, 0, 0.6, 0.3, 0.2, 0.8, -0.5, 0.2, 0, -0.3;
  const auto& limits = options.daemon.controller.trajectory;
  const auto motion =
      motion::MakePathMotion("via", {motion::ThroughPoints(points, robot)}, {1, 4, 40}, robot);
  experiment::ClosedLoop loop(options);
  const double lead_s = LeadOf(options);
  std::vector<double> nearest(5, 1);
  Eigen::VectorXd acceleration = Eigen::VectorXd::Zero(2);
  Follow(loop, *motion, {lead_s, lead_s}, [&](const CycleRecord& r, double) {
    for (int i = 0; i < 5; ++i) {
      auto& n = nearest[static_cast<std::size_t>(i)];
      n = std::min(n, (r.output.reference.position_rad - points.row(i).transpose()).norm());
    }
    EXPECT_LE(r.output.reference.velocity_radps.norm(), limits.max_rate_radps);
    EXPECT_LE(r.output.reference.acceleration_radps2.norm(), limits.max_acceleration_radps2 * (1 + 1e-9));
    EXPECT_LE((r.output.reference.acceleration_radps2 - acceleration).norm() / 1e-3,
              limits.max_jerk_radps3 * (1 + 1e-6));
    acceleration = r.output.reference.acceleration_radps2;
  });
  // A millisecond's way at 1 rad/s, and what smoothing takes off the bends of the path.
  for (const double gap : nearest) EXPECT_LT(gap, 0.003);
}

// The estimate's own covariance against the plant's truth. The robot file is right here and units bend
// unequally, yet the sum that a section's bend is differs little from an arc's: what is left is the sensors'
// part.
TEST(Estimate, AgreesWithThePlantAsWellAsItsCovarianceSays) {
  struct Case {
    const char* robot;
    const char* motion;
  };
  for (const Case& c :
       {Case{"rig_60mm.yaml", "circle"}, Case{"rig_90mm.yaml", "planar"}, Case{"rig_60mm.yaml", "spiral"}}) {
    double normalised = 0, largest = 0, sum2 = 0;
    int count = 0;
    for (const std::uint64_t seed : {1, 2}) {
      const experiment::ClosedLoopOptions options = Options(c.robot, true, true, seed);
      const auto motion = motion::MakeMotion(c.motion, options.controller_robot);
      experiment::ClosedLoop loop(options);
      BendingVector truth(2);
      Follow(loop, *motion, {0, 0}, [&](const CycleRecord& r, double) {
        if (r.input.cycle % 20 != 0) return;
        loop.plant().body().SumBending(loop.plant().q(), truth);
        const BendingVector error = r.output.bending_estimate_rad - truth;
        normalised += error.dot(r.output.bending_covariance_rad2.ldlt().solve(error));
        largest = std::max(largest, error.norm());
        sum2 += error.squaredNorm();
        ++count;
      });
    }
    normalised /= 2 * count;
    const std::string name = c.motion;
    RecordProperty(name + "_normalised", std::to_string(normalised));
    RecordProperty(name + "_largest_mrad", std::to_string(1e3 * largest));
    printf("%s: error squared over its variance %.2f, rms %.3f mrad, largest %.3f mrad\n", c.motion,
           normalised, 1e3 * std::sqrt(sum2 / count), 1e3 * largest);
    EXPECT_GT(normalised, 0.3) << c.motion;
    EXPECT_LT(normalised, 3) << c.motion;
    EXPECT_LT(largest, 1e-3) << c.motion;
  }
}

}  // namespace
}  // namespace tendril::experiment
