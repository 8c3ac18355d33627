// The drive's object table and its electronic data sheet. Knows which objects exist, not what they do.
#include "tendril/canopen/epos4.h"

#include <algorithm>
#include <array>
#include <cstdarg>
#include <cstdio>
#include <limits>
#include <vector>

#include "tendril/canopen/pdo.h"

namespace tendril::canopen {
namespace {

using T = DataType;
using A = Access;
using M = Mapping;

constexpr std::int64_t kTypeRange = std::numeric_limits<std::int64_t>::min();  // stands for "the whole type"

struct Range {
  std::int64_t min = kTypeRange, max = kTypeRange;
};

std::int64_t TypeMin(T type) {
  return TypeSigned(type) ? -(std::int64_t{1} << (8 * TypeBytes(type) - 1)) : 0;
}
std::int64_t TypeMax(T type) {
  if (type == T::kString) return 0;
  return (std::int64_t{1} << (8 * TypeBytes(type) - (TypeSigned(type) ? 1 : 0))) - 1;
}

class Builder {
 public:
  ObjectEntry& Add(std::uint16_t index, std::uint8_t sub, T type, A access, M mapping, std::int64_t value,
                   const char* name, Range range = {}) {
    ObjectEntry entry;
    entry.index = index;
    entry.sub = sub;
    entry.type = type;
    entry.access = access;
    entry.mapping = mapping;
    entry.default_value = value;
    entry.min = range.min == kTypeRange ? TypeMin(type) : range.min;
    entry.max = range.max == kTypeRange ? TypeMax(type) : range.max;
    entry.name = name;
    entries_.push_back(entry);
    return entries_.back();
  }
  /// Sub-index 0 of a record or array with `count` entries; carries the object's name.
  void Record(std::uint16_t index, int count, const char* name) {
    Add(index, 0, T::kU8, A::kConst, M::kNone, count, name);
  }
  std::vector<ObjectEntry> Take() {
    std::sort(entries_.begin(), entries_.end(), [](const ObjectEntry& a, const ObjectEntry& b) {
      return a.index != b.index ? a.index < b.index : a.sub < b.sub;
    });
    return std::move(entries_);
  }

