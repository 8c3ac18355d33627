// What a person and a program read of a daemon: nothing unknown is shown as a number, and every reason has
// its remedy.
#include "tendril/io/status_text.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "tendril/core/status.h"

namespace tendril::io {
namespace {

using testing::HasSubstr;
using testing::Not;

/// One section and one tendon; what is not given is not known.
DaemonStatus Running() {
  DaemonStatus status;
  tendril_lcm::state_t& s = status.state;
  s.mode_text = "running";
  s.cycle = 7;
  s.status_text = "ok";
  const double none = std::nan("");
  for (double* p : {s.target_tip_W_m, s.tip_desired_W_m, s.tip_estimate_W_m}) std::fill(p, p + 3, none);
  s.num_bending = 2;
  s.bending_desired_rad = {M_PI / 2, none};
  s.bending_estimate_rad = {none, -M_PI};
  s.bending_covariance_rad2 = {0.01 * M_PI * 0.01 * M_PI, 0, 0, 0};
  s.num_covariance = 4;
  s.num_tendons = 1;
  s.tension_desired_base_N = {1.5};
  s.tension_desired_motor_N = {2};
  s.tension_measured_N = {none};
  s.displacement_desired_m = {0.001};
  s.displacement_m = {-0.002};
  s.torque_measured_Nm = {0.003};
  return status;
}

DaemonSubject Subject() {
  return {.daemon = "host (1)",
          .robot = "rig",
          .bus = "can0",
          .error_meaning = [](int node_id, std::uint16_t code) -> std::optional<std::string> {
            if (node_id != 3) return std::nullopt;
            return "means " + std::to_string(code);
          }};
}

tendril_lcm::statistics_t Statistics() {
  tendril_lcm::statistics_t s{};
  s.num_drives = 3;
  s.drive_node_id = {1, 3, 4};
  s.drive_serial = {11, 13, 14};
  s.drive_state = {3, 5, 99};
  s.drive_statusword = {0, 0, 0};
  s.drive_error_code = {0, 0x2310, 0x8130};
  s.wake_latency_counts = {0, 9, 10, 1000};
  return s;
}

TEST(StatusText, ValuesAreInTheUnitsOfTheirColumns) {
  const std::string table = StatusTable(Running());
  EXPECT_THAT(table, HasSubstr("mode running (cycle 7)\nstatus 0 ok\n"));
  EXPECT_THAT(table,
              HasSubstr("  section 1       90.00          -          -    -180.00      1.800      0.000\n"));
  EXPECT_THAT(table,
              HasSubstr("  1               1.500      2.000          -      1.000     -2.000      3.000\n"));
  EXPECT_THAT(table, HasSubstr("  estimated           -          -          -\n"));
  EXPECT_THAT(table, Not(HasSubstr("nan")));
  EXPECT_THAT(table, Not(HasSubstr("out of reach")));
}

TEST(StatusText, AReasonComesWithItsRemedyAndTheDaemonsOwnWords) {
  DaemonStatus status = Running();
  status.state.status = static_cast<std::int16_t>(Status::kDriveAbsent);
  status.state.status_text = "node 3 does not answer";
  status.state.reported = {status.state.status, static_cast<std::int16_t>(Status::kSlack)};
  const std::string table = StatusTable(status);
  EXPECT_THAT(table, HasSubstr("status 317 node 3 does not answer; " +
                               std::string(StatusRemedy(Status::kDriveAbsent)) + "\n"));
  EXPECT_THAT(table, HasSubstr("status 303 " + std::string(StatusText(Status::kSlack)) + "; " +
                               std::string(StatusRemedy(Status::kSlack)) + "\n"));
}

TEST(StatusText, ATargetOutOfReachSaysByHowMuch) {
  DaemonStatus status = Running();
  status.state.target_distance_m = 0.0123;
  EXPECT_THAT(StatusTable(status), HasSubstr("-   12.30 mm out of reach\n"));
}

TEST(StatusText, AnErrorCodeHasItsMeaningOnlyWhereTheDriveIsKnown) {
  DaemonStatus status = Running();
  status.statistics = Statistics();
  EXPECT_THAT(StatusTable(status), HasSubstr("fault   0x2310\n"));
  status.subject = Subject();
  const std::string table = StatusTable(status);
  EXPECT_THAT(table, testing::StartsWith("robot rig on can0 (host (1))\nmode running"));
  EXPECT_THAT(table, HasSubstr("enabled   none\n"));
  EXPECT_THAT(table, HasSubstr("fault   0x2310 means 8976\n"));
  EXPECT_THAT(table, HasSubstr("?   0x8130\n"));
  EXPECT_THAT(table, HasSubstr("   .013\n"));  // a bin's digit d: 10^d cycles or more
  EXPECT_THAT(table, HasSubstr("last fault: none since start\n"));
  status.subject->robot.clear();
  EXPECT_THAT(StatusTable(status), HasSubstr("robot ? on can0"));
}

TEST(StatusText, TheLastFaultHasItsTime) {
  DaemonStatus status = Running();
  status.statistics = Statistics();
  status.statistics->last_fault_utime = 86'400'000'000 + 7'000;
  status.statistics->last_fault_status = 401;
  status.statistics->last_fault_text = "node 3";
  EXPECT_THAT(StatusTable(status), HasSubstr("last fault: 1970-01-02T00:00:00.007Z, 401 node 3\n"));
}

TEST(StatusText, JsonIsOneLineWithNullForWhatIsNotKnown) {
  DaemonStatus status = Running();
  EXPECT_FALSE(nlohmann::json::parse(StatusJson(status)).contains("robot"));
  EXPECT_FALSE(nlohmann::json::parse(StatusJson(status)).contains("statistics"));
  status.subject = Subject();
  status.statistics = Statistics();
  const std::string text = StatusJson(status);
  EXPECT_EQ(text.find('\n'), text.npos);
  const auto json = nlohmann::json::parse(text);
  EXPECT_EQ(json["robot"], "rig");
  EXPECT_EQ(json["bending_desired_rad"][0], M_PI / 2);
  EXPECT_TRUE(json["bending_desired_rad"][1].is_null());
  EXPECT_EQ(json["tension_desired_motor_N"][0], 2);
  EXPECT_TRUE(json["statistics"]["last_fault"].is_null());
  EXPECT_EQ(json["statistics"]["drives"][1]["state"], "fault");
  EXPECT_EQ(json["statistics"]["drives"][1]["error_code"], 0x2310);
}

}  // namespace
}  // namespace tendril::io
