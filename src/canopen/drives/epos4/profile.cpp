// The EPOS4 as a profile: its parts together, and its PDOs.
#include "../torque_pdos.h"
#include "epos4.h"

namespace tendril::canopen {

DriveProfilePtr Epos4Profile() {
  static const DriveProfilePtr profile = [] {
    DriveProfile p;
    p.name = "maxon EPOS4";
    p.objects = epos4::Objects();
    constexpr MappingEntry kLoadCell{0x3160, 1, 16, true};
    p.pdos = TorquePdos(kLoadCell);
    p.analog_input = {kLoadCell.index, kLoadCell.sub};
    p.rated_torque_unit_uNm = 1;
    p.rated_torque_source = "torque constant x nominal current";
    p.identity_source = "bus.identity";
    p.emcy = epos4::EmcyTable();
    p.boot_script = epos4::BootScript;
    return std::make_shared<const DriveProfile>(std::move(p));
  }();
  return profile;
}

}  // namespace tendril::canopen
