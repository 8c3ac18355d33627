// Antagonistic pairs from the robot file to the plant: armed, moved, commanded by tension, limited, released.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <numbers>

#include "tendril/config/config.h"
#include "tendril/experiment/closed_loop.h"
#include "tendril/experiment/motion_run.h"
#include "tendril/model/tendon_pairs.h"

namespace tendril::experiment {
namespace {

ClosedLoopOptions Options(ControlLaw law, double pretension_N = 4) {
  const std::string folder = TENDRIL_SOURCE_DIR "/config/";
  RobotParameters robot = config::LoadRobot(folder + "robots/pairs_90mm.yaml");
  for (TendonPair& pair : robot.actuation->pairs) pair.pretension_N = pretension_N;
  ClosedLoopOptions o{.controller_robot = robot,
                      .plant_robot = robot,
                      .daemon = config::LoadDaemon(folder + "tendrild_pairs.yaml"),
                      .plant = {.seed = 1},
                      .log_path = ""};
  o.daemon.controller.law = law;
  return o;
}

struct Figures {
  double rms_m = 0, largest_m = 0, least_N = 1e9, tension_off_N = 0;
  std::map<Status, int> cycles;
};

Figures Follow(const ClosedLoopOptions& options, const char* name, bool disarms = true) {
  const auto motion = motion::MakeMotion(name, options.controller_robot);
  ClosedLoop loop(options);
  loop.ArmAndPretension();
  ApproachStart(loop, *motion, [](const CycleRecord&, double) {});
  Figures run;
  double sum2 = 0;
  int count = 0;
  StreamMotion(
      loop, *motion,
      [&](const CycleRecord& r, double t_s) {
        ++run.cycles[r.output.status];
        for (std::size_t j = 0; j < 4; ++j) {
          const double real_N = loop.plant().tendon()[j].tension_base_N;
          run.least_N = std::min(run.least_N, real_N);
          const double estimated_N = r.output.tension_base_estimate_N[static_cast<Eigen::Index>(j)];
          run.tension_off_N = std::max(run.tension_off_N, std::abs(estimated_N - real_N));
        }
        if (t_s < motion->judged_from_s() || t_s > motion->judged_until_s()) return;
        const double error_m = (loop.plant().TipPose().p_WA - motion->TipAt(t_s)).norm();
        run.largest_m = std::max(run.largest_m, error_m);
        sum2 += error_m * error_m;
        ++count;
      },
      loop.sender_lead_s());
  if (disarms) loop.DisarmAndWait();
  run.rms_m = std::sqrt(sum2 / count);
  return run;
}

/// The same robot with a motor for every tendon.
ClosedLoopOptions WithAMotorEach(ClosedLoopOptions options) {
  ActuationParameters& actuation = *options.controller_robot.actuation;
  actuation.pairs.clear();
  for (std::size_t j = 0; j < actuation.tendons.size(); ++j)
    actuation.tendons[j].node_id = static_cast<int>(j) + 1;
  options.plant_robot = options.controller_robot;
  return options;
}

// The pulleys of a pair lose what their pretension makes them lose, in two tendons at once.
TEST(Pairs, FollowABendAndACircleUnderBothLaws) {
  for (const char* name : {"planar", "circle"}) {
    for (const ControlLaw law : {ControlLaw::kPaper, ControlLaw::kEquilibrium}) {
      SCOPED_TRACE(testing::Message() << name << ", law " << static_cast<int>(law));
      const Figures run = Follow(Options(law), name);
      // On the way down its soft tendons go slack (417).
      const Figures each = Follow(WithAMotorEach(Options(law)), name, false);
      std::printf(
          "%s law %d: rms %.3f mm, at most %.3f mm, least tension %.2f N, estimate within %.2f N; with a "
          "motor each %.3f and %.3f mm\n",
          name, static_cast<int>(law), 1e3 * run.rms_m, 1e3 * run.largest_m, run.least_N, run.tension_off_N,
          1e3 * each.rms_m, 1e3 * each.largest_m);
      EXPECT_LT(run.rms_m, law == ControlLaw::kPaper ? 3e-3 : 0.8e-3);
      EXPECT_LT(run.largest_m, law == ControlLaw::kPaper ? 5e-3 : 3e-3);
      EXPECT_LT(run.rms_m, 1.5 * each.rms_m);
      EXPECT_GT(run.least_N, 0);
      for (const auto& [status, cycles] : run.cycles)
        EXPECT_EQ(status, Status::kOk) << StatusText(status) << " in " << cycles << " cycles";
    }
  }
}

TEST(Pairs, TwoDrivesOnTheBusAreFourTendonsOfTheController) {
  ClosedLoop loop(Options(ControlLaw::kEquilibrium));
  loop.ArmAndPretension();
  Command command;
  command.kind = CommandKind::kBending;
  command.bending_rad = BendingVector(2);
  command.bending_rad << 0.6, -0.3;
  loop.Send(command);
  for (int i = 0; i < 3000; ++i) loop.Step();
  const CycleRecord& r = loop.record();
  EXPECT_EQ(r.input.drives, 4);
  for (std::size_t j = 0; j < 2; ++j) {
    EXPECT_EQ(r.input.drive[j].position_counts, -r.input.drive[j + 2].position_counts);
    EXPECT_EQ(r.input.drive[j].torque_permille, -r.input.drive[j + 2].torque_permille);
    EXPECT_EQ(r.output.torque_target_permille[j], -r.output.torque_target_permille[j + 2]);
  }
  EXPECT_NEAR(r.output.bending_estimate_rad[0], 0.6, 0.03);
  EXPECT_NEAR(r.output.bending_estimate_rad[1], -0.3, 0.03);
}

TEST(Pairs, TakeTheDifferenceOfCommandedTensions) {
  ClosedLoop loop(Options(ControlLaw::kEquilibrium, 2));
  loop.ArmAndPretension();
  Command command;
  command.kind = CommandKind::kTension;
  command.tension_N = TendonVector(4);
  const auto pull = [&](double first_N, double second_N) {
    command.tension_N << first_N, 1, second_N, 1;
    Status worst = Status::kOk;
    for (int i = 0; i < 4000; ++i) {
      if (i % 50 == 0) loop.Send(command);
      const Status now = loop.Step().output.status;
      if (now != Status::kOk) worst = now;
    }
    return worst;
  };
  EXPECT_EQ(pull(3, 1), Status::kOk);
  const auto& tendon = loop.plant().tendon();
  EXPECT_NEAR(tendon[0].tension_base_N - tendon[2].tension_base_N, 2, 0.1);
  EXPECT_NEAR(tendon[1].tension_base_N - tendon[3].tension_base_N, 0, 0.05);
  EXPECT_NEAR(tendon[0].tension_motor_N + tendon[2].tension_motor_N, 4, 0.2);
  // More than the pretension can give is limited, and said.
  EXPECT_EQ(pull(5, 0.5), Status::kLimitedTensionMax);
  EXPECT_GT(tendon[2].tension_base_N, 0.1);
  EXPECT_EQ(loop.record().output.mode, Mode::kRunning);
}

TEST(Pairs, AreHomedWithoutWindingAndBendNoFartherThanTheyCan) {
  ClosedLoop loop(Options(ControlLaw::kEquilibrium, 2));
  loop.StepUntil([](const CycleRecord& r) { return r.output.mode == Mode::kConfigured; }, 10, "the drives");
  loop.Send(ModeRequest::kHome);
  double most_rad = 0;
  loop.StepUntil(
      [&](const CycleRecord& r) {
        most_rad = std::max(most_rad, std::abs(loop.plant().tendon()[0].motor_angle_rad));
        return r.output.mode == Mode::kHold;
      },
      20, "homing");
  loop.Send(ModeRequest::kArm);
  loop.StepUntil([](const CycleRecord& r) { return r.output.mode == Mode::kRunning; }, 10, "arming");
  EXPECT_LT(most_rad, 0.05);
  Command command;
  command.kind = CommandKind::kBending;
  command.bending_rad = BendingVector(2);
  command.bending_rad << 1.7, 0;
  loop.Send(command);
  int limited = 0;
  for (int i = 0; i < 6000; ++i) limited += loop.Step().output.status == Status::kLimitedTensionMax;
  EXPECT_GT(limited, 1000);
  const CycleOutput& o = loop.record().output;
  EXPECT_GT(o.target_bending_rad[0], 0.8);
  EXPECT_LT(o.target_bending_rad[0], 1.3);
  EXPECT_EQ(o.mode, Mode::kRunning);
  loop.DisarmAndWait();
}

// The second section's tendons pass through the first, whose pairs reach their bounds while they do.
TEST(Pairs, BesideTendonsOfTheirOwnMotorFollowACircle) {
  ClosedLoopOptions options = Options(ControlLaw::kPaper);
  options.daemon = config::LoadDaemon(TENDRIL_SOURCE_DIR "/config/tendrild.yaml");
  RobotParameters& robot = options.controller_robot;
  robot.body.sections[0].units = 8;
  robot.body.sections[0].unit_length_m = 0.0075;
  robot.body.sections.push_back(robot.body.sections[0]);
  for (TendonRoute& t : robot.body.sections[1].tendons) t.angle_rad += std::numbers::pi / 4;
  robot.limits.max_bending_rad = 1.2;
  for (int j = 0; j < 4; ++j) robot.actuation->tendons.push_back(robot.actuation->tendons[0]);
  for (int j = 4; j < 8; ++j) robot.actuation->tendons[static_cast<std::size_t>(j)].node_id = j;
  options.plant_robot = robot;
  for (const double pretension_N : {4.0, 5.0}) {
    SCOPED_TRACE(pretension_N);
    for (TendonPair& pair : robot.actuation->pairs) pair.pretension_N = pretension_N;
    options.plant_robot = robot;
    const Figures run = Follow(options, "circle");
    std::printf("mixed, %.0f N: rms %.3f mm, at most %.3f mm, limited in %d cycles\n", pretension_N,
                1e3 * run.rms_m, 1e3 * run.largest_m, run.cycles.at(Status::kLimitedTensionMax));
    EXPECT_LT(run.rms_m, 0.01);
    EXPECT_LT(static_cast<int>(run.cycles.rbegin()->first), 400) << "no fault";
  }
}

TEST(Pairs, APlantWithOtherMotorsIsRefused) {
  ClosedLoopOptions options = Options(ControlLaw::kPaper);
  options.plant_robot.actuation->pairs.clear();
  EXPECT_THAT([&] { ClosedLoop loop(options); },
              testing::ThrowsMessage<std::invalid_argument>(testing::HasSubstr("2 motors, the plant's 4")));
}

}  // namespace
}  // namespace tendril::experiment
