// What the configuration refuses, and that each refusal is one line a person can act on: file, line, key,
// what is wrong, what is accepted. Every case edits a shipped file in one place.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <random>
#include <set>
#include <sstream>

#include "files.h"
#include "tendril/config/config.h"
#include "tendril/model/capstan.h"

namespace tendril::config {
namespace {

using ::testing::AnyOf;
using ::testing::ContainsRegex;
using ::testing::HasSubstr;
using ::testing::MatchesRegex;
using ::testing::Not;
using ::testing::StartsWith;

struct Case {
  const char* name;
  const char* file;               // the shipped file that is edited
  const char* from;               // its first occurrence ...
  const char* to;                 // ... is replaced by this
  const char* marker;             // the message names the line that first holds this, after the edit
  const char* key;                // full path of the key
  std::vector<const char*> says;  // and these
};

void PrintTo(const Case& c, std::ostream* os) { *os << c.name; }

void Parse(const std::string& file, const std::string& yaml) {
  if (file.starts_with("robots/")) {
    (void)ParseRobot(yaml, "some.yaml");
  } else {
    (void)ParseDaemon(yaml, "some.yaml");
  }
}

std::string MessageOf(const std::string& file, const std::string& yaml) {
  try {
    Parse(file, yaml);
  } catch (const ConfigError& e) {
    return e.what();
  }
  return "(accepted)";
}

class Refusal : public ::testing::TestWithParam<Case> {};

TEST_P(Refusal, IsOneLineThatHelps) {
  const Case& c = GetParam();
  const std::string yaml = Edited(ReadText(ConfigPath(c.file)), c.from, c.to);
  const std::string message = MessageOf(c.file, yaml);
  EXPECT_THAT(message,
              StartsWith("some.yaml:" + std::to_string(LineWith(yaml, c.marker)) + ": " + c.key + ": "));
  EXPECT_THAT(message, HasSubstr("; accepted: "));
  for (const char* part : c.says) EXPECT_THAT(message, HasSubstr(part));
  EXPECT_THAT(message, Not(HasSubstr("\n")));
}

constexpr const char* kRig = "robots/rig_60mm.yaml";
constexpr const char* kTwo = "robots/two_section.yaml";
constexpr const char* kDaemon = "tendrild.yaml";
constexpr const char* kPairs = "robots/pairs_90mm.yaml";

// clang-format off
const Case kCases[] = {
    // ---- pairs
    {"PairWithoutTendon", kPairs, "tendons: [2, 4]", "tendons: [2, 5]", "tendons: [2, 5]", "actuation.pairs[2].tendons",
     {"tendons 2 and 5 are a pair, and the robot has 4", "two of the tendons 1 .. 4"}},
    {"PairTwice", kPairs, "tendons: [2, 4]", "tendons: [1, 3]", "    - {tendons: [1, 3], pretension_N: 4.0}\n  motor",
     "actuation.pairs[2].tendons", {"one of tendons 1 and 3 is named twice"}},
    {"PairOfOne", kPairs, "tendons: [2, 4]", "tendons: [2, 2]", "tendons: [2, 2]", "actuation.pairs[2].tendons",
     {"one of tendons 2 and 2 is named twice"}},
    {"PairOfTwoSections", kTwo, "actuation:\n", "actuation:\n  pairs:\n    - {tendons: [1, 4], pretension_N: 1.0}\n",
     "tendons: [1, 4]", "actuation.pairs[1].tendons",
     {"tendons 1 and 4 belong to sections 1 and 2", "two tendons of one section"}},
    {"PairAcross", kPairs, "{angle_rad: 3.141592653589793,", "{angle_rad: 3.0,", "tendons: [1, 3]",
     "actuation.pairs[1].tendons", {"tendons 1 and 3 do not lie opposite each other", "180° apart within 3°"}},
    {"PairOfUnequalHoles", kPairs, "{angle_rad: 3.141592653589793, radius_m: 0.004}",
     "{angle_rad: 3.141592653589793, radius_m: 0.003}", "tendons: [1, 3]", "actuation.pairs[1].tendons",
     {"do not lie opposite each other", "same radius"}},
    {"PairWithoutPretension", kPairs, "tendons: [1, 3], pretension_N: 4.0", "tendons: [1, 3], pretension_N: 0.2",
     "tendons: [1, 3]", "actuation.pairs[1].pretension_N", {"0.2;", "above limits.min_tension_N, 0.3 N"}},
    {"PairBeyondItsMotor", kPairs, "max_tension_motor_N: 10.0", "max_tension_motor_N: 3.5", "tendons: [1, 3]",
     "actuation.pairs[1].pretension_N", {"4;", "max_tension_motor_N, 3.5 N"}},
    {"PairWithALoadCell", kPairs, "    place: none",
     "    place: motor_side\n    gain_VpN: 0.2\n    resolution_V: 0.001\n    noise_N: 0.005", "  pairs:  ",
     "actuation.pairs", {"one analog input for the two", "load_cell.place: none"}},
    {"PairOfThree", kPairs, "tendons: [2, 4]", "tendons: [2, 4, 1]", "tendons: [2, 4, 1]", "actuation.pairs[2].tendons",
     {"has 3 entries"}},
    {"PairWithTwoMotors", kPairs, "  tracker:", "  per_tendon:\n    3:\n      gear:\n        ratio: 20.0\n  tracker:",
     "  pairs:  ", "actuation.pairs", {"tendons 1 and 3 have one motor, drive, gear and spool"}},
    {"PairsNodes", kPairs, "  pairs:", "  nodes: [1, 2, 3, 4]\n  pairs:", "  nodes: [", "actuation.nodes",
     {"has 4 entries", "a list of 2"}},
    // ---- keys
    {"UnknownKey", kRig, "unit_length_m:", "unit_lenght_m:", "unit_lenght_m", "body.sections[1].unit_lenght_m",
     {"unknown key", "did you mean unit_length_m?"}},
    {"UnknownKeyAtTop", kRig, "name: rig_60mm", "name: rig_60mm\ncolour: blue", "colour", "colour",
     {"unknown key", "name, body, limits"}},
    {"WrongUnitInKey", kRig, "unit_length_m: 0.015 ", "unit_length_mm: 15 ", "unit_length_mm", "body.sections[1].unit_length_mm",
     {"millimetres", "unit_length_m in m", "write unit_length_m: 0.015"}},
    {"WrongUnitInKeyUnknownUnit", kRig, "nominal_current_A", "nominal_current_furlong", "furlong", "actuation.motor.nominal_current_furlong",
     {"furlong", "nominal_current_A in A"}},
    {"UnitMissingInKey", kRig, "free_length_m:", "free_length:", "free_length:", "actuation.tendon.free_length",
     {"the unit is missing", "free_length_m in m"}},
    {"MissingKey", kRig, "unit_mass_kg:", "# unit_mass_kg:", "- units", "body.sections[1].unit_mass_kg",
     {"missing", "1e-07 .. 10 kg", "add it below body.sections[1]"}},
    {"MisspeltBlock", kRig, "  gear:", "  geer:", "geer", "actuation.geer", {"did you mean gear?"}},
    {"MissingBlock", kRig, "  spool:\n    radius_m: 0.008\n", "", "actuation:", "actuation.spool", {"missing", "add it below actuation"}},
    {"MissingTopKey", kRig, "name: rig_60mm", "", "body:", "name", {"missing", "add it at the top level"}},
    {"DuplicateKey", kRig, "radius_m: 0.008", "radius_m: 0.008\n    radius_m: 0.009", "radius_m: 0.009", "actuation.spool.radius_m",
     {"given twice (first on line "}},
    {"DuplicateBlock", kRig, "limits:", "limits: {}\nlimits:", "limits:\n", "limits", {"given twice"}},
    {"MergeKey", kRig, "radius_m: 0.008", "<<: {radius_m: 0.008}\n    radius_m: 0.008", "<<:", "actuation.spool.<<", {"merge keys"}},
    {"KeyIsAList", kRig, "radius_m: 0.008", "[a, b]: 0.008", "[a, b]", "actuation.spool", {"a key is not a plain word"}},

    // ---- types
    {"TextForNumber", kRig, "unit_length_m: 0.015 ", "unit_length_m: short ", "short", "body.sections[1].unit_length_m",
     {"'short' is not a number", "0.0001 .. 1 m"}},
    {"UnitInValue", kRig, "unit_length_m: 0.015 ", "unit_length_m: 15 mm ", "15 mm", "body.sections[1].unit_length_m",
     {"'15 mm' is not a number", "the unit is in the key's name"}},
    {"DecimalComma", kRig, "unit_length_m: 0.015 ", "unit_length_m: 0,015 ", "0,015", "body.sections[1].unit_length_m",
     {"'0,015' is not a number", "decimal point"}},
    {"QuotedNumber", kRig, "unit_length_m: 0.015 ", "unit_length_m: \"0.015\" ", "\"0.015\"", "body.sections[1].unit_length_m",
     {"text in quotes"}},
    {"EffectsNotAList", kRig, "name: rig_60mm", "name: rig_60mm\neffects: backlash", "effects:", "effects", {"not a list"}},
    {"EffectWithoutName", kRig, "name: rig_60mm", "name: rig_60mm\neffects: [{rad: 0.1}]", "effects:", "effects[1].effect", {"missing"}},
    {"EffectNowhere", kRig, "name: rig_60mm", "name: rig_60mm\neffects:\n  - {effect: backlash, where: 'tendon:', rad: 0.1}", "- {effect",
     "effects[1].where", {"'tendon:' is not accepted", "tendon:2"}},
    {"EffectValueNotANumber", kRig, "name: rig_60mm", "name: rig_60mm\neffects:\n  - {effect: backlash, rad: much}", "- {effect",
     "effects[1].rad", {"'much' is not a number"}},
    {"NoValue", kRig, "unit_length_m: 0.015 ", "unit_length_m: ", "unit_length_m", "body.sections[1].unit_length_m",
     {"has no value", "0.0001 .. 1 m"}},
    {"ListForNumber", kRig, "unit_length_m: 0.015 ", "unit_length_m: [0.015] ", "unit_length_m", "body.sections[1].unit_length_m",
     {"a list, not a number"}},
    {"NumberForList", kRig, "gravity_W_mps2: [0.0, 0.0, -9.81]", "gravity_W_mps2: -9.81", "gravity_W", "body.gravity_W_mps2",
     {"not a list", "a list of 3 numbers", "m/s²"}},
    {"ShortList", kRig, "gravity_W_mps2: [0.0, 0.0, -9.81]", "gravity_W_mps2: [0.0, -9.81]", "gravity_W", "body.gravity_W_mps2",
     {"2 entries", "a list of 3 numbers"}},
    {"BadListElement", kRig, "gravity_W_mps2: [0.0, 0.0, -9.81]", "gravity_W_mps2: [0.0, 0.0, down]", "gravity_W", "body.gravity_W_mps2[3]",
     {"'down' is not a number"}},
    {"FractionForInteger", kRig, "units: 4 ", "units: 4.5 ", "units: 4.5", "body.sections[1].units",
     {"'4.5' is not a whole number", "1 .. 64"}},
    {"BudgetAboveTheRule", kDaemon, "max_load: 0.8", "max_load: 1.0", "max_load", "bus.max_load", {"out of range", "0.05 .. 0.8"}},
    {"OctalLookingInteger", kDaemon, "heartbeat_ms: 100", "heartbeat_ms: 0100", "0100", "bus.heartbeat_ms", {"'0100'"}},
    {"HugeInteger", kDaemon, "heartbeat_ms: 100", "heartbeat_ms: 99999999999999999999", "9999999", "bus.heartbeat_ms",
     {"out of range", "5 .. 10000 ms"}},
    {"MappingForNumber", kRig, "radius_m: 0.008", "radius_m: {a: 1}", "{a: 1}", "actuation.spool.radius_m", {"a mapping, not a number"}},
    {"NumberForMapping", kRig, "  spool:\n    radius_m: 0.008", "  spool: 0.008", "spool: 0.008", "actuation.spool", {"not a mapping"}},
    {"YesForTrue", kDaemon, "lock_memory: true", "lock_memory: yes", "lock_memory", "realtime.lock_memory",
     {"'yes' is neither true nor false"}},
    {"UnknownChoice", kRig, "law: cumulative", "law: euler", "law: euler", "actuation.transmission.pulleys[1].law",
     {"'euler'", "cumulative, local, classic"}},
    {"BadUrl", kDaemon, "udpm://239", "http://239", "http://", "lcm.url", {"udpm://239.255.76.67:7667?ttl=0"}},
    {"UrlOfOneComputer", kDaemon, "udpm://239.255.76.67", "udpm://192.168.1.5", "udpm://", "lcm.url", {"a multicast address (224.0.0.0 to 239.255.255.255)"}},
    {"UrlWithoutAddress", kDaemon, "udpm://239.255.76.67:7667", "udpm://", "udpm://", "lcm.url", {"a multicast address"}},
    {"UrlWithoutPort", kDaemon, "76.67:7667", "76.67", "udpm://", "lcm.url", {"a port from 1 to 65535"}},
    {"UrlWithPortZero", kDaemon, "76.67:7667", "76.67:0", "udpm://", "lcm.url", {"a port from 1 to 65535"}},
    {"UrlWithFiveNumbers", kDaemon, "239.255.76.67", "239.255.76.67.1", "udpm://", "lcm.url", {"a multicast address"}},
    {"UrlTtl", kDaemon, "ttl=0", "ttl=300", "ttl=300", "lcm.url", {"a ttl from 0 (this computer) to 255"}},
    {"UrlTtlNegative", kDaemon, "ttl=0", "ttl=-1", "ttl=-1", "lcm.url", {"a ttl from 0"}},
    {"UrlUnknownOption", kDaemon, "ttl=0", "tll=0", "tll=0", "lcm.url", {"?ttl=N"}},
    {"BadInterface", kDaemon, "interface: can0", "interface: /dev/can0", "/dev/can0", "bus.interface", {"can0"}},

    // ---- values
    {"NotANumber", kRig, "unit_length_m: 0.015 ", "unit_length_m: .nan ", ".nan", "body.sections[1].unit_length_m", {"not finite"}},
    {"Infinite", kRig, "unit_length_m: 0.015 ", "unit_length_m: -.Inf ", "-.Inf", "body.sections[1].unit_length_m", {"not finite"}},
    {"TooLargeForDouble", kRig, "unit_length_m: 0.015 ", "unit_length_m: 1e999 ", "1e999", "body.sections[1].unit_length_m", {"double"}},
    {"Millimetres", kRig, "unit_length_m: 0.015 ", "unit_length_m: 22.5 ", "22.5", "body.sections[1].unit_length_m",
     {"out of range", "0.0001 .. 1 m", "looks like millimetres: write 0.0225"}},
    {"Gigapascals", kRig, "2.3e10", "23", "youngs", "body.sections[1].youngs_modulus_Pa", {"1000000 .. 1000000000000 Pa", "gigapascals: write 2.3e+10"}},
    {"Degrees", kRig, "angle_rad: 2.0943951023931953", "angle_rad: 120", "120,", "body.sections[1].tendons[2].angle_rad",
     {"looks like degrees: write 2.094395102"}},
    {"Milliamperes", kRig, "current_limit_A: 0.360", "current_limit_A: 360", "current_limit_A", "actuation.drive.current_limit_A",
     {"looks like milliamperes: write 0.36"}},
    {"NegativeMass", kRig, "unit_mass_kg: 0.0025", "unit_mass_kg: -0.0025", "unit_mass", "body.sections[1].unit_mass_kg", {"1e-07 .. 10 kg"}},
    {"GearBetterThanPerfect", kRig, "efficiency: 0.84", "efficiency: 1.01", "1.01", "actuation.gear.efficiency", {"above 0 up to 1"}},
    {"GearOfNoUse", kRig, "efficiency: 0.84", "efficiency: 0", "efficiency", "actuation.gear.efficiency", {"above 0 up to 1"}},
    {"ExponentAboveOne", kRig, "exponent: 0.67", "exponent: 1.5", "exponent: 1.5", "actuation.transmission.pulleys[1].exponent", {"0.05 .. 1"}},
    {"ExponentZero", kRig, "exponent: 0.67", "exponent: 0", "exponent: 0", "actuation.transmission.pulleys[1].exponent", {"0.05 .. 1"}},
    {"NodeIdZero", kDaemon, "node_id: 1,", "node_id: 0,", "node_id: 0", "bus.nodes[1].node_id", {"1 .. 126"}},
    {"NodeIdOfTheMaster", kDaemon, "node_id: 3,", "node_id: 127,", "node_id: 127", "bus.nodes[3].node_id", {"1 .. 126"}},
    {"UnknownProfile", kDaemon, "{node_id: 2, tendon: 2}", "{node_id: 2, tendon: 2, profile: cia401}", "cia401", "bus.nodes[2].profile", {"accepted: epos4, cia402"}},
    {"GenericDriveWithoutEds", kDaemon, "{node_id: 2, tendon: 2}", "{node_id: 2, tendon: 2, profile: cia402}", "cia402", "bus.nodes[2].profile", {"cia402 without the drive's objects", "eds: FILE beside it"}},
    {"EdsOfAnEpos4", kDaemon, "{node_id: 2, tendon: 2}", "{node_id: 2, tendon: 2, eds: a.eds}", "a.eds", "bus.nodes[2].eds", {"profile: cia402 beside it"}},
    {"AnalogInputOfAnEpos4", kDaemon, "{node_id: 2, tendon: 2}", "{node_id: 2, tendon: 2, analog_input: 0x6401:01}", "0x6401:01", "bus.nodes[2].analog_input", {"whose load cell is at 0x3160:01"}},
    {"AnalogInputThatIsNone", kDaemon, "{node_id: 2, tendon: 2}", "{node_id: 2, tendon: 2, profile: cia402, eds: a.eds, analog_input: 0x6401}", "a.eds", "bus.nodes[2].analog_input", {"an object's index and sub-index, e.g. 0x6401:01"}},
    {"ScaleWithoutAnalogInput", kDaemon, "{node_id: 2, tendon: 2}", "{node_id: 2, tendon: 2, profile: cia402, eds: a.eds, analog_mV_per_count: 2.5}", "a.eds", "bus.nodes[2].analog_mV_per_count", {"analog_input beside it"}},
    {"CycleInMilliseconds", kDaemon, "cycle_ns: 1000000", "cycle_ns: 1", "cycle_ns: 1", "bus.cycle_ns", {"looks like milliseconds: write 1000000"}},
    {"HeartbeatInMicroseconds", kDaemon, "heartbeat_ms: 100 ", "heartbeat_ms: 65535 ", "heartbeat_ms: 65535", "bus.heartbeat_ms", {"5 .. 10000 ms", "looks like microseconds: write 66"}},

    // ---- rules between keys
    {"NoTendon", kRig, "      tendons:  ", "      tendons: []\n      other:  ", "tendons:", "body.sections[1].tendons",
     {"0 entries", "1 .. 16"}},
    {"TooManyUnits", kTwo, "units: 4 ", "units: 61 ", "sections:", "body.sections", {"65 units", "up to 64"}},
    {"SameHole", kTwo, "- {angle_rad: 1.0471975511965976", "- {angle_rad: 0.0, radius_m: 0.004}\n        - {angle_rad: 1.0471975511965976", "sections:", "body.sections", {"tendons 1 and 4", "same hole"}},
    {"NoSection", kRig, "  sections:\n", "  sections: []\n  other:\n", "sections:", "body.sections", {"0 entries", "1 .. 4"}},
    {"MinAboveMax", kRig, "max_tension_base_N: 8.0", "max_tension_base_N: 0.2", "max_tension_base_N", "limits.max_tension_base_N", {"above min_tension_N, 0.3 N"}},
    {"MinAboveMotorMax", kRig, "max_tension_motor_N: 10.0", "max_tension_motor_N: 0.3", "max_tension_motor_N", "limits.max_tension_motor_N",
     {"above min_tension_N, 0.3 N"}},
    {"DisksTouch", kRig, "radius_m: 0.004}", "radius_m: 0.030}", "disk_diameter_m", "body.sections[1].disk_diameter_m", {"above 0.06 m"}},
    {"BendingFoldsDisks", "robots/qi2021_60mm.yaml", "unit_length_m: 0.015 ", "unit_length_m: 0.0025 ", "max_bending_rad: 2.6", "limits.max_bending_rad",
     {"section 1 touch", "below 2.5 rad"}},
    {"CoreWiderThanHole", kRig, "core_radius_m: 0.0005", "core_radius_m: 0.004", "core_radius_m", "body.sections[1].core_radius_m", {"less than 0.004 m"}},
    {"BothInertias", kRig, "disk_diameter_m: 0.010 ", "disk_diameter_m: 0.010\n      disk_inertia_xx_kgm2: 1.0e-8 ", "disk_inertia_xx_kgm2",
     "body.sections[1].disk_inertia_xx_kgm2", {"either disk_diameter_m, or disk_inertia_xx_kgm2"}},
    {"OneInertiaOnly", kRig, "disk_diameter_m: 0.010 ", "disk_inertia_xx_kgm2: 1.0e-8 ", "- units", "body.sections[1].disk_inertia_zz_kgm2", {"missing"}},
    {"NeitherInertia", kRig, "disk_diameter_m: 0.010 ", "", "- units", "body.sections[1].disk_inertia_xx_kgm2", {"missing"}},
    {"ImpossibleInertia", kRig, "disk_diameter_m: 0.010 ", "disk_inertia_xx_kgm2: 1.0e-8\n      disk_inertia_zz_kgm2: 2.1e-8 ", "disk_inertia_zz",
     "body.sections[1].disk_inertia_zz_kgm2", {"up to 2e-08 kg·m²"}},
    {"RatedTorque", kRig, "rated_torque_Nm: 0.007056", "rated_torque_Nm: 0.0072", "rated_torque_Nm", "actuation.drive.rated_torque_Nm",
     {"0.00698544 .. 0.00712656 N·m", "1 %"}},
    {"LoadCellSaturates", kRig, "gain_VpN: 0.2", "gain_VpN: 2.0", "gain_VpN", "actuation.load_cell.gain_VpN", {"20 V", "up to 1 V/N"}},
    {"LowTensionAbovePretension", kRig, "low_tension_N: 0.05", "low_tension_N: 0.5", "low_tension_N", "actuation.transmission.low_tension_N", {"up to 0.3 N"}},
    {"SameNodeTwiceInRobot", kRig, "\nactuation:", "\nactuation:\n  nodes: [1, 2, 2]", "nodes: [1", "actuation.nodes", {"node 2 twice"}},
    {"TooFewNodesInRobot", kRig, "\nactuation:", "\nactuation:\n  nodes: [1, 2]", "nodes: [1", "actuation.nodes", {"2 entries", "a list of 3"}},
    {"SameNodeTwice", kDaemon, "node_id: 2", "node_id: 1", "nodes:", "bus.nodes", {"node_id 1 twice"}},
    {"SameTendonTwice", kDaemon, "tendon: 2", "tendon: 1", "nodes:", "bus.nodes", {"tendon 1 twice"}},
    {"BitRate", kDaemon, "bitrate_bps: 1000000", "bitrate_bps: 300000", "bitrate_bps", "bus.bitrate_bps", {"125000, 250000, 500000, 800000, 1000000"}},
    {"DeadlinePastCycle", kDaemon, "feedback_deadline_ns: 600000", "feedback_deadline_ns: 1000000", "feedback_deadline_ns", "bus.feedback_deadline_ns",
     {"below cycle_ns, 1000000 ns"}},
    {"HeartbeatTimeout", kDaemon, "heartbeat_timeout_ms: 250", "heartbeat_timeout_ms: 110", "heartbeat_timeout_ms", "bus.heartbeat_timeout_ms", {"200 ms"}},
    {"Revisions", kDaemon, "min_revision: 0x01000000", "min_revision: 0x02000000", "max_revision", "bus.identity.max_revision", {"0x02000000 or more"}},
    {"DefaultSpeed", kDaemon, "default_speed_radps: 0.5", "default_speed_radps: 9", "default_speed_radps", "controller.trajectory.default_speed_radps",
     {"up to 8 rad/s"}},

    // ---- tendons that differ
    {"OverrideOfNoTendon", kRig, "\nactuation:", "\nactuation:\n  per_tendon: {4: {gear: {efficiency: 0.8}}}", "per_tendon: {4", "actuation.per_tendon.4", {"1 .. 3"}},
    {"OverrideUnknownKey", kRig, "\nactuation:", "\nactuation:\n  per_tendon: {2: {gear: {eficiency: 0.8}}}", "per_tendon: {2: {gear: {e",
     "actuation.per_tendon.2.gear.eficiency", {"did you mean efficiency?"}},
    {"OverrideOutOfRange", kRig, "\nactuation:", "\nactuation:\n  per_tendon:\n    2:\n      gear:\n        efficiency: 1.5", "efficiency: 1.5",
     "actuation.per_tendon.2.gear.efficiency", {"above 0 up to 1"}},
    {"OverrideOfNodes", kRig, "\nactuation:", "\nactuation:\n  per_tendon: {2: {nodes: [1]}}", "per_tendon: {2: {nodes", "actuation.per_tendon.2.nodes", {"unknown key"}},
    {"OverrideBreaksRatedTorque", kRig, "\nactuation:", "\nactuation:\n  per_tendon:\n    2:\n      motor: {nominal_current_A: 0.4}", "nominal_current_A: 0.4",
     "actuation.per_tendon.2.motor.nominal_current_A", {"tendon 2: ", "= 0.00784; accepted: 0.0077616 .. 0.0079184 N·m"}},
    {"OverrideBreaksLowTension", kRig, "\nactuation:", "\nactuation:\n  per_tendon:\n    3:\n      transmission: {low_tension_N: 0.4}", "low_tension_N: 0.4",
     "actuation.per_tendon.3.transmission.low_tension_N", {"tendon 3: ", "up to 0.3 N"}},

};
// clang-format on

INSTANTIATE_TEST_SUITE_P(All, Refusal, ::testing::ValuesIn(kCases),
                         [](const auto& instance) { return std::string(instance.param.name); });

// ---- every key of the shipped files, damaged in every way
// --------------------------------------------------------

struct Line {
  int number;
  std::string indent, key, value;
};

/// Lines "  key: value  # comment" with a plain scalar.
std::vector<Line> ScalarLines(const std::string& yaml) {
  std::vector<Line> lines;
  std::istringstream in(yaml);
  std::string text;
  for (int number = 1; std::getline(in, text); ++number) {
    text = text.substr(0, text.find('#'));
    const auto start = text.find_first_not_of(' ');
    const auto colon = text.find(": ");
    const auto end = text.find_last_not_of(' ');
    if (start == std::string::npos || colon == std::string::npos || end <= colon || text[start] == '-')
      continue;
    const std::string value = text.substr(colon + 2, end - colon - 1);
    if (value[0] == '[' || value[0] == '{') continue;
    lines.push_back({number, text.substr(0, start), text.substr(start, colon - start), value});
  }
  return lines;
}

std::string WithLine(const std::string& yaml, int number, const std::string& replacement) {
  std::istringstream in(yaml);
  std::string out, text;
  for (int n = 1; std::getline(in, text); ++n) out += (n == number ? replacement : text) + "\n";
  return out;
}

class EveryKey : public ::testing::TestWithParam<const char*> {};

TEST_P(EveryKey, DamageIsFoundWhereItIs) {
  const std::string file = GetParam();
  const std::string yaml = ReadText(ConfigPath(file));
  const std::vector<Line> lines = ScalarLines(yaml);
  EXPECT_GT(lines.size(), 20u);
  for (const Line& line : lines) {
    const std::string here = "some.yaml:" + std::to_string(line.number) + ": ";
    const std::string prefix = line.indent + line.key;
    SCOPED_TRACE(prefix);
    for (const std::string& damaged : {prefix + ": {}", prefix + ":", prefix + "x: " + line.value}) {
      const std::string message = MessageOf(file, WithLine(yaml, line.number, damaged));
      EXPECT_THAT(message, StartsWith(here)) << damaged;
      EXPECT_THAT(message, HasSubstr(line.key));
      EXPECT_THAT(message, HasSubstr("accepted: "));
    }
    const bool number = std::isdigit(static_cast<unsigned char>(line.value[0])) || line.value[0] == '-';
    if (number) {
      for (const char* value : {".nan", "1e300", "-1e300", "12 x", "'1'"}) {
        const std::string message = MessageOf(file, WithLine(yaml, line.number, prefix + ": " + value));
        EXPECT_THAT(message, StartsWith(here)) << value;
        EXPECT_THAT(message, HasSubstr(line.key + ": "));
        EXPECT_THAT(message, ContainsRegex("accepted: .*[0-9] ([.][.]|up to) -?[0-9]"));
      }
    }
    const std::string twice = prefix + ": " + line.value + "\n" + prefix + ": " + line.value;
    EXPECT_THAT(MessageOf(file, WithLine(yaml, line.number, twice)),
                StartsWith("some.yaml:" + std::to_string(line.number + 1) + ": "));
    const std::string missing = MessageOf(file, WithLine(yaml, line.number, ""));
    static const std::set<std::string> kMayBeLeftOut{"tension_feedback", "shape_feedback", "tip_feedback",
                                                     "look_ahead", "max_torque_error_N"};
    if (line.key == "exchanged_drives") {
      // May be left out as well, and is strict then.
      EXPECT_TRUE(ParseDaemon(WithLine(yaml, line.number, ""), "left out").exchanged_drives_refused);
      continue;
    }
    if (line.key == "commissioning") {
      EXPECT_EQ(missing, "(accepted)");
      EXPECT_TRUE(ParseDaemon(WithLine(yaml, line.number, ""), "left out").commissioning_required)
          << "what is not said is required";
      continue;
    }
    if (kMayBeLeftOut.contains(line.key)) {
      EXPECT_EQ(missing, "(accepted)");
      continue;
    }
    // An only child leaves its block without a value.
    EXPECT_THAT(missing, AnyOf(HasSubstr((line.key == "disk_diameter_m" ? "disk_inertia_xx_kgm2" : line.key) +
                                         ": missing"),
                               HasSubstr("spool: has no value")));
    if (HasFailure()) return;
  }
}

INSTANTIATE_TEST_SUITE_P(Files, EveryKey,
                         ::testing::Values("robots/rig_60mm.yaml", "robots/two_section.yaml",
                                           "tendrild.yaml"));

// ---- files
// ---------------------------------------------------------------------------------------------------------

template <class F>
std::string ErrorOf(F f) {
  try {
    f();
  } catch (const ConfigError& e) {
    return e.what();
  }
  return "(accepted)";
}

TEST(RefusedFile, NotYaml) {
  for (const char* text : {"body: [\n", "body: {a: 1\n", "\tname: x\n", "name: *nowhere\n", "a: b: c\n"}) {
    const std::string message = ErrorOf([&] { ParseRobot(text, "some.yaml"); });
    EXPECT_THAT(message, MatchesRegex("some\\.yaml:[0-9]+: not valid YAML: .*; accepted: a robot file.*; .*"))
        << text;
  }
}

TEST(RefusedFile, EmptyListTextOrTwoDocuments) {
  for (const char* text : {"", "\n", "# only a comment\n", "---\n", "~\n"}) {
    EXPECT_THAT(ErrorOf([&] { ParseDaemon(text, "some.yaml"); }),
                StartsWith("some.yaml:1: the file is empty; accepted: a daemon file"));
  }
  EXPECT_THAT(ErrorOf([&] { ParseRobot("- 1\n- 2\n", "some.yaml"); }), HasSubstr("the file contains a list"));
  EXPECT_THAT(ErrorOf([&] { ParseRobot("hello\n", "some.yaml"); }),
              HasSubstr("the file contains a single value"));
  EXPECT_THAT(ErrorOf([&] { ParseRobot("name: a\n---\nname: b\n", "some.yaml"); }),
              StartsWith("some.yaml:2: a second YAML document"));
}

TEST(RefusedFile, TheOtherKind) {
  EXPECT_THAT(ErrorOf([] { LoadRobot(ConfigPath("tendrild.yaml")); }),
              ::testing::AllOf(HasSubstr("tendrild.yaml:5: this is a daemon file"),
                               HasSubstr("accepted: a robot file")));
  EXPECT_THAT(ErrorOf([] { LoadDaemon(ConfigPath("robots/rig_60mm.yaml")); }),
              ::testing::AllOf(HasSubstr("rig_60mm.yaml:5: this is a robot file"),
                               HasSubstr("accepted: a daemon file")));
}

class Scratch : public ::testing::Test {
 protected:
  Scratch() {
    std::string pattern = std::filesystem::temp_directory_path() / "tendril_config_XXXXXX";
    dir_ = ::mkdtemp(pattern.data());
  }
  ~Scratch() override { std::filesystem::remove_all(dir_); }
  std::string Write(const std::string& name, const std::string& text) {
    std::ofstream(dir_ / name) << text;
    return dir_ / name;
  }
  std::filesystem::path dir_;
};

TEST_F(Scratch, MissingDirectoryPipeHugeAndUnreadable) {
  const std::string missing = dir_ / "none.yaml";
  for (const auto& load :
       {+[](const std::string& p) { (void)LoadRobot(p); }, +[](const std::string& p) { (void)LoadDaemon(p); },
        +[](const std::string& p) { (void)KindOf(p); }}) {
    EXPECT_THAT(
        ErrorOf([&] { load(missing); }),
        ::testing::AllOf(StartsWith(missing + ": "), HasSubstr("o such file"), HasSubstr("check the path")));
    EXPECT_THAT(ErrorOf([&] { load(dir_); }), HasSubstr(": is a directory; accepted: "));
  }
  const std::string pipe = dir_ / "pipe";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_THAT(ErrorOf([&] { LoadRobot(pipe); }), HasSubstr("not an ordinary file"));
  EXPECT_THAT(ErrorOf([&] { LoadRobot(Write("huge.yaml", std::string(2 << 20, '#'))); }),
              HasSubstr("larger than 1 MiB"));
  const std::string secret = Write("secret.yaml", "name: x\n");
  ::chmod(secret.c_str(), 0);
  if (::access(secret.c_str(), R_OK) == 0) return;  // root reads everything
  EXPECT_THAT(ErrorOf([&] { LoadRobot(secret); }), HasSubstr("cannot be read: Permission denied"));
}

TEST_F(Scratch, NeitherKind) {
  const std::string path = Write("other.yaml", "# other\nservices: {}\n");
  EXPECT_THAT(ErrorOf([&] { KindOf(path); }), StartsWith(path + ":2: neither a robot nor a daemon file"));
}

TEST_F(Scratch, RobotOfADaemonIsLookedForBesideIt) {
  const std::string daemon = ReadText(ConfigPath("tendrild.yaml"));
  const std::string path = Write("tendrild.yaml", daemon);
  EXPECT_THAT(ErrorOf([&] { LoadDaemon(path); }), StartsWith(path + ":5: robot: no such file: "));
  std::filesystem::create_directory(dir_ / "robots");
  Write("robots/rig_60mm.yaml", ReadText(ConfigPath("robots/rig_60mm.yaml")));
  EXPECT_EQ(LoadDaemon(path).robot_file, (dir_ / "robots/rig_60mm.yaml").string());
}

TEST_F(Scratch, EdsFileOfADriveIsLookedForBesideTheDaemons) {
  std::string daemon = ReadText(ConfigPath("tendrild.yaml"));
  daemon = Edited(daemon, "robot: robots/", "robot: " + ConfigPath("robots/"));
  daemon = Edited(daemon, "{node_id: 2, tendon: 2}",
                  "{node_id: 2, tendon: 2, profile: cia402, eds: drives/servo.eds}");
  const std::string path = Write("tendrild.yaml", daemon), eds = (dir_ / "drives/servo.eds").string();
  EXPECT_THAT(
      ErrorOf([&] { LoadDaemon(path); }),
      AllOf(StartsWith(path + ":"), HasSubstr("node 2 has eds: " + eds + ": no such file; accepted: ")));
  std::filesystem::create_directory(dir_ / "drives");
  Write("drives/servo.eds", "");
  EXPECT_EQ(LoadDaemon(path).bus.nodes[1].eds_file, eds);
}

// ---- what the controller's keys say of each other

TEST(RefusedController, KeysThatDoNotGoTogether) {
  const std::string path = ConfigPath("tendrild.yaml");
  const std::string text = Edited(ReadText(path), "robot: robots/", "robot: " + ConfigPath("robots/"));
  struct Wrong {
    std::vector<std::pair<const char*, const char*>> edits;
    const char* message;
  };
  const Wrong wrong[] = {
      {{{"tension_feedback: off", "tension_feedback: on"}},
       "controller.tension_feedback: on without what it corrects; accepted: off, or law: equilibrium"},
      {{{"law: paper", "law: equilibrium"}, {"shape_feedback: off", "shape_feedback: on"}},
       "controller.shape_feedback: on without the damping that it needs; accepted: off, or tension_feedback"},
      {{{"law: paper", "law: equilibrium"}, {"tip_feedback: off", "tip_feedback: on"}},
       "controller.tip_feedback: on without the damping that it needs; accepted: off, or tension_feedback"},
      {{{"default_speed_radps: 0.5", "default_speed_radps: 9"}},
       "controller.trajectory.default_speed_radps: 9 is faster than max_rate_radps allows; accepted: up to "
       "8"},
      {{{"max_acceleration_radps2: 160.0", "max_acceleration_radps2: 1.0"}},
       "controller.trajectory.max_acceleration_radps2: 1 takes 16 s"},
      {{{"max_jerk_radps3: 8000.0", "max_jerk_radps3: 10.0"}},
       "controller.trajectory.max_jerk_radps3: 10 takes 32 s"},
  };
  for (const Wrong& w : wrong) {
    std::string edited = text;
    for (const auto& [from, to] : w.edits) edited = Edited(edited, from, to);
    EXPECT_THAT(ErrorOf([&] { ParseDaemon(edited, "some.yaml"); }), HasSubstr(w.message));
  }
  std::string all =
      Edited(Edited(text, "law: paper", "law: equilibrium"), "tension_feedback: off", "tension_feedback: on");
  all = Edited(Edited(all, "shape_feedback: off", "shape_feedback: on"), "tip_feedback: off",
               "tip_feedback: on");
  const ControllerParameters c = ParseDaemon(all, "some.yaml").controller;
  EXPECT_TRUE(c.tension_feedback && c.shape_feedback && c.tip_feedback);
}

// ---- two files that do not fit each other
// ---------------------------------------------------------------------------

TEST(RefusedPair, TendonsAndNodes) {
  const std::string path = ConfigPath("tendrild.yaml");
  const DaemonParameters daemon = LoadDaemon(path);
  const RobotParameters robot = LoadRobot(daemon.robot_file);
  const std::string nodes =
      path + ":" + std::to_string(LineWith(ReadText(path), "\n  nodes:") + 1) + ": bus.nodes: ";
  EXPECT_NO_THROW(CheckTogether(daemon, robot, path));

  DaemonParameters fewer = daemon;
  fewer.bus.nodes.pop_back();
  EXPECT_THAT(ErrorOf([&] { CheckTogether(fewer, robot, path); }),
              StartsWith(nodes + "tendon 3 of rig_60mm has 0 nodes"));
  DaemonParameters more = daemon;
  more.bus.nodes.push_back({4, 4});
  EXPECT_THAT(ErrorOf([&] { CheckTogether(more, robot, path); }),
              StartsWith(nodes + "node 4 pulls tendon 4"));
  DaemonParameters same = daemon;
  same.bus.nodes[1].node_id = 1;
  EXPECT_THAT(ErrorOf([&] { CheckTogether(same, robot, path); }), StartsWith(nodes + "node_id 1 twice"));
  DaemonParameters slack = daemon;
  slack.controller.guards.slack_tension_N = 0.3;
  EXPECT_THAT(ErrorOf([&] { CheckTogether(slack, robot, path); }),
              HasSubstr("below limits.min_tension_N, 0.3 N"));
  DaemonParameters blind = daemon;
  blind.controller.tip_feedback = true;
  RobotParameters unseen = robot;
  EXPECT_NO_THROW(CheckTogether(blind, robot, path));
  unseen.actuation->tracker.reset();
  EXPECT_THAT(ErrorOf([&] { CheckTogether(blind, unseen, path); }),
              HasSubstr("controller.tip_feedback: on, but rig_60mm has no tracker; accepted: off"));
  DaemonParameters slow = daemon;
  slow.controller.pretension_ramp_Nps = 0.001;
  EXPECT_THAT(ErrorOf([&] { CheckTogether(slow, robot, path); }),
              AllOf(HasSubstr("controller.pretension_ramp_Nps: 0.001 N/s would take rig_60mm down"),
                    HasSubstr("accepted: 0.267 N/s or more")));
  DaemonParameters strong = daemon;
  strong.controller.take_up.pull_N = 1.1 * robot.limits.max_tension_motor_N;
  EXPECT_THAT(ErrorOf([&] { CheckTogether(strong, robot, path); }),
              HasSubstr("accepted: limits.max_tension_motor_N"));
  EXPECT_THAT(ErrorOf([&] { CheckTogether(daemon, LoadRobot(ConfigPath("robots/qi2021_60mm.yaml")), path); }),
              StartsWith(path + ":5: robot: qi2021_60mm has no actuation"));
  DaemonParameters of_pairs = LoadDaemon(ConfigPath("tendrild_pairs.yaml"));
  of_pairs.bus.nodes.push_back({3, 3});
  EXPECT_THAT(ErrorOf([&] { CheckTogether(of_pairs, LoadRobot(of_pairs.robot_file), path); }),
              HasSubstr("node 3 pulls tendon 3 of pairs_90mm, whose motor is that of tendon 1"));
  EXPECT_THAT(ErrorOf([&] { CheckTogether(fewer, robot, "gone.yaml"); }),
              StartsWith("gone.yaml: bus.nodes: tendon 3"));
}

TEST(RefusedPair, GenericDrives) {
  const std::string path = ConfigPath("tendrild.yaml");
  const DaemonParameters daemon = LoadDaemon(path);
  const RobotParameters robot = LoadRobot(daemon.robot_file);
  DaemonParameters unread = daemon;
  unread.bus.nodes[1].profile = DriveKind::kCia402;
  EXPECT_THAT(ErrorOf([&] { CheckTogether(unread, robot, path); }),
              AllOf(HasSubstr("bus.nodes: node 2 pulls tendon 2, which has a load cell in rig_60mm"),
                    HasSubstr("accepted: analog_input: OBJECT")));
  unread.bus.nodes[1].analog_input = "0x6401:01";
  EXPECT_NO_THROW(CheckTogether(unread, robot, path));
  unread.bus.nodes[1].analog_input = "";
  RobotParameters bare = robot;
  bare.actuation->tendons[1].load_cell.place = LoadCellPlace::kNone;
  EXPECT_NO_THROW(CheckTogether(unread, bare, path));
}

// ---- what is accepted
// -----------------------------------------------------------------------------------------------

TEST(Accepted, TendonsThatDiffer) {
  const std::string yaml =
      Edited(ReadText(ConfigPath(kRig)), "\nactuation:",
             "\nactuation:\n  nodes: [11, 12, 7]\n  per_tendon:\n    2:\n      gear: {efficiency: 0.8}\n"
             "      load_cell: {place: none}\n    3: {spool: {radius_m: 0.009}}");
  const RobotParameters robot = ParseRobot(yaml, "some.yaml");
  const auto& t = robot.actuation->tendons;
  EXPECT_EQ(t[0].gear.efficiency, 0.84);
  EXPECT_EQ(t[1].gear.efficiency, 0.8);
  EXPECT_EQ(t[1].gear.ratio, 19);
  EXPECT_EQ(t[2].gear.efficiency, 0.84);
  EXPECT_EQ(t[0].load_cell.place, LoadCellPlace::kMotorSide);
  EXPECT_EQ(t[1].load_cell.place, LoadCellPlace::kNone);
  EXPECT_EQ(t[1].spool.radius_m, 0.008);
  EXPECT_EQ(t[2].spool.radius_m, 0.009);
  EXPECT_EQ(t[0].node_id, 11);
  EXPECT_EQ(t[2].node_id, 7);
}

TEST(Accepted, AnchorsHexAndPlusSigns) {
  std::string yaml = Edited(ReadText(ConfigPath(kRig)), "  spool:\n    radius_m: 0.008",
                            "  spool: &spool\n    radius_m: +8.0E-3\n  per_tendon: {2: {spool: *spool}}");
  yaml = Edited(yaml, "units: 4 ", "units: 0x4 ");
  const RobotParameters robot = ParseRobot(yaml, "some.yaml");
  EXPECT_EQ(robot.actuation->tendons[1].spool.radius_m, 0.008);
  EXPECT_EQ(robot.body.sections[0].units, 4);
}

TEST(Accepted, DrivesOfOtherMakers) {
  const std::string yaml =
      Edited(ReadText(ConfigPath(kDaemon)), "{node_id: 2, tendon: 2}",
             "{node_id: 2, tendon: 2, profile: cia402, eds: servo.eds, analog_input: 0x6401:01, "
             "analog_mV_per_count: 2.5}");
  const DaemonParameters mixed = ParseDaemon(yaml, "some.yaml");
  EXPECT_EQ(mixed.bus.nodes[0].profile, DriveKind::kEpos4);
  EXPECT_EQ(mixed.bus.nodes[1].profile, DriveKind::kCia402);
  EXPECT_EQ(mixed.bus.nodes[1].eds_file, "servo.eds");
  EXPECT_EQ(mixed.bus.nodes[1].analog_input, "0x6401:01");
  EXPECT_EQ(mixed.bus.nodes[1].analog_mV_per_count, 2.5);
  EXPECT_EQ(ToYaml(ParseDaemon(ToYaml(mixed), "again")), ToYaml(mixed));

  // The identity of generic drives is in their EDS files.
  DaemonParameters generic = mixed;
  generic.bus.identity = {};
  EXPECT_THAT(ErrorOf([&] { ParseDaemon(ToYaml(generic), "again"); }), HasSubstr("bus.identity: missing"));
  for (NodeParameters& node : generic.bus.nodes) {
    node.profile = DriveKind::kCia402;
    node.eds_file = "servo.eds";
  }
  EXPECT_EQ(ToYaml(ParseDaemon(ToYaml(generic), "again")), ToYaml(generic));
}

TEST(Accepted, NodesInAnyOrder) {
  std::string yaml = ReadText(ConfigPath(kDaemon));
  yaml = Edited(yaml, "{node_id: 1, tendon: 1}", "{node_id: 21, tendon: 3}");
  yaml = Edited(yaml, "{node_id: 3, tendon: 3}", "{node_id: 23, tendon: 1}");
  const DaemonParameters daemon = ParseDaemon(yaml, "some.yaml");
  EXPECT_EQ(daemon.bus.nodes[0].node_id, 23);
  EXPECT_EQ(daemon.bus.nodes[1].node_id, 2);
  EXPECT_EQ(daemon.bus.nodes[2].node_id, 21);
}

// What passes here must not fail in the model afterwards.
TEST(Accepted, EveryPulleyIsOneTheModelTakes) {
  for (const char* law : {"cumulative", "local", "classic"}) {
    for (const char* wrap : {"0", "30"}) {
      for (const char* ratio : {"0.1", "1e6"}) {
        for (const char* exponent : {"0.05", "1"}) {
          std::string yaml = ReadText(ConfigPath(kRig));
          yaml = Edited(yaml, "law: cumulative", std::string("law: ") + law);
          yaml = Edited(yaml, "wrap_rad: 3.141592653589793", std::string("wrap_rad: ") + wrap);
          yaml = Edited(yaml, "radius_ratio: 10.0", std::string("radius_ratio: ") + ratio);
          yaml = Edited(yaml, "alpha: 0.466", *wrap == '0' ? "alpha: 0" : "alpha: 5");
          yaml = Edited(yaml, "exponent: 0.67", std::string("exponent: ") + exponent);
          yaml = Edited(yaml, "entry_angle_rad: 0.0",
                        *wrap == '0' ? "entry_angle_rad: 0" : "entry_angle_rad: 1.5");
          const RobotParameters robot = ParseRobot(yaml, "some.yaml");
          EXPECT_NO_THROW(model::ValidatePulley(robot.actuation.value().tendons[0].transmission.pulleys[0]));
        }
      }
    }
  }
}

TEST(Damaged, NestingAndAliasesThatGrow) {
  std::string deep = "name: x\nbody: ";
  for (int i = 0; i < 100000; ++i) deep += "[";
  EXPECT_THAT(ErrorOf([&] { ParseRobot(deep, "some.yaml"); }), HasSubstr("; accepted: "));
  std::string laughs = "name: x\nbody:\n  a0: &a0 [x, x]\n";
  for (int i = 1; i < 60; ++i) {
    const std::string before = "*a" + std::to_string(i - 1);
    laughs += "  a" + std::to_string(i) + ": &a" + std::to_string(i) + " [" + before + ", " + before + "]\n";
  }
  EXPECT_THAT(ErrorOf([&] { ParseRobot(laughs, "some.yaml"); }),
              StartsWith("some.yaml:3: body.a0: unknown key"));
  EXPECT_THAT(ErrorOf([&] { ParseRobot("body: &b\n  sections: [*b, *b]\n", "some.yaml"); }),
              HasSubstr("; accepted: "));
}

TEST(Damaged, AStrayCommaBeforeTheKeys) {
  EXPECT_THAT(ErrorOf([&] { ParseRobot("# what it is\n, and more\n\nname: x\n", "some.yaml"); }),
              testing::AllOf(StartsWith("some.yaml:2:"), HasSubstr("; accepted: ")));
}

// Damaged at random, a file is either read or refused in one line; nothing else happens.
TEST(Damaged, NeverCrashesAndAlwaysOneLine) {
  std::mt19937 random(7);
  for (const std::string file : {kRig, kTwo, kDaemon}) {
    const std::string whole = ReadText(ConfigPath(file));
    int refused = 0;
    for (int i = 0; i < 600; ++i) {
      std::string yaml = whole;
      for (int damage = static_cast<int>(random() % 4); damage >= 0; --damage) {
        const std::size_t at = random() % yaml.size();
        switch (random() % 4) {
          case 0:
            yaml[at] = static_cast<char>(random());
            break;
          case 1:
            yaml.erase(at, random() % 40);
            break;
          case 2:
            yaml.insert(at, yaml.substr(random() % yaml.size(), random() % 60));
            break;
          default:
            yaml[at] = "{}[]&*!|>'\"%@`:-,?#\n\t "[random() % 23];
        }
      }
      const std::string message = MessageOf(file, yaml);
      if (message == "(accepted)") continue;
      ++refused;
      ASSERT_THAT(message, StartsWith("some.yaml:"));
      ASSERT_THAT(message, HasSubstr("; accepted: "));
      ASSERT_EQ(message.find('\n'), std::string::npos) << message;
    }
    EXPECT_GT(refused, 100);
  }
}

}  // namespace
}  // namespace tendril::config
