// The EPOS4's emergency codes with texts. Knows no node's state.
#include "../emcy_texts.h"
#include "epos4.h"

namespace tendril::canopen::epos4 {
namespace {

using R = EmcyReaction;
using namespace error_register;

constexpr EmcyInfo kTable[] = {
    {0x0000, 0x0000, 0, R::kNone, "no error", "an earlier error was cleared", ""},
    {0x1000, 0x1000, kGeneric, R::kDisable, "generic error", "not stated by the drive",
     "read 0x603F and 0x1003; power the drive off and on"},
    {0x1080, 0x1088, kGeneric, R::kDisable, "initialisation error", "the drive's firmware failed to start up",
     "power the drive off and on; update its firmware"},
    {0x1090, 0x1090, kGeneric, R::kDisable, "firmware incompatible", "firmware does not fit the hardware",
     "load the firmware made for this drive"},
    {0x2310, 0x2310, kCurrent, R::kDisable, "over-current",
     "short circuit in the motor or its cable, or too high a gain",
     "check motor and cable, then the current controller's tuning"},
    {0x2320, 0x2320, kCurrent, R::kDisable, "power stage protection", "the output stage protected itself",
     "check motor and cable for shorts and the ambient temperature"},
    {0x3210, 0x3210, kVoltage, R::kDisable, "over-voltage", "supply too high, or braking fed energy back",
     "check the supply; add a shunt regulator"},
    {0x3220, 0x3220, kVoltage, R::kDisable, "under-voltage", "supply too low or too weak",
     "check the supply's voltage, current and wiring"},
    {0x4210, 0x4210, kTemperature, R::kDisable, "power stage too hot", "high load or poor cooling",
     "let it cool; lower the load or cool better"},
    {0x4380, 0x4380, kTemperature, R::kDisable, "motor thermal overload",
     "current above nominal for too long",
     "let it cool; check 0x3001 against the motor and what blocks the tendon"},
    {0x5113, 0x5113, kVoltage, R::kDisable, "logic supply too low", "logic supply voltage out of range",
     "check the logic supply"},
    {0x5280, 0x5282, kGeneric, R::kDisable, "hardware defect or incompatible", "the drive's self-test failed",
     "power the drive off and on; else replace it"},
    {0x5480, 0x5483, kGeneric, R::kDisable, "hardware error", "the drive's electronics failed",
     "power the drive off and on; else replace it"},
    {0x6080, 0x6080, kGeneric, R::kDisable, "sign of life lost", "the drive's processors lost each other",
     "power the drive off and on"},
    {0x6180, 0x61F0, kGeneric, R::kDisable, "internal software error", "the drive's firmware failed",
     "power the drive off and on; update its firmware"},
    {0x6320, 0x6320, kGeneric, R::kFaultOption, "parameter error",
     "a set value is inconsistent or out of range", "check the target values and the drive's parameters"},
    {0x6380, 0x6380, kGeneric, R::kDisable, "stored parameters corrupt", "power failed while storing",
     "restore defaults (0x1011), then configure the drive again"},
    {0x7320, 0x7320, kProfile, R::kDisable, "position sensor error", "encoder signal missing or implausible",
     "check the encoder and its cable"},
    {0x7380, 0x7382, kProfile, R::kDisable, "position sensor breach, resolution or index",
     "encoder cable broken or resolution set wrong", "check the encoder's cable and its set resolution"},
    {0x7388, 0x738A, kProfile, R::kDisable, "hall sensor error", "hall signals missing or implausible",
     "check the hall sensor's cable and the pole pairs (0x3001:03)"},
    {0x7390, 0x7392, kProfile, R::kDisable, "main or commutation sensor missing or reversed",
     "a configured sensor is not there or counts the wrong way", "check sensor configuration and direction"},
    {0x8110, 0x8111, kCommunication, R::kAbortConnection, "CAN overrun",
     "frames came faster than the drive read them", "lower the bus load"},
    {0x8120, 0x8120, kCommunication, R::kAbortConnection, "CAN error passive", "many transmission errors",
     "check termination, shield and bit rate"},
    {0x8130, 0x8130, kCommunication, R::kAbortConnection, "heartbeat lost",
     "the drive lost the master's heartbeat", "check that the daemon runs and the bus is connected"},
    {0x8150, 0x8150, kCommunication, R::kAbortConnection, "PDO COB-ID collision", "a COB-ID is used twice",
     "check that every node id is used once"},
    {0x81FD, 0x81FD, kCommunication, R::kAbortConnection, "CAN bus off",
     "the drive left the bus after errors", "check wiring and termination"},
    {0x81FE, 0x81FE, kCommunication, R::kAbortConnection, "CAN receive queue overflow",
     "too many frames for the drive", "lower the bus load"},
    {0x81FF, 0x81FF, kCommunication, R::kAbortConnection, "CAN transmit queue overflow",
     "the drive could not send", "lower the bus load; check wiring"},
    {0x8210, 0x8210, kCommunication, R::kAbortConnection, "PDO too short",
     "an RPDO had fewer bytes than mapped", "check that only one master is on the bus"},
    {0x8250, 0x8250, kCommunication, R::kAbortConnection, "RPDO timeout", "no torque command arrived in time",
     "check that the daemon runs and the bus is connected"},
    {0x8611, 0x8611, kMotion, R::kFaultOption, "following error", "position left the window 0x6065",
     "check what blocks the motor; widen 0x6065"},
    {0x8A88, 0x8A88, kGeneric, R::kDisable, "safe torque off", "the STO inputs are not powered",
     "release the emergency stop"},
    // Codes that this drive does not document, by CiA 301's classes.
    {0x2000, 0x2FFF, kCurrent, R::kDisable, "current error (code not in the drive's list)",
     "see the drive's manual", "see the drive's manual"},
    {0x3000, 0x3FFF, kVoltage, R::kDisable, "voltage error (code not in the drive's list)",
     "see the drive's manual", "see the drive's manual"},
    {0x4000, 0x4FFF, kTemperature, R::kDisable, "temperature error (code not in the drive's list)",
     "see the drive's manual", "see the drive's manual"},
    {0x8100, 0x82FF, kCommunication, R::kAbortConnection,
     "communication error (code not in the drive's list)", "see the drive's manual",
     "see the drive's manual"},
    {0x0001, 0xFFFF, kGeneric, R::kDisable, "error (code not in the drive's list)", "see the drive's manual",
     "see the drive's manual"},
};
static_assert(EmcyTextsFit(kTable));

}  // namespace

std::span<const EmcyInfo> EmcyTable() noexcept { return kTable; }

}  // namespace tendril::canopen::epos4
