// The daemon is killed in the middle of a motion: what the drives' own reaction makes of the robot, object
// 0x6007 = 2 (disable voltage) beside 3 (quick stop). With TENDRIL_REACTION_CSV=FILE the courses are written
// there, for tools/plot_reaction.py.
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>

#include "safety_rig.h"

namespace tendril::daemon {
namespace {

struct Course {
  std::vector<double> t_s, tip_x_mm, tip_z_mm, highest_N;  // from the death of the daemon
  double free_after_s = -1;                                // first time without torque on any tendon
  double tip_speed_mps = 0;                                // highest
};

Course Kill(int option) {
  SafetyOptions o;
  const std::string config = std::string(TENDRIL_SOURCE_DIR) + "/config/";
  o.daemon = config::LoadDaemon(config + "tendrild.yaml");
  o.robot = config::LoadRobot(config + "robots/rig_60mm.yaml");
  o.plant = o.robot;
  o.daemon.bus.abort_connection_option = option;
  o.daemon.controller.pretension_ramp_Nps = 5;
  o.noise = false;
  SafetyRig r(o);
  EXPECT_TRUE(r.Arm());
  for (int i = 0; i < 1500; ++i) {  // in full motion
    r.Step(i % 10 == 0 ? r.Circle(std::min(1., i * 1e-3), 2, i * 1e-3) : Command{});
  }
  EXPECT_EQ(r.output().mode, Mode::kRunning) << StatusText(r.output().status);
  Course c;
  Eigen::Vector3d last = r.rig().plant().TipPose().p_WA;
  for (int i = 0; i < 2000; ++i) {
    r.StepAlone();
    const auto& plant = r.rig().plant();
    const Eigen::Vector3d tip = plant.TipPose().p_WA;
    double highest_N = 0, torque_Nm = 0;
    for (int j = 0; j < 3; ++j) {
      highest_N = std::max(highest_N, plant.tendon()[static_cast<std::size_t>(j)].tension_motor_N);
      torque_Nm = std::max(torque_Nm, std::abs(r.rig().drives().torque_Nm(j)));
    }
    c.t_s.push_back(1e-3 * (i + 1));
    c.tip_x_mm.push_back(1e3 * tip.x());
    c.tip_z_mm.push_back(1e3 * tip.z());
    c.highest_N.push_back(highest_N);
    c.tip_speed_mps = std::max(c.tip_speed_mps, (tip - last).norm() / 1e-3);
    if (torque_Nm == 0 && c.free_after_s < 0) c.free_after_s = c.t_s.back();
    last = tip;
  }
  return c;
}

// Either way heartbeats missed for 250 ms end the last torque; a quick stop brakes the motors first, and then
// the fault takes the torque away as well. Nothing is held, and no tension rises above its limit.
TEST(Reaction, BothFreeTheTendonsAndNeitherPullsHarder) {
  const Course free = Kill(2), held = Kill(3);
  for (const Course* c : {&free, &held}) {
    EXPECT_GT(c->free_after_s, 0.15);
    EXPECT_LT(c->free_after_s, 0.45);
    EXPECT_LT(*std::max_element(c->highest_N.begin(), c->highest_N.end()), 10.0);
    EXPECT_LT(c->highest_N.back(), 0.5 * c->highest_N.front());
    EXPECT_LT(std::abs(c->tip_x_mm.back()), 5.0) << "straight as far as friction lets it";
  }
  EXPECT_LE(free.free_after_s, held.free_after_s) << "braking comes first";
  for (const Course* c : {&free, &held}) {
    std::printf("%s: free after %.0f ms, tip at up to %.2f m/s, highest tension %.2f -> %.2f N\n",
                c == &free ? "disable voltage" : "quick stop", 1e3 * c->free_after_s, c->tip_speed_mps,
                c->highest_N.front(), c->highest_N.back());
  }

  if (const char* path = std::getenv("TENDRIL_REACTION_CSV")) {
    std::ofstream out(path);
    out << "t_s,option,tip_x_mm,tip_z_mm,highest_tension_N\n";
    for (const auto& [option, course] : {std::pair{2, &free}, std::pair{3, &held}}) {
      for (std::size_t i = 0; i < course->t_s.size(); ++i) {
        out << course->t_s[i] << ',' << option << ',' << course->tip_x_mm[i] << ',' << course->tip_z_mm[i]
            << ',' << course->highest_N[i] << '\n';
      }
    }
  }
}

}  // namespace
}  // namespace tendril::daemon
