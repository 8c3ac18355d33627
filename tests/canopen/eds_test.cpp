// What a maker's data sheet says: read whole, refused by line, and what it makes of a generic drive. The
// sheets are the shipped ones, changed a line at a time.
#include "tendril/canopen/eds.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "support/test_bus.h"
#include "tendril/canopen/drive_profile.h"
#include "tendril/canopen/epos4.h"

namespace tendril::canopen {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

const std::string kServo = TENDRIL_SOURCE_DIR "/config/drives/cia402_servo.eds";

std::string Text(const std::string& path) {
  std::ifstream file(path);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

/// The servo's sheet with the first `from` made `to`.
std::string Changed(const std::string& from, const std::string& to) {
  std::string text = Text(kServo);
  const std::size_t at = text.find(from);
  EXPECT_NE(at, text.npos) << from;
  return at == text.npos ? text : text.replace(at, from.size(), to);
}

/// The same within the section of an object.
std::string ChangedIn(const std::string& section, const std::string& from, const std::string& to) {
  std::string text = Text(kServo);
  const std::size_t begin = text.find("[" + section + "]\n");
  const std::size_t at = text.find(from, begin);
  EXPECT_NE(begin, text.npos) << section;
  EXPECT_LT(at, text.find("\n[", begin)) << from;
  return text.replace(at, from.size(), to);
}

std::string Refusal(const std::string& text) {
  try {
    ParseEds(text, "servo.eds");
  } catch (const std::invalid_argument& e) {
    return e.what();
  }
  return "";
}

TEST(Eds, TheEpos4sOwnSheetGivesItsTableBack) {
  const Eds eds = ParseEds(EdsText(), "own.eds");
  const auto expected = Epos4Profile()->objects.entries();
  ASSERT_EQ(eds.objects.entries().size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) {
    const ObjectEntry &a = eds.objects.entries()[i], &b = expected[i];
    SCOPED_TRACE(testing::Message() << std::hex << b.index << ":" << int{b.sub});
    EXPECT_EQ(a.address(), b.address());
    EXPECT_EQ(a.type, b.type);
    EXPECT_EQ(a.access, b.access);
    EXPECT_EQ(a.mapping, b.mapping);
    EXPECT_EQ(a.plus_node_id, b.plus_node_id);
    EXPECT_EQ(a.default_value, b.default_value);
    EXPECT_EQ(a.min, b.min);
    EXPECT_EQ(a.max, b.max);
  }
}

TEST(Eds, NumbersTypesAndAccess) {
  const Eds eds = ParseEds(Text(kServo), "servo.eds");
  EXPECT_EQ(eds.vendor, 0xFA0u);
  EXPECT_EQ(eds.product, 0x00480010u);
  EXPECT_EQ(eds.product_name, "CST-48-10");
  const auto at = [&eds](std::uint16_t index, std::uint8_t sub) { return *eds.objects.Find({index, sub}); };
  EXPECT_EQ(at(0x1800, 1).default_value, 0x40000180);
  EXPECT_TRUE(at(0x1800, 1).plus_node_id);
  EXPECT_EQ(at(0x6071, 0).type, DataType::kI16);
  EXPECT_EQ(at(0x6071, 0).mapping, Mapping::kReceive);
  EXPECT_EQ(at(0x6064, 0).mapping, Mapping::kTransmit);
  EXPECT_FALSE(at(0x6064, 0).states_default);
  EXPECT_EQ(at(0x60C2, 2).default_value, -3);
  EXPECT_EQ(at(0x60C2, 2).min, -6);
  EXPECT_EQ(at(0x6502, 0).access, Access::kReadOnly);
  EXPECT_STREQ(at(0x1008, 0).text, "CST-48-10");
  EXPECT_EQ(eds.objects.Find({0x1A00, 9}), nullptr);
  EXPECT_EQ(eds.objects.Find({0x60C2, 3}), nullptr) << "a record has its sub-indices only";
}

TEST(Eds, EveryWayOfWritingTheSame) {
  const std::string cases[][2] = {
      {"DefaultValue=$NODEID+0x40000180", "defaultvalue = 0x40000180+$nodeid ; TPDO 1"},
      {"DefaultValue=$NODEID+0x40000180", "DefaultValue=1073742208 + $NODEID"},
      {"DefaultValue=-3", "DefaultValue=0xFD"},
      {"DefaultValue=0x00020192", "DefaultValue=131474"},
      {"DefaultValue=0x00020192", "DefaultValue=0400622"},  // octal
      {"[6064]", "[6064] ; the encoder"},
      {"; A servo", "\xEF\xBB\xBF; A s\xE4rvo"},  // a byte order mark, and a byte of Latin-1
      {"[DummyUsage]", "[Maker's own]\nWhat ever=it says\n[DummyUsage]"},
      {"PDOMapping=0", "PDOMapping=0\nObjFlags=0x1"},
  };
  const Eds plain = ParseEds(Text(kServo), "servo.eds");
  const auto same = [&plain](const std::string& text, const std::string& what) {
    const Eds eds = ParseEds(text, "servo.eds");
    ASSERT_EQ(eds.objects.entries().size(), plain.objects.entries().size()) << what;
    for (std::size_t i = 0; i < plain.objects.entries().size(); ++i) {
      const ObjectEntry &a = eds.objects.entries()[i], &b = plain.objects.entries()[i];
      EXPECT_TRUE(a.address() == b.address() && a.default_value == b.default_value && a.min == b.min &&
                  a.plus_node_id == b.plus_node_id && a.mapping == b.mapping)
          << what << ": " << std::hex << b.index;
    }
  };
  for (const auto& [from, to] : cases) same(Changed(from, to), to);
  std::string windows;
  for (const char c : Text(kServo)) windows += c == '\n' ? std::string("\r\n") : std::string(1, c);
  same(windows, "CR LF");
}

TEST(Eds, CompactSubIndicesAndTypesThatNobodyNeeds) {
  const Eds eds = ParseEds(
      "[DeviceInfo]\n[MandatoryObjects]\nSupportedObjects=1\n1=0x2010\n"
      "[2010]\nParameterName=Table\nObjectType=0x8\nDataType=0x0006\nAccessType=rw\nDefaultValue=7\n"
      "PDOMapping=0\nCompactSubObj=3\n[2010Value]\nNrOfEntries=1\n2=0x11\n"
      "[2011]\nParameterName=Program\nObjectType=0x2\nDataType=0x000F\nAccessType=wo\n"
      "[2012]\nParameterName=Gain\nDataType=0x0008\nAccessType=rw\nDefaultValue=0.25\nLowLimit=-1.5\n",
      "small.eds");
  EXPECT_EQ(eds.objects.Find({0x2010, 0})->default_value, 3);
  EXPECT_EQ(eds.objects.Find({0x2010, 1})->default_value, 7);
  EXPECT_EQ(eds.objects.Find({0x2010, 2})->default_value, 0x11);
  EXPECT_EQ(eds.objects.Find({0x2010, 4}), nullptr);
  EXPECT_EQ(eds.objects.Find({0x2011, 0})->type, DataType::kOther);
  EXPECT_EQ(eds.objects.Find({0x2012, 0})->type, DataType::kOther);
}

TEST(Eds, RefusesInOneLineWithFileAndLine) {
  const auto line_of = [](const std::string& text, const std::string& what) {
    return "servo.eds:" +
           std::to_string(
               std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(text.find(what)), '\n') +
               1) +
           ": ";
  };
  const std::string cases[][4] = {
      // section, from, to, what is said
      {"6064", "DataType=0x0004", "DataType=0x00O4", "[6064] DataType is '0x00O4'; accepted: a whole number"},
      {"6064", "AccessType=ro", "AccessType=readonly", "accepted: ro, wo, rw, rwr, rww or const"},
      {"6064", "PDOMapping=1", "PDOMapping=yes", "[6064] PDOMapping is 'yes'"},
      {"60C2sub2", "DefaultValue=-3", "DefaultValue=-300", "accepted: -128 .. 127, its DataType's range"},
      {"60C2sub2", "LowLimit=-6", "LowLimit=5", "has a LowLimit above its HighLimit"},
      {"1016sub1", "DefaultValue=0", "DefaultValue=$NODE+1", "or $NODEID+NUMBER"},
      {"1016sub1", "DefaultValue=0", "DefaultValue=09", "accepted: a whole number"},
      {"6077", "ParameterName=Torque actual value", "Torque actual value", "neither a section nor KEY=VALUE"},
      {"6077", "DataType=0x0003", "DataType=0x0003\nDataType=0x0004", "DataType is in this section already"},
      {"6077", "DataType=0x0003\n", "", "[6077] has no DataType"},
      {"6077", "AccessType=ro\n", "", "[6077] has no AccessType"},
      {"6077", "[6077]", "[6077", "has no end"},
      {"6077", "[6077]", "[6064]", "section [6064] is in line"},
      {"6077", "[6077]", "[6078]", "lists 0x6077, which has no section"},
      {"1018", "[1018]", "[1019]", "[1018sub0] belongs to no object"},
      {"1018sub2", "[1018sub2]", "[1018sub01]", "object 0x1018:01 is in line"},
      {"OptionalObjects", "SupportedObjects=", "SupportedObjects=9", "lists no "},
  };
  for (const auto& [section, from, to, said] : cases) {
    const std::string text = ChangedIn(section, from, to);
    EXPECT_THAT(Refusal(text), AllOf(HasSubstr(said), StartsWith("servo.eds:"), HasSubstr("; accepted: "),
                                     ::testing::Not(HasSubstr("\n"))))
        << to;
    const bool same_line =
        !to.empty() && said.find("lists") == std::string::npos && said.find("belongs") == std::string::npos &&
        said.find("already") == std::string::npos && said.find("is in line") == std::string::npos &&
        said.find("above") == std::string::npos;
    if (same_line) {
      EXPECT_THAT(Refusal(text), StartsWith(line_of(text, to))) << to;
    }
  }
  EXPECT_THAT(Refusal("DataType=7\n"), StartsWith("servo.eds:1: 'DataType=7' is before the first section"));
  EXPECT_THAT(Refusal("[DeviceInfo]\n"), HasSubstr("no section [MandatoryObjects]"));
  EXPECT_THAT(Refusal("; nothing\n"), HasSubstr("no section [DeviceInfo]"));
  EXPECT_THAT(Refusal(std::string("[DeviceInfo]\n\0\1", 15)), HasSubstr("this is no text"));
  // Cut off anywhere it is refused, or still whole: never half a drive.
  const std::string whole = Text(kServo);
  for (std::size_t n = 0; n + 40 < whole.size(); n += 997) EXPECT_NE(Refusal(whole.substr(0, n)), "") << n;
}

// Few lines can stand for many objects.
TEST(Eds, ASheetOfMoreObjectsThanAnyDriveHasIsRefused) {
  std::string text = Text(kServo);
  for (int k = 0; k < 250; ++k) {
    std::stringstream index;
    index << std::hex << 0x3000 + k;
    text += "[" + index.str() +
            "]\nParameterName=many\nObjectType=0x8\nCompactSubObj=254\nDataType=7\nAccessType=ro\n"
            "PDOMapping=0\n";
  }
  EXPECT_THAT(Refusal(text), HasSubstr("more than 50000 objects; accepted: fewer"));
}

TEST(Eds, WhatIsNoFileIsRefusedByItsPath) {
  const auto refusal = [](const std::string& path) -> std::string {
    try {
      ReadEds(path);
    } catch (const std::invalid_argument& e) {
      return e.what();
    }
    return "";
  };
  const auto is = [](const std::string& path, const std::string& why) {
    return AllOf(StartsWith(path + ": "), HasSubstr(why), HasSubstr("; accepted: an EDS file"));
  };
  EXPECT_THAT(refusal("/no/such/file.eds"), is("/no/such/file.eds", "no such file"));
  EXPECT_THAT(refusal("/"), is("/", "is not an ordinary file"));
  EXPECT_THAT(refusal("/dev/zero"), is("/dev/zero", "is not an ordinary file"));
  const std::string empty = testing::TempDir() + "empty_" + std::to_string(getpid()) + ".eds";
  std::ofstream(empty).close();
  EXPECT_THAT(refusal(empty), is(empty, "is empty"));
  std::filesystem::remove(empty);
}

// ---- the generic drive of a sheet ---------------------------------------------------------------

class GenericDrive : public ::testing::Test {
 protected:
  void TearDown() override { std::filesystem::remove(path_); }

