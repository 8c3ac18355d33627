// The EPOS4's object table as an electronic data sheet (CiA 306), for other CANopen tools.
#include <array>
#include <cstdarg>
#include <cstdio>

#include "epos4.h"
#include "tendril/canopen/epos4.h"

namespace tendril::canopen {
namespace {

using T = DataType;
using A = Access;
using M = Mapping;

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
    case T::kOther:
      break;
  }
  return 0;
}

const char* EdsAccess(const ObjectEntry& entry) {
  switch (entry.access) {
    case A::kConst:
      return "const";
    case A::kReadOnly:
      return "ro";
    case A::kWriteOnly:
      return "wo";
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

std::string EdsText() {
  const std::span<const ObjectEntry> table = Epos4Profile()->objects.entries();
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
