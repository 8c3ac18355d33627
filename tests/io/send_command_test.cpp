// What an operator reads of the state that answers a command.
#include "tendril/io/send_command.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tendril/core/status.h"
#include "tendril_lcm/state_t.hpp"

namespace tendril::io {
namespace {

using testing::HasSubstr;
using testing::Not;

std::int16_t Number(Status status) { return static_cast<std::int16_t>(status); }
std::string Text(Status status) { return std::string(StatusText(status)); }

tendril_lcm::state_t State(const std::string& mode, std::vector<Status> reported) {
  tendril_lcm::state_t state{};
  state.mode_text = mode;
  for (const Status status : reported) state.reported.push_back(Number(status));
  return state;
}

TEST(SendCommand, AcceptedSaysWhichLimitActsAndHowFarTheGoalIs) {
  EXPECT_EQ(AcceptedText(State("hold", {})), "accepted; mode hold");
  tendril_lcm::state_t state = State("running", {Status::kLimitedBending});
  state.target_distance_m = 0.0025;
  EXPECT_EQ(AcceptedText(state), "accepted; mode running; 102 " + Text(Status::kLimitedBending) +
                                     " (2.50 mm away from the requested point)");
}

TEST(SendCommand, RefusedSaysWhyAndWhatElseIsWrongWithItsRemedy) {
  tendril_lcm::state_t state = State("disconnected", {Status::kDriveAbsent, Status::kCommandWrongMode});
  state.command_status = Number(Status::kCommandWrongMode);
  state.command_status_text = "refused here";
  EXPECT_EQ(RefusedText(state), "refused here (204, mode disconnected: 317 " + Text(Status::kDriveAbsent) +
                                    "; " + std::string(StatusRemedy(Status::kDriveAbsent)) + ")");
}

// Another program's targets being refused concerns that program.
TEST(SendCommand, TwoSendersAreNoPartOfAnAnswer) {
  tendril_lcm::state_t state = State("running", {Status::kTwoSenders});
  EXPECT_EQ(AcceptedText(state), "accepted; mode running");
  state.command_status = Number(Status::kAnotherSender);
  EXPECT_THAT(RefusedText(state), Not(HasSubstr("323")));
}

}  // namespace
}  // namespace tendril::io
