// Emergency codes of CiA 301 and CiA 402. Makers' own codes show their number and class.
#include "../emcy_texts.h"
#include "cia402_drive.h"

namespace tendril::canopen::cia402 {
namespace {

using R = EmcyReaction;
using namespace error_register;

constexpr const char* kMakers = "only the drive's manual says what it means";
constexpr const char* kManual = "look the code up there";

constexpr EmcyInfo kTable[] = {
    {0x0000, 0x0000, 0, R::kNone, "no error", "an earlier error was cleared", ""},
    {0x1000, 0x1000, kGeneric, R::kDisable, "generic error", "not stated by the drive",
     "read 0x603F and 0x1003; power the drive off and on"},
    {0x2130, 0x213F, kCurrent, R::kDisable, "short circuit at the input", "the drive's supply side",
     "check the supply's wiring"},
    {0x2300, 0x231F, kCurrent, R::kDisable, "over-current",
     "short circuit in the motor or its cable, or too high a gain",
     "check motor and cable, then the current controller's tuning"},
    {0x2320, 0x233F, kCurrent, R::kDisable, "short circuit or earth leakage at the output",
     "the motor or its cable", "check motor and cable for shorts"},
    {0x2350, 0x235F, kCurrent, R::kDisable, "motor overload (i2t)", "current above rated for too long",
     "let it cool; check the rated current and what blocks the tendon"},
    {0x3110, 0x311F, kVoltage, R::kDisable, "mains over-voltage", "supply too high", "check the supply"},
    {0x3120, 0x312F, kVoltage, R::kDisable, "mains under-voltage", "supply too low or too weak",
     "check the supply"},
    {0x3210, 0x321F, kVoltage, R::kDisable, "DC link over-voltage",
     "supply too high, or braking fed energy back", "check the supply; add a shunt regulator"},
    {0x3220, 0x322F, kVoltage, R::kDisable, "DC link under-voltage", "supply too low or too weak",
     "check the supply's voltage, current and wiring"},
    {0x4210, 0x421F, kTemperature, R::kDisable, "device too hot", "high load or poor cooling",
     "let it cool; lower the load or cool better"},
    {0x4310, 0x431F, kTemperature, R::kDisable, "drive or motor too hot", "high load or poor cooling",
     "let it cool; check what blocks the tendon"},
    {0x5110, 0x51FF, kVoltage, R::kDisable, "logic supply out of range", "logic supply voltage",
     "check the logic supply"},
    {0x5440, 0x544F, kGeneric, R::kDisable, "contacts or enable input", "an enable or safety input is off",
     "check the enable and safe-torque-off inputs"},
    {0x5530, 0x553F, kGeneric, R::kDisable, "data storage error", "stored parameters are not readable",
     "restore defaults (0x1011), then set the drive up again"},
    {0x6100, 0x61FF, kGeneric, R::kDisable, "internal software error", "the drive's firmware failed",
     "power the drive off and on; update its firmware"},
    {0x6320, 0x632F, kGeneric, R::kFaultOption, "parameter error",
     "a set value is inconsistent or out of range", "check the drive's parameters"},
    {0x7120, 0x712F, kGeneric, R::kDisable, "motor error", "blocked, or its commutation failed",
     "check what blocks the motor, and its set-up in the drive"},
    {0x7300, 0x73FF, kProfile, R::kDisable, "sensor error", "position sensor missing or implausible",
     "check the encoder and its cable"},
    {0x8110, 0x811F, kCommunication, R::kAbortConnection, "CAN overrun",
     "frames came faster than the drive read them", "lower the bus load"},
    {0x8120, 0x812F, kCommunication, R::kAbortConnection, "CAN error passive", "many transmission errors",
     "check termination, shield and bit rate"},
    {0x8130, 0x813F, kCommunication, R::kAbortConnection, "heartbeat lost",
     "the drive lost the master's heartbeat", "check that the daemon runs and the bus is connected"},
    {0x8140, 0x814F, kCommunication, R::kAbortConnection, "recovered from bus off",
     "the drive left the bus after errors", "check wiring and termination"},
    {0x8150, 0x815F, kCommunication, R::kAbortConnection, "COB-ID collision", "a COB-ID is used twice",
     "check that every node id is used once"},
    {0x8210, 0x821F, kCommunication, R::kAbortConnection, "PDO too short",
     "an RPDO had fewer bytes than mapped", "check that only one master is on the bus"},
    {0x8240, 0x824F, kCommunication, R::kAbortConnection, "unexpected SYNC length", "SYNC of another sender",
     "check that only one master is on the bus"},
    {0x8250, 0x825F, kCommunication, R::kAbortConnection, "RPDO timeout", "no torque command arrived in time",
     "check that the daemon runs and the bus is connected"},
    {0x8300, 0x83FF, kMotion, R::kFaultOption, "torque control error", "torque beyond its limits",
     "check what blocks the motor, and the drive's torque limits"},
    {0x8400, 0x84FF, kMotion, R::kFaultOption, "velocity control error", "velocity beyond its limits",
     "check the drive's velocity limits"},
    {0x8600, 0x86FF, kMotion, R::kFaultOption, "positioning error", "position left its window",
     "check what blocks the motor; widen the window 0x6065"},
    {0x8700, 0x87FF, kMotion, R::kFaultOption, "synchronisation error", "SYNC was missing or came unsteadily",
     "check that the daemon runs and misses no cycles, and 0x60C2 against bus.cycle_ns"},
    // Codes that CiA does not define, by its classes.
    {0x2000, 0x2FFF, kCurrent, R::kDisable, "current error (the maker's code)", kMakers, kManual},
    {0x3000, 0x3FFF, kVoltage, R::kDisable, "voltage error (the maker's code)", kMakers, kManual},
    {0x4000, 0x4FFF, kTemperature, R::kDisable, "temperature error (the maker's code)", kMakers, kManual},
    {0x5000, 0x5FFF, kGeneric, R::kDisable, "hardware error (the maker's code)", kMakers, kManual},
    {0x8100, 0x82FF, kCommunication, R::kAbortConnection, "communication error (the maker's code)", kMakers,
     kManual},
    {0x0001, 0xFFFF, kGeneric, R::kDisable, "error (the maker's code)", kMakers, kManual},
};
static_assert(EmcyTextsFit(kTable));

}  // namespace

std::span<const EmcyInfo> EmcyTable() noexcept { return kTable; }

}  // namespace tendril::canopen::cia402
