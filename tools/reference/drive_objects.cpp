// The drives' objects: what a cycle carries, what the start-up checks and writes, for each profile, and the
// EPOS4's whole dictionary; from the CANopen room's own tables.
#include <fmt/format.h>

#include "markdown.h"
#include "reference.h"
#include "tendril/canopen/drive_profile.h"
#include "tendril/canopen/master.h"
#include "tendril/config/config.h"
#include "tendril/daemon/wiring.h"

namespace tendril::reference {
namespace {

using canopen::BootAction;
using canopen::DriveSetup;
using canopen::ObjectEntry;
using canopen::ObjectTable;

std::string AddressText(canopen::ObjectAddress a) { return fmt::format("0x{:04X}:{:02X}", a.index, a.sub); }

/// The object's name, of a record's entry with the record's before it.
std::string NameOf(const ObjectTable& objects, canopen::ObjectAddress address) {
  const ObjectEntry* entry = objects.Find(address);
  if (entry == nullptr) return "";
  const ObjectEntry* record = address.sub == 0 ? nullptr : objects.Find({address.index, 0});
  const bool counts = record != nullptr && std::string_view(record->name).starts_with("Highest sub-index");
  return Escaped(record == nullptr || counts ? entry->name
                                             : fmt::format("{}: {}", record->name, entry->name));
}

std::string TypeText(const ObjectEntry& entry) {
  constexpr const char* kNames[] = {"INT8", "INT16", "INT32", "UINT8", "UINT16", "UINT32", "STRING", "other"};
  return kNames[static_cast<int>(entry.type)];
}

std::string AccessText(const ObjectEntry& entry) {
  constexpr const char* kAccess[] = {"const", "read", "read, write", "write"};
  constexpr const char* kMapping[] = {"", ", in RPDOs", ", in TPDOs", ", in PDOs"};
  return std::string(kAccess[static_cast<int>(entry.access)]) + kMapping[static_cast<int>(entry.mapping)];
}

std::string Pdos(const DriveSetup& drive) {
  Table table({"PDO", "Carries"});
  const canopen::DrivePdos& pdos = drive.profile->pdos;
  for (const canopen::PdoLayout* pdo : {&pdos.torque, &pdos.feedback, &pdos.status}) {
    std::string objects;
    for (int i = 0; i < pdo->count; ++i) {
      const canopen::MappingEntry& m = pdo->entries[static_cast<std::size_t>(i)];
      objects += fmt::format("{}{} {}, {} bits", i == 0 ? "" : "<br>", Code(AddressText({m.index, m.sub})),
                             NameOf(drive.profile->objects, {m.index, m.sub}), m.bits);
    }
    const std::string when = pdo->transmission == 1
                                 ? "every SYNC"
                                 : fmt::format("on change, every {:g} ms at most", 0.1 * pdo->inhibit_100us);
    table.Row({fmt::format("{}PDO {}", pdo->transmit ? "T" : "R", pdo->number) + Below(when), objects});
  }
  return table.Text();
}

std::string ActionText(const BootAction& a) {
  const auto number = [](std::int64_t value) {
    return Code(value >= 0x10000 ? fmt::format("0x{:08X}", value) : fmt::format("{}", value));
  };
  switch (a.kind) {
    case BootAction::Kind::kWrite:
      return "write " + number(a.value) + ", read it back";
    case BootAction::Kind::kDisablePdo:
      return "switch the PDO off, read it back";
    case BootAction::Kind::kExpect:
      return a.value == a.max ? "must be " + number(a.value)
                              : fmt::format("must be {} .. {}", number(a.value), number(a.max));
    case BootAction::Kind::kExpectBits:
      return fmt::format("bits {} must be {}", Code(fmt::format("0x{:X}", a.max)),
                         Code(fmt::format("0x{:X}", a.value)));
    case BootAction::Kind::kExpectProduct:
      return "must be one of `bus.identity.product_codes`";
    case BootAction::Kind::kConfirm:
      return "read until it is " + number(a.value);
    case BootAction::Kind::kNote:
      return "read and keep";
    case BootAction::Kind::kStart:
      return "NMT start, then wait for the first feedback";
  }
  return "";
}

/// True when a drive without the object is refused.
bool Needed(const BusParameters& bus, const DriveSetup& drive, canopen::ObjectAddress address) {
  const canopen::DriveProfile& whole = *drive.profile;
  canopen::DriveProfile less;
  less.pdos = whole.pdos;
  less.rated_torque_unit_uNm = whole.rated_torque_unit_uNm;
  less.boot_script = whole.boot_script;
  for (const ObjectEntry& entry : whole.objects.entries()) {
    if (entry.address() != address) less.objects.Add(entry.address(), entry.type, entry.access, "") = entry;
  }
  less.objects.Sort();
  DriveSetup without = drive;
  without.profile = std::make_shared<const canopen::DriveProfile>(std::move(less));
  return !canopen::Unsupported(bus, without).empty();
}

/// `marks_needed`: of a kind of drive whose objects differ from maker to maker.
std::string StartUp(const BusParameters& bus, const DriveSetup& drive, bool marks_needed) {
  Table table({"Object", "What is done"});
  std::string_view step;
  for (const BootAction& action : drive.profile->boot_script(*drive.profile, bus, drive)) {
    const bool begins = step != action.step;
    step = action.step;
    const bool optional = marks_needed && !Needed(bus, drive, action.address);
    table.Row({Code(AddressText(action.address)) + Below(NameOf(drive.profile->objects, action.address)),
               (begins ? fmt::format("**{}** ", Escaped(step)) : "") + ActionText(action) +
                   (optional ? Below("where the drive has it") : "")});
  }
  return table.Text();
}

std::string Dictionary(const ObjectTable& objects) {
  Table table({"Object", "Name", "Default"});
  for (const ObjectEntry& entry : objects.entries()) {
    const std::string value = entry.type == canopen::DataType::kString
                                  ? entry.text
                                  : fmt::format("0x{:X}", entry.default_value & 0xFFFFFFFF);
    table.Row(
        {Target(AddressText(entry.address()), AddressText(entry.address())),
         NameOf(objects, entry.address()) + Below(fmt::format("{}, {}", TypeText(entry), AccessText(entry))),
         Code(value) + (entry.plus_node_id ? " + node id" : "")});
  }
  return table.Text();
}

/// The first drive of the shipped daemon file, or what it would be with the example's data sheet.
DriveSetup ExampleDrive(const DaemonParameters& daemon, const std::string& eds) {
  DaemonParameters with = daemon;
  if (!eds.empty()) {
    NodeParameters& node = with.bus.nodes.front();
    node.profile = DriveKind::kCia402;
    node.eds_file = eds;
    node.analog_input = "0x6401:01";
  }
  return daemon::DriveSetups(config::LoadRobot(daemon.robot_file), with.bus).front();
}

}  // namespace

Page DriveObjectsPage(const std::filesystem::path& source) {
  const DaemonParameters daemon = config::LoadDaemon((source / "config/tendrild.yaml").string());
  const DriveSetup epos4 = ExampleDrive(daemon, "");
  const DriveSetup generic = ExampleDrive(daemon, (source / "config/drives/cia402_servo.eds").string());
  std::string text =
      Head("Drive objects",
           "What Tendril reads and writes in a drive, by CANopen, for each profile of `bus.nodes`.",
           {"src/canopen/drives/epos4/objects.cpp", "src/canopen/drives/epos4/boot_script.cpp",
            "src/canopen/drives/cia402/boot_script.cpp", "config/drives/cia402_servo.eds"});
  text += Heading(2, "maxon EPOS4, in every cycle", "cycle") + Pdos(epos4);
  text += Heading(2, "maxon EPOS4, at start-up", "start-up");
  text +=
      "In this order, with the values of `config/tendrild.yaml` and its first drive. What differs, or is not "
      "kept, leaves the drive out and is reported with node, step and object.\n\n";
  text += StartUp(daemon.bus, epos4, false);
  text += Heading(2, "Another maker's drive, in every cycle", "cia402-cycle");
  text +=
      "A drive with `profile: cia402`, here the example `config/drives/cia402_servo.eds` with "
      "`analog_input: 0x6401:01`. Without it TPDO 1 has 6 bytes. A drive without an inhibit time in TPDO 2 "
      "sends that at every SYNC.\n\n";
  text += Pdos(generic);
  text += Heading(2, "Another maker's drive, at start-up", "cia402-start-up");
  text +=
      "What is not marked is needed: `tendril config check` refuses a drive whose EDS file lacks it, has it "
      "read-only, does not map it, or does not accept the value.\n\n";
  text += StartUp(daemon.bus, generic, true);
  text += Heading(2, "EPOS4's object dictionary", "dictionary");
  text +=
      "Every object of an EPOS4 that Tendril uses or `tendril-plant` emulates. The same table is shipped as "
      "an electronic data sheet, `config/tendril_drive.eds`.\n\n";
  return {"drive-objects.md", text + Dictionary(epos4.profile->objects)};
}

}  // namespace tendril::reference
