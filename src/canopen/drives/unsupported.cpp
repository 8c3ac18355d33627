// What a drive's objects do not allow of its start-up and its PDOs. Knows tables and scripts, no drive.
#include <array>
#include <cstdarg>
#include <cstdio>

#include "tendril/canopen/drive_profile.h"

namespace tendril::canopen {
namespace {

[[gnu::format(printf, 2, 3)]] std::string Text(const ObjectEntry* entry, const char* format, ...) {
  std::array<char, 256> text{};
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(text.data(), text.size(), format, arguments);
  va_end(arguments);
  std::string line = ":";
  if (entry != nullptr && entry->line > 0) line += std::to_string(entry->line) + ":";
  return line + " " + text.data();
}

/// Of a write, with its read-back.
std::string WriteProblem(const BootAction& action, const ObjectEntry& entry) {
  if (entry.access == Access::kConst || entry.access == Access::kReadOnly) {
    return Text(&entry, "0x%04X:%02X (%s) is read-only, and must be set", entry.index, entry.sub,
                action.step);
  }
  if (entry.access == Access::kWriteOnly) {
    return Text(&entry, "0x%04X:%02X (%s) is write-only, and must be read back", entry.index, entry.sub,
                action.step);
  }
  // The data sheets' limits of COB-IDs leave out the bits above the identifier.
  const bool in_range = action.value >= entry.min && action.value <= entry.max;
  if (action.kind != BootAction::Kind::kWrite || IsPdoCobId(entry.address()) || in_range) return "";
  return Text(&entry, "0x%04X:%02X (%s) takes %lld .. %lld, and must be %lld", entry.index, entry.sub,
              action.step, static_cast<long long>(entry.min), static_cast<long long>(entry.max),
              static_cast<long long>(action.value));
}

/// Of an object that has no width here; empty where it has one.
std::string TypeProblem(const ObjectEntry& entry, const char* use) {
  if (TypeBytes(entry.type) != 0) return "";
  return Text(&entry, "0x%04X:%02X (%s) is no whole number of up to 32 bits", entry.index, entry.sub, use);
}

std::string ActionProblem(const BootAction& action, const ObjectTable& objects) {
  const ObjectEntry* entry = objects.Find(action.address);
  if (entry == nullptr) {
    return Text(nullptr, "0x%04X:%02X (%s) is not there", action.address.index, action.address.sub,
                action.step);
  }
  if (std::string problem = TypeProblem(*entry, action.step); !problem.empty()) return problem;
  switch (action.kind) {
    case BootAction::Kind::kWrite:
    case BootAction::Kind::kDisablePdo:
      return WriteProblem(action, *entry);
    case BootAction::Kind::kExpectBits:
      // Many data sheets have 0 there for "not stated".
      if (entry->default_value == 0 || (entry->default_value & action.max) == action.value) return "";
      return Text(entry, "0x%04X:%02X is 0x%llX: %s", entry->index, entry->sub,
                  static_cast<unsigned long long>(entry->default_value),
                  entry->index == 0x1000 ? "no CiA 402 drive" : "no cyclic synchronous torque mode (bit 9)");
    default:
      if (entry->access != Access::kWriteOnly) return "";
      return Text(entry, "0x%04X:%02X (%s) is write-only, and must be read", entry->index, entry->sub,
                  action.step);
  }
}

std::string MappingProblem(const PdoLayout& pdo, const DriveProfile& profile) {
  const char* way = pdo.transmit ? "TPDO" : "RPDO";
  for (int i = 0; i < pdo.count; ++i) {
    const MappingEntry& mapped = pdo.entries[static_cast<std::size_t>(i)];
    const ObjectAddress address{mapped.index, mapped.sub};
    const ObjectEntry* entry = profile.objects.Find(address);
    if (entry == nullptr) {
      return Text(nullptr, "0x%04X:%02X, for %s %d, is not there%s", mapped.index, mapped.sub, way,
                  pdo.number, profile.analog_input == address ? " (analog_input)" : "");
    }
    const Mapping direction = pdo.transmit ? Mapping::kTransmit : Mapping::kReceive;
    if (entry->mapping != Mapping::kBoth && entry->mapping != direction) {
      return Text(entry, "0x%04X:%02X cannot be mapped into %s %d", entry->index, entry->sub, way,
                  pdo.number);
    }
    if (std::string problem = TypeProblem(*entry, "PDO mapping"); !problem.empty()) return problem;
    if (8 * TypeBytes(entry->type) != mapped.bits || TypeSigned(entry->type) != mapped.is_signed) {
      return Text(entry, "0x%04X:%02X has %d bits%s, and must have %d%s", entry->index, entry->sub,
                  8 * TypeBytes(entry->type), TypeSigned(entry->type) ? " with a sign" : "", mapped.bits,
                  mapped.is_signed ? " with a sign" : "");
    }
  }
  if (pdo.bytes() <= 8) return "";
  return Text(nullptr, "%s %d would need %d bytes and holds 8: analog_input has too many bits", way,
              pdo.number, pdo.bytes());
}

}  // namespace

std::string Unsupported(const BusParameters& bus, const DriveSetup& drive) {
  const DriveProfile& profile = *drive.profile;
  std::string problem;
  for (const PdoLayout* pdo : {&profile.pdos.torque, &profile.pdos.feedback, &profile.pdos.status}) {
    if (problem.empty()) problem = MappingProblem(*pdo, profile);
  }
  for (const BootAction& action : profile.boot_script(profile, bus, drive)) {
    if (problem.empty()) problem = ActionProblem(action, profile.objects);
  }
  return problem.empty() ? "" : profile.file + problem;
}

}  // namespace tendril::canopen
