// The wire level against bytes written down by hand from CiA 301 and 402, and the tables against each other.
// Nothing here runs a master.
#include "tendril/canopen/wire.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "tendril/canopen/cia402.h"
#include "tendril/canopen/emcy.h"
#include "tendril/canopen/epos4.h"
#include "tendril/canopen/master.h"
#include "tendril/canopen/pdo.h"
#include "tendril/canopen/sdo.h"

namespace tendril::canopen {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::vector<int> Bytes(const can::CanFrame& frame) {
  return {frame.data.begin(), frame.data.begin() + frame.size};
}

can::CanFrame Frame(std::uint32_t id, std::initializer_list<int> bytes) {
  can::CanFrame frame;
  frame.id = id;
  for (int byte : bytes) frame.data[frame.size++] = static_cast<std::uint8_t>(byte);
  return frame;
}

// ---- NMT, heartbeat, SYNC, EMCY -----------------------------------------------------------------

TEST(Wire, FramesOfThePredefinedConnectionSet) {
  EXPECT_EQ(NmtFrame(NmtCommand::kResetCommunication, 5).id, 0x000u);
  EXPECT_THAT(Bytes(NmtFrame(NmtCommand::kStart, 5)), ElementsAre(0x01, 5));
  EXPECT_THAT(Bytes(NmtFrame(NmtCommand::kStop, 0)), ElementsAre(0x02, 0));
  EXPECT_THAT(Bytes(NmtFrame(NmtCommand::kEnterPreOperational, 9)), ElementsAre(0x80, 9));
  EXPECT_THAT(Bytes(NmtFrame(NmtCommand::kResetNode, 9)), ElementsAre(0x81, 9));
  EXPECT_THAT(Bytes(NmtFrame(NmtCommand::kResetCommunication, 9)), ElementsAre(0x82, 9));
  EXPECT_EQ(HeartbeatFrame(127, NmtState::kOperational).id, 0x77Fu);
  EXPECT_THAT(Bytes(HeartbeatFrame(127, NmtState::kOperational)), ElementsAre(0x05));
  EXPECT_EQ(SyncFrame().id, 0x080u);
  EXPECT_EQ(SyncFrame().size, 0);
  EXPECT_EQ(TpdoCobId(1, 3), 0x183u);
  EXPECT_EQ(TpdoCobId(4, 3), 0x483u);
  EXPECT_EQ(RpdoCobId(1, 3), 0x203u);
  EXPECT_EQ(RpdoCobId(4, 3), 0x503u);
}

TEST(Wire, ParsersTakeTheirsAndNothingElse) {
  const auto nmt = ParseNmt(Frame(0x000, {0x82, 0x07}));
  ASSERT_TRUE(nmt);
  EXPECT_EQ(nmt->command, NmtCommand::kResetCommunication);
  EXPECT_EQ(nmt->node_id, 7);
  EXPECT_FALSE(ParseNmt(Frame(0x000, {0x82})));
  EXPECT_FALSE(ParseNmt(Frame(0x000, {0x55, 1})));
  EXPECT_FALSE(ParseNmt(Frame(0x000, {0x01, 128})));
  const auto heartbeat = ParseHeartbeat(Frame(0x70B, {0x7F}));
  ASSERT_TRUE(heartbeat);
  EXPECT_EQ(heartbeat->node_id, 11);
  EXPECT_EQ(heartbeat->state, NmtState::kPreOperational);
  EXPECT_FALSE(ParseHeartbeat(Frame(0x700, {0x05})));
  EXPECT_FALSE(ParseHeartbeat(Frame(0x701, {0x06})));
  EXPECT_FALSE(ParseHeartbeat(Frame(0x701, {})));
  EXPECT_TRUE(IsSync(Frame(0x080, {})));
  EXPECT_FALSE(IsSync(Frame(0x081, {})));
  const auto emcy = ParseEmcy(Frame(0x083, {0x30, 0x81, 0x11, 1, 2, 3, 4, 5}));
  ASSERT_TRUE(emcy);
  EXPECT_EQ(emcy->node_id, 3);
  EXPECT_EQ(emcy->code, 0x8130);
  EXPECT_EQ(emcy->error_register, 0x11);
  EXPECT_THAT(emcy->vendor, ElementsAre(1, 2, 3, 4, 5));
  EXPECT_FALSE(ParseEmcy(Frame(0x080, {0, 0, 0, 0, 0, 0, 0, 0})));
  EXPECT_FALSE(ParseEmcy(Frame(0x083, {0x30, 0x81})));
  EXPECT_THAT(Bytes(EmcyFrame({.node_id = 3, .code = 0x8130, .error_register = 0x11, .vendor = {}})),
              ElementsAre(0x30, 0x81, 0x11, 0, 0, 0, 0, 0));
}

TEST(Wire, LittleEndianWithSign) {
  std::array<std::uint8_t, 8> data{};
  Put<std::int32_t>(data, -2);
  EXPECT_EQ(data[0], 0xFE);
  EXPECT_EQ(data[3], 0xFF);
  EXPECT_EQ(data[4], 0x00);
  EXPECT_EQ(Get<std::int32_t>(data), -2);
  EXPECT_EQ(Get<std::uint16_t>(data), 0xFFFE);
  EXPECT_EQ(SignExtend(0x8000, 16), -32768);
  EXPECT_EQ(SignExtend(0x7FFF, 16), 32767);
}

// ---- SDO ----------------------------------------------------------------------------------------

SdoMessage Initiate(SdoKind kind, ObjectAddress address, int bytes, std::uint32_t value) {
  SdoMessage message;
  message.kind = kind;
  message.address = address;
  message.expedited = message.size_indicated = true;
  message.size = static_cast<std::uint32_t>(bytes);
  PutLe(message.data, value, bytes);
  return message;
}

TEST(SdoCodec, ExpeditedBytes) {
  const auto download = [](int bytes, std::uint32_t value) {
    return EncodeSdoRequest(2, Initiate(SdoKind::kInitiateDownload, {0x6071, 0}, bytes, value));
  };
  EXPECT_EQ(download(2, 1000).id, 0x602u);
  EXPECT_THAT(Bytes(download(1, 0x0A)), ElementsAre(0x2F, 0x71, 0x60, 0x00, 0x0A, 0, 0, 0));
  EXPECT_THAT(Bytes(download(2, 1000)), ElementsAre(0x2B, 0x71, 0x60, 0x00, 0xE8, 0x03, 0, 0));
  EXPECT_THAT(Bytes(download(3, 0x030201)), ElementsAre(0x27, 0x71, 0x60, 0x00, 1, 2, 3, 0));
  EXPECT_THAT(Bytes(download(4, 0x04030201)), ElementsAre(0x23, 0x71, 0x60, 0x00, 1, 2, 3, 4));
  const auto response = EncodeSdoResponse(2, Initiate(SdoKind::kInitiateUpload, {0x1018, 1}, 4, 0xFB));
  EXPECT_EQ(response.id, 0x582u);
  EXPECT_THAT(Bytes(response), ElementsAre(0x43, 0x18, 0x10, 0x01, 0xFB, 0, 0, 0));
  SdoMessage ack;
  ack.kind = SdoKind::kInitiateDownload;
  ack.address = {0x6071, 0};
  EXPECT_THAT(Bytes(EncodeSdoResponse(2, ack)), ElementsAre(0x60, 0x71, 0x60, 0x00, 0, 0, 0, 0));
  SdoMessage read;
  read.kind = SdoKind::kInitiateUpload;
  read.address = {0x3160, 1};
  EXPECT_THAT(Bytes(EncodeSdoRequest(2, read)), ElementsAre(0x40, 0x60, 0x31, 0x01, 0, 0, 0, 0));
}

TEST(SdoCodec, SegmentBytes) {
  SdoMessage segment;
  segment.kind = SdoKind::kDownloadSegment;
  segment.size = 7;
  segment.data = {1, 2, 3, 4, 5, 6, 7};
  EXPECT_THAT(Bytes(EncodeSdoRequest(1, segment)), ElementsAre(0x00, 1, 2, 3, 4, 5, 6, 7));
  segment.size = 3;
  segment.toggle = segment.last = true;
  EXPECT_THAT(Bytes(EncodeSdoRequest(1, segment)), ElementsAre(0x19, 1, 2, 3, 0, 0, 0, 0));
  EXPECT_THAT(Bytes(EncodeSdoResponse(1, segment)), ElementsAre(0x30, 0, 0, 0, 0, 0, 0, 0));
  segment.kind = SdoKind::kUploadSegment;
  EXPECT_THAT(Bytes(EncodeSdoRequest(1, segment)), ElementsAre(0x70, 0, 0, 0, 0, 0, 0, 0));
  EXPECT_THAT(Bytes(EncodeSdoResponse(1, segment)), ElementsAre(0x19, 1, 2, 3, 0, 0, 0, 0));
  SdoMessage begin;
  begin.kind = SdoKind::kInitiateDownload;
  begin.address = {0x1008, 0};
  begin.size_indicated = true;
  begin.size = 10;
  EXPECT_THAT(Bytes(EncodeSdoRequest(1, begin)), ElementsAre(0x21, 0x08, 0x10, 0x00, 10, 0, 0, 0));
  SdoMessage abort;
  abort.kind = SdoKind::kAbort;
  abort.address = {0x1008, 0};
  abort.abort_code = 0x06090011;
  EXPECT_THAT(Bytes(EncodeSdoRequest(1, abort)), ElementsAre(0x80, 0x08, 0x10, 0x00, 0x11, 0x00, 0x09, 0x06));
  EXPECT_EQ(Bytes(EncodeSdoResponse(1, abort)), Bytes(EncodeSdoRequest(1, abort)));
}

TEST(SdoCodec, EveryRequestAndResponseDecodesToWhatItWas) {
  for (SdoKind kind : {SdoKind::kInitiateDownload, SdoKind::kInitiateUpload}) {
    for (int bytes = 1; bytes <= 4; ++bytes) {
      const SdoMessage in = Initiate(kind, {0x1A2B, 0x3C}, bytes, 0x44332211);
      const bool request = kind == SdoKind::kInitiateDownload;
      const SdoMessage out =
          request ? DecodeSdoRequest(EncodeSdoRequest(9, in)) : DecodeSdoResponse(EncodeSdoResponse(9, in));
      EXPECT_EQ(out.kind, kind);
      EXPECT_EQ(out.address, in.address);
      EXPECT_TRUE(out.expedited);
      EXPECT_EQ(out.size, in.size);
      EXPECT_EQ(out.data, in.data);
    }
  }
  for (SdoKind kind : {SdoKind::kDownloadSegment, SdoKind::kUploadSegment}) {
    for (std::uint32_t bytes = 0; bytes <= 7; ++bytes) {
      for (int flags = 0; flags < 4; ++flags) {
        SdoMessage in;
        in.kind = kind;
        in.size = bytes;
        in.toggle = flags & 1;
        in.last = flags & 2;
        for (std::uint32_t i = 0; i < bytes; ++i) in.data[i] = static_cast<std::uint8_t>(i + 1);
        const bool request = kind == SdoKind::kDownloadSegment;
        const SdoMessage out =
            request ? DecodeSdoRequest(EncodeSdoRequest(9, in)) : DecodeSdoResponse(EncodeSdoResponse(9, in));
        EXPECT_EQ(out.kind, kind);
        EXPECT_EQ(out.size, bytes);
        EXPECT_EQ(out.toggle, in.toggle);
        EXPECT_EQ(out.last, in.last);
        EXPECT_EQ(out.data, in.data);
      }
    }
  }
  EXPECT_EQ(DecodeSdoRequest(Frame(0x601, {0x40, 0, 0x10})).kind, SdoKind::kUnknown) << "too short";
  EXPECT_EQ(DecodeSdoRequest(Frame(0x601, {0xC0, 0, 0x10, 0, 0, 0, 0, 0})).kind, SdoKind::kUnknown)
      << "block";
  EXPECT_EQ(DecodeSdoRequest(Frame(0x601, {0xE0, 0, 0x10, 0, 0, 0, 0, 0})).kind, SdoKind::kUnknown);
}

TEST(SdoCodec, EveryAbortCodeHasAText) {
  for (std::uint32_t code :
       {0x05030000u, 0x05040000u, 0x05040001u, 0x06010000u, 0x06010001u, 0x06010002u, 0x06020000u,
        0x06040041u, 0x06040042u, 0x06040043u, 0x06060000u, 0x06070010u, 0x06070012u, 0x06070013u,
        0x06090011u, 0x06090030u, 0x06090031u, 0x06090032u, 0x08000000u, 0x08000020u, 0x08000022u}) {
    EXPECT_STRNE(AbortText(code), "unknown abort code") << std::hex << code;
  }
  EXPECT_STREQ(AbortText(0x12345678), "unknown abort code");
}

// ---- CiA 402 ------------------------------------------------------------------------------------

TEST(Cia402, StatuswordOfEveryState) {
  const std::pair<std::uint16_t, DriveMachine> cases[] = {
      {0x0000, DriveMachine::kNotReady},
      {0x0020, DriveMachine::kNotReady},
      {0x0040, DriveMachine::kSwitchOnDisabled},
      {0x0060, DriveMachine::kSwitchOnDisabled},
      {0x0250, DriveMachine::kSwitchOnDisabled},
      {0x0231, DriveMachine::kReadyToSwitchOn},
      {0x0233, DriveMachine::kSwitchedOn},
      {0x1237, DriveMachine::kOperationEnabled},
      {0x8EB7, DriveMachine::kOperationEnabled},
      {0x0017, DriveMachine::kQuickStopActive},
      {0x000F, DriveMachine::kFaultReactionActive},
      {0x002F, DriveMachine::kFaultReactionActive},
      {0x0208, DriveMachine::kFault},
      {0x0028, DriveMachine::kFault},
  };
  for (const auto& [word, state] : cases) EXPECT_EQ(DecodeStatusword(word), state) << std::hex << word;
  for (int i = 0; i < kDriveMachineStates; ++i) {
    EXPECT_EQ(DecodeStatusword(EncodeState(static_cast<DriveMachine>(i))), static_cast<DriveMachine>(i));
  }
  EXPECT_EQ(EncodeState(DriveMachine::kOperationEnabled), 0x27);
}

TEST(Cia402, ControlwordsAsTheMasksSay) {
  // mask/value of the standard, over every controlword without the fault reset bit
  for (int w = 0; w < 0x80; ++w) {
    const auto word = static_cast<std::uint16_t>(w);
    DriveCommand expected = DriveCommand::kNone;
    if ((w & 0x87) == 0x06) expected = DriveCommand::kShutdown;
    if ((w & 0x8F) == 0x07) expected = DriveCommand::kSwitchOn;  // and disable operation
    if ((w & 0x8F) == 0x0F) expected = DriveCommand::kEnableOperation;
    if ((w & 0x82) == 0x00) expected = DriveCommand::kDisableVoltage;
    if ((w & 0x86) == 0x02) expected = DriveCommand::kQuickStop;
    EXPECT_EQ(DecodeControlword(word, 0), expected) << std::hex << w;
  }
  EXPECT_EQ(DecodeControlword(0x80, 0x00), DriveCommand::kFaultReset);
  EXPECT_EQ(DecodeControlword(0x8F, 0x0F), DriveCommand::kFaultReset);
  EXPECT_EQ(DecodeControlword(0x80, 0x80), DriveCommand::kNone) << "an edge, not a level";
}

TEST(Cia402, WalkingUpPassesEveryStateInTurn) {
  DriveMachine state = DriveMachine::kSwitchOnDisabled;
  std::vector<DriveMachine> passed;
  for (int i = 0; i < 3; ++i) {
    state = Apply(state, DecodeControlword(ControlwordTowardsEnabled(state), 0));
    passed.push_back(state);
  }
  EXPECT_THAT(passed, ElementsAre(DriveMachine::kReadyToSwitchOn, DriveMachine::kSwitchedOn,
                                  DriveMachine::kOperationEnabled));
  EXPECT_EQ(Apply(state, DecodeControlword(ControlwordTowardsEnabled(state), 0)),
            DriveMachine::kOperationEnabled);
  for (DriveMachine stuck : {DriveMachine::kNotReady, DriveMachine::kQuickStopActive,
                             DriveMachine::kFaultReactionActive, DriveMachine::kFault}) {
    EXPECT_EQ(ControlwordTowardsEnabled(stuck), 0x0000);
  }
}

TEST(Cia402, DisableVoltageCutsThePowerFromEveryState) {
  for (int i = 0; i < kDriveMachineStates; ++i) {
    const DriveMachine after = Apply(static_cast<DriveMachine>(i), DriveCommand::kDisableVoltage);
    EXPECT_NE(after, DriveMachine::kOperationEnabled);
    EXPECT_NE(after, DriveMachine::kSwitchedOn);
  }
  EXPECT_EQ(Apply(DriveMachine::kFault, DriveCommand::kEnableOperation), DriveMachine::kFault);
  EXPECT_EQ(Apply(DriveMachine::kSwitchOnDisabled, DriveCommand::kEnableOperation),
            DriveMachine::kSwitchOnDisabled);
}

// ---- EMCY ---------------------------------------------------------------------------------------

const EmcyInfo& Find(std::uint16_t code) { return FindEmcy(Epos4Profile()->emcy, code); }

TEST(Emcy, CodesRegisterAndReaction) {
  using R = EmcyReaction;
  const std::tuple<std::uint16_t, int, R> cases[] = {
      {0x1000, 0x01, R::kDisable},
      {0x1085, 0x01, R::kDisable},
      {0x2310, 0x02, R::kDisable},
      {0x3220, 0x04, R::kDisable},
      {0x5113, 0x04, R::kDisable},
      {0x4210, 0x08, R::kDisable},
      {0x4380, 0x08, R::kDisable},
      {0x7320, 0x20, R::kDisable},
      {0x7391, 0x20, R::kDisable},
      {0x6320, 0x01, R::kFaultOption},
      {0x8611, 0x80, R::kFaultOption},
      {0x8130, 0x10, R::kAbortConnection},
      {0x81FD, 0x10, R::kAbortConnection},
      {0x8250, 0x10, R::kAbortConnection},
      {0x8A88, 0x01, R::kDisable},
      {0x61A0, 0x01, R::kDisable},
      {0x0000, 0x00, R::kNone},
  };
  for (const auto& [code, bit, reaction] : cases) {
    EXPECT_EQ(Find(code).register_bit, bit) << std::hex << code;
    EXPECT_EQ(Find(code).reaction, reaction) << std::hex << code;
    EXPECT_THAT(Find(code).text, ::testing::Not(HasSubstr("not in the drive's list")));
  }
  for (int code = 0; code <= 0xFFFF; ++code) {
    const EmcyInfo& info = Find(static_cast<std::uint16_t>(code));
    ASSERT_STRNE(info.text, "");
    ASSERT_TRUE(code >= info.first && code <= info.last);
  }
  EXPECT_THAT(Find(0x2345).text, HasSubstr("not in the drive's list"));
}

// ---- PDO ----------------------------------------------------------------------------------------

const ObjectTable& Objects() { return Epos4Profile()->objects; }

const DrivePdos& Pdos() { return Epos4Profile()->pdos; }

std::span<const MappingEntry> Entries(const PdoLayout& pdo) {
  return {pdo.entries.data(), static_cast<std::size_t>(pdo.count)};
}

TEST(Pdo, BytesOfOurThree) {
  std::array<std::uint8_t, 8> data{};
  EXPECT_EQ(EncodePdo(Entries(Pdos().torque), std::array<std::int64_t, 2>{0x000F, -250}, data), 4);
  EXPECT_THAT(data, ElementsAre(0x0F, 0x00, 0x06, 0xFF, 0, 0, 0, 0));
  const std::array<std::uint8_t, 8> feedback{0xFF, 0xFF, 0xFF, 0x7F, 0x00, 0x80, 0x88, 0x13};
  PdoValues values{};
  ASSERT_TRUE(DecodePdo(Entries(Pdos().feedback), feedback, values));
  EXPECT_EQ(values[0], 0x7FFFFFFF);
  EXPECT_EQ(values[1], -32768);
  EXPECT_EQ(values[2], 5000);
  EXPECT_FALSE(DecodePdo(Entries(Pdos().feedback), std::span(feedback).first(7), values));
  EXPECT_EQ(Pdos().torque.bytes(), 4);
  EXPECT_EQ(Pdos().feedback.bytes(), 8);
  EXPECT_EQ(Pdos().status.bytes(), 2);
}

TEST(Pdo, WhatWeMapIsMappableAsWideAndAsSigned) {
  for (const PdoLayout* pdo : {&Pdos().torque, &Pdos().feedback, &Pdos().status}) {
    for (const MappingEntry& entry : Entries(*pdo)) {
      const ObjectEntry* object = Objects().Find({entry.index, entry.sub});
      ASSERT_NE(object, nullptr) << std::hex << entry.index;
      EXPECT_EQ(8 * TypeBytes(object->type), entry.bits) << std::hex << entry.index;
      EXPECT_EQ(TypeSigned(object->type), entry.is_signed) << std::hex << entry.index;
      const Mapping way = pdo->transmit ? Mapping::kTransmit : Mapping::kReceive;
      EXPECT_TRUE(object->mapping == way || object->mapping == Mapping::kBoth) << std::hex << entry.index;
    }
  }
}

// ---- object table -------------------------------------------------------------------------------

TEST(ObjectTable, IsSortedUniqueAndWithinItsOwnRanges) {
  const auto table = Objects().entries();
  for (std::size_t i = 0; i < table.size(); ++i) {
    const ObjectEntry& entry = table[i];
    EXPECT_EQ(Objects().Find(entry.address()), &entry);
    EXPECT_TRUE(Objects().HasIndex(entry.index));
    EXPECT_LE(entry.min, entry.max) << std::hex << entry.index;
    if (i > 0) {
      EXPECT_LT(std::pair(table[i - 1].index, table[i - 1].sub), std::pair(entry.index, entry.sub));
    }
    // "save" and "load" read as abilities; their range is that of the type.
    if (entry.plus_node_id) continue;
    EXPECT_GE(entry.default_value, entry.min) << std::hex << entry.index << ":" << int{entry.sub};
    EXPECT_LE(entry.default_value, entry.max) << std::hex << entry.index << ":" << int{entry.sub};
  }
  EXPECT_EQ(Objects().Find({0x6072, 0}), nullptr) << "the drive has no max torque";
  EXPECT_EQ(Objects().Find({0x1018, 5}), nullptr);
}

TEST(ObjectTable, RatedTorqueAsRealDrivesShowIt) {
  EXPECT_EQ(RatedTorque_uNm(4760, 107746), 512871u);
  EXPECT_EQ(RatedTorque_uNm(6000, 34619), 207714u);
  EXPECT_EQ(RatedTorque_uNm(360, 19600), 7056u);
  EXPECT_EQ(RatedTorque_uNm(1500, 0), 0u);
}

TEST(ObjectTable, TheDataSheetInTheTreeIsMadeOfIt) {
  const std::string path = std::string(TENDRIL_SOURCE_DIR) + "/config/tendril_drive.eds";
  std::ifstream file(path);
  std::stringstream text;
  text << file.rdbuf();
  EXPECT_TRUE(text.str() == EdsText()) << path
                                       << " differs from the object table; to write it anew: cmake "
                                          "--build <build directory> --target write_eds";
}

// ---- bus budget ---------------------------------------------------------------------------------

BusParameters Bus(int drives, TimeNs cycle_ns) {
  BusParameters bus;
  bus.bitrate_bps = 1'000'000;
  bus.cycle_ns = cycle_ns;
  bus.heartbeat_ms = 100;
  bus.max_load = 0.8;
  bus.nodes.resize(static_cast<std::size_t>(drives));
  return bus;
}

std::vector<DriveSetup> Drives(int count) { return std::vector<DriveSetup>(static_cast<std::size_t>(count)); }

BusBudget Budget(int drives, TimeNs cycle_ns) {
  return ComputeBusBudget(Bus(drives, cycle_ns), Drives(drives));
}

TEST(BusBudget, FrameLengths) {
  const int expected[] = {55, 65, 75, 85, 95, 105, 115, 125, 135};
  for (int n = 0; n <= 8; ++n) EXPECT_EQ(can::WorstCaseBits(n), expected[n]);
  EXPECT_EQ(can::WorstCaseBits(Pdos().torque.bytes()) + can::WorstCaseBits(Pdos().feedback.bytes()), 230);
}

TEST(BusBudget, ThreeDrivesAtOneKilohertz) {
  const BusBudget budget = Budget(3, kNsPerMs);
  // By hand: 1000 (55 + 3 x 230) cyclic; 3 x 100 x 75 statuswords; 4 x 10 x 65 heartbeats; 50 x 270 SDO.
  EXPECT_DOUBLE_EQ(budget.cyclic_bits_per_s, 745'000);
  EXPECT_DOUBLE_EQ(budget.other_bits_per_s, 22'500 + 2'600 + 13'500);
  EXPECT_NEAR(budget.load, 0.7836, 1e-9);
  EXPECT_EQ(budget.feedback_ns, 595'000) << "55 + 3 x 135 + 135 bits";
  EXPECT_EQ(budget.torques_ns, 285'000) << "3 x 95 bits";
  EXPECT_EQ(budget.max_drives_at_this_cycle, 3);
  EXPECT_EQ(budget.min_cycle_ns_for_these_drives, kNsPerMs);
}

TEST(BusBudget, WhatFits) {
  EXPECT_EQ(Budget(4, kNsPerMs).max_drives_at_this_cycle, 3);
  EXPECT_EQ(Budget(4, kNsPerMs).min_cycle_ns_for_these_drives, 2 * kNsPerMs);
  EXPECT_GT(Budget(4, kNsPerMs).load, 0.8);
  EXPECT_EQ(Budget(1, 2 * kNsPerMs).max_drives_at_this_cycle, 6);
  EXPECT_LE(Budget(6, 2 * kNsPerMs).load, 0.8);
  EXPECT_GT(Budget(7, 2 * kNsPerMs).load, 0.8);
  EXPECT_EQ(Budget(12, 2 * kNsPerMs).min_cycle_ns_for_these_drives, 5 * kNsPerMs)
      << "at 4 ms by hand: 250 (55 + 12 x 230) + 90 000 + 8450 + 3375 = 805 575 bit/s";
  BusParameters slow = Bus(3, kNsPerMs);
  slow.bitrate_bps = 10'000;
  EXPECT_EQ(ComputeBusBudget(slow, Drives(3)).max_drives_at_this_cycle, 0);
  EXPECT_EQ(ComputeBusBudget(slow, Drives(3)).min_cycle_ns_for_these_drives, 0)
      << "statuswords alone fill it";
  EXPECT_THAT(Budget(3, kNsPerMs).ToString(),
              HasSubstr("78.4 % (745000 bit/s cyclic, 38600 bit/s other); at most 3 drives fit this cycle"));
}

TEST(BusBudget, TheFeedbackDeadlineLeavesTimeForFeedbackAndForTorques) {
  const auto problem = [](int drives, TimeNs cycle_ns, TimeNs deadline_ns) {
    BusParameters bus = Bus(drives, cycle_ns);
    bus.feedback_deadline_ns = deadline_ns;
    return FeedbackDeadlineProblem(bus, Drives(drives));
  };
  EXPECT_EQ(problem(3, kNsPerMs, 595'000), "");
  EXPECT_EQ(problem(3, kNsPerMs, 715'000), "");
  EXPECT_EQ(problem(3, kNsPerMs, 594'999),
            "594999 is too early: at 1000000 bit/s the feedback of 3 drives can take 595000 ns after SYNC; "
            "accepted: "
            "595000 .. 715000; raise it");
  EXPECT_EQ(problem(3, kNsPerMs, 715'001),
            "715001 is too late: at 1000000 bit/s the torques of 3 drives can take 285000 ns, before the "
            "next SYNC; "
            "accepted: 595000 .. 715000; lower it");
  EXPECT_THAT(problem(6, kNsPerMs, 600'000), HasSubstr("accepted: a cycle_ns of 1570000 or more"));
}

}  // namespace
}  // namespace tendril::canopen
