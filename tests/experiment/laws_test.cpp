// The control laws on the plant: what feedback may not cost, what a fast motion may not do, and what becomes
// of the tip when its tracker fails. Figures are those of `tendril compare`.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <map>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "tendril/config/config.h"
#include "tendril/control/controller.h"
#include "tendril/experiment/closed_loop.h"
#include "tendril/experiment/motion_run.h"
#include "tendril/sim/effects.h"

namespace tendril::experiment {
namespace {

experiment::ClosedLoopOptions Options(const char* robot, bool tension_feedback, bool tip_feedback = false,
                                      bool shape_feedback = false) {
  const std::string folder = TENDRIL_SOURCE_DIR "/config/";
  const RobotParameters parameters = config::LoadRobot(folder + "robots/" + robot);
  experiment::ClosedLoopOptions o{.controller_robot = parameters,
                                  .plant_robot = parameters,
                                  .daemon = config::LoadDaemon(folder + "tendrild.yaml"),
                                  .plant = {.seed = 1},
                                  .log_path = ""};
  auto& c = o.daemon.controller;
  c.law = ControlLaw::kEquilibrium;
  c.tension_feedback = tension_feedback;
  c.shape_feedback = shape_feedback;
  c.tip_feedback = tip_feedback;
  c.trajectory.look_ahead = false;
  return o;
}

struct Figures {
  double rms_m = 0, largest_m = 0;
  double largest_step_Nm = 0;  // of a desired torque, from one cycle to the next
  double most_base_N = 0;      // that a tendon carried
  std::map<Status, int> cycles;

