// The control laws on the plant: what feedback may not cost, what a fast motion may not do, and what becomes
// of the tip when its tracker fails. Figures are those of `tendril compare`.
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <optional>
#include <string>

#include "closed_loop.h"
#include "motion_run.h"
#include "tendril/config/config.h"

namespace tendril::tools {
namespace {

ClosedLoopOptions Options(const char* robot, bool tension_feedback, bool tip_feedback = false) {
  const std::string folder = TENDRIL_SOURCE_DIR "/config/";
  const RobotParameters parameters = config::LoadRobot(folder + "robots/" + robot);
  ClosedLoopOptions o{.controller_robot = parameters,
                      .plant_robot = parameters,
                      .daemon = config::LoadDaemon(folder + "tendrild.yaml"),
                      .plant = {.seed = 1},
                      .log_path = ""};
  auto& c = o.daemon.controller;
  c.law = ControlLaw::kEquilibrium;
  c.tension_feedback = tension_feedback;
  c.tip_feedback = tip_feedback;
  c.trajectory.look_ahead = false;
  return o;
}

struct Figures {
  double rms_m = 0, largest_m = 0;
  double largest_step_Nm = 0;  // of a torque that is wanted, from one cycle to the next
  double most_base_N = 0;      // that a tendon carried
  std::map<Status, int> cycles;

