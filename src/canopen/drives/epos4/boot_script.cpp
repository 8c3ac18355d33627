// The order of an EPOS4's start-up: identity, power off, configuration, rated torque, PDOs, mode, NMT start.
// Knows the drive's objects and the configuration; runs nothing.
#include "../script.h"
#include "epos4.h"

namespace tendril::canopen::epos4 {
namespace {

using Kind = BootAction::Kind;

void CheckIdentity(Script& s, const IdentityParameters& identity) {
  s.Step("identity");
  s.Add(Kind::kExpectBits, 0x1000, 0, 0x0192, 0xFFFF);  // device profile 402
  s.Add(Kind::kExpect, 0x1018, 1, identity.vendor_id, identity.vendor_id);
  s.Add(Kind::kExpectProduct, 0x1018, 2);
  s.Add(Kind::kExpect, 0x1018, 3, identity.min_revision, identity.max_revision);
  s.Add(Kind::kNote, 0x1018, 4);
  constexpr std::int64_t kTorqueMode = 1 << (kModeCyclicSynchronousTorque - 1);
  s.Add(Kind::kExpectBits, 0x6502, 0, kTorqueMode, kTorqueMode);
}

void Configure(Script& s, const BusParameters& bus, const DriveSetup& drive) {
  // The motor is off while the drive's data change, and no old set value survives.
  s.Step("power off");
  s.Write(0x6040, 0, 0);
  s.Write(0x6071, 0, 0);
  s.Write(0x60B2, 0, 0);

  s.Step("motor data");
  s.Write(0x3001, 1, drive.nominal_current_mA);
  s.Write(0x3001, 2, drive.output_current_limit_mA);
  s.Write(0x3001, 5, drive.torque_constant_uNmpA);

  // A tendon is safe when its motor is free; a motor that brakes along a ramp keeps pulling. So every stop is
  // "disable at once", except the quick stop, for which the drive has a single value.
  s.Step("stop reactions");
  s.Write(0x6007, 0, bus.abort_connection_option);
  s.Write(0x605A, 0, 6);
  s.Write(0x605B, 0, 0);
  s.Write(0x605C, 0, 0);
  s.Write(0x605E, 0, 0);
  s.Write(0x1029, 1, 0);  // pre-operational on a communication error

  // No interpolation between set values: a torque acts as received, at its SYNC. (That 0 switches it off is
  // our reading of the drive's default; the master only needs the same value everywhere.)
  s.Step("interpolation");
  s.Write(0x60C2, 1, 0);
  s.Write(0x60C2, 2, -3);

  s.Step("heartbeat");
  s.Write(0x1016, 1, (static_cast<std::int64_t>(kMasterNodeId) << 16) | bus.heartbeat_timeout_ms);
  s.Write(0x1016, 2, 0);
  s.Write(0x1017, 0, bus.heartbeat_ms);

  s.Step("rated torque");
  s.Add(Kind::kExpect, 0x6076, 0, static_cast<std::int64_t>(drive.rated_torque_uNm) - 1,
        static_cast<std::int64_t>(drive.rated_torque_uNm) + 1);  // the drive may round differently
}

}  // namespace

std::vector<BootAction> BootScript(const DriveProfile& profile, const BusParameters& bus,
                                   const DriveSetup& drive) {
  Script s;
  CheckIdentity(s, bus.identity);
  Configure(s, bus, drive);
  // Unused PDOs first, so that no COB-ID is ever used twice.
  s.Step("unused PDOs");
  for (std::uint16_t index : {0x1401, 0x1402, 0x1403, 0x1802, 0x1803}) s.Add(Kind::kDisablePdo, index, 1);
  for (const PdoLayout* pdo : {&profile.pdos.torque, &profile.pdos.feedback, &profile.pdos.status})
    Remap(s, *pdo, drive.node_id, profile.objects);
  SetTorqueMode(s);
  StartAndReadState(s, profile.objects);
  return s.Finished();
}

}  // namespace tendril::canopen::epos4
