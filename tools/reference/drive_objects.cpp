// The drive's objects: what a cycle carries, what the start-up checks and writes, and the whole dictionary;
// from the CANopen room's own tables.
#include <fmt/format.h>

#include "markdown.h"
#include "reference.h"
#include "tendril/canopen/boot_script.h"
#include "tendril/canopen/epos4.h"
#include "tendril/canopen/pdo.h"
#include "tendril/config/config.h"
#include "tendril/daemon/wiring.h"

namespace tendril::reference {
namespace {

using canopen::BootAction;
using canopen::ObjectEntry;

std::string AddressText(canopen::ObjectAddress a) { return fmt::format("0x{:04X}:{:02X}", a.index, a.sub); }

/// The object's name, of a record's entry with the record's before it.
std::string NameOf(canopen::ObjectAddress address) {
  const ObjectEntry* entry = canopen::FindObject(address);
  if (entry == nullptr) return "";
  const ObjectEntry* record = address.sub == 0 ? nullptr : canopen::FindObject({address.index, 0});
  return Escaped(record == nullptr ? entry->name : fmt::format("{}: {}", record->name, entry->name));
}

std::string TypeText(const ObjectEntry& entry) {
  constexpr const char* kNames[] = {"INT8", "INT16", "INT32", "UINT8", "UINT16", "UINT32", "STRING"};
  return kNames[static_cast<int>(entry.type)];
}

std::string AccessText(const ObjectEntry& entry) {
  constexpr const char* kAccess[] = {"const", "read", "read, write"};
  constexpr const char* kMapping[] = {"", ", in RPDOs", ", in TPDOs", ", in PDOs"};
  return std::string(kAccess[static_cast<int>(entry.access)]) + kMapping[static_cast<int>(entry.mapping)];
}

std::string Pdos() {
  std::string text = Heading(2, "In every cycle", "cycle");
  Table table({"PDO", "Carries"});
  for (const canopen::PdoLayout* pdo :
       {&canopen::kRpdoTorque, &canopen::kTpdoFeedback, &canopen::kTpdoStatus}) {
    std::string objects;
    for (int i = 0; i < pdo->count; ++i) {
      const canopen::MappingEntry& m = pdo->entries[static_cast<std::size_t>(i)];
      objects += fmt::format("{}{} {}, {} bits", i == 0 ? "" : "<br>", Code(AddressText({m.index, m.sub})),
                             NameOf({m.index, m.sub}), m.bits);
    }
    const std::string when = pdo->transmission == 1
                                 ? "every SYNC"
                                 : fmt::format("on change, every {:g} ms at most", 0.1 * pdo->inhibit_100us);
    table.Row({fmt::format("{}PDO {}", pdo->transmit ? "T" : "R", pdo->number) + Below(when), objects});
  }
  return text + table.Text();
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

std::string StartUp(const std::filesystem::path& source) {
  const DaemonParameters daemon = config::LoadDaemon((source / "config/tendrild.yaml").string());
  const auto drives = daemon::DriveSetups(config::LoadRobot(daemon.robot_file), daemon.bus);
  std::string text = Heading(2, "At start-up", "start-up");
  text +=
      "In this order, with the values of `config/tendrild.yaml` and its first drive. What differs, or is not "
      "kept, leaves the drive out and is reported with node, step and object.\n\n";
  Table table({"Object", "What is done"});
  std::string_view step;
  for (const BootAction& action : canopen::MakeBootScript(daemon.bus, drives.front())) {
    const bool begins = step != action.step;
    step = action.step;
    table.Row({Code(AddressText(action.address)) + Below(NameOf(action.address)),
               (begins ? fmt::format("**{}** ", Escaped(step)) : "") + ActionText(action)});
  }
  return text + table.Text();
}

std::string Dictionary() {
  std::string text = Heading(2, "Object dictionary", "dictionary");
  text +=
      "Every object of an EPOS4 that Tendril uses or `tendril-plant` emulates. The same table is shipped as "
      "an electronic data sheet, `config/tendril_drive.eds`.\n\n";
  Table table({"Object", "Name", "Default"});
  for (const ObjectEntry& entry : canopen::ObjectTable()) {
    const std::string value = entry.type == canopen::DataType::kString
                                  ? entry.text
                                  : fmt::format("0x{:X}", entry.default_value & 0xFFFFFFFF);
    table.Row({Target(AddressText(entry.address()), AddressText(entry.address())),
               NameOf(entry.address()) + Below(fmt::format("{}, {}", TypeText(entry), AccessText(entry))),
               Code(value) + (entry.plus_node_id ? " + node id" : "")});
  }
  return text + table.Text();
}

}  // namespace

Page DriveObjectsPage(const std::filesystem::path& source) {
  return {"drive-objects.md",
          Head("Drive objects", "What Tendril reads and writes in an EPOS4 drive, by CANopen.",
               {"src/canopen/epos4.cpp", "src/canopen/boot_script.cpp", "include/tendril/canopen/pdo.h"}) +
              Pdos() + StartUp(source) + Dictionary()};
}

}  // namespace tendril::reference