  int slack_cycles() const {
    const auto found = cycles.find(Status::kSlack);
    return found == cycles.end() ? 0 : found->second;
  }
};

Figures Follow(const ClosedLoopOptions& options, const char* name) {
  const auto motion = MakeMotion(name, options.controller_robot.body);
  ClosedLoop loop(options);
  loop.ArmAndPretension();
  ApproachStart(loop, *motion, [](const CycleRecord&, double) {});
  Figures run;
  double sum2 = 0;
  int count = 0;
  std::optional<TendonVector> last_Nm;
  StreamMotion(
      loop, *motion,
      [&](const CycleRecord& r, double t_s) {
        ++run.cycles[r.output.status];
        if (last_Nm) {
          const double step_Nm = (r.output.torque_desired_Nm - *last_Nm).cwiseAbs().maxCoeff();
          run.largest_step_Nm = std::max(run.largest_step_Nm, step_Nm);
        }
        last_Nm = r.output.torque_desired_Nm;
        for (const auto& t : loop.plant().tendon())
          run.most_base_N = std::max(run.most_base_N, t.tension_base_N);
        if (t_s < motion->judged_from_s() || t_s > motion->judged_until_s()) return;
        const double error_m = (loop.plant().TipPose().p_WA - motion->TipAt(t_s)).norm();
        run.largest_m = std::max(run.largest_m, error_m);
        sum2 += error_m * error_m;
        ++count;
      },
      loop.sender_lead_s());
  run.rms_m = std::sqrt(sum2 / count);
  return run;
}

// A bend begins with pulleys of which nobody knows how they were left when the robot was armed.
TEST(Laws, TensionFeedbackCostsNothingAtTheStartOfABend) {
  const Figures open = Follow(Options("rig_90mm.yaml", false), "planar");
  const Figures closed = Follow(Options("rig_90mm.yaml", true), "planar");
  EXPECT_LT(closed.rms_m, 1.05 * open.rms_m);
  EXPECT_LT(closed.largest_m, 1.1 * open.largest_m);
  EXPECT_LT(closed.slack_cycles(), 10) << "of 7654; without feedback some hundreds";
}

// A tendon turns round under 5 N, another under the least tension.
TEST(Laws, NoTorqueJumpsOnTheSlowCircle) {
  const Figures run = Follow(Options("rig_60mm.yaml", false), "circle");
  EXPECT_LT(run.largest_step_Nm, 5e-5);
  EXPECT_LT(run.rms_m, 1e-4);
}

// Without load cells to hold them the spools must not lose their tendons: a rotor takes 0.36 N at this pace,
// more than the least tension.
TEST(Laws, ACircleASecondNeedsNoFeedback) {
  const ClosedLoopOptions options = Options("rig_60mm.yaml", false);
  const Figures run = Follow(options, "fast_circle");
  EXPECT_LT(run.rms_m, 1e-3);
  EXPECT_LT(run.slack_cycles(), 100) << "of 7000, all while it gathers speed and loses it";
  EXPECT_LT(static_cast<int>(run.cycles.rbegin()->first), 400);
  EXPECT_LT(run.most_base_N, options.controller_robot.limits.max_tension_base_N);
}

// The tip is held on a payload that the controller does not know, which only the tracker shows.
TEST(Laws, ALostAnOldAndAJumpingTracker) {
  ClosedLoopOptions options = Options("rig_60mm.yaml", true, true);
  options.plant_robot.body.tip_payload_kg += 0.002;
  const auto motion = MakeMotion("circle", options.controller_robot.body);
  const Eigen::Vector3d goal = motion->TipAt(0);
  ClosedLoop loop(options);
  double late_s = 0, jump_m = 0;
  bool lost = false;
  loop.OnTracker([&](const TrackerSample& s) -> std::optional<TrackerSample> {
    if (lost) return std::nullopt;
    TrackerSample shown = s;
    shown.time_ns -= static_cast<TimeNs>(late_s * 1e9);
    shown.tip_W_m.x() += jump_m;
    return shown;
  });
  const auto tip = [&] { return loop.plant().TipPose().p_WA; };
  // Cycles with status 311, and the farthest that the tip came from `from`.
  struct Seen {
    int lost = 0;
    double farthest_m = 0, fastest_mps = 0;
  };
  const auto run = [&](double seconds, const Eigen::Vector3d& from) {
    Seen seen;
    Eigen::Vector3d before = tip();
    for (int i = 0; i < static_cast<int>(1e3 * seconds); ++i) {
      const CycleRecord& r = loop.Step();
      EXPECT_EQ(r.output.mode, Mode::kRunning) << StatusText(r.output.status);
      if (r.output.status == Status::kTrackerLost) ++seen.lost;
      seen.farthest_m = std::max(seen.farthest_m, (tip() - from).norm());
      if (i % 100 == 99) {
        seen.fastest_mps = std::max(seen.fastest_mps, (tip() - before).norm() / 0.1);
        before = tip();
      }
    }
    return seen;
  };
  loop.ArmAndPretension();
  ApproachStart(loop, *motion, [](const CycleRecord&, double) {});
  run(6, goal);
  Eigen::Vector3d held = tip();
  EXPECT_LT((held - goal).norm(), 2.5e-4) << "0.9 mm without the tracker";

  lost = true;
  Seen seen = run(3, held);
  EXPECT_GT(seen.lost, 2850) << "said from a tenth of a second on";
  EXPECT_LT(seen.farthest_m, 1e-4) << "the correction stays";
  lost = false;
  run(0.2, held);
  EXPECT_EQ(run(1, held).lost, 0);
  EXPECT_LT((tip() - goal).norm(), 2.5e-4);

  late_s = 0.5;
  held = tip();
  seen = run(2, held);
  EXPECT_GT(seen.lost, 1850) << "too old to be used";
  EXPECT_LT(seen.farthest_m, 1e-4);
  late_s = 0;
  run(1, held);

  jump_m = 0.03;
  held = tip();
  seen = run(0.3, held);
  EXPECT_GT(seen.farthest_m, 1e-3) << "it is believed";
  EXPECT_LT(seen.farthest_m, 0.3 * 0.03) << "slowly";
  EXPECT_LT(seen.fastest_mps, 0.04);
  jump_m = 0;
  seen = run(8, held);
  EXPECT_LT(seen.fastest_mps, 0.04);
  EXPECT_LT((tip() - goal).norm(), 2.5e-4) << "and forgotten as slowly";
}

}  // namespace
}  // namespace tendril::tools
