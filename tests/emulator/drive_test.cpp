// The emulated drive seen from the bus: start-up, SDO, remapping, torque at SYNC, heartbeats, errors, resets.
// Speaks bare frames; knows nothing of the emulator's inside.
#include <gmock/gmock.h>

#include <cmath>

#include "raw_master.h"
#include "support/test_rack.h"

namespace tendril::emulator {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

// ---- start-up
// ---------------------------------------------------------------------------------------------------

TEST(Boot, EachNodeSaysOnceThatItIsThereAndThenIsQuiet) {
  RawMaster m({RawMaster::Drive(1), RawMaster::Drive(127)});
  const auto frames = m.Poll();
  EXPECT_THAT(RawMaster::Of(0x701, frames), ElementsAre(Bytes{0x00}));
  EXPECT_THAT(RawMaster::Of(0x77F, frames), ElementsAre(Bytes{0x00}));
  EXPECT_EQ(frames.size(), 2u);
  EXPECT_THAT(m.Run(500), IsEmpty());
}

TEST(Boot, IdentityIsThatOfTheDrive) {
  RawMaster m;
  m.Poll();
  EXPECT_EQ(m.Read(0x1000, 0).number(), 0x00020192u);
  EXPECT_EQ(m.Read(0x1018, 1).number(), 0xFBu);
  EXPECT_EQ(m.Read(0x1018, 2).number(), 0x60500000u);
  EXPECT_EQ(m.Read(0x1018, 3).number(), 0x01700000u);
  EXPECT_EQ(m.Read(0x1018, 4).number(), 0x1235u);
  EXPECT_EQ(m.Read(0x1014, 0).number(), 0x81u);
  EXPECT_EQ(m.Read(0x1200, 1).number(), 0x601u);
}

TEST(Boot, BadNodeIdsAreRefused) {
  SimulatedClock clock;
  can::MemoryBus bus(clock);
  for (const auto& ids : {std::vector<int>{0}, std::vector<int>{128}, std::vector<int>{3, 3}}) {
    std::vector<EmulatedDriveParameters> drives;
    for (int id : ids) drives.push_back(RawMaster::Drive(id));
    EXPECT_THROW(DriveRack(drives, bus.AddPort()), std::invalid_argument);
  }
}

// ---- SDO
// --------------------------------------------------------------------------------------------------------

TEST(Sdo, AbortsNameTheMistake) {
  RawMaster m;
  m.Poll();
  EXPECT_EQ(m.Read(0x5555, 0).abort, 0x06020000u);
  EXPECT_EQ(m.Read(0x1018, 9).abort, 0x06090011u);
  EXPECT_EQ(m.Write(0x5555, 0, 0, 1), 0x06020000u);
  EXPECT_EQ(m.Write(0x6041, 0, 0, 2), 0x06010002u);
  EXPECT_EQ(m.Write(0x6040, 0, 0, 1), 0x06070013u);
  EXPECT_EQ(m.Write(0x6040, 0, 0, 4), 0x06070012u);
  EXPECT_EQ(m.Write(0x605A, 0, 7, 2), 0x06090031u);
  EXPECT_EQ(m.Write(0x605A, 0, 5, 2), 0x06090032u);
  EXPECT_EQ(m.Write(0x605A, 0, 0xFFFF, 2), 0x06090032u) << "-1 is below the range, not above";
  EXPECT_EQ(m.Write(0x6060, 0, 2, 1), 0x06090030u) << "a mode that 0x6502 does not list";
  EXPECT_EQ(m.Write(0x1010, 1, 0x12345678, 4), 0x08000020u);
}

TEST(Sdo, AStringComesInSegmentsWithAlternatingToggle) {
  RawMaster m;
  m.Poll();
  EXPECT_EQ(m.Read(0x1008, 0).text(), "EPOS4");
  m.Exchange({0x40, 0x08, 0x10, 0, 0, 0, 0, 0});
  const auto wrong_toggle = m.Exchange({0x70, 0, 0, 0, 0, 0, 0, 0});
  ASSERT_TRUE(wrong_toggle);
  EXPECT_EQ((*wrong_toggle)[0], 0x80);
  EXPECT_EQ(Number(Bytes(wrong_toggle->begin() + 4, wrong_toggle->end())), 0x05030000u);
  EXPECT_EQ(m.Read(0x1008, 0).text(), "EPOS4") << "an abort must leave the server ready";
}

TEST(Sdo, ANumberMayBeWrittenInSegments) {
  RawMaster m;
  m.Poll();
  EXPECT_EQ(m.WriteSegmented(0x6085, 0, Little(5000, 4)), 0u);
  EXPECT_EQ(m.Read(0x6085, 0).number(), 5000u);
  EXPECT_EQ(m.WriteSegmented(0x6085, 0, Little(5000, 2)), 0x06070013u);
  EXPECT_EQ(m.WriteSegmented(0x6085, 0, Bytes(20, 1)), 0x06070012u);
  EXPECT_EQ(m.WriteSegmented(0x6085, 0, Bytes(300, 1)), 0x06070012u);
  EXPECT_EQ(m.Read(0x6085, 0).number(), 5000u);
}

TEST(Sdo, SegmentsWithoutAStartAndBlockTransferAreRefused) {
  RawMaster m;
  m.Poll();
  for (std::uint8_t command : {0x00, 0x60, 0xA0, 0xC0, 0xE0}) {
    const auto answer = m.Exchange({command, 0x08, 0x10, 0, 0, 0, 0, 0});
    ASSERT_TRUE(answer) << static_cast<int>(command);
    EXPECT_EQ((*answer)[0], 0x80);
    EXPECT_EQ(Number(Bytes(answer->begin() + 4, answer->end())), 0x05040001u);
  }
  EXPECT_FALSE(m.Exchange({0x80, 0x08, 0x10, 0, 0, 0, 4, 5})) << "a client's abort is not answered";
}

TEST(Sdo, FourBytesWithoutSizeAreTakenByTheObjectsWidth) {
  RawMaster m;
  m.Poll();
  const auto answer = m.Exchange({0x22, 0x17, 0x10, 0, 0x64, 0, 0, 0});
  ASSERT_TRUE(answer);
  EXPECT_EQ((*answer)[0], 0x60);
  EXPECT_EQ(m.Read(0x1017, 0).number(), 100u);
}

TEST(Sdo, IsSilentWhenStoppedAndForOtherNodes) {
  RawMaster m;
  m.Poll();
  EXPECT_EQ(m.Read(0x1000, 0, 2).abort, 0xDEADu);
  m.Nmt(0x02);
  EXPECT_EQ(m.Read(0x1000, 0).abort, 0xDEADu);
  m.Nmt(0x80);
  EXPECT_EQ(m.Read(0x1000, 0).number(), 0x00020192u);
}

// ---- remapping
// --------------------------------------------------------------------------------------------------

TEST(Remapping, OnlyTheRightOrderIsAccepted) {
  RawMaster m;
  m.Poll();
  EXPECT_EQ(m.Write(0x1600, 0, 0, 1), 0x08000022u) << "the PDO still exists";
  EXPECT_EQ(m.Write(0x1800, 3, 100, 2), 0x08000022u) << "inhibit time of an existing PDO";
  EXPECT_EQ(m.Write(0x1400, 1, 0x80000201, 4), 0u);
  EXPECT_EQ(m.Write(0x1600, 1, 0x60710010, 4), 0x08000022u) << "the number of entries is not 0";
  EXPECT_EQ(m.Write(0x1600, 0, 0, 1), 0u);
  EXPECT_EQ(m.Write(0x1600, 1, 0x60400010, 4), 0u);
  EXPECT_EQ(m.Write(0x1600, 2, 0x60710010, 4), 0u);
  EXPECT_EQ(m.Write(0x1600, 0, 2, 1), 0u);
  EXPECT_EQ(m.Write(0x1400, 2, 1, 1), 0u);
  EXPECT_EQ(m.Write(0x1400, 1, 0x201, 4), 0u);
  EXPECT_EQ(m.Write(0x1400, 1, 0x211, 4), 0x06090030u) << "an existing PDO keeps its identifier";
  EXPECT_EQ(m.Read(0x1600, 2).number(), 0x60710010u);
}

TEST(Remapping, WhatCannotBeMappedIsRefused) {
  RawMaster m;
  m.Poll();
  ASSERT_EQ(m.Write(0x1400, 1, 0x80000201, 4), 0u);
  ASSERT_EQ(m.Write(0x1600, 0, 0, 1), 0u);
  EXPECT_EQ(m.Write(0x1600, 1, 0x60760020, 4), 0x06040041u) << "rated torque is not mappable";
  EXPECT_EQ(m.Write(0x1600, 1, 0x60770010, 4), 0x06040041u) << "read-only objects cannot be received";
  EXPECT_EQ(m.Write(0x1600, 1, 0x60710020, 4), 0x06040041u) << "wrong length";
  EXPECT_EQ(m.Write(0x1600, 1, 0x55550010, 4), 0x06020000u);
  ASSERT_EQ(m.Write(0x1600, 1, 0x607A0020, 4), 0u);
  ASSERT_EQ(m.Write(0x1600, 2, 0x60FF0020, 4), 0u);
  ASSERT_EQ(m.Write(0x1600, 3, 0x60600008, 4), 0u);
  EXPECT_EQ(m.Write(0x1600, 0, 3, 1), 0x06040042u) << "nine bytes";
  EXPECT_EQ(m.Write(0x1600, 0, 13, 1), 0x06090031u);
  EXPECT_EQ(m.Write(0x1600, 0, 4, 1), 0x06020000u) << "the fourth entry names no object";
  EXPECT_EQ(m.Write(0x1600, 0, 2, 1), 0u);
  EXPECT_EQ(m.Write(0x1600, 0, 0, 1), 0u);
}

TEST(Remapping, IdentifiersAndTypesAreChecked) {
  RawMaster m;
  m.Poll();
  for (std::uint32_t id : {0x000u, 0x07Fu, 0x180u, 0x581u, 0x67Fu, 0x701u, 0x800u, 0x20000201u}) {
    EXPECT_EQ(m.Write(0x1401, 1, 0x80000000u | id, 4), 0x06090030u) << id;
  }
  for (int type : {1, 255}) EXPECT_EQ(m.Write(0x1400, 2, static_cast<std::uint64_t>(type), 1), 0u);
  for (int type : {1, 253, 255}) EXPECT_EQ(m.Write(0x1800, 2, static_cast<std::uint64_t>(type), 1), 0u);
  for (int type : {0, 2, 240, 241, 252, 254}) {
    EXPECT_EQ(m.Write(0x1800, 2, static_cast<std::uint64_t>(type), 1), 0x06090030u) << type;
  }
}

TEST(Remapping, NeedsPreOperational) {
  RawMaster m;
  m.Poll();
  m.Nmt(0x01);
  EXPECT_EQ(m.Write(0x1400, 1, 0x80000201, 4), 0x08000022u);
  m.Nmt(0x80);
  EXPECT_EQ(m.Write(0x1400, 1, 0x80000201, 4), 0u);
}

// ---- PDOs and torque
// --------------------------------------------------------------------------------------------

TEST(Torque, ActsAtTheNextSyncAndNotBefore) {
  RawMaster m;
  m.Enable();
  m.Command(0x0F, 500);
  m.Run(1);
  EXPECT_EQ(m.rack().torque_Nm(0), 0.0) << "before SYNC";
  m.Sync();
  m.Run(1);
  EXPECT_NEAR(m.rack().torque_Nm(0), 0.5 * kRated_Nm, 1e-12);
  m.Sync();
  m.Command(0x0F, -250);
  m.Run(1);
  EXPECT_NEAR(m.rack().torque_Nm(0), 0.5 * kRated_Nm, 1e-12) << "came after the SYNC";
  m.Command(0x0F, 100);
  m.Sync();
  m.Run(1);
  EXPECT_NEAR(m.rack().torque_Nm(0), 0.1 * kRated_Nm, 1e-12) << "the last one before SYNC counts";
}

TEST(Torque, NeedsOperationEnabledAndTorqueMode) {
  RawMaster m;
  m.Poll();
  m.MapTorque();
  m.Nmt(0x01);
  for (std::uint16_t controlword : {0x06, 0x07}) {
    m.Command(controlword, 500);
    m.Sync();
    m.Run(1);
    EXPECT_EQ(m.rack().torque_Nm(0), 0.0);
    EXPECT_FALSE(m.rack().enabled(0));
  }
  m.Command(0x0F, 500);
  m.Sync();
  m.Run(1);
  EXPECT_TRUE(m.rack().enabled(0));
  EXPECT_NEAR(m.rack().torque_Nm(0), 0.5 * kRated_Nm, 1e-12);
  EXPECT_TRUE(m.Statusword() & 0x1000) << "follows the command";
  EXPECT_EQ(m.Write(0x6060, 0, 0, 1), 0u);
  EXPECT_EQ(m.rack().torque_Nm(0), 0.0) << "no mode, no torque";
  EXPECT_FALSE(m.Statusword() & 0x1000);
}

// CiA 402: bit n - 1 of 0x6502 stands for mode n.
TEST(Modes, ThoseListedAreTakenAndWorkAndNoOthers) {
  RawMaster m;
  m.Enable();
  const std::uint64_t listed = m.Read(0x6502, 0).number();
  for (int mode = 1; mode <= 10; ++mode) {
    const bool offered = (listed >> (mode - 1)) & 1;
    EXPECT_EQ(m.Write(0x6060, 0, static_cast<std::uint64_t>(mode), 1), offered ? 0u : 0x06090030u) << mode;
    EXPECT_EQ(m.Read(0x6061, 0).number(), 10u) << mode;
    if (!offered) continue;
    m.Command(0x0F, 500);
    m.Sync();
    m.Run(1);
    EXPECT_NEAR(m.rack().torque_Nm(0), 0.5 * kRated_Nm, 1e-12) << mode << " does something";
  }
  EXPECT_EQ(listed, 0x200u);
}

// The drive's object dictionary has no torque slope (0x6087): in its cyclic synchronous torque mode the
// master makes the set values, and each acts at its SYNC. Ramps are those of the stops, see QuickStop and
// Stop.
TEST(Torque, ActsAtOnceForThereIsNoSlope) {
  RawMaster m;
  m.Enable();
  EXPECT_EQ(m.Read(0x6087, 0).abort, 0x06020000u);
  EXPECT_EQ(m.Write(0x6087, 0, 1000, 4), 0x06020000u);
  for (const std::int16_t torque : {1000, -1000, 0}) {
    m.Command(0x0F, torque);
    m.Sync();
    m.Poll();
    EXPECT_NEAR(m.rack().torque_Nm(0), 1e-3 * torque * kRated_Nm, 1e-12);
  }
}

TEST(Torque, WithoutARatedTorqueIsNotEnabled) {
  EmulatedDriveParameters factory;  // no motor data: 0x6076 is 0
  RawMaster m({factory});
  m.Poll();
  EXPECT_EQ(m.Read(0x6076, 0).number(), 0u);
  m.Nmt(0x01);
  for (std::uint16_t controlword : {0x06, 0x07}) m.Write(0x6040, 0, controlword, 2);
  EXPECT_EQ(m.State(), 0x23);
  m.Poll();
  m.Send(0x601, {0x2B, 0x40, 0x60, 0, 0x0F, 0, 0, 0});
  EXPECT_THAT(RawMaster::Of(0x081, m.Poll()), ElementsAre(Bytes{0x20, 0x63, 0x01, 0, 0, 0, 0, 0}));
  EXPECT_EQ(m.State(), 0x08);
  EXPECT_EQ(m.Read(0x603F, 0).number(), 0x6320u) << "parameter error";
  m.Write(0x6040, 0, 0, 2);
  EXPECT_EQ(m.Write(0x3001, 5, 19600, 4), 0u);
  for (std::uint16_t controlword : {0x80, 0x06, 0x0F}) m.Write(0x6040, 0, controlword, 2);
  EXPECT_EQ(m.State(), 0x27) << "with motor data it goes";
}

TEST(Torque, WhatScalesItCannotChangeWhileTheMotorIsPowered) {
  RawMaster m;
  m.Enable();
  m.Command(0x0F, 500);
  m.Sync();
  m.Run(1);
  EXPECT_EQ(m.Write(0x6076, 0, 9999, 4), 0x08000022u);
  EXPECT_EQ(m.Write(0x3001, 5, 9999, 4), 0x08000022u);
  EXPECT_EQ(m.Write(0x3001, 3, 2, 1), 0x08000022u);
  EXPECT_EQ(m.Write(0x6402, 0, 1, 2), 0x08000022u);
  EXPECT_EQ(m.Write(0x3001, 2, 700, 4), 0u) << "the current limit may";
  m.Run(1);
  EXPECT_NEAR(m.rack().torque_Nm(0), 0.5 * kRated_Nm, 1e-12);
  EXPECT_EQ(m.Read(0x6076, 0).number(), 7056u);
  m.Write(0x6040, 0, 0, 2);
  EXPECT_EQ(m.Write(0x6076, 0, 9999, 4), 0u);
  EXPECT_EQ(m.Write(0x3001, 5, 9999, 4), 0u);
}

TEST(Torque, OffsetAddsAndTheCurrentLimitClamps) {
  RawMaster m;
  m.Enable();
  ASSERT_EQ(m.Write(0x60B2, 0, 50, 2), 0u);
  m.Command(0x0F, 100);
  m.Sync();
  m.Run(1);
  EXPECT_NEAR(m.rack().torque_Nm(0), 0.15 * kRated_Nm, 1e-12);
  EXPECT_FALSE(m.Statusword() & 0x0800);
  ASSERT_EQ(m.Write(0x3001, 2, 36, 4), 0u);  // a tenth of the nominal current
  m.Run(1);
  EXPECT_NEAR(m.rack().torque_Nm(0), 0.1 * kRated_Nm, 1e-12);
  EXPECT_TRUE(m.Statusword() & 0x0800) << "internal limit active";
  m.Command(0x0F, -1000);
  m.Sync();
  m.Run(1);
  EXPECT_NEAR(m.rack().torque_Nm(0), -0.1 * kRated_Nm, 1e-12);
}

// Two real drives' parameter files: 4760 mA x 107746 uNm/A and 6000 mA x 34619 uNm/A.
TEST(Torque, RatedTorqueFollowsTheMotorData) {
  RawMaster m;
  m.Poll();
  EXPECT_EQ(m.Read(0x6076, 0).number(), 7056u);
  m.Write(0x3001, 1, 4760, 4);
  m.Write(0x3001, 5, 107746, 4);
  EXPECT_EQ(m.Read(0x6076, 0).number(), 512871u);
  m.Write(0x3001, 1, 6000, 4);
  m.Write(0x3001, 5, 34619, 4);
  EXPECT_EQ(m.Read(0x6076, 0).number(), 207714u);
  m.Write(0x3001, 5, 0, 4);
  EXPECT_EQ(m.Read(0x6076, 0).number(), 0u);
}

TEST(Feedback, IsSampledAtSync) {
  RawMaster m;
  m.Enable();
  DriveSensors sensors;
  sensors.position_counts = -123456;
  sensors.actual_torque_Nm = 0.25 * kRated_Nm;
  sensors.analog_mV = {-321, 7};
  sensors.velocity_rpm = 42;
  m.rack().SetSensors(0, sensors);
  EXPECT_THAT(RawMaster::Of(0x181, m.Run(5)), IsEmpty());
  m.Sync();
  const auto tpdo = RawMaster::Of(0x181, m.Poll());
  ASSERT_EQ(tpdo.size(), 1u);
  Bytes expected = Little(static_cast<std::uint32_t>(-123456), 4);
  for (std::uint8_t b : Little(250, 2)) expected.push_back(b);
  for (std::uint8_t b : Little(static_cast<std::uint16_t>(-321), 2)) expected.push_back(b);
  EXPECT_EQ(tpdo[0], expected);
  EXPECT_EQ(m.Read(0x606C, 0).number(), 42u);
  EXPECT_EQ(m.Read(0x30D1, 2).number(), 90u) << "a quarter of 360 mA";
  EXPECT_EQ(m.Read(0x3160, 2).number(), 7u);
}

TEST(Feedback, StatuswordIsSentOnChangeAtMostAtItsInhibitRate) {
  RawMaster m;
  m.Poll();
  ASSERT_EQ(m.Write(0x1801, 1, 0xC0000281, 4), 0u);
  ASSERT_EQ(m.Write(0x1801, 3, 100, 2), 0u);  // 10 ms
  ASSERT_EQ(m.Write(0x1A01, 0, 0, 1), 0u);
  ASSERT_EQ(m.Write(0x1A01, 0, 1, 1), 0u);
  ASSERT_EQ(m.Write(0x1801, 1, 0x40000281, 4), 0u);
  m.Nmt(0x01);
  const auto first = RawMaster::Of(0x281, m.Run(30));
  ASSERT_EQ(first.size(), 1u) << "once at the start, then only on change";
  EXPECT_EQ(first[0], Little(0x0240, 2));
  std::vector<Bytes> seen;
  for (int i = 0; i < 21; ++i) {  // a change each millisecond
    m.Send(0x601, {0x2B, 0x40, 0x60, 0, static_cast<std::uint8_t>(i % 2 ? 0x00 : 0x06), 0, 0, 0});
    for (const Bytes& b : RawMaster::Of(0x281, m.Run(1))) seen.push_back(b);
  }
  EXPECT_EQ(seen.size(), 2u);
  const auto last = RawMaster::Of(0x281, m.Run(20));
  ASSERT_EQ(last.size(), 1u) << "the last change is not lost in the inhibit time";
  EXPECT_EQ(last[0], Little(m.Statusword(), 2));
}

TEST(Feedback, RemoteRequestsAreAnsweredWhereAllowed) {
  RawMaster m;
  m.Poll();
  m.Remap(0x1802, 0x1A02, 0x381, 253, {0x60640020});
  m.Nmt(0x01);
  EXPECT_THAT(RawMaster::Of(0x381, m.Run(5)), IsEmpty());
  m.Send(0x381, {}, true);
  EXPECT_EQ(RawMaster::Of(0x381, m.Poll()).size(), 1u);
  m.Send(0x181, {}, true);
  EXPECT_THAT(RawMaster::Of(0x181, m.Poll()), IsEmpty()) << "bit 30 forbids it";
}

TEST(Pdo, WorkInOperationalOnly) {
  RawMaster m;
  m.Enable();
  m.Nmt(0x80);
  m.Command(0x0F, 500);
  m.Sync();
  EXPECT_THAT(m.Poll(), IsEmpty());
  EXPECT_EQ(m.rack().torque_Nm(0), 0.0);
}

TEST(Pdo, TooShortIsAnError) {
  RawMaster m;
  m.Enable();
  m.Run(1);
  m.Send(0x201, {0x0F, 0x00, 0x01});
  const auto emcy = RawMaster::Of(0x081, m.Poll());
  ASSERT_EQ(emcy.size(), 1u);
  EXPECT_EQ(emcy[0], (Bytes{0x10, 0x82, 0x10, 0, 0, 0, 0, 0}));
  EXPECT_EQ(m.State(), 0x08);
  EXPECT_EQ(m.Read(0x603F, 0).number(), 0x8210u);
  m.Send(0x201, {});
  EXPECT_THAT(RawMaster::Of(0x081, m.Poll()), IsEmpty()) << "told once, not every cycle";
}

TEST(Pdo, EventDrivenTorqueActsAtOnce) {
  RawMaster m;
  m.Enable();
  m.Nmt(0x80);
  m.Remap(0x1400, 0x1600, 0x201, 255, {0x60400010, 0x60710010});
  m.Nmt(0x01);
  m.Command(0x0F, 500);
  m.Poll();
  EXPECT_NEAR(m.rack().torque_Nm(0), 0.5 * kRated_Nm, 1e-12);
}

// ---- heartbeats
// -------------------------------------------------------------------------------------------------

TEST(Heartbeat, IsProducedAtItsPeriodWithTheNmtState) {
  RawMaster m;
  m.Poll();
  ASSERT_EQ(m.Write(0x1017, 0, 100, 2), 0u);
  EXPECT_THAT(RawMaster::Of(0x701, m.Run(1000)),
              testing::AllOf(testing::SizeIs(10), testing::Each(Bytes{0x7F})));
  m.Nmt(0x01);
  EXPECT_THAT(RawMaster::Of(0x701, m.Run(200)), ElementsAre(Bytes{0x05}, Bytes{0x05}));
  m.Nmt(0x02);
  EXPECT_THAT(RawMaster::Of(0x701, m.Run(100)), ElementsAre(Bytes{0x04}));
  m.rack().StopHeartbeat(0);
  EXPECT_THAT(RawMaster::Of(0x701, m.Run(500)), IsEmpty());
}

TEST(Heartbeat, LossOfTheMasterDisablesAndNeedsTheRightRecovery) {
  RawMaster m;
  m.Poll();
  ASSERT_EQ(m.Write(0x1016, 1, 0x007F0064, 4), 0u);  // node 127, 100 ms
  ASSERT_EQ(m.Write(0x6007, 0, 2, 2), 0u);
  m.Enable();
  m.Command(0x0F, 500);
  m.Sync();
  EXPECT_THAT(RawMaster::Of(0x081, m.Run(300)), IsEmpty()) << "monitoring begins with the first heartbeat";
  for (int i = 0; i < 5; ++i) {
    m.Send(0x77F, {0x05});
    EXPECT_THAT(RawMaster::Of(0x081, m.Run(90)), IsEmpty());
  }
  EXPECT_NE(m.rack().torque_Nm(0), 0.0);
  const auto emcy = RawMaster::Of(0x081, m.Run(20));
  ASSERT_EQ(emcy.size(), 1u);
  EXPECT_EQ(emcy[0], (Bytes{0x30, 0x81, 0x10, 0, 0, 0, 0, 0}));
  EXPECT_EQ(m.rack().torque_Nm(0), 0.0);
  EXPECT_EQ(m.State(), 0x08);
  m.Sync();
  EXPECT_THAT(RawMaster::Of(0x181, m.Poll()), IsEmpty()) << "pre-operational by 0x1029";

  m.Write(0x6040, 0, 0x00, 2);
  m.Write(0x6040, 0, 0x80, 2);
  EXPECT_EQ(m.State(), 0x08) << "no fault reset before NMT reset communication";
  m.Nmt(0x82);
  EXPECT_THAT(RawMaster::Of(0x701, m.Poll()), ElementsAre(Bytes{0x00}));
  EXPECT_EQ(m.State(), 0x08) << "the fault outlives the reset of the communication";
  m.Write(0x6040, 0, 0x00, 2);
  m.Write(0x6040, 0, 0x80, 2);
  EXPECT_EQ(m.State(), 0x40);
}

// On a real bus every drive hears every other; in one rack too.
TEST(Heartbeat, DrivesOfOneRackWatchEachOther) {
  RawMaster m({RawMaster::Drive(1), RawMaster::Drive(2)});
  m.Poll();
  ASSERT_EQ(m.Write(0x1017, 0, 20, 2, 1), 0u);
  ASSERT_EQ(m.Write(0x1016, 1, 0x00010032, 4, 2), 0u);  // drive 2 watches node 1, 50 ms
  ASSERT_EQ(m.Write(0x1016, 2, 0x00020032, 4, 2), 0u);  // ... and itself, whom no node hears
  EXPECT_THAT(RawMaster::Of(0x082, m.Run(500)), IsEmpty());
  m.rack().SetSupply(0, false);
  const auto emcy = RawMaster::Of(0x082, m.Run(100));
  ASSERT_EQ(emcy.size(), 1u);
  EXPECT_EQ(emcy[0][0] | emcy[0][1] << 8, 0x8130);
}

TEST(Feedback, ADriveMayTakeAnothersTpdo) {
  RawMaster m({RawMaster::Drive(1), RawMaster::Drive(2)});
  m.Poll();
  m.Enable(2);
  m.Nmt(0x80, 0);
  m.Remap(0x1800, 0x1A00, 0x181, 1, {0x60770010});       // actual torque of drive 1 ...
  m.Remap(0x1400, 0x1600, 0x181, 255, {0x60710010}, 2);  // ... is the set value of drive 2
  m.Nmt(0x01, 0);
  m.rack().SetSensors(0, {.position_counts = 0, .velocity_rpm = 0, .actual_torque_Nm = 0.25 * 7056e-6});
  m.Sync();
  m.Poll();
  EXPECT_EQ(static_cast<std::int16_t>(m.Read(0x6071, 0, 2).number()), 250);
}

TEST(Heartbeat, OneConsumerANode) {
  RawMaster m;
  m.Poll();
  ASSERT_EQ(m.Write(0x1016, 1, 0x007F0064, 4), 0u);
  EXPECT_EQ(m.Write(0x1016, 2, 0x007F00C8, 4), 0x06040043u);
  EXPECT_EQ(m.Write(0x1016, 2, 0x007E00C8, 4), 0u);
  EXPECT_EQ(m.Write(0x1016, 2, 0x00800001, 4), 0x06090030u);
}

TEST(Heartbeat, BehaviourOfTheNmtStateIsConfigurable) {
  for (const auto& [behaviour, state] : {std::pair{0, 0x7F}, std::pair{1, 0x05}, std::pair{2, 0x04}}) {
    RawMaster m;
    m.Poll();
    m.Write(0x1016, 1, 0x007F0064, 4);
    m.Write(0x1017, 0, 10, 2);
    ASSERT_EQ(m.Write(0x1029, 1, static_cast<std::uint64_t>(behaviour), 1), 0u);
    m.Nmt(0x01);
    m.Send(0x77F, {0x05});
    m.Run(150);
    EXPECT_EQ(RawMaster::Of(0x701, m.Run(10)).at(0).at(0), state);
  }
}

// ---- stops
// ------------------------------------------------------------------------------------------------------

TEST(QuickStop, BringsTheMotorToRestOnItsRampAndHoldsIt) {
  RawMaster m;
  m.Enable();
  m.Command(0x0F, 300);
  m.Sync();
  m.Run(1);
  // A bare rotor at 3000 rpm with a constant load, integrated here: J dw/dt = torque - load.
  const double inertia_kgm2 = 4.1e-7, load_Nm = 0.2 * kRated_Nm;
  double speed_radps = 3000 * 2 * M_PI / 60;
  m.Command(0x02, 300);
  m.Sync();
  double fastest_after_ramp = 0;
  for (int i = 0; i < 600; ++i) {
    DriveSensors s;
    s.velocity_rpm = static_cast<std::int32_t>(speed_radps * 60 / (2 * M_PI));
    m.rack().SetSensors(0, s);
    m.Run(1);
    speed_radps += 1e-3 * (m.rack().torque_Nm(0) - load_Nm) / inertia_kgm2;
    if (i > 400) fastest_after_ramp = std::max(fastest_after_ramp, std::abs(speed_radps));
    if (i == 150) {
      EXPECT_NEAR(speed_radps * 60 / (2 * M_PI), 1500, 200) << "10000 rpm/s: half way after 150 ms";
    }
  }
  EXPECT_LT(fastest_after_ramp * 60 / (2 * M_PI), 30);
  EXPECT_NEAR(m.rack().torque_Nm(0), load_Nm, 0.02 * kRated_Nm) << "holds against the load";
  EXPECT_EQ(m.State(), 0x07) << "option 6: stays in quick stop active";
  m.Command(0x00, 0);
  m.Sync();
  m.Run(1);
  EXPECT_EQ(m.rack().torque_Nm(0), 0.0);
  EXPECT_EQ(m.State(), 0x40);
}

TEST(Stop, OptionCodesOfShutdownAndDisableOperation) {
  for (const bool ramp : {false, true}) {
    for (const auto& [controlword, option, end] :
         {std::tuple{0x07, 0x605C, 0x23}, std::tuple{0x06, 0x605B, 0x21}}) {
      RawMaster m;
      m.Enable();
      ASSERT_EQ(m.Write(static_cast<std::uint16_t>(option), 0, ramp ? 1 : 0, 2), 0u);
      DriveSensors s;
      s.velocity_rpm = 1000;
      m.rack().SetSensors(0, s);
      m.Command(static_cast<std::uint16_t>(controlword), 0);
      m.Sync();
      m.Run(1);
      EXPECT_EQ(m.State(), ramp ? 0x27 : end) << "at once, or still on the ramp";
      s.velocity_rpm = 0;
      m.rack().SetSensors(0, s);
      m.Run(110);  // 1000 rpm at 10000 rpm/s
      EXPECT_EQ(m.State(), end);
    }
  }
}

TEST(Stop, ARampThatCannotEndIsGivenUp) {
  RawMaster m;
  m.Enable();
  DriveSensors s;
  s.velocity_rpm = 1000;  // a load that drags the motor on
  m.rack().SetSensors(0, s);
  m.Command(0x07, 0);
  m.Sync();
  m.Run(1000);
  EXPECT_EQ(m.State(), 0x23);
}

TEST(Stop, NmtStopDisablesWithoutAFault) {
  RawMaster m;
  m.Enable();
  m.Command(0x0F, 500);
  m.Sync();
  m.Run(1);
  m.Nmt(0x02);
  m.Run(1);
  EXPECT_EQ(m.rack().torque_Nm(0), 0.0);
  m.Nmt(0x80);
  EXPECT_EQ(m.State(), 0x40);
}

// ---- errors
// -----------------------------------------------------------------------------------------------------

TEST(Emcy, IsSentKeptAndClearedByTheRisingEdge) {
  RawMaster m;
  m.Enable();
  m.Command(0x0F, 500);
  m.Sync();
  m.Run(1);
  m.rack().InjectEmcy(0, 0x2310);
  EXPECT_THAT(RawMaster::Of(0x081, m.Poll()), ElementsAre(Bytes{0x10, 0x23, 0x02, 0, 0, 0, 0, 0}));
  EXPECT_EQ(m.State(), 0x08);
  EXPECT_EQ(m.rack().torque_Nm(0), 0.0);
  EXPECT_EQ(m.Read(0x1001, 0).number(), 0x02u);
  EXPECT_EQ(m.Read(0x1003, 0).number(), 1u);
  EXPECT_EQ(m.Read(0x1003, 1).number(), 0x2310u);

  m.Write(0x6040, 0, 0x0F, 2);
  EXPECT_EQ(m.State(), 0x08);
  m.Write(0x6040, 0, 0x80, 2);
  EXPECT_EQ(m.State(), 0x40);
  EXPECT_EQ(m.Read(0x1001, 0).number(), 0u);
  EXPECT_EQ(m.Read(0x603F, 0).number(), 0u);
  EXPECT_EQ(m.Read(0x1003, 1).number(), 0x2310u) << "the history outlives the reset";

  m.rack().InjectEmcy(0, 0x3220);
  EXPECT_EQ(m.State(), 0x08);
  m.Write(0x6040, 0, 0x80, 2);
  EXPECT_EQ(m.State(), 0x08) << "bit 7 was still set: no rising edge";
  m.Write(0x6040, 0, 0x00, 2);
  m.Write(0x6040, 0, 0x80, 2);
  EXPECT_EQ(m.State(), 0x40);
}

TEST(Emcy, ResetIsAnnounced) {
  RawMaster m;
  m.Poll();
  m.rack().InjectEmcy(0, 0x2310);
  m.Poll();
  m.Send(0x601, {0x2B, 0x40, 0x60, 0, 0x80, 0, 0, 0});
  EXPECT_THAT(RawMaster::Of(0x081, m.Poll()), ElementsAre(Bytes{0, 0, 0, 0, 0, 0, 0, 0}));
}

TEST(Emcy, WithoutAReactionIsAcknowledgedByTheRisingEdge) {
  RawMaster m;
  m.Enable();
  ASSERT_EQ(m.Write(0x6007, 0, 0, 2), 0u);  // communication errors do nothing
  m.rack().InjectEmcy(0, 0x8110);
  EXPECT_THAT(RawMaster::Of(0x081, m.Poll()), ElementsAre(Bytes{0x10, 0x81, 0x10, 0, 0, 0, 0, 0}));
  EXPECT_EQ(m.State(), 0x27) << "no reaction";
  EXPECT_EQ(m.Read(0x1001, 0).number(), 0x10u);
  EXPECT_EQ(m.Read(0x603F, 0).number(), 0x8110u);
  m.Send(0x601, {0x2B, 0x40, 0x60, 0, 0x8F, 0, 0, 0});
  EXPECT_THAT(RawMaster::Of(0x081, m.Poll()), ElementsAre(Bytes{0, 0, 0, 0, 0, 0, 0, 0}));
  EXPECT_EQ(m.Read(0x1001, 0).number(), 0u);
  EXPECT_EQ(m.Read(0x603F, 0).number(), 0u);
  EXPECT_EQ(m.State(), 0x27);
  m.Write(0x6040, 0, 0x0F, 2);
  m.Poll();
  m.Send(0x601, {0x2B, 0x40, 0x60, 0, 0x8F, 0, 0, 0});
  EXPECT_THAT(RawMaster::Of(0x081, m.Poll()), IsEmpty()) << "nothing is there to be reset";
}

TEST(Emcy, OfTheCommunicationWithoutAReactionEndsWithItsReset) {
  RawMaster m;
  m.Poll();
  m.Write(0x6007, 0, 0, 2);
  m.rack().InjectEmcy(0, 0x8110);
  m.Nmt(0x82);
  m.Poll();
  EXPECT_EQ(m.Read(0x1001, 0).number(), 0u);
  EXPECT_EQ(m.Read(0x603F, 0).number(), 0u);
  EXPECT_EQ(m.Read(0x1003, 1).number(), 0x8110u);

  m.rack().InjectEmcy(0, 0x2310);  // a fault keeps its cause through it
  m.Nmt(0x82);
  m.Poll();
  EXPECT_EQ(m.Read(0x1001, 0).number(), 0x02u);
  EXPECT_EQ(m.Read(0x603F, 0).number(), 0x2310u);
}

// ---- safe torque off ----------------------------------------------------------------------------

TEST(Sto, TakesTheTorqueAtOnceAndRefusesTheResetUntilItEnds) {
  RawMaster m;
  m.Enable();
  m.Command(0x0F, 500);
  m.Sync();
  m.Run(1);
  EXPECT_EQ(m.Read(0x3202, 1).number(), 3u) << "both inputs powered";
  m.rack().SetSto(0, true);
  EXPECT_EQ(m.rack().torque_Nm(0), 0.0);
  EXPECT_THAT(RawMaster::Of(0x081, m.Poll()), ElementsAre(Bytes{0x88, 0x8A, 0x01, 0, 0, 0, 0, 0}));
  EXPECT_EQ(m.State(), 0x08);
  EXPECT_FALSE(m.Statusword() & 0x10) << "no voltage";
  EXPECT_EQ(m.Read(0x3202, 1).number(), 0u);
  for (int i = 0; i < 3; ++i) {
    m.Write(0x6040, 0, 0x00, 2);
    m.Write(0x6040, 0, 0x80, 2);
    EXPECT_EQ(m.State(), 0x08) << "no reset while it lasts";
  }
  m.rack().SetSto(0, false);
  EXPECT_EQ(m.State(), 0x08) << "nor by its end";
  m.Write(0x6040, 0, 0x00, 2);
  m.Write(0x6040, 0, 0x80, 2);
  EXPECT_EQ(m.State(), 0x40);
  EXPECT_EQ(m.Read(0x1001, 0).number(), 0u);
  for (std::uint16_t controlword : {0x06, 0x07, 0x0F}) m.Write(0x6040, 0, controlword, 2);
  EXPECT_EQ(m.State(), 0x27);
}

TEST(Sto, IsToldWhenADriveWantsPowerAndNotBefore) {
  RawMaster m;
  m.Poll();
  m.MapTorque();
  m.Nmt(0x01);
  m.Poll();
  m.rack().SetSto(0, true);
  EXPECT_THAT(RawMaster::Of(0x081, m.Run(20)), IsEmpty());
  for (std::uint16_t controlword : {0x06, 0x07}) m.Write(0x6040, 0, controlword, 2);
  EXPECT_EQ(m.Statusword() & 0x7F, 0x23) << "switched on, without voltage";
  m.Command(0x0F, 500);
  m.Sync();
  EXPECT_THAT(RawMaster::Of(0x081, m.Run(1)), ElementsAre(Bytes{0x88, 0x8A, 0x01, 0, 0, 0, 0, 0}));
  EXPECT_EQ(m.State(), 0x08);
  EXPECT_EQ(m.rack().torque_Nm(0), 0.0);
}

TEST(Sto, OutlastsAPowerCycle) {
  RawMaster m;
  m.Poll();
  m.rack().SetSto(0, true);
  m.rack().PowerCycle(0);
  m.Poll();
  for (std::uint16_t controlword : {0x06, 0x07, 0x0F}) m.Write(0x6040, 0, controlword, 2);
  EXPECT_EQ(m.State(), 0x08);
  EXPECT_EQ(m.Read(0x603F, 0).number(), 0x8A88u);
}

TEST(Emcy, TheLastFiveAreKeptNewestFirstAndCanBeCleared) {
  RawMaster m;
  m.Poll();
  for (std::uint16_t code : {0x2310, 0x3210, 0x3220, 0x4210, 0x7320, 0x6320}) m.rack().InjectEmcy(0, code);
  EXPECT_EQ(m.Read(0x1003, 0).number(), 5u);
  const std::uint64_t expected[] = {0x6320, 0x7320, 0x4210, 0x3220, 0x3210};
  for (std::uint8_t sub = 1; sub <= 5; ++sub) EXPECT_EQ(m.Read(0x1003, sub).number(), expected[sub - 1]);
  EXPECT_EQ(m.Read(0x1001, 0).number(), 0x02u | 0x04u | 0x08u | 0x20u | 0x01u);
  EXPECT_NE(m.Write(0x1003, 0, 1, 1), 0u);
  EXPECT_EQ(m.Write(0x1003, 0, 0, 1), 0u);
  for (std::uint8_t sub = 0; sub <= 5; ++sub) EXPECT_EQ(m.Read(0x1003, sub).number(), 0u);
}

TEST(Emcy, ReactionFollowsTheOptionCode) {
  RawMaster m;
  m.Enable();
  DriveSensors s;
  s.velocity_rpm = 1000;
  m.rack().SetSensors(0, s);
  m.Run(1);
  m.rack().InjectEmcy(0, 0x8611);  // following error, 0x605E = 2: quick-stop ramp
  EXPECT_EQ(m.State(), 0x0F);
  EXPECT_TRUE(m.rack().enabled(0));
  s.velocity_rpm = 0;
  m.rack().SetSensors(0, s);
  m.Run(110);
  EXPECT_EQ(m.State(), 0x08);

  m.Write(0x6040, 0, 0x80, 2);
  for (std::uint16_t controlword : {0x06, 0x07, 0x0F}) m.Write(0x6040, 0, controlword, 2);
  ASSERT_EQ(m.Write(0x605E, 0, 0, 2), 0u);
  s.velocity_rpm = 1000;
  m.rack().SetSensors(0, s);
  m.Run(1);
  m.rack().InjectEmcy(0, 0x8611);
  EXPECT_EQ(m.State(), 0x08) << "0x605E = 0: at once";
}

TEST(I2t, HotWindingIsHeldToTheNominalCurrent) {
  RawMaster m;
  m.Enable();
  ASSERT_EQ(m.Write(0x3001, 4, 10, 2), 0u);  // 1 s
  m.Command(0x0F, 2000);
  m.Sync();
  m.Run(1);
  EXPECT_NEAR(m.rack().torque_Nm(0), 2 * kRated_Nm, 1e-12) << "twice nominal is the limit";
  int held_ms = 0;
  while (m.rack().torque_Nm(0) > 1.5 * kRated_Nm && held_ms < 2000) {
    DriveSensors s;
    s.actual_torque_Nm = m.rack().torque_Nm(0);
    m.rack().SetSensors(0, s);
    m.Run(1);
    ++held_ms;
  }
  // Heat 4 (1 - exp(-t / 1 s)) reaches 1 at ln(4/3) s.
  EXPECT_NEAR(held_ms, 288, 5);
  EXPECT_NEAR(m.rack().torque_Nm(0), kRated_Nm, 1e-12);
  EXPECT_TRUE(m.Statusword() & 0x0880) << "limited, and warned";
}

// ---- resets, store, faults on demand
// ----------------------------------------------------------------------------

TEST(Reset, OfTheNodeBringsEverythingBack) {
  RawMaster m;
  m.Enable();
  m.Command(0x0F, 500);
  m.Sync();
  m.Run(1);
  m.Nmt(0x81);
  EXPECT_THAT(RawMaster::Of(0x701, m.Poll()), ElementsAre(Bytes{0x00}));
  EXPECT_EQ(m.rack().torque_Nm(0), 0.0);
  EXPECT_EQ(m.State(), 0x40);
  EXPECT_EQ(m.Read(0x1600, 0).number(), 1u);
  EXPECT_EQ(m.Read(0x1400, 2).number(), 255u);
  EXPECT_EQ(m.Read(0x6060, 0).number(), 0u);
  EXPECT_EQ(m.Read(0x6071, 0).number(), 0u);
  EXPECT_EQ(m.Read(0x6076, 0).number(), 7056u) << "the motor's data are stored in the drive";
}

TEST(Reset, OfTheCommunicationLeavesTheApplication) {
  RawMaster m;
  m.Poll();
  m.MapTorque();
  m.Write(0x1017, 0, 100, 2);
  m.Write(0x6085, 0, 5000, 4);
  m.Nmt(0x82, 0);
  EXPECT_THAT(RawMaster::Of(0x701, m.Poll()), ElementsAre(Bytes{0x00}));
  EXPECT_EQ(m.Read(0x1017, 0).number(), 0u);
  EXPECT_EQ(m.Read(0x1600, 0).number(), 1u);
  EXPECT_EQ(m.Read(0x6060, 0).number(), 10u);
  EXPECT_EQ(m.Read(0x6085, 0).number(), 5000u);
}

TEST(Store, SavedValuesSurviveAndLoadBringsTheFactorysBack) {
  RawMaster m;
  m.Poll();
  m.Write(0x1017, 0, 100, 2);
  m.Write(0x6085, 0, 5000, 4);
  m.Write(0x6071, 0, 77, 2);
  EXPECT_EQ(m.Write(0x1010, 1, 0x65766173, 4), 0u);
  EXPECT_EQ(m.Read(0x1010, 1).number(), 1u);
  m.Write(0x6085, 0, 6000, 4);
  m.rack().PowerCycle(0);
  m.Poll();
  EXPECT_EQ(m.Read(0x6085, 0).number(), 5000u);
  EXPECT_EQ(m.Read(0x1017, 0).number(), 100u);
  EXPECT_EQ(m.Read(0x6071, 0).number(), 0u) << "targets are never stored";
  EXPECT_THAT(RawMaster::Of(0x701, m.Run(100)), ElementsAre(Bytes{0x7F})) << "the stored heartbeat runs";

  EXPECT_EQ(m.Write(0x1011, 1, 0x64616F6C, 4), 0u);
  EXPECT_EQ(m.Read(0x6085, 0).number(), 5000u) << "acts at the next reset";
  m.Nmt(0x81);
  m.Poll();
  EXPECT_EQ(m.Read(0x6085, 0).number(), 10000u);
  EXPECT_EQ(m.Read(0x1017, 0).number(), 0u);
}

TEST(Pdo, AnIdentifierThatIsTakenIsRefused) {
  RawMaster m;
  m.Poll();
  EXPECT_EQ(m.Write(0x1401, 1, 0x80000201, 4), 0u) << "not while it is invalid";
  EXPECT_EQ(m.Write(0x1401, 1, 0x00000201, 4), 0x06040043u) << "that of RPDO 1";
  EXPECT_EQ(m.Write(0x1401, 1, 0x80000181, 4), 0u);
  EXPECT_EQ(m.Write(0x1401, 1, 0x00000181, 4), 0x06040043u) << "that of TPDO 1";
  EXPECT_EQ(m.Write(0x1401, 1, 0x80000080, 4), 0u);
  EXPECT_EQ(m.Write(0x1401, 1, 0x00000080, 4), 0x06040043u) << "SYNC";
  EXPECT_EQ(m.Write(0x1401, 1, 0x80000081, 4), 0u);
  EXPECT_EQ(m.Write(0x1401, 1, 0x00000081, 4), 0x06040043u) << "its own EMCY";
  EXPECT_EQ(m.Write(0x1400, 1, 0x80000201, 4), 0u);
  EXPECT_EQ(m.Write(0x1401, 1, 0x80000201, 4), 0u);
  EXPECT_EQ(m.Write(0x1401, 1, 0x00000201, 4), 0u) << "free now";
  EXPECT_EQ(m.Write(0x1400, 1, 0x00000201, 4), 0x06040043u);
}

TEST(NodeId, CountsFromTheNextResetOnWhenItWasStored) {
  RawMaster m;
  m.Poll();
  ASSERT_EQ(m.Write(0x2000, 0, 9, 1), 0u);
  m.Nmt(0x81);
  m.Poll();
  EXPECT_EQ(m.Read(0x2000, 0).number(), 1u) << "not stored, gone";

  ASSERT_EQ(m.Write(0x1401, 1, 0x80000345, 4), 0u);  // set by hand: stays where it is
  ASSERT_EQ(m.Write(0x2000, 0, 9, 1), 0u);
  ASSERT_EQ(m.Write(0x1010, 1, 0x65766173, 4), 0u);
  EXPECT_EQ(m.Read(0x1014, 0).number(), 0x81u) << "not before the reset";
  m.Nmt(0x81);
  EXPECT_THAT(RawMaster::Of(0x709, m.Poll()), ElementsAre(Bytes{0x00}));
  EXPECT_EQ(m.rack().node_id(0), 9);
  EXPECT_EQ(m.Read(0x1000, 0, 1).abort, 0xDEADu) << "nobody answers to the old one";
  EXPECT_EQ(m.Read(0x2000, 0, 9).number(), 9u);
  EXPECT_EQ(m.Read(0x1014, 0, 9).number(), 0x89u);
  EXPECT_EQ(m.Read(0x1200, 1, 9).number(), 0x609u);
  EXPECT_EQ(m.Read(0x1400, 1, 9).number(), 0x209u);
  EXPECT_EQ(m.Read(0x1800, 1, 9).number(), 0x40000189u);
  EXPECT_EQ(m.Read(0x1401, 1, 9).number(), 0x80000345u);
  m.Enable(9);
  m.rack().InjectEmcy(0, 0x2310);
  EXPECT_EQ(RawMaster::Of(0x089, m.Poll()).size(), 1u);

  m.Write(0x6040, 0, 0, 2, 9);
  ASSERT_EQ(m.Write(0x1011, 1, 0x64616F6C, 4, 9), 0u);
  m.Nmt(0x81, 9);
  EXPECT_THAT(RawMaster::Of(0x701, m.Poll()), ElementsAre(Bytes{0x00})) << "factory values";
  EXPECT_EQ(m.Read(0x1400, 1).number(), 0x201u);
}

TEST(Store, IsRefusedWhileTheMotorIsPowered) {
  RawMaster m;
  m.Enable();
  EXPECT_EQ(m.Write(0x1010, 1, 0x65766173, 4), 0x08000022u);
}

TEST(Faults, AFrozenDriveIsDeafAndMuteAndKeepsItsTorque) {
  RawMaster m;
  m.Poll();
  m.Write(0x1017, 0, 10, 2);
  m.Enable();
  m.Command(0x0F, 500);
  m.Sync();
  m.Run(1);
  m.rack().SetFrozen(0, true);
  m.Command(0x00, 0);
  m.Sync();
  EXPECT_THAT(m.Run(100), IsEmpty());
  EXPECT_NEAR(m.rack().torque_Nm(0), 0.5 * kRated_Nm, 1e-12);
  m.rack().SetFrozen(0, false);
  m.Sync();
  EXPECT_EQ(RawMaster::Of(0x181, m.Poll()).size(), 1u);
  EXPECT_NEAR(m.rack().torque_Nm(0), 0.5 * kRated_Nm, 1e-12) << "the frames of that time are lost";
  m.rack().PowerCycle(0);
  EXPECT_EQ(m.rack().torque_Nm(0), 0.0);
  EXPECT_THAT(RawMaster::Of(0x701, m.Poll()), ElementsAre(Bytes{0x00}));
}

TEST(Rack, AnswersForEveryNodeOfABus) {
  std::vector<EmulatedDriveParameters> drives;
  for (int node = 1; node <= 127; ++node) drives.push_back(RawMaster::Drive(node));
  RawMaster m(drives);
  EXPECT_EQ(m.Poll().size(), 127u);
  for (int node : {1, 2, 64, 127}) {
    EXPECT_EQ(m.Read(0x1018, 4, node).number(), 0x1234u + static_cast<unsigned>(node));
    m.Enable(node);
    EXPECT_TRUE(m.rack().enabled(node - 1));
  }
  EXPECT_FALSE(m.rack().enabled(2));
}

}  // namespace
}  // namespace tendril::emulator