 private:
  std::vector<ObjectEntry> entries_;
};

constexpr const char* kMappedObject[kMaxMappingEntries] = {
    "1st mapped object", "2nd mapped object",  "3rd mapped object",  "4th mapped object",
    "5th mapped object", "6th mapped object",  "7th mapped object",  "8th mapped object",
    "9th mapped object", "10th mapped object", "11th mapped object", "12th mapped object"};

void AddMapping(Builder& b, std::uint16_t index, const char* name,
                std::initializer_list<MappingEntry> entries) {
  b.Add(index, 0, T::kU8, A::kReadWrite, M::kNone, static_cast<std::int64_t>(entries.size()), name,
        {0, kMaxMappingEntries});
  for (int i = 0; i < kMaxMappingEntries; ++i) {
    const bool mapped = i < static_cast<int>(entries.size());
    b.Add(index, static_cast<std::uint8_t>(i + 1), T::kU32, A::kReadWrite, M::kNone,
          mapped ? MappingValue(entries.begin()[i]) : 0, kMappedObject[i]);
  }
}

void AddPdos(Builder& b) {
  constexpr const char* kRpdoName[] = {"RPDO 1 parameter", "RPDO 2 parameter", "RPDO 3 parameter",
                                       "RPDO 4 parameter"};
  constexpr const char* kTpdoName[] = {"TPDO 1 parameter", "TPDO 2 parameter", "TPDO 3 parameter",
                                       "TPDO 4 parameter"};
  for (int i = 0; i < 4; ++i) {
    const auto rpdo = static_cast<std::uint16_t>(0x1400 + i);
    b.Record(rpdo, 2, kRpdoName[i]);
    b.Add(rpdo, 1, T::kU32, A::kReadWrite, M::kNone, RpdoCobId(i + 1, 0), "COB-ID").plus_node_id = true;
    b.Add(rpdo, 2, T::kU8, A::kReadWrite, M::kNone, 255, "Transmission type");
    const auto tpdo = static_cast<std::uint16_t>(0x1800 + i);
    const std::uint32_t off = i == 0 ? 0 : kPdoInvalid;
    b.Record(tpdo, 3, kTpdoName[i]);
    b.Add(tpdo, 1, T::kU32, A::kReadWrite, M::kNone, off | kPdoNoRtr | TpdoCobId(i + 1, 0), "COB-ID")
        .plus_node_id = true;
    b.Add(tpdo, 2, T::kU8, A::kReadWrite, M::kNone, 255, "Transmission type");
    b.Add(tpdo, 3, T::kU16, A::kReadWrite, M::kNone, 0, "Inhibit time");
  }
  constexpr MappingEntry kControlword{0x6040, 0, 16}, kStatusword{0x6041, 0, 16};
  AddMapping(b, 0x1600, "RPDO 1 mapping", {kControlword});
  AddMapping(b, 0x1601, "RPDO 2 mapping", {kControlword, {0x6060, 0, 8}});
  AddMapping(b, 0x1602, "RPDO 3 mapping", {kControlword, {0x607A, 0, 32}});
  AddMapping(b, 0x1603, "RPDO 4 mapping", {kControlword, {0x60FF, 0, 32}});
  AddMapping(b, 0x1A00, "TPDO 1 mapping", {kStatusword});
  AddMapping(b, 0x1A01, "TPDO 2 mapping", {kStatusword, {0x6061, 0, 8}});
  AddMapping(b, 0x1A02, "TPDO 3 mapping", {kStatusword, {0x6064, 0, 32}});
  AddMapping(b, 0x1A03, "TPDO 4 mapping", {kStatusword, {0x606C, 0, 32}});
}

void AddCommunication(Builder& b) {
  b.Add(0x1000, 0, T::kU32, A::kReadOnly, M::kNone, 0x00020192, "Device type");
  b.Add(0x1001, 0, T::kU8, A::kReadOnly, M::kNone, 0, "Error register");
  b.Add(0x1003, 0, T::kU8, A::kReadWrite, M::kNone, 0, "Error history", {0, 0});
  for (std::uint8_t sub = 1; sub <= 5; ++sub) {
    b.Add(0x1003, sub, T::kU32, A::kReadOnly, M::kNone, 0, "Error");
  }
  b.Add(0x1005, 0, T::kU32, A::kConst, M::kNone, kSyncCobId, "COB-ID SYNC");
  b.Add(0x1008, 0, T::kString, A::kConst, M::kNone, 0, "Device name").text = "EPOS4";
  b.Record(0x1010, 1, "Store parameters");
  b.Add(0x1010, 1, T::kU32, A::kReadWrite, M::kNone, 1, "Save all parameters");
  b.Record(0x1011, 1, "Restore default parameters");
  b.Add(0x1011, 1, T::kU32, A::kReadWrite, M::kNone, 1, "Restore all default parameters");
  b.Add(0x1014, 0, T::kU32, A::kReadOnly, M::kNone, kEmcyBase, "COB-ID EMCY").plus_node_id = true;
  b.Record(0x1016, 2, "Consumer heartbeat time");
  b.Add(0x1016, 1, T::kU32, A::kReadWrite, M::kNone, 0, "Consumer 1 heartbeat time");
  b.Add(0x1016, 2, T::kU32, A::kReadWrite, M::kNone, 0, "Consumer 2 heartbeat time");
  b.Add(0x1017, 0, T::kU16, A::kReadWrite, M::kNone, 0, "Producer heartbeat time");
  b.Record(0x1018, 4, "Identity object");
  b.Add(0x1018, 1, T::kU32, A::kReadOnly, M::kNone, kMaxonVendorId, "Vendor ID");
  b.Add(0x1018, 2, T::kU32, A::kReadOnly, M::kNone, 0x60500000, "Product code");
  b.Add(0x1018, 3, T::kU32, A::kReadOnly, M::kNone, 0x01700000, "Revision number");
  b.Add(0x1018, 4, T::kU32, A::kReadOnly, M::kNone, 1, "Serial number");
  b.Record(0x1029, 1, "Error behavior");
  b.Add(0x1029, 1, T::kU8, A::kReadWrite, M::kNone, 0, "Communication error", {0, 2});
  b.Record(0x1200, 2, "SDO server parameter");
  b.Add(0x1200, 1, T::kU32, A::kReadOnly, M::kNone, kSdoRequestBase, "COB-ID client to server").plus_node_id =
      true;
  b.Add(0x1200, 2, T::kU32, A::kReadOnly, M::kNone, kSdoResponseBase, "COB-ID server to client")
      .plus_node_id = true;
}

// Motor data of a 1.5 A drive without a motor: the torque constant 0 makes the rated torque 0.
void AddManufacturer(Builder& b) {
  b.Add(0x2000, 0, T::kU8, A::kReadWrite, M::kNone, 0, "Node-ID", {kMinNodeId, kMaxNodeId}).plus_node_id =
      true;
  b.Add(0x2001, 0, T::kU8, A::kReadWrite, M::kNone, 0, "CAN bit rate", {0, 9});
  b.Record(0x3001, 5, "Motor data");
  b.Add(0x3001, 1, T::kU32, A::kReadWrite, M::kReceive, 1500, "Nominal current");
  b.Add(0x3001, 2, T::kU32, A::kReadWrite, M::kReceive, 3000, "Output current limit");
  b.Add(0x3001, 3, T::kU8, A::kReadWrite, M::kNone, 1, "Number of pole pairs", {1, 255});
  b.Add(0x3001, 4, T::kU16, A::kReadWrite, M::kNone, 40, "Thermal time constant winding", {1, 65535});
  b.Add(0x3001, 5, T::kU32, A::kReadWrite, M::kNone, 0, "Motor torque constant");
  b.Record(0x30D1, 2, "Current actual values");
  b.Add(0x30D1, 1, T::kI32, A::kReadOnly, M::kTransmit, 0, "Current actual value averaged");
  b.Add(0x30D1, 2, T::kI32, A::kReadOnly, M::kTransmit, 0, "Current actual value");
  b.Record(0x30D2, 1, "Torque actual values");
  b.Add(0x30D2, 1, T::kI16, A::kReadOnly, M::kTransmit, 0, "Torque actual value averaged");
  b.Record(0x3160, 2, "Analog input properties");
  b.Add(0x3160, 1, T::kI16, A::kReadOnly, M::kTransmit, 0, "Analog input 1 voltage");
  b.Add(0x3160, 2, T::kI16, A::kReadOnly, M::kTransmit, 0, "Analog input 2 voltage");
  b.Record(0x3202, 1, "Functional safety");
  b.Add(0x3202, 1, T::kU8, A::kReadOnly, M::kNone, 3, "STO input states");
}

// Of the modes of a real drive (0x3A5 in 0x6502) only the one that works here is offered, and none is set at
// power-on. The target objects of the other modes stay, because the drive's PDOs map them by default. There
// is no 0x6087: an EPOS4 has no torque slope, and a set torque of the cyclic synchronous mode acts at once.
void AddDriveProfile(Builder& b) {
  b.Add(0x6007, 0, T::kI16, A::kReadWrite, M::kNone, 3, "Abort connection option code", {0, 3});
  b.Add(0x603F, 0, T::kU16, A::kReadOnly, M::kTransmit, 0, "Error code");
  b.Add(0x6040, 0, T::kU16, A::kReadWrite, M::kReceive, 0, "Controlword");
  b.Add(0x6041, 0, T::kU16, A::kReadOnly, M::kTransmit, 0, "Statusword");
  b.Add(0x605A, 0, T::kI16, A::kReadWrite, M::kNone, 6, "Quick stop option code", {6, 6});
  b.Add(0x605B, 0, T::kI16, A::kReadWrite, M::kNone, 0, "Shutdown option code", {0, 1});
  b.Add(0x605C, 0, T::kI16, A::kReadWrite, M::kNone, 1, "Disable operation option code", {0, 1});
  b.Add(0x605E, 0, T::kI16, A::kReadWrite, M::kNone, 2, "Fault reaction option code", {0, 2});
  b.Add(0x6060, 0, T::kI8, A::kReadWrite, M::kReceive, 0, "Modes of operation", {0, 10});
  b.Add(0x6061, 0, T::kI8, A::kReadOnly, M::kTransmit, 0, "Modes of operation display");
  b.Add(0x6064, 0, T::kI32, A::kReadOnly, M::kTransmit, 0, "Position actual value");
  b.Add(0x6065, 0, T::kU32, A::kReadWrite, M::kNone, 2000, "Following error window");
  b.Add(0x606C, 0, T::kI32, A::kReadOnly, M::kTransmit, 0, "Velocity actual value");
  b.Add(0x6071, 0, T::kI16, A::kReadWrite, M::kReceive, 0, "Target torque");
  b.Add(0x6076, 0, T::kU32, A::kReadWrite, M::kNone, 0, "Motor rated torque");
  b.Add(0x6077, 0, T::kI16, A::kReadOnly, M::kTransmit, 0, "Torque actual value");
  b.Add(0x607A, 0, T::kI32, A::kReadWrite, M::kReceive, 0, "Target position");
  b.Add(0x6085, 0, T::kU32, A::kReadWrite, M::kNone, 10000, "Quick stop deceleration", {1, 0xFFFFFFFF});
  b.Add(0x60B2, 0, T::kI16, A::kReadWrite, M::kReceive, 0, "Torque offset");
  b.Record(0x60C2, 2, "Interpolation time period");
  b.Add(0x60C2, 1, T::kU8, A::kReadWrite, M::kNone, 0, "Interpolation time period value");
  b.Add(0x60C2, 2, T::kI8, A::kReadWrite, M::kNone, -3, "Interpolation time index", {-3, -3});
  b.Add(0x60FF, 0, T::kI32, A::kReadWrite, M::kReceive, 0, "Target velocity");
  b.Add(0x6402, 0, T::kU16, A::kReadWrite, M::kNone, 10, "Motor type");
  b.Add(0x6502, 0, T::kU32, A::kReadOnly, M::kNone, 0x200, "Supported drive modes");
}

const std::vector<ObjectEntry>& Table() {
  static const std::vector<ObjectEntry> table = [] {
    Builder b;
    AddCommunication(b);
    AddPdos(b);
    AddManufacturer(b);
    AddDriveProfile(b);
    return b.Take();
  }();
  return table;
}

// ---- electronic data sheet ----------------------------------------------------------------------

[[gnu::format(printf, 2, 3)]] void Print(std::string& text, const char* format, ...) {
  std::array<char, 512> piece{};
  va_list arguments;
  va_start(arguments, format);
  // NOLINTNEXTLINE(clang-analyzer-valist.Uninitialized): it is, one line above
  std::vsnprintf(piece.data(), piece.size(), format, arguments);
  va_end(arguments);
  text += piece.data();
}

/// Data type codes of CiA 301.
int EdsType(T type) {
  switch (type) {
    case T::kI8:
      return 0x2;
    case T::kI16:
      return 0x3;
    case T::kI32:
      return 0x4;
    case T::kU8:
      return 0x5;
    case T::kU16:
      return 0x6;
    case T::kU32:
      return 0x7;
    case T::kString:
      return 0x9;
  }
  return 0;
}

const char* EdsAccess(const ObjectEntry& entry) {
  switch (entry.access) {
    case A::kConst:
      return "const";
    case A::kReadOnly:
      return "ro";
    case A::kReadWrite:
      return entry.mapping == M::kReceive ? "rww" : entry.mapping == M::kTransmit ? "rwr" : "rw";
  }
  return "";
}

std::string EdsNumber(const ObjectEntry& entry, std::int64_t value) {
  std::string text;
  if (TypeSigned(entry.type)) {
    Print(text, "%lld", static_cast<long long>(value));
  } else {
    Print(text, "0x%llX", static_cast<unsigned long long>(value));
  }
  return text;
}

void PrintEntry(std::string& text, const ObjectEntry& entry, const char* name) {
  Print(text, "ParameterName=%s\nObjectType=0x7\nDataType=0x%04X\nAccessType=%s\n", name, EdsType(entry.type),
        EdsAccess(entry));
  if (entry.type == T::kString) {
    Print(text, "DefaultValue=%s\n", entry.text);
  } else {
    if (entry.min != TypeMin(entry.type) || entry.max != TypeMax(entry.type)) {
      Print(text, "LowLimit=%s\nHighLimit=%s\n", EdsNumber(entry, entry.min).c_str(),
            EdsNumber(entry, entry.max).c_str());
    }
    Print(text, "DefaultValue=%s%s\n", entry.plus_node_id ? "$NODEID+" : "",
          EdsNumber(entry, entry.default_value).c_str());
  }
  Print(text, "PDOMapping=%d\n\n", entry.mapping == M::kNone ? 0 : 1);
}

void PrintList(std::string& text, const char* section, const std::vector<std::uint16_t>& indices) {
  Print(text, "[%s]\nSupportedObjects=%d\n", section, static_cast<int>(indices.size()));
  for (std::size_t i = 0; i < indices.size(); ++i) {
    Print(text, "%d=0x%04X\n", static_cast<int>(i + 1), indices[i]);
  }
  text += "\n";
}

}  // namespace

std::span<const ObjectEntry> ObjectTable() { return Table(); }

const ObjectEntry* FindObject(ObjectAddress address) noexcept {
  const auto& table = Table();
  const auto at =
      std::lower_bound(table.begin(), table.end(), address, [](const ObjectEntry& e, ObjectAddress a) {
        return e.index != a.index ? e.index < a.index : e.sub < a.sub;
      });
  return at != table.end() && at->index == address.index && at->sub == address.sub ? &*at : nullptr;
}

bool HasIndex(std::uint16_t index) noexcept { return FindObject({index, 0}) != nullptr; }

std::string EdsText() {
  const auto& table = Table();
  std::vector<std::uint16_t> mandatory, optional, manufacturer;
  for (const ObjectEntry& entry : table) {
    if (entry.sub != 0) continue;
    const bool required = entry.index == 0x1000 || entry.index == 0x1001 || entry.index == 0x1018;
    const bool own = entry.index >= 0x2000 && entry.index < 0x6000;
    (required ? mandatory : own ? manufacturer : optional).push_back(entry.index);
  }

  std::string text =
      "[FileInfo]\nFileName=tendril_drive.eds\nFileVersion=1\nFileRevision=1\nEDSVersion=4.0\n"
      "Description=Torque drive as Tendril uses it and as tendril-plant emulates it\n"
      "CreationTime=12:00AM\nCreationDate=01-01-2026\nCreatedBy=Tendril\n"
      "ModificationTime=12:00AM\nModificationDate=01-01-2026\nModifiedBy=Tendril\n\n";
  Print(text, "[DeviceInfo]\nVendorName=Tendril\nVendorNumber=0x%X\nProductName=Emulated EPOS4 drive\n",
        kMaxonVendorId);
  text +=
      "ProductNumber=0x60500000\nRevisionNumber=0x01700000\nOrderCode=none\n"
      "BaudRate_10=0\nBaudRate_20=0\nBaudRate_50=0\nBaudRate_125=1\nBaudRate_250=1\nBaudRate_500=1\nBaudRate_"
      "800=1\n"
      "BaudRate_1000=1\nSimpleBootUpMaster=0\nSimpleBootUpSlave=1\nGranularity=8\nDynamicChannelsSupported="
      "0\n"
      "GroupMessaging=0\nNrOfRXPDO=4\nNrOfTXPDO=4\nLSS_Supported=0\n\n"
      "[DummyUsage]\nDummy0001=0\nDummy0002=0\nDummy0003=0\nDummy0004=0\nDummy0005=0\nDummy0006=0\nDummy0007="
      "0\n\n"
      "[Comments]\nLines=1\nLine1=Made from the one object table of the master and the emulator.\n\n";
  PrintList(text, "MandatoryObjects", mandatory);
  PrintList(text, "OptionalObjects", optional);
  PrintList(text, "ManufacturerObjects", manufacturer);

  for (std::size_t i = 0; i < table.size(); ++i) {
    const ObjectEntry& entry = table[i];
    if (entry.sub != 0) {
      Print(text, "[%04Xsub%X]\n", entry.index, entry.sub);
      PrintEntry(text, entry, entry.name);
      continue;
    }
    std::size_t subs = 1;
    while (i + subs < table.size() && table[i + subs].index == entry.index) ++subs;
    Print(text, "[%04X]\n", entry.index);
    if (subs == 1) {
      PrintEntry(text, entry, entry.name);
      continue;
    }
    Print(text, "ParameterName=%s\nObjectType=0x%X\nSubNumber=%d\n\n", entry.name,
          entry.index == 0x1003 ? 0x8 : 0x9, static_cast<int>(subs));
    Print(text, "[%04Xsub0]\n", entry.index);
    PrintEntry(text, entry, "Highest sub-index supported");
  }
  return text;
}

}  // namespace tendril::canopen
