// The mode table against the rules it must keep, over every mode and event.
#include "tendril/control/supervisor.h"

#include <gtest/gtest.h>

#include <set>
#include <vector>

namespace tendril::control {
namespace {

constexpr Event kEvents[] = {Event::kDrivesReady, Event::kDrivesEnabled, Event::kPretensioned,
                             Event::kReleased,    Event::kHomed,         Event::kArm,
                             Event::kHome,        Event::kCommission,    Event::kDisarm,
                             Event::kHold,        Event::kClear,         Event::kFault};
constexpr Mode kModes[] = {Mode::kDisconnected, Mode::kConfigured,   Mode::kArmed,    Mode::kPretension,
                           Mode::kRunning,      Mode::kHold,         Mode::kSafeStop, Mode::kFault,
                           Mode::kHoming,       Mode::kCommissioning};

// Events that lead a fresh supervisor into a mode, found by searching the table.
std::vector<Event> PathTo(Mode goal) {
  std::vector<std::vector<Event>> open{{}};
  std::set<Mode> seen;
  while (!open.empty()) {
    const auto path = open.front();
    open.erase(open.begin());
    Supervisor s;
    for (Event e : path) s.Handle(e, Status::kDriveLost);
    if (s.mode() == goal) return path;
    if (!seen.insert(s.mode()).second) continue;
    for (Event e : kEvents) {
      auto next = path;
      next.push_back(e);
      open.push_back(next);
    }
  }
  return {};
}

Supervisor In(Mode mode) {
  Supervisor s;
  for (Event e : PathTo(mode)) s.Handle(e, Status::kDriveLost);
  EXPECT_EQ(s.mode(), mode) << "not reachable: " << ModeText(mode);
  return s;
}

TEST(Supervisor, EveryModeIsReachable) {
  for (Mode m : kModes) In(m);
}

TEST(Supervisor, NoModeAndEventHaveTwoRows) {
  std::set<std::pair<Mode, Event>> rows;
  for (const auto& t : Supervisor::Table()) EXPECT_TRUE(rows.insert({t.from, t.event}).second);
}

TEST(Supervisor, OnlyTheOperatorArmsAndOnlyFromConfigured) {
  for (const auto& t : Supervisor::Table()) {
    if (t.to == Mode::kArmed) {
      EXPECT_EQ(t.event, Event::kArm);
      EXPECT_EQ(t.from, Mode::kConfigured);
    }
  }
}

// Power comes to the motors from configured only, each way on a word of its own, and the robot follows
// commands only after arm.
TEST(Supervisor, EachWayToPowerHasItsOwnWord) {
  for (const auto& t : Supervisor::Table()) {
    if (t.to == Mode::kHoming || t.to == Mode::kCommissioning) {
      EXPECT_EQ(t.from, Mode::kConfigured);
      EXPECT_EQ(t.event, t.to == Mode::kHoming ? Event::kHome : Event::kCommission);
    }
    if (t.from == Mode::kHoming || t.from == Mode::kCommissioning) {
      EXPECT_NE(t.to, Mode::kRunning);
    }
  }
}

TEST(Supervisor, FaultLatchesAgainstEverythingButClear) {
  for (Event e : kEvents) {
    Supervisor s = In(Mode::kFault);
    EXPECT_EQ(s.Handle(e, Status::kBusOff), e == Event::kClear);
    if (e != Event::kClear) {
      EXPECT_EQ(s.mode(), Mode::kFault);
      EXPECT_EQ(s.cause(), Status::kDriveLost) << "the first cause stays";
    } else {
      EXPECT_EQ(s.mode(), Mode::kDisconnected) << "clearing resumes nothing";
    }
  }
}

TEST(Supervisor, EveryPoweredModeHasDisarmAndFault) {
  for (Mode m :
       {Mode::kArmed, Mode::kPretension, Mode::kRunning, Mode::kHold, Mode::kHoming, Mode::kCommissioning}) {
    Supervisor s = In(m);
    EXPECT_TRUE(s.Handle(Event::kDisarm));
    EXPECT_EQ(s.mode(), Mode::kSafeStop);
    Supervisor f = In(m);
    EXPECT_TRUE(f.Handle(Event::kFault, Status::kBusOff));
    EXPECT_EQ(f.mode(), Mode::kFault);
    EXPECT_EQ(f.cause(), Status::kBusOff);
  }
}

}  // namespace
}  // namespace tendril::control