  /// Of the servo, or of its changed sheet; with its first analog input unless `analog` says otherwise.
  DriveSetup Setup(const std::string& sheet, const std::string& analog = "0x6401:01") {
    std::ofstream(path_) << sheet;
    DriveSetup setup = TestDrives(1)[0];
    NodeParameters node;
    node.node_id = 1;
    node.profile = DriveKind::kCia402;
    node.eds_file = path_;
    node.analog_input = analog;
    setup.profile = ProfileOf(node);
    return setup;
  }
  std::string Problem(const std::string& sheet, const std::string& analog = "0x6401:01",
                      const BusParameters& bus = TestBus(1)) {
    const std::string problem = Unsupported(bus, Setup(sheet, analog));
    if (!problem.empty()) {
      EXPECT_THAT(problem, StartsWith(path_ + ":"));
    }
    return problem;
  }
  /// Without an object: its section under another name, and off its list.
  static std::string Without(const std::string& object) {
    std::string text = ChangedIn(object, "[" + object + "]", "[X]");
    const std::size_t at = text.find("=0x" + object + "\n");
    return at == text.npos ? text : text.replace(at, 3 + object.size(), "=0x1000");
  }

  const std::string path_ = testing::TempDir() + "eds_test_" + std::to_string(getpid()) + ".eds";
};

TEST_F(GenericDrive, TheServoCanAllThatIsNeeded) {
  EXPECT_EQ(Problem(Text(kServo)), "");
  EXPECT_EQ(Problem(Text(kServo), ""), "");
  EXPECT_EQ(Unsupported(TestBus(1), TestDrives(1)[0]), "") << "as can the EPOS4";
}

TEST_F(GenericDrive, IsAskedForNoMakersObject) {
  const DriveSetup setup = Setup(Text(kServo));
  for (const BootAction& action : setup.profile->boot_script(*setup.profile, TestBus(1), setup)) {
    EXPECT_FALSE(action.address.index >= 0x2000 && action.address.index < 0x6000) << action.step;
  }
}

TEST_F(GenericDrive, WhatTheSheetSaysItCannotDoIsSaidByObject) {
  for (const char* object : {"6071", "6076", "6064", "6077", "6041", "6060", "6061", "6007", "1016sub1",
                             "1017", "1801sub1", "1A00sub3"}) {
    const std::string address = std::string("0x").append(object, 4) + ":" +
                                (std::string(object).size() == 4 ? "00" : "0") +
                                (std::string(object).size() == 4 ? "" : std::string(1, object[7]));
    EXPECT_THAT(Problem(Without(object)), AllOf(HasSubstr(address), HasSubstr("is not there"))) << object;
  }
  EXPECT_THAT(Problem(ChangedIn("6064", "PDOMapping=1", "PDOMapping=0")),
              HasSubstr("0x6064:00 cannot be mapped into TPDO 1"));
  EXPECT_THAT(Problem(ChangedIn("6071", "PDOMapping=1", "PDOMapping=0")),
              HasSubstr("0x6071:00 cannot be mapped into RPDO 1"));
  EXPECT_THAT(Problem(ChangedIn("6071", "DataType=0x0003", "DataType=0x0004")),
              HasSubstr("0x6071:00 has 32 bits with a sign, and must have 16 with a sign"));
  EXPECT_THAT(Problem(ChangedIn("6502", "0x000003A5", "0x000001A5")),
              HasSubstr("0x6502:00 is 0x1A5: no cyclic synchronous torque mode"));
  EXPECT_THAT(Problem(ChangedIn("6502", "0x000003A5", "0")), IsEmpty()) << "not stated";
  EXPECT_THAT(Problem(Without("6502")), IsEmpty()) << "not there";
  EXPECT_THAT(Problem(ChangedIn("1000", "0x00020192", "0x00020191")), HasSubstr("no CiA 402 drive"));
  EXPECT_THAT(Problem(ChangedIn("6060", "AccessType=rww", "AccessType=ro")),
              HasSubstr("0x6060:00 (mode) is read-only"));
  EXPECT_THAT(Problem(ChangedIn("6007", "HighLimit=3", "HighLimit=1")),
              HasSubstr("0x6007:00 (stop reactions) takes 0 .. 1, and must be 2"));
  EXPECT_THAT(Problem(ChangedIn("1A00sub0", "HighLimit=4", "HighLimit=2")),
              HasSubstr("0x1A00:00 (PDO mapping) takes 0 .. 2, and must be 3"));
  EXPECT_THAT(Problem(Text(kServo), "0x2200:01"), HasSubstr("0x2200:01 cannot be mapped into TPDO 1"));
  EXPECT_THAT(Problem(Text(kServo), "0x2201:01"),
              HasSubstr("0x2201:01, for TPDO 1, is not there (analog_input)"));
  EXPECT_THAT(Problem(Text(kServo), "0x606C:00"), HasSubstr("TPDO 1 would need 10 bytes"));
  for (const char* type : {"0x0008", "0x0015", "0x0009"}) {  // a real number, 64 bits, a string
    EXPECT_THAT(Problem(ChangedIn("6401sub1", "DataType=0x0003", std::string("DataType=") + type)),
                HasSubstr("0x6401:01 (PDO mapping) is no whole number of up to 32 bits"))
        << type;
  }
}

TEST_F(GenericDrive, OptionalObjectsAreWrittenWhereTheyAreThere) {
  const auto writes = [this](const std::string& sheet, std::uint16_t index) {
    const DriveSetup setup = Setup(sheet);
    std::vector<std::int64_t> values;
    for (const BootAction& action : setup.profile->boot_script(*setup.profile, TestBus(1), setup)) {
      if (action.kind == BootAction::Kind::kWrite && action.address.index == index)
        values.push_back(action.value);
    }
    return values;
  };
  using ::testing::ElementsAre;
  EXPECT_THAT(writes(Text(kServo), 0x605E), ElementsAre(0));
  EXPECT_THAT(writes(Without("605E"), 0x605E), IsEmpty());
  EXPECT_THAT(writes(ChangedIn("605E", "LowLimit=0", "LowLimit=1"), 0x605E), IsEmpty())
      << "not a value of its";
  EXPECT_THAT(writes(Text(kServo), 0x6072), ElementsAre(2000)) << "720 mA of 360, per mille";
  EXPECT_THAT(writes(Text(kServo), 0x60C2), ElementsAre(1, -3)) << "1 ms";
  EXPECT_THAT(writes(Text(kServo), 0x60B2), IsEmpty()) << "the servo has none";
}

TEST_F(GenericDrive, APdoWithoutInhibitTimeIsSentAtEverySyncAndCounted) {
  EXPECT_EQ(Setup(Text(kServo)).profile->pdos.status.transmission, 255);
  const DriveSetup bare = Setup(Without("1801sub3"));
  EXPECT_EQ(bare.profile->pdos.status.transmission, 1);
  const DriveSetup fixed = Setup(ChangedIn("1801sub3", "AccessType=rw", "AccessType=ro"));
  EXPECT_EQ(fixed.profile->pdos.status.transmission, 1) << "one that cannot be set";
  const std::vector<DriveSetup> drives = {bare};
  // By hand: 1000 (55 + 95 + 135 + 75) cyclic.
  EXPECT_DOUBLE_EQ(ComputeBusBudget(TestBus(1), drives).cyclic_bits_per_s, 360'000);
}

TEST_F(GenericDrive, TheBudgetOfAMixedBusIsThatOfItsOwnPdos) {
  std::vector<DriveSetup> drives = TestDrives(3);
  drives[2].profile = Setup(Text(kServo), "").profile;
  drives[1].profile = drives[2].profile;
  // By hand: 1000 (55 + 230 + 2 (95 + 115)) cyclic: without a load cell the feedback has 6 bytes.
  const BusBudget mixed = ComputeBusBudget(TestBus(3), drives);
  EXPECT_DOUBLE_EQ(mixed.cyclic_bits_per_s, 705'000);
  EXPECT_EQ(mixed.feedback_ns, 55'000 + 135'000 + 2 * 115'000 + 135'000);
  EXPECT_EQ(mixed.max_drives_at_this_cycle, 3) << "a fourth like the first does not fit";
}

TEST_F(GenericDrive, ASheetWithoutAVendorNamesNoDrive) {
  std::string text = Changed("VendorNumber=0x00000FA0", "VendorNumber=0");
  const std::size_t at = text.find("DefaultValue=0x00000FA0");
  text.replace(at, 23, "DefaultValue=0");
  EXPECT_THROW(Setup(text), std::invalid_argument);
  EXPECT_THAT(Problem(Without("1018sub1")), HasSubstr("0x1018:01 (identity) is not there"));
}

TEST(GenericEmergencies, EveryCodeHasATextAndTheStandardsReaction) {
  NodeParameters node;
  node.profile = DriveKind::kCia402;
  node.eds_file = kServo;
  const DriveProfilePtr profile = ProfileOf(node);
  for (int code = 0; code <= 0xFFFF; ++code) {
    const EmcyInfo& info = FindEmcy(profile->emcy, static_cast<std::uint16_t>(code));
    ASSERT_STRNE(info.text, "");
    ASSERT_TRUE(code >= info.first && code <= info.last);
  }
  EXPECT_EQ(FindEmcy(profile->emcy, 0x8130).reaction, EmcyReaction::kAbortConnection);
  EXPECT_THAT(FindEmcy(profile->emcy, 0xFF01).text, HasSubstr("the maker's code"));
}

}  // namespace
}  // namespace tendril::canopen
