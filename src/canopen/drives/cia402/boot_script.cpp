// The order of a generic drive's start-up, which is the EPOS4's without its maker's objects. What CiA 402
// leaves to the maker is written where the EDS file has it; all else is needed. Runs nothing.
#include <algorithm>
#include <cmath>

#include "../script.h"
#include "cia402_drive.h"

namespace tendril::canopen::cia402 {
namespace {

using Kind = BootAction::Kind;

class Optional {
 public:
  Optional(Script& script, const ObjectTable& objects) : script_(script), objects_(objects) {}

  /// Where the drive has the object and takes the value.
  void Write(std::uint16_t index, std::uint8_t sub, std::int64_t value) {
    const ObjectEntry* entry = objects_.Find({index, sub});
    if (entry == nullptr || entry->access != Access::kReadWrite || TypeBytes(entry->type) == 0) return;
    if (value >= entry->min && value <= entry->max) script_.Write(index, sub, value);
  }
  /// The nearest value that it takes.
  void WriteUpTo(std::uint16_t index, std::uint8_t sub, std::int64_t value) {
    const ObjectEntry* entry = objects_.Find({index, sub});
    if (entry != nullptr) Write(index, sub, std::clamp(value, entry->min, entry->max));
  }

 private:
  Script& script_;
  const ObjectTable& objects_;
};

void CheckIdentity(Script& s, const ObjectTable& objects) {
  s.Step("identity");
  s.Add(Kind::kExpectBits, 0x1000, 0, 0x0192, 0xFFFF);  // device profile 402
  const ObjectEntry* entry = objects.Find({0x1018, 1});
  const std::int64_t vendor = entry == nullptr ? 0 : entry->default_value;
  s.Add(Kind::kExpect, 0x1018, 1, vendor, vendor);
  // Product code and serial number are optional in CiA 301. Revisions change with the firmware.
  if (const ObjectEntry* product = objects.Find({0x1018, 2})) {
    const std::int64_t code = product->default_value;
    s.Add(Kind::kExpect, 0x1018, 2, code, code == 0 ? 0xFFFFFFFF : code);
  }
  if (objects.Find({0x1018, 4}) != nullptr) s.Add(Kind::kNote, 0x1018, 4);
  constexpr std::int64_t kTorqueMode = 1 << (kModeCyclicSynchronousTorque - 1);
  if (objects.Find({0x6502, 0}) != nullptr) s.Add(Kind::kExpectBits, 0x6502, 0, kTorqueMode, kTorqueMode);
}

/// 0x60C2 in the largest power of ten seconds of which the cycle is a whole number.
void SetInterpolation(Optional& optional, TimeNs cycle_ns) {
  std::int64_t unit_ns = kNsPerMs;
  int exponent = -3;
  while ((cycle_ns % unit_ns != 0) && exponent > -6 && 10 * cycle_ns / unit_ns <= 255) {
    unit_ns /= 10;
    --exponent;
  }
  optional.Write(0x60C2, 1, std::clamp<std::int64_t>((cycle_ns + unit_ns / 2) / unit_ns, 1, 255));
  optional.Write(0x60C2, 2, exponent);
}

void Configure(Script& s, Optional& optional, const DriveProfile& profile, const BusParameters& bus,
               const DriveSetup& drive) {
  // The motor is off while the drive's data change, and no old set value survives.
  s.Step("power off");
  s.Write(0x6040, 0, 0);
  s.Write(0x6071, 0, 0);
  optional.Write(0x60B2, 0, 0);

  s.Step("torque limits");
  const std::int64_t limit_permille =
      drive.nominal_current_mA == 0 ? 0 : 1000LL * drive.output_current_limit_mA / drive.nominal_current_mA;
  for (const std::uint16_t index : {0x6072, 0x60E0, 0x60E1}) optional.WriteUpTo(index, 0, limit_permille);

  // As for every drive here: a tendon is safe when its motor is free, so every stop is "disable at once". A
  // drive that is to brake when the daemon falls silent keeps its own quick stop.
  s.Step("stop reactions");
  s.Write(0x6007, 0, bus.abort_connection_option);
  if (bus.abort_connection_option == 2) optional.Write(0x605A, 0, 0);
  optional.Write(0x605B, 0, 0);
  optional.Write(0x605C, 0, 0);
  optional.Write(0x605E, 0, 0);
  optional.Write(0x1029, 1, 0);  // pre-operational on a communication error

  s.Step("interpolation");
  SetInterpolation(optional, bus.cycle_ns);

  // The drive-side watchdog: a drive without it would keep its last torque when the daemon falls silent.
  s.Step("heartbeat");
  s.Write(0x1016, 1, (static_cast<std::int64_t>(kMasterNodeId) << 16) | bus.heartbeat_timeout_ms);
  optional.Write(0x1016, 2, 0);
  s.Write(0x1017, 0, bus.heartbeat_ms);

  s.Step("rated torque");
  const auto rated = static_cast<std::int64_t>(
      std::llround(static_cast<double>(drive.rated_torque_uNm) / profile.rated_torque_unit_uNm));
  s.Add(Kind::kExpect, 0x6076, 0, std::max<std::int64_t>(rated - 1, 1),
        rated + 1);  // it may round differently
}

}  // namespace

std::vector<BootAction> BootScript(const DriveProfile& profile, const BusParameters& bus,
                                   const DriveSetup& drive) {
  Script s;
  Optional optional(s, profile.objects);
  CheckIdentity(s, profile.objects);
  Configure(s, optional, profile, bus, drive);
  // Unused PDOs first, so that no COB-ID is ever used twice.
  s.Step("unused PDOs");
  const PdoLayout* const used[] = {&profile.pdos.torque, &profile.pdos.feedback, &profile.pdos.status};
  for (const ObjectEntry& entry : profile.objects.entries()) {
    const bool ours = std::any_of(std::begin(used), std::end(used), [&entry](const PdoLayout* pdo) {
      return pdo->communication_index() == entry.index;
    });
    if (IsPdoCobId(entry.address()) && !ours) s.Add(Kind::kDisablePdo, entry.index, 1);
  }
  for (const PdoLayout* pdo : used) Remap(s, *pdo, drive.node_id, profile.objects);
  SetTorqueMode(s);
  StartAndReadState(s, profile.objects);
  return s.Finished();
}

}  // namespace tendril::canopen::cia402
