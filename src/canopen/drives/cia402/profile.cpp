// A drive of any maker with cyclic synchronous torque: its objects from the EDS file, the rest from CiA 402.
#include <charconv>
#include <stdexcept>
#include <string_view>

#include "../torque_pdos.h"
#include "cia402_drive.h"
#include "tendril/canopen/eds.h"

namespace tendril::canopen::cia402 {
namespace {

constexpr std::uint32_t kMilliNewtonMetre_uNm = 1000;  // CiA 402's unit of 0x6076

/// "0x6401:01", whose form the configuration has checked.
ObjectAddress AddressOf(std::string_view text) {
  const auto hex = [](std::string_view digits) {
    unsigned value = 0;
    std::from_chars(digits.data(), digits.data() + digits.size(), value, 16);
    return value;
  };
  return {static_cast<std::uint16_t>(hex(text.substr(2, 4))), static_cast<std::uint8_t>(hex(text.substr(7)))};
}

DrivePdos Pdos(const ObjectTable& objects, const std::optional<ObjectAddress>& analog_input) {
  std::optional<MappingEntry> load_cell;
  if (analog_input) {
    const ObjectEntry* entry = objects.Find(*analog_input);
    const DataType type = entry == nullptr ? DataType::kI16 : entry->type;
    load_cell = {analog_input->index, analog_input->sub, static_cast<std::uint8_t>(8 * TypeBytes(type)),
                 TypeSigned(type)};
  }
  DrivePdos pdos = TorquePdos(load_cell);
  // Without an inhibit time that can be set nothing bounds how often a change is sent; at every SYNC the bus
  // budget counts it.
  const ObjectEntry* inhibit = objects.Find({pdos.status.communication_index(), 3});
  if (inhibit == nullptr || inhibit->access != Access::kReadWrite) {
    pdos.status.transmission = 1;
    pdos.status.inhibit_100us = 0;
  }
  return pdos;
}

/// The identity that a drive must show: what [DeviceInfo] says goes before the default of 0x1018.
void SetIdentity(Eds& eds) {
  const auto set = [&eds](std::uint8_t sub, const std::optional<std::uint32_t>& value) {
    if (value) eds.objects.SetDefault({0x1018, sub}, *value);
  };
  set(1, eds.vendor);
  set(2, eds.product);
  const ObjectEntry* vendor = eds.objects.Find({0x1018, 1});
  if (vendor != nullptr && vendor->default_value == 0) {  // a drive without the object is Unsupported
    throw std::invalid_argument(
        eds.file + ":" + std::to_string(vendor->line) +
        ": names no vendor; accepted: VendorNumber in [DeviceInfo], or a DefaultValue "
        "of 0x1018:01; add what the drive shows there");
  }
}

}  // namespace

DriveProfilePtr Profile(const NodeParameters& node) {
  Eds eds = ReadEds(node.eds_file);
  SetIdentity(eds);
  DriveProfile p;
  p.name = eds.vendor_name + (eds.vendor_name.empty() ? "" : " ") + eds.product_name;
  p.file = eds.file;
  if (!node.analog_input.empty()) p.analog_input = AddressOf(node.analog_input);
  p.analog_mV_per_count = node.analog_mV_per_count;
  p.pdos = Pdos(eds.objects, p.analog_input);
  p.objects = std::move(eds.objects);
  p.rated_torque_unit_uNm = kMilliNewtonMetre_uNm;
  p.rated_torque_source = "the one that the drive is set up for";
  p.identity_source = "its EDS file";
  p.emcy = EmcyTable();
  p.boot_script = BootScript;
  return std::make_shared<const DriveProfile>(std::move(p));
}

}  // namespace tendril::canopen::cia402
