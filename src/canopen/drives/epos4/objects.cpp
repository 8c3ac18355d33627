// The EPOS4's object table. Knows which objects exist, not what they do.
#include <initializer_list>
#include <limits>

#include "epos4.h"
#include "tendril/canopen/epos4.h"

namespace tendril::canopen::epos4 {
namespace {

using T = DataType;
using A = Access;
using M = Mapping;

constexpr std::int64_t kTypeRange = std::numeric_limits<std::int64_t>::min();  // stands for "the whole type"

struct Range {
  std::int64_t min = kTypeRange, max = kTypeRange;
};

class Builder {
 public:
  ObjectEntry& Add(std::uint16_t index, std::uint8_t sub, T type, A access, M mapping, std::int64_t value,
                   const char* name, Range range = {}) {
    ObjectEntry& entry = table_.Add({index, sub}, type, access, name);
    entry.mapping = mapping;
    entry.default_value = value;
    entry.states_default = true;
    if (range.min != kTypeRange) entry.min = range.min;
    if (range.max != kTypeRange) entry.max = range.max;
    return entry;
  }
  /// Sub-index 0 of a record or array with `count` entries; carries the object's name.
  void Record(std::uint16_t index, int count, const char* name) {
    Add(index, 0, T::kU8, A::kConst, M::kNone, count, name);
  }
  ObjectTable Finished() {
    table_.Sort();
    return std::move(table_);
  }

 private:
  ObjectTable table_;
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

}  // namespace

ObjectTable Objects() {
  Builder b;
  AddCommunication(b);
  AddPdos(b);
  AddManufacturer(b);
  AddDriveProfile(b);
  return b.Finished();
}

}  // namespace tendril::canopen::epos4
