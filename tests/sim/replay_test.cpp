// Each cut of the replay, fed with the plant's own signals, gives the plant's signals behind it.
#include "tendril/sim/replay.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>

#include "recording.h"

namespace tendril::sim {
namespace {

using test::Record;
using test::Recording;
using test::Rig;
using test::Rms;

TEST(Figures, Print) {
  const RobotParameters robot = Rig();
  const Replay replay(robot);
  for (const bool lively : {false, true}) {
    const Recording r = Record(robot, lively ? test::Multisine(robot) : test::Triangles(robot), 12000);
    const auto report = [&](const char* what, const BodyMotion& m, double seconds) {
      std::printf("%-6s tip %.2f um rms, %.2f max, base %.2f mN, d %.3f um, %.1f ms\n", what,
                  1e6 * Rms(m.tip_m - r.tip_m), 1e6 * (m.tip_m - r.tip_m).rowwise().norm().maxCoeff(),
                  1e3 * Rms(m.tension_base_N - r.tension_base_N), 1e6 * Rms(m.shortening_m - r.shortening_m),
                  1e3 * seconds);
    };
    std::printf("range of tip %.1f mm; C1 %.2e Nm, C2 %.3f mN, C3 %.3f mN\n",
                1e3 * (r.tip_m.colwise().maxCoeff() - r.tip_m.colwise().minCoeff()).maxCoeff(),
                Rms(replay.ActualTorque(r.signals) - r.signals.torque_actual_Nm),
                1e3 * Rms(replay.CellFromTorque(r.signals, r.shortening_m) - r.signals.tension_N),
                1e3 * Rms(replay.CellFromStretch(r.signals, r.shortening_m) - r.signals.tension_N));
    const auto timed = [&](const char* what, const ReplaySignals& s, Replay::DrivenBy by) {
      const auto start = std::chrono::steady_clock::now();
      const BodyMotion m = replay.Body(s, by, 1);
      report(what, m, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    };
    timed("cell", r.signals, Replay::DrivenBy::kCell);
    timed("torque", r.signals, Replay::DrivenBy::kTorque);
    timed("motor", r.signals, Replay::DrivenBy::kMotor);
    ReplaySignals robot_side = r.signals;
    robot_side.load_cell = LoadCellPlace::kRobotSide;
    robot_side.tension_N = r.tension_base_N;
    timed("robot", robot_side, Replay::DrivenBy::kCell);
  }
}

}  // namespace
}  // namespace tendril::sim
