// Every object of the table and every transition of CiA 402, allowed and forbidden, one by one.
// The transitions are written out here from the standard; the objects are those of the one table.
#include <gmock/gmock.h>

#include <array>

#include "raw_master.h"
#include "tendril/canopen/epos4.h"

namespace tendril::emulator {
namespace {

using canopen::Access;
using canopen::DataType;
using canopen::ObjectEntry;

std::string Name(const ObjectEntry& e) {
  char text[32];
  std::snprintf(text, sizeof text, "%04X:%02X", e.index, e.sub);
  return text;
}

/// What differs from the table's default after the drive was commissioned with RawMaster::Drive(5).
std::int64_t Expected(const ObjectEntry& e) {
  if (e.index == 0x1018 && e.sub == 4) return 0x1239;
  if (e.index == 0x3001 && e.sub == 1) return 360;
  if (e.index == 0x3001 && e.sub == 2) return 720;
  if (e.index == 0x3001 && e.sub == 5) return 19600;
  if (e.index == 0x6076) return 7056;
  if (e.index == 0x6041) return 0x0040;  // switch on disabled, not remote
  return e.default_value + (e.plus_node_id ? 5 : 0);
}

TEST(Objects, EachIsReadWithItsWidthAndValue) {
  RawMaster m({RawMaster::Drive(5)});
  m.Poll();
  int checked = 0;
  for (const ObjectEntry& e : canopen::Epos4Profile()->objects.entries()) {
    const SdoResult r = m.Read(e.index, e.sub, 5);
    ASSERT_EQ(r.abort, 0u) << Name(e);
    if (e.type == DataType::kString) {
      EXPECT_EQ(r.text(), e.text) << Name(e);
    } else {
      EXPECT_EQ(r.data, Little(static_cast<std::uint64_t>(Expected(e)), canopen::TypeBytes(e.type)))
          << Name(e);
    }
    ++checked;
  }
  const int objects = static_cast<int>(canopen::Epos4Profile()->objects.entries().size());
  RecordProperty("objects", checked);
  std::printf("objects read as the table says: %d of %d\n", checked, objects);
  EXPECT_EQ(checked, objects);
  EXPECT_GT(checked, 150);
}

TEST(Objects, EachRefusesWhatItMust) {
  RawMaster m({RawMaster::Drive(5)});
  m.Poll();
  int refused = 0, asked = 0;
  const auto expect_refused = [&](std::uint32_t abort, std::uint32_t expected, const ObjectEntry& e) {
    ++asked;
    refused += abort == expected;
    EXPECT_EQ(abort, expected) << std::hex << Name(e);
  };
  for (const ObjectEntry& e : canopen::Epos4Profile()->objects.entries()) {
    const int bytes = canopen::TypeBytes(e.type);
    if (e.access != Access::kReadWrite) {
      expect_refused(m.Write(e.index, e.sub, 0, bytes == 0 ? 4 : bytes, 5), 0x06010002u, e);
      continue;
    }
    const Bytes too_long(static_cast<std::size_t>(bytes) + 1, 0);
    expect_refused(m.WriteSegmented(e.index, e.sub, too_long, 5), 0x06070012u, e);
    if (bytes > 1) {
      expect_refused(m.Write(e.index, e.sub, 0, bytes - 1, 5), 0x06070013u, e);
    }
    const bool is_signed = canopen::TypeSigned(e.type);
    const std::int64_t type_max = (std::int64_t{1} << (8 * bytes - (is_signed ? 1 : 0))) - 1;
    const std::int64_t type_min = is_signed ? -type_max - 1 : 0;
    if (e.max < type_max) {
      expect_refused(m.Write(e.index, e.sub, static_cast<std::uint64_t>(e.max + 1), bytes, 5), 0x06090031u,
                     e);
    }
    if (e.min > type_min) {
      expect_refused(m.Write(e.index, e.sub, static_cast<std::uint64_t>(e.min - 1), bytes, 5), 0x06090032u,
                     e);
    }
    const SdoResult after = m.Read(e.index, e.sub, 5);
    EXPECT_EQ(after.data, Little(static_cast<std::uint64_t>(Expected(e)), bytes))
        << Name(e) << " was changed";
  }
  std::printf("writes against access, length or range refused with the right abort: %d of %d\n", refused,
              asked);
  EXPECT_EQ(refused, asked);
}

TEST(Objects, EachWritableOneTakesItsOwnValueAndItsLimits) {
  int taken = 0, written = 0;
  for (const ObjectEntry& e : canopen::Epos4Profile()->objects.entries()) {
    // Those whose writing depends on more than the range have their own tests.
    const bool special = (e.index >= 0x1400 && e.index < 0x1C00) || e.index == 0x1003 || e.index == 0x1010 ||
                         e.index == 0x1011 || e.index == 0x1016 || e.index == 0x6040;
    if (e.access != Access::kReadWrite || special) continue;
    for (const std::int64_t value : {e.min, Expected(e), e.max}) {
      RawMaster m({RawMaster::Drive(5)});
      m.Poll();
      const int bytes = canopen::TypeBytes(e.type);
      ASSERT_EQ(m.Write(e.index, e.sub, static_cast<std::uint64_t>(value), bytes, 5), 0u) << Name(e);
      const Bytes read = m.Read(e.index, e.sub, 5).data;
      ++written;
      taken += read == Little(static_cast<std::uint64_t>(value), bytes);
      EXPECT_EQ(read, Little(static_cast<std::uint64_t>(value), bytes)) << Name(e);
    }
  }
  std::printf("values written at the limits and within, read back: %d of %d\n", taken, written);
  EXPECT_EQ(taken, written);
}

// ---- CiA 402
// ----------------------------------------------------------------------------------------------------

constexpr std::uint16_t kSwitchOnDisabled = 0x40, kReady = 0x21, kSwitchedOn = 0x23, kEnabled = 0x27,
                        kQuickStop = 0x07, kReaction = 0x0F, kFault = 0x08;
constexpr std::array kStates = {kSwitchOnDisabled, kReady,    kSwitchedOn, kEnabled,
                                kQuickStop,        kReaction, kFault};
constexpr std::array<std::uint16_t, 7> kCommands = {0x06, 0x07, 0x0F, 0x00, 0x02, 0x80, 0x87};

struct Move {
  std::uint16_t from, controlword, to;
};
// Every pair that is not listed must leave the state alone. 0x0F in ready passes switched on (transitions 3
// and 4).
constexpr Move kMoves[] = {
    {kSwitchOnDisabled, 0x06, kReady},
    {kReady, 0x07, kSwitchedOn},
    {kReady, 0x0F, kEnabled},
    {kReady, 0x00, kSwitchOnDisabled},
    {kReady, 0x02, kSwitchOnDisabled},
    {kSwitchedOn, 0x0F, kEnabled},
    {kSwitchedOn, 0x06, kReady},
    {kSwitchedOn, 0x00, kSwitchOnDisabled},
    {kSwitchedOn, 0x02, kSwitchOnDisabled},
    {kEnabled, 0x07, kSwitchedOn},
    {kEnabled, 0x06, kReady},
    {kEnabled, 0x00, kSwitchOnDisabled},
    {kEnabled, 0x02, kQuickStop},
    {kQuickStop, 0x00, kSwitchOnDisabled},
    {kQuickStop, 0x0F, kEnabled},
    {kFault, 0x80, kSwitchOnDisabled},
    {kFault, 0x87, kSwitchOnDisabled},  // the rising edge counts, whatever the other bits say
};

void Reach(RawMaster& m, std::uint16_t state) {
  m.Poll();
  const auto write = [&](std::uint16_t controlword) { ASSERT_EQ(m.Write(0x6040, 0, controlword, 2), 0u); };
  if (state != kSwitchOnDisabled && state != kFault) write(0x06);
  if (state == kSwitchedOn || state == kEnabled || state == kQuickStop || state == kReaction) write(0x07);
  if (state == kEnabled || state == kQuickStop || state == kReaction) write(0x0F);
  if (state == kQuickStop) write(0x02);
  if (state == kFault) m.rack().InjectEmcy(0, 0x2310);
  if (state == kReaction) {  // lasts as long as the motor turns
    DriveSensors s;
    s.velocity_rpm = 5000;
    m.rack().SetSensors(0, s);
    m.Run(1);
    m.rack().InjectEmcy(0, 0x8611);
  }
  ASSERT_EQ(m.State(), state);
}

TEST(Cia402, EveryCommandInEveryState) {
  int pairs = 0, moves = 0, right = 0;
  for (const std::uint16_t from : kStates) {
    for (const std::uint16_t controlword : kCommands) {
      RawMaster m;
      Reach(m, from);
      ASSERT_EQ(m.Write(0x6040, 0, controlword, 2), 0u);
      std::uint16_t expected = from;
      for (const Move& move : kMoves) {
        if (move.from == from && move.controlword == controlword) {
          expected = move.to;
          ++moves;
        }
      }
      right += m.State() == expected;
      EXPECT_EQ(m.State(), expected) << std::hex << "from " << from << " by controlword " << controlword;
      const bool powered = expected == kEnabled || expected == kQuickStop || expected == kReaction;
      EXPECT_EQ(m.rack().enabled(0), powered);
      EXPECT_EQ((m.Statusword() & 0x10) != 0, powered || expected == kReady || expected == kSwitchedOn);
      ++pairs;
    }
  }
  RecordProperty("pairs", pairs);
  const int all = static_cast<int>(kStates.size() * kCommands.size());
  std::printf("transitions, %d allowed and %d forbidden: %d of %d\n", moves, pairs - moves, right, all);
  EXPECT_EQ(right, all);
  EXPECT_EQ(pairs, 49);
  EXPECT_EQ(moves, static_cast<int>(std::size(kMoves)));
}

TEST(Cia402, AnErrorLeadsFromEveryStateToFault) {
  int right = 0;
  for (const std::uint16_t from : kStates) {
    RawMaster m;
    Reach(m, from);
    m.rack().InjectEmcy(0, 0x3210);
    right += m.State() == kFault;
    EXPECT_EQ(m.State(), kFault) << std::hex << from;
  }
  std::printf("states from which an error leads to fault: %d of %zu\n", right, kStates.size());
}

// ---- EMCY
// -------------------------------------------------------------------------------------------------------

struct Code {
  std::uint16_t code;
  std::uint8_t error_register;
  std::uint16_t option;  // that governs the reaction: 0 none, always at once
};
constexpr Code kCodes[] = {
    {0x1000, 0x01, 0},      {0x1080, 0x01, 0},      {0x1088, 0x01, 0},      {0x1090, 0x01, 0},
    {0x5280, 0x01, 0},      {0x5282, 0x01, 0},      {0x5480, 0x01, 0},      {0x5483, 0x01, 0},
    {0x6080, 0x01, 0},      {0x6180, 0x01, 0},      {0x61F0, 0x01, 0},      {0x6380, 0x01, 0},
    {0x8A88, 0x01, 0},      {0x2310, 0x02, 0},      {0x2320, 0x02, 0},      {0x3210, 0x04, 0},
    {0x3220, 0x04, 0},      {0x5113, 0x04, 0},      {0x4210, 0x08, 0},      {0x4380, 0x08, 0},
    {0x7320, 0x20, 0},      {0x7380, 0x20, 0},      {0x7382, 0x20, 0},      {0x7388, 0x20, 0},
    {0x738A, 0x20, 0},      {0x7390, 0x20, 0},      {0x7392, 0x20, 0},      {0x6320, 0x01, 0x605E},
    {0x8611, 0x80, 0x605E}, {0x8110, 0x10, 0x6007}, {0x8111, 0x10, 0x6007}, {0x8120, 0x10, 0x6007},
    {0x8130, 0x10, 0x6007}, {0x8150, 0x10, 0x6007}, {0x81FD, 0x10, 0x6007}, {0x81FE, 0x10, 0x6007},
    {0x81FF, 0x10, 0x6007}, {0x8210, 0x10, 0x6007}, {0x8250, 0x10, 0x6007}};

TEST(Emergencies, EachCodeShowsItsRegisterAndItsReaction) {
  std::size_t right = 0;
  for (const Code& c : kCodes) {
    // Once with the option at "at once", once at "ramp"; both with a motor that turns.
    for (const bool ramp : {false, true}) {
      RawMaster m;
      m.Poll();
      m.Nmt(0x01);
      for (std::uint16_t controlword : {0x06, 0x07, 0x0F}) m.Write(0x6040, 0, controlword, 2);
      m.Write(0x605E, 0, ramp ? 2 : 0, 2);
      m.Write(0x6007, 0, ramp ? 3 : 2, 2);
      DriveSensors s;
      s.velocity_rpm = 5000;
      m.rack().SetSensors(0, s);
      m.Run(1);
      m.rack().InjectEmcy(0, c.code);
      const auto sent = RawMaster::Of(0x081, m.Poll());
      ASSERT_EQ(sent.size(), 1u) << std::hex << c.code;
      EXPECT_EQ(sent[0], (Bytes{static_cast<std::uint8_t>(c.code), static_cast<std::uint8_t>(c.code >> 8),
                                c.error_register, 0, 0, 0, 0, 0}));
      right += m.State() == (ramp && c.option != 0 ? kReaction : kFault);
      EXPECT_EQ(m.State(), ramp && c.option != 0 ? kReaction : kFault) << std::hex << c.code;
      EXPECT_EQ(m.Read(0x603F, 0).number(), c.code);
      EXPECT_EQ(m.Read(0x1003, 1).number(), c.code);
    }
  }
  std::printf("error codes with their reaction, at once and by ramp: %zu of %zu\n", right,
              2 * std::size(kCodes));
}

}  // namespace
}  // namespace tendril::emulator