  int slack_cycles() const {
    const auto found = cycles.find(Status::kSlack);
    return found == cycles.end() ? 0 : found->second;
  }
};

Figures Follow(const experiment::ClosedLoopOptions& options, const char* name) {
  const auto motion = motion::MakeMotion(name, options.controller_robot);
  experiment::ClosedLoop loop(options);
  loop.ArmAndPretension();
  experiment::ApproachStart(loop, *motion, [](const CycleRecord&, double) {});
  Figures run;
  double sum2 = 0;
  int count = 0;
  std::optional<TendonVector> last_Nm;
  experiment::StreamMotion(
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

// A bend begins with pulleys whose friction state is unknown after arming.
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
  const experiment::ClosedLoopOptions options = Options("rig_60mm.yaml", false);
  const Figures run = Follow(options, "fast_circle");
  EXPECT_LT(run.rms_m, 1e-3);
  EXPECT_LT(run.slack_cycles(), 100) << "of 7000, all while it gathers speed and loses it";
  EXPECT_LT(static_cast<int>(run.cycles.rbegin()->first), 400);
  EXPECT_LT(run.most_base_N, options.controller_robot.limits.max_tension_base_N);
}

// The tip is held on a payload that the controller does not know, which only the tracker shows.
TEST(Laws, ALostAnOldAndAJumpingTracker) {
  experiment::ClosedLoopOptions options = Options("rig_60mm.yaml", true, true);
  options.plant_robot.body.tip_payload_kg += 0.002;
  const auto motion = motion::MakeMotion("circle", options.controller_robot);
  const Eigen::Vector3d goal = motion->TipAt(0);
  experiment::ClosedLoop loop(options);
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
  // Cycles with status 311 and 322, and the farthest that the tip came from `from`.
  struct Seen {
    int lost = 0, disagrees = 0;
    double farthest_m = 0, fastest_mps = 0;
  };
  const auto run = [&](double seconds, const Eigen::Vector3d& from) {
    Seen seen;
    Eigen::Vector3d before = tip();
    for (int i = 0; i < static_cast<int>(1e3 * seconds); ++i) {
      const CycleRecord& r = loop.Step();
      EXPECT_EQ(r.output.mode, Mode::kRunning) << StatusText(r.output.status);
      if (r.output.status == Status::kTrackerLost) ++seen.lost;
      if (r.output.status == Status::kTrackerDisagrees) ++seen.disagrees;
      seen.farthest_m = std::max(seen.farthest_m, (tip() - from).norm());
      if (i % 100 == 99) {
        seen.fastest_mps = std::max(seen.fastest_mps, (tip() - before).norm() / 0.1);
        before = tip();
      }
    }
    return seen;
  };
  loop.ArmAndPretension();
  experiment::ApproachStart(loop, *motion, [](const CycleRecord&, double) {});
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
  seen = run(2, held);
  EXPECT_GT(seen.lost + seen.disagrees, 1850) << "the tendons know better";
  EXPECT_GT(seen.disagrees, 1400) << "and after half a second it is said";
  EXPECT_LT(seen.farthest_m, 1e-4);
  jump_m = 0;
  run(1, held);

  jump_m = 0.004;
  held = tip();
  seen = run(0.3, held);
  EXPECT_GT(seen.farthest_m, 2e-4) << "a few millimetres are believed";
  EXPECT_LT(seen.farthest_m, 0.004) << "slowly";
  EXPECT_LT(seen.fastest_mps, 0.04);
  jump_m = 0;
  seen = run(8, held);
  EXPECT_LT(seen.fastest_mps, 0.04);
  EXPECT_LT((tip() - goal).norm(), 2.5e-4) << "and forgotten as slowly";
}

Command Bend(double u_rad, double v_rad, double speed_radps = 0) {
  Command c;
  c.kind = CommandKind::kBending;
  c.bending_rad = BendingVector::Zero(2);
  c.bending_rad << u_rad, v_rad;
  c.speed_radps = speed_radps;
  return c;
}

void StepFor(experiment::ClosedLoop& loop, double seconds,
             const std::function<void(const CycleRecord&)>& see) {
  for (const double end_s = loop.now_s() + seconds; loop.now_s() < end_s;) see(loop.Step());
}

// A robot that was bent and is left alone stands: the commanded torques do not change, so that nothing
// shakes it through its own dry friction, and no tendon goes slack.
TEST(Laws, ARobotAtRestStands) {
  for (const char* robot : {"rig_60mm.yaml", "rig_90mm.yaml"}) {
    for (const int law : {1, 2, 3}) {
      if (law != 2 && std::string(robot) == "rig_90mm.yaml") continue;
      SCOPED_TRACE(std::string(robot) + ", law " + std::to_string(law));
      experiment::ClosedLoop loop(Options(robot, law >= 2, law >= 3, law >= 3));
      loop.ArmAndPretension();
      loop.Send(Bend(1, 0));
      StepFor(loop, 8, [](const CycleRecord&) {});
      const Eigen::Vector3d start = loop.plant().TipPose().p_WA;
      auto told = loop.record().output.torque_target_permille;
      int changes = 0;
      double farthest_m = 0, least_N = HUGE_VAL;
      StepFor(loop, 60, [&](const CycleRecord& r) {
        for (std::size_t j = 0; j < 3; ++j) changes += r.output.torque_target_permille[j] != told[j];
        told = r.output.torque_target_permille;
        farthest_m = std::max(farthest_m, (loop.plant().TipPose().p_WA - start).norm());
        for (const auto& t : loop.plant().tendon()) least_N = std::min(least_N, t.tension_base_N);
        ASSERT_LT(static_cast<int>(r.output.status), law == 1 ? 400 : 300);
      });
      EXPECT_LT(farthest_m, 5e-5);
      EXPECT_LT(changes, 200) << "a few where a tracker's last correction ends, thousands when it hunts";
      EXPECT_GT(least_N, law == 1 ? 0.1 : 0.2) << "without feedback 0.03 N of the motor's side are left";
    }
  }
}

// Two integrals over one error, on sections that carry each other, come to an end as well.
TEST(Laws, TwoSectionsAtRestStandUnderEveryFeedback) {
  experiment::ClosedLoop loop(Options("two_section.yaml", true, true, true));
  loop.ArmAndPretension();
  Command c = Bend(0, 0);
  c.speed_radps = 3;
  for (const Eigen::Vector4d& bend_rad :
       {Eigen::Vector4d(0.6, -0.5, -0.3, 0.2), Eigen::Vector4d(-0.2, 0.7, 0.3, 0.3)}) {
    c.bending_rad = bend_rad;
    loop.Send(c);
    StepFor(loop, 2, [](const CycleRecord&) {});
  }
  StepFor(loop, 10, [](const CycleRecord&) {});
  const Eigen::Vector3d start_W_m = loop.plant().TipPose().p_WA;
  double farthest_m = 0;
  StepFor(loop, 4, [&](const CycleRecord&) {
    farthest_m = std::max(farthest_m, (loop.plant().TipPose().p_WA - start_W_m).norm());
  });
  EXPECT_LT(farthest_m, 2e-4) << "52 mm when it hunts";
}

// One load cell that shows too much: its tendon is not let go, for a rope cannot be pushed.
TEST(Laws, ACellThatShowsTooMuchUnwindsNoSpool) {
  for (const bool tip : {false, true}) {
    experiment::ClosedLoopOptions options = Options("rig_60mm.yaml", true, tip);
    for (const char* effect : {"cell_offset N=0.1 where=tendon:2", "cell_offset N=0.3 where=tendon:2"}) {
      options.plant_robot.effects.assign(1, sim::ParseEffect(effect, options.plant_robot));
      const Figures run = Follow(options, "circle");
      EXPECT_LT(static_cast<int>(run.cycles.rbegin()->first), 300) << effect;
      EXPECT_LT(run.largest_m, 4e-3) << effect;
    }
  }
}

// A bend that the tensions cannot hold ends at their limit, with room for what friction adds; no law breaks
// it on the way there, nor back, nor jumps where it is reached.
TEST(Laws, ABendBeyondAllTensionStaysWithinTheirLimits) {
  for (const int law : {1, 2, 3}) {
    SCOPED_TRACE(law);
    const experiment::ClosedLoopOptions options = Options("rig_60mm.yaml", law >= 2, law >= 3);
    const LimitParameters& limits = options.controller_robot.limits;
    experiment::ClosedLoop loop(options);
    loop.ArmAndPretension();
    std::optional<TendonVector> last_Nm;
    double base_N = 0, motor_N = 0, step_Nm = 0;
    const auto see = [&](const CycleRecord& r) {
      for (const auto& t : loop.plant().tendon()) {
        base_N = std::max(base_N, t.tension_base_N);
        motor_N = std::max(motor_N, t.tension_motor_N);
      }
      const TendonVector& now_Nm = r.output.torque_desired_Nm;
      if (last_Nm) step_Nm = std::max(step_Nm, (now_Nm - *last_Nm).cwiseAbs().maxCoeff());
      last_Nm = now_Nm;
      ASSERT_EQ(r.output.mode, Mode::kRunning);
    };
    for (const double way_rad : {0., std::numbers::pi, 1., 4.2, 0.}) {
      loop.Send(Bend(2.5 * std::cos(way_rad), 2.5 * std::sin(way_rad)));
      StepFor(loop, 13, see);
    }
    EXPECT_LT(base_N, limits.max_tension_base_N);
    EXPECT_LT(motor_N, limits.max_tension_motor_N);
    EXPECT_LT(step_Nm, 3e-4) << "of 7 mNm, as the friction of a loaded tendon turns round";
  }
}

// Whatever is commanded, and however fast: the base's limit holds. Goals beyond it are projected before the
// robot moves, so that no rotor runs into the end of its tendon.
TEST(Laws, NoCommandIsTooFastForTheTendons) {
  for (const int law : {0, 1, 2}) {
    for (const double bend_rad : {1.2, 2.5}) {
      SCOPED_TRACE("law " + std::to_string(law) + ", " + std::to_string(bend_rad) + " rad");
      experiment::ClosedLoopOptions options = Options("rig_60mm.yaml", law >= 2);
      if (law == 0) options.daemon.controller.law = ControlLaw::kPaper;
      const LimitParameters& limits = options.controller_robot.limits;
      experiment::ClosedLoop loop(options);
      loop.ArmAndPretension();
      double base_N = 0, motor_N = 0;
      int limited = 0;
      const auto see = [&](const CycleRecord& r) {
        limited += r.output.target_bending_rad.norm() < bend_rad - 0.1;
        for (const auto& t : loop.plant().tendon()) {
          base_N = std::max(base_N, t.tension_base_N);
          motor_N = std::max(motor_N, t.tension_motor_N);
        }
      };
      int n = 0;
      for (const double way_rad : {0., 3.14, 1., 4.2, 0.5, -1., 2., 5.}) {
        loop.Send(Bend(bend_rad * std::cos(way_rad), bend_rad * std::sin(way_rad), 8));
        StepFor(loop, ++n % 3 == 2 ? 0.25 : 1, see);
      }
      EXPECT_LT(base_N, limits.max_tension_base_N);
      EXPECT_LT(motor_N, limits.max_tension_motor_N);
      if (bend_rad > 2) {
        EXPECT_GT(limited, 1000) << "not led where no tension holds it";
      }
    }
  }
}

// Friction that the file does not know makes shape and tip feedback ask for ever more. The tensions come up
// to their bound evenly: rotors that had to stop at once pulled 0.5 N beyond the motors' limit, and the
// friction kept that.
TEST(Laws, FrictionThatNobodyKnowsBreaksNoLimit) {
  for (const bool tip_feedback : {false, true}) {
    SCOPED_TRACE(tip_feedback);
    experiment::ClosedLoopOptions options = Options("rig_60mm.yaml", true, tip_feedback, true);
    for (const char* effect : {"capstan_alpha scale=2", "motor_coulomb scale=2"})
      options.plant_robot.effects.push_back(sim::ParseEffect(effect, options.plant_robot));
    options.daemon.controller.trajectory.look_ahead = true;
    const LimitParameters& limits = options.controller_robot.limits;
    const double bound_N = control::kCommandedTensionShare * limits.max_tension_base_N;
    const auto motion = motion::MakeMotion("spiral", options.controller_robot);
    experiment::ClosedLoop loop(options);
    loop.ArmAndPretension();
    experiment::ApproachStart(loop, *motion, [](const CycleRecord&, double) {});
    double base_N = 0, motor_N = 0, wanted_N = 0;
    std::optional<TendonVector> last_N;
    experiment::StreamMotion(
        loop, *motion,
        [&](const CycleRecord& r, double t_s) {
          ASSERT_EQ(r.output.mode, Mode::kRunning) << t_s;
          for (const auto& t : loop.plant().tendon()) {
            base_N = std::max(base_N, t.tension_base_N);
            motor_N = std::max(motor_N, t.tension_motor_N);
          }
          const TendonVector& now_N = r.output.tension_desired_base_N;
          wanted_N = std::max(wanted_N, now_N.maxCoeff());
          for (int j = 0; last_N && j < now_N.size(); ++j) {
            const double room_N = bound_N - (*last_N)[j];
            if (room_N > 0.5) continue;
            EXPECT_LT(now_N[j] - (*last_N)[j], 0.014 * room_N + 1e-9) << t_s;
          }
          last_N = now_N;
        },
        loop.sender_lead_s());
    EXPECT_GT(wanted_N, bound_N - 0.1) << "it is asked for as much as may be";
    EXPECT_LT(base_N, limits.max_tension_base_N);
    EXPECT_LT(motor_N, limits.max_tension_motor_N);
  }
}

// Nothing of the motion before a disarm is left: armed again without homing, the robot stands as it did when
// it was armed first.
TEST(Laws, ArmedAgainTheRobotStandsStill) {
  for (const int law : {0, 1, 2}) {
    SCOPED_TRACE("law " + std::to_string(law));
    experiment::ClosedLoopOptions options = Options("rig_60mm.yaml", law >= 2);
    if (law == 0) options.daemon.controller.law = ControlLaw::kPaper;
    experiment::ClosedLoop loop(options);
    double most_N = 0, bend_rad = 0;
    const auto see = [&](const CycleRecord& r) {
      ASSERT_EQ(r.output.mode, Mode::kRunning) << static_cast<int>(r.output.status);
      most_N = std::max(most_N, r.output.tension_desired_base_N.maxCoeff());
      bend_rad = std::max(bend_rad, r.output.bending_estimate_rad.norm());
    };
    loop.ArmAndPretension();
    StepFor(loop, 2, see);
    const double first_N = most_N;
    loop.Send(Bend(0.3, 0.15, 0.5));
    StepFor(loop, 2, [](const CycleRecord&) {});
    loop.DisarmAndWait();
    StepFor(loop, 1, [](const CycleRecord&) {});
    loop.ArmAndPretension();
    most_N = bend_rad = 0;
    StepFor(loop, 3, see);
    EXPECT_LT(most_N, first_N + 0.1);
    EXPECT_LT(bend_rad, 0.15) << "friction alone";
    Eigen::Vector2d truth_rad = Eigen::Vector2d::Zero();
    for (Eigen::Index i = 0; i < loop.plant().q().size(); i += 2) truth_rad += loop.plant().q().segment<2>(i);
    EXPECT_LT((loop.record().output.bending_estimate_rad - truth_rad).norm(), 0.002)
        << "bent by " << truth_rad.norm() << " rad: it is no new zero";
  }
}

// Tensions that are commanded arrive at the base, though the cells sit before the pulleys.
TEST(Laws, CommandedTensionsArriveAtTheBase) {
  for (const bool feedback : {false, true}) {
    experiment::ClosedLoop loop(Options("rig_60mm.yaml", feedback));
    loop.ArmAndPretension();
    for (const Eigen::Vector3d& wanted_N : {Eigen::Vector3d(1, 1, 3), Eigen::Vector3d(3, 1, 1)}) {
      Command c;
      c.kind = CommandKind::kTension;
      c.tension_N = wanted_N;
      loop.Send(c);
      StepFor(loop, 6, [](const CycleRecord&) {});
      for (int j = 0; j < 3; ++j) {
        EXPECT_NEAR(loop.plant().tendon()[static_cast<std::size_t>(j)].tension_base_N, wanted_N[j], 0.15)
            << "tendon " << j + 1 << (feedback ? ", fed back" : "");
      }
    }
  }
}

// However brisk they are commanded, with no friction left that would hold the motors; and a bend commanded
// next starts from there without a blow.
TEST(Laws, BriskTensionsAndABendAfterThemStayWithinLimits) {
  for (const ControlLaw law : {ControlLaw::kPaper, ControlLaw::kEquilibrium}) {
    experiment::ClosedLoopOptions options = Options("rig_60mm.yaml", false);
    options.daemon.controller.law = law;
    if (law == ControlLaw::kEquilibrium) options.daemon.controller.pretension_ramp_Nps = 100;
    experiment::ClosedLoop loop(options);
    loop.ArmAndPretension();
    const double travel_m = options.plant_robot.actuation->tendons[0].SpoolTravelPerMotorRad();
    double most_N = 0, jump_Nm = 0, overrun_m = 0;
    TendonVector last_Nm = loop.record().output.torque_desired_Nm;
    const auto watch = [&](const CycleRecord& record) {
      EXPECT_LT(static_cast<int>(record.output.status), 400);
      for (const auto& tendon : loop.plant().tendon()) {
        most_N = std::max(most_N, tendon.tension_motor_N);
        overrun_m = std::max(overrun_m, -tendon.spool_pull_m);
      }
      jump_Nm = std::max(jump_Nm, (record.output.torque_desired_Nm - last_Nm).cwiseAbs().maxCoeff());
      last_Nm = record.output.torque_desired_Nm;
    };
    const bool brisk = law == ControlLaw::kEquilibrium;
    for (int i = 0; i < (brisk ? 8 : 1); ++i) {
      Command c;
      c.kind = CommandKind::kTension;
      c.tension_N = TendonVector::Constant(3, 0.5);
      c.tension_N[i % 3] = 3;
      loop.Send(c);
      StepFor(loop, brisk ? 0.3 : 3, watch);
    }
    Command c;
    c.kind = CommandKind::kBending;
    c.bending_rad = BendingVector(Eigen::Vector2d(0.43, 1.12));
    c.speed_radps = 3;
    loop.Send(c);
    StepFor(loop, 3, watch);
    EXPECT_LT(most_N, options.plant_robot.limits.max_tension_motor_N - 2);
    EXPECT_LT(overrun_m, 0.008) << overrun_m / travel_m << " rad of the motor; slack was paid out";
    EXPECT_LT(jump_Nm, 3e-4);
    EXPECT_EQ(loop.record().output.mode, Mode::kRunning);
    EXPECT_LT((loop.record().output.reference.position_rad - c.bending_rad).norm(), 1e-3);
  }
}

// Tensions that take over from a motion at high tension: there a stretched tendon's friction has three
// solutions, and it must not go from one to another at once.
TEST(Laws, TensionsTakeOverFromAMotionWithoutAJump) {
  experiment::ClosedLoopOptions options = Options("rig_60mm.yaml", true, false, true);
  for (RobotParameters* robot : {&options.controller_robot, &options.plant_robot}) {
    for (auto& t : robot->actuation->tendons) t.load_cell.place = LoadCellPlace::kRobotSide;
  }
  experiment::ClosedLoop loop(options);
  loop.ArmAndPretension();
  double jump_Nm = 0;
  TendonVector last_Nm = loop.record().output.torque_desired_Nm;
  const auto watch = [&](const CycleRecord& r) {
    ASSERT_EQ(r.output.mode, Mode::kRunning) << static_cast<int>(r.output.status);
    jump_Nm = std::max(jump_Nm, (r.output.torque_desired_Nm - last_Nm).cwiseAbs().maxCoeff());
    last_Nm = r.output.torque_desired_Nm;
  };
  for (const double after_s : {0.7, 0.764, 0.85}) {
    loop.Send(Bend(-0.26, 0.22));
    StepFor(loop, 2, watch);
    loop.Send(Bend(-1.63, -0.41, 3.64));
    StepFor(loop, after_s, watch);
    Command c;
    c.kind = CommandKind::kTension;
    c.tension_N = Eigen::Vector3d(1, 2, 3);
    loop.Send(c);
    StepFor(loop, 1, watch);
  }
  EXPECT_LT(jump_Nm, 3e-4) << "0.96 mNm when friction turns at once";
}

// A robot that is not as its file says, without a tracker: the tendons' displacement shows it.
TEST(Laws, TheTendonsShowWhatTheFileHasWrong) {
  for (const std::vector<const char*>& effects : {std::vector<const char*>{"bending_stiffness scale=1.2"},
                                                  {"capstan_alpha scale=2", "motor_coulomb scale=2"}}) {
    experiment::ClosedLoopOptions options = Options("rig_60mm.yaml", true, false, true);
    for (const char* effect : effects)
      options.plant_robot.effects.push_back(sim::ParseEffect(effect, options.plant_robot));
    const Figures run = Follow(options, "circle");
    EXPECT_LT(static_cast<int>(run.cycles.rbegin()->first), 400) << effects[0];
    // That friction takes all that tensions may be, and the robot is still not where it should be.
    const bool within_reach = effects.size() == 1;
    EXPECT_LT(run.rms_m, within_reach ? 5e-4 : 0.02)
        << "5.9 mm by load cells alone; with that friction a fault";
  }
}

// A spool that ran out without its tendon, when that is found out: winding it in again would end in a blow.
TEST(Laws, AfterAFaultNoTendonIsSnatched) {
  experiment::ClosedLoopOptions options = Options("rig_60mm.yaml", false);
  options.daemon.controller.law = ControlLaw::kPaper;
  for (const char* effect : {"bending_stiffness scale=1.2", "tendon_stiffness scale=0.5"}) {
    options.plant_robot.effects.assign(1, sim::ParseEffect(effect, options.plant_robot));
    experiment::ClosedLoop loop(options);
    const auto motion = motion::MakeMotion("fast_circle", options.controller_robot);
    loop.ArmAndPretension();
    experiment::ApproachStart(loop, *motion, [](const CycleRecord&, double) {});
    double after_s = 0, base_N = 0;
    experiment::StreamMotion(
        loop, *motion,
        [&](const CycleRecord& r, double) {
          if (r.output.mode != Mode::kFault || after_s > 3) return;
          for (const auto& t : loop.plant().tendon()) base_N = std::max(base_N, t.tension_base_N);
          after_s += 1e-3;
        },
        loop.sender_lead_s());
    EXPECT_GT(after_s, 2) << "the paper's law loses a tendon at this pace";
    EXPECT_LT(base_N, 6) << effect << ": 5 N are there when it is found out";
  }
}

}  // namespace
}  // namespace tendril::experiment
