// The daemon is killed in the middle of a motion: what the drives' own reaction makes of the robot, object
// 0x6007 = 2 (disable voltage) beside 3 (quick stop), after a long and after a short heartbeat time. With
// TENDRIL_REACTION_CSV=FILE the courses are written there, for tools/plot_reaction.py.
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>

#include "safety_rig.h"

namespace tendril::daemon {
namespace {

struct Course {
  std::vector<double> t_s, tip_x_mm, tip_z_mm, highest_N;  // from the death of the daemon
  double reacted_after_s = -1;                             // no drive follows its last target any more
  double free_after_s = -1;                                // no torque on any tendon
  double peak_N = 0, tip_speed_mps = 0;                    // highest, from the reaction on
};

struct Heartbeat {
  int period_ms, timeout_ms;
};
constexpr double kTurn_radps = 2;
constexpr Heartbeat kUsual{100, 250}, kQuick{15, 30};

Course Kill(int option, Heartbeat heartbeat) {
  SafetyOptions o;
  const std::string config = std::string(TENDRIL_SOURCE_DIR) + "/config/";
  o.daemon = config::LoadDaemon(config + "tendrild.yaml");
  o.robot = config::LoadRobot(config + "robots/rig_60mm.yaml");
  o.plant = o.robot;
  o.daemon.bus.abort_connection_option = option;
  o.daemon.bus.heartbeat_ms = heartbeat.period_ms;
  o.daemon.bus.heartbeat_timeout_ms = heartbeat.timeout_ms;
  o.daemon.controller.pretension_ramp_Nps = 5;
  o.noise = false;
  SafetyRig r(o);
  EXPECT_TRUE(r.Arm());
  for (int i = 0; i < 1500; ++i) {  // in full motion
    r.Step(i % 10 == 0 ? r.Circle(std::min(1., i * 1e-3), kTurn_radps, i * 1e-3) : Command{});
  }
  EXPECT_EQ(r.output().mode, Mode::kRunning) << StatusText(r.output().status);
  Course c;
  Eigen::Vector3d last = r.rig().plant().TipPose().p_WA;
  std::vector<double> last_Nm(3);
  for (std::size_t j = 0; j < 3; ++j) last_Nm[j] = r.rig().drives().torque_Nm(static_cast<int>(j));
  for (int i = 0; i < 2000; ++i) {
    r.StepAlone();
    const auto& plant = r.rig().plant();
    const Eigen::Vector3d tip = plant.TipPose().p_WA;
    double highest_N = 0, torque_Nm = 0;
    bool kept = true;
    for (std::size_t j = 0; j < 3; ++j) {
      const double now_Nm = r.rig().drives().torque_Nm(static_cast<int>(j));
      highest_N = std::max(highest_N, plant.tendon()[j].tension_motor_N);
      torque_Nm = std::max(torque_Nm, std::abs(now_Nm));
      kept = kept && now_Nm == last_Nm[j];
    }
    c.t_s.push_back(1e-3 * (i + 1));
    c.tip_x_mm.push_back(1e3 * tip.x());
    c.tip_z_mm.push_back(1e3 * tip.z());
    c.highest_N.push_back(highest_N);
    if (!kept && c.reacted_after_s < 0) c.reacted_after_s = c.t_s.back();
    if (torque_Nm == 0 && c.free_after_s < 0) c.free_after_s = c.t_s.back();
    if (c.reacted_after_s >= 0) {
      c.peak_N = std::max(c.peak_N, highest_N);
      c.tip_speed_mps = std::max(c.tip_speed_mps, (tip - last).norm() / 1e-3);
    }
    last = tip;
  }
  return c;
}

// Heartbeats missed end the last torque: at once, or after the motors were braked. Nothing is held, and no
// tension rises above its limit. After the usual time the robot stands under its last torques, and there is
// nothing to brake.
TEST(Reaction, BothFreeTheTendonsAndNeitherPullsHarder) {
  std::ofstream out;
  if (const char* path = std::getenv("TENDRIL_REACTION_CSV")) out.open(path);
  out << "t_s,timeout_ms,option,tip_x_mm,tip_z_mm,highest_tension_N\n";
  for (const Heartbeat& heartbeat : {kUsual, kQuick}) {
    const Course free = Kill(2, heartbeat), braked = Kill(3, heartbeat);
    for (const auto& [option, c] : {std::pair{2, &free}, std::pair{3, &braked}}) {
      std::printf(
          "heartbeat %d ms, 0x6007 = %d: reacts after %.0f ms, free after %.0f ms; tip then at up to %.3f "
          "m/s, "
          "tension at most %.2f N, %.2f N in the end\n",
          heartbeat.timeout_ms, option, 1e3 * c->reacted_after_s, 1e3 * c->free_after_s, c->tip_speed_mps,
          c->peak_N, c->highest_N.back());
      EXPECT_GT(c->reacted_after_s, 1e-3 * (heartbeat.timeout_ms - heartbeat.period_ms) - 0.002);
      EXPECT_LT(c->reacted_after_s, 1e-3 * heartbeat.timeout_ms + 0.003);
      EXPECT_LT(c->free_after_s, c->reacted_after_s + 0.2);
      EXPECT_LT(*std::max_element(c->highest_N.begin(), c->highest_N.end()), 10.0);
      EXPECT_LT(c->highest_N.back(), 0.5 * c->highest_N.front());
      EXPECT_LT(std::abs(c->tip_x_mm.back()), 5.0) << "straight as far as friction lets it";
      for (std::size_t i = 0; i < c->t_s.size(); ++i) {
        out << c->t_s[i] << ',' << heartbeat.timeout_ms << ',' << option << ',' << c->tip_x_mm[i] << ','
            << c->tip_z_mm[i] << ',' << c->highest_N[i] << '\n';
      }
    }
    EXPECT_EQ(free.free_after_s, free.reacted_after_s) << "disable voltage takes the torque at once";
    EXPECT_GE(braked.free_after_s, free.free_after_s) << "braking comes first";
  }
}

}  // namespace
}  // namespace tendril::daemon
